"""Tokens of several people, how many sessions each may hold, and what is written down about them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.server.conftest import TOKEN

from webgym.core.errors import ConfigError, TooManySessions, Unauthorized
from webgym.server.callers import SERVER_CALLER, Audit, Quota, Tokens, audit_to
from webgym.server.client import BrowserClient
from webgym.server.config import ClientLimits, GatewayConfig, ServerConfig
from webgym.server.gateway import running_gateway

ALICE, BOB, NEW = ("a" * 16, "b" * 20, "c" * 40)


def name(tokens: Tokens, token: str) -> str | None:
    return tokens.name_of(f"Bearer {token}")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "tokens"
    path.write_text(f"# who may\nalice {ALICE}\n\nbob {BOB} # till spring\n")
    return path


async def until(holds: Callable[[], bool]) -> None:
    while not holds():
        await asyncio.sleep(0.01)


def test_everybody_has_a_name(file: Path) -> None:
    tokens = Tokens(TOKEN, file)
    assert [name(tokens, each) for each in (TOKEN, ALICE, BOB, NEW, "", "é")] == [
        SERVER_CALLER,
        "alice",
        "bob",
    ] + [None] * 3
    assert tokens.name_of(ALICE) is None


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("alice", "line 1 of"),
        ("alice short", "16 characters or more"),
        (f"alice {ALICE} more", "line 1 of"),
        (f"server {ALICE}", "names the server's own token"),
        (f"al/ice {ALICE}", "line 1 of"),
        (f"alice {ALICE}\nbob {ALICE}", "bob has the same token as another name"),
        ("alice ééééééééééééééééé", "not plain ASCII"),
    ],
)
def test_what_is_no_file_of_tokens_is_said_with_its_line(file: Path, line: str, said: str) -> None:
    file.write_text(line)
    with pytest.raises(ConfigError) as raised:
        Tokens(TOKEN, file)
    assert said in f"{raised.value.message} {raised.value.hint}"


def test_no_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        Tokens(TOKEN, tmp_path / "none")


@pytest.mark.parametrize("mode", [0o644, 0o600])
def test_a_file_that_every_user_can_read_is_said(
    file: Path, caplog: pytest.LogCaptureFixture, mode: int
) -> None:
    file.chmod(mode)
    Tokens(TOKEN, file)
    assert ("chmod 600" in caplog.text) == (mode == 0o644)


async def test_tokens_are_added_and_withdrawn_while_it_runs(
    file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tokens = Tokens(TOKEN, file, check_seconds=0.01)
    async with tokens.watching_file():
        file.write_text(f"alice {ALICE}\nalice {NEW}\n")  # both are good while she changes over
        await until(lambda: name(tokens, NEW) == "alice")
        assert (name(tokens, ALICE), name(tokens, BOB)) == ("alice", None)
        file.write_text("half a line")
        await until(lambda: "line 1 of" in caplog.text)
        assert name(tokens, NEW) == "alice"
        file.unlink()
        await until(lambda: "cannot be read" in caplog.text)
        file.write_text(f"bob {BOB}\n")
        await until(lambda: name(tokens, BOB) == "bob")
        assert name(tokens, NEW) is None
    assert caplog.text.count("cannot be read") == 1


def test_an_audit_file_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be written"), audit_to(tmp_path / "none" / "audit"):
        pass


def _note(audit: Audit, session: str) -> None:
    audit.opened(session, token="t", client="c", address="a")


async def test_an_audit_file_that_is_away_for_a_while_is_written_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "log" / "audit"
    file.parent.mkdir()
    with audit_to(file) as audit:
        _note(audit, "first")
        await until(lambda: "first" in file.read_text())
        file.parent.rename(tmp_path / "old")
        _note(audit, "missing")
        _note(audit, "missing too")
        await until(lambda: "cannot be written" in caplog.text)
        file.parent.mkdir()
        _note(audit, "second")
        await until(file.exists)
    assert "second" in file.read_text()
    assert caplog.text.count("cannot be written") == 1


def test_a_full_disk_under_the_audit_file_ends_nothing(
    caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    with audit_to(Path("/dev/full")) as audit:
        _note(audit, "first")
        _note(audit, "second")
    assert caplog.text.count("No space left on device") == 1
    assert not capsys.readouterr().err


def test_a_requested_session_counts() -> None:
    quota = Quota(2)
    with quota.requesting("ann"):
        quota.granted("ann", "1")
    with quota.requesting("ann"):  # still waits in line
        with pytest.raises(TooManySessions, match="2 sessions"), quota.requesting("ann"):
            raise AssertionError
        with quota.requesting("bob"):
            pass
    quota.ended("1")
    quota.ended("1")
    quota.ended("nobody's")
    for name in ("2", "3"):
        with quota.requesting("ann"):
            quota.granted("ann", name)
    with pytest.raises(TooManySessions), quota.requesting("ann"):
        raise AssertionError


def test_no_limit() -> None:
    quota = Quota(None)
    for number in range(1000):
        with quota.requesting("ann"):
            quota.granted("ann", str(number))


@pytest.mark.browser
async def test_a_server_of_several_people(file: Path, tmp_path: Path) -> None:
    """Through the gateway and straight to the worker; every session is written down."""
    audit = tmp_path / "audit.jsonl"
    config = ServerConfig(
        slots=2, token=TOKEN, tokens_file=file, audit_file=audit, sessions_per_client=1, beat_seconds=0.1
    )
    async with (
        running_gateway(config, GatewayConfig(workers=1)) as gateway,
        BrowserClient(gateway.url, token=ALICE) as alice,
        BrowserClient(gateway.url, token=ALICE) as again,
        BrowserClient(gateway.url, token=BOB, limits=ClientLimits(direct=False), name='"},{') as bob,
    ):
        direct, relayed = await alice.open(), await bob.open()
        assert (await direct.metadata()).url == (await relayed.metadata()).url == "about:blank"
        with pytest.raises(TooManySessions):  # a name is one client, however it calls itself
            await again.open()
        # The worker's own address is known, but it opens sessions for its gateway alone.
        async with BrowserClient(gateway.gateway.workers[0].url, token=ALICE) as around:
            with pytest.raises(Unauthorized, match="gateway"):
                await around.open()
        file.write_text(f"alice {ALICE}\n")

        async def refused() -> bool:
            try:
                await relayed.metadata()
            except Unauthorized:
                return True
            return False

        while not await refused():
            await asyncio.sleep(0.05)
        assert (await direct.metadata()).url == "about:blank"
        await direct.close()
        await until(lambda: audit.read_text().count('"ended"') == 1)
    lines = [json.loads(line) for line in audit.read_text().splitlines()]
    assert [(line["event"], line["token"]) for line in lines[:3]] == [
        ("opened", "alice"),
        ("opened", "bob"),
        ("ended", "alice"),
    ]
    assert lines[2]["session"] == lines[0]["session"]
    assert lines[0]["address"] == "127.0.0.1"
    assert lines[1]["client"] == '"},{'
