"""Bad input and broken surroundings: one clear line, an exit code, and no lost trajectory."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import pytest
import pytest_asyncio
import yaml
from tests.conftest import Calls
from tests.llm.endpoint import Endpoint, serve
from tests.serving import beside

from webgym.cli.serve import _read_or_create_token
from webgym.core.errors import ConfigError, PolicyError, StoreFull, WebGymError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.offline.config import CollectionName
from webgym.offline.web import OfflineWeb
from webgym.run.collect import collect
from webgym.run.config import RunConfig, Secrets, ServerChoice
from webgym.run.services import services
from webgym.server.config import ServerConfig
from webgym.server.listening import listen
from webgym.server.worker import running_server
from webgym.store.runs import RunReader, RunWriter
from webgym.tasks.formats import write_tasks
from webgym.tasks.sampling import draw

SITES = {"collection": "small", "per_family": 2, "latency": 0}


def tasks(count: int, collection: CollectionName = "small") -> list[Task]:
    web = OfflineWeb(per_family=2, collection=collection)
    hosts = [host for host, spec in web.specs.items() if spec.behaviour == "good"]
    return draw((task for host in hosts for task in web.tasks_of(host)), count, seed=8)


def leaves(error: BaseException) -> list[BaseException]:
    """The errors inside nested groups."""
    if isinstance(error, BaseExceptionGroup):
        return [leaf for inner in error.exceptions for leaf in leaves(inner)]
    return [error]


@pytest.fixture
def few_websites(tmp_path: Path) -> tuple[object, ...]:
    """Options of a run that need not build the whole offline web before something is wrong."""
    (tmp_path / "few.yaml").write_text(yaml.safe_dump({"sites": SITES}))
    return ("--config", tmp_path / "few.yaml")


def one_line(said: str) -> str:
    """The one line that an error consists of."""
    (line,) = [each for each in said.splitlines() if each.startswith("webgym:")]
    assert "Traceback" not in said
    return line


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("rollout --policy oracle --out run", "unknown policy 'oracle' (choose one of scripted"),
        ("rollout policy.name=oracle --out run", "unknown policy 'oracle'"),
        ("rollout --out file/run", "cannot create file/run: "),
        ("eval --out file/run", "cannot create file/run: "),
        ("demo --out file/run", "cannot create file/run: "),
        ("demo --weights ../none/w", "cannot load the model ../none/w: there is no such folder"),
        ("train tiny --out file/run", "cannot create file/run: "),
        ("train tiny --out t --learn.model /nowhere/m", "cannot load the model /nowhere/m"),
        ("train tiny --out t learn.model=null", "learn.model is missing"),
        ("train tiny --out t learn.model=m --rollout.tasks.file none.jsonl", "cannot read none.jsonl"),
        ("pretrain --out file/run", "cannot create file/run: "),
        ("study --out study --weights /nowhere/w", "cannot load the model /nowhere/w"),
        ("rollout --colector.sessions 2 --out run", "colector: there is no such setting; did you mean"),
        ("rollout --tasks none.jsonl --out run", "cannot read the task file none.jsonl"),
        ("rollout --tasks /dev/zero --out run", "webgym: /dev/zero is a device (give a file)"),
        ("tasks build --source deepshop=/dev/zero --dry-run --out run", "/dev/zero is a device"),
        ("train /dev/zero --out run", "webgym: /dev/zero is a device (give a file)"),
        ("train none.yaml --out run", "cannot read none.yaml"),
        ("train tiny --resume t --explain", "give either settings and --out, or --resume"),
        ("train tiny", "give either settings and --out, or --resume"),
        ("train --out t --resume t", "give either settings and --out, or --resume"),
        ("train", "give either settings and --out, or --resume"),
        ("rollout --tasks offline-v1 --out run", "no tasks named 'offline-v1' any more (offline-v2 replaces"),
        ("tasks show offline-small-v1", "any more (offline-small-v2 replaces them)"),
        ("export offline-cross-v1 --out run", "any more (offline-cross-v2 replaces them)"),
        ("eval --of none --model B --retry-errors --judge offline", "and excludes --model, --retry-errors ("),
        ("demo --out run --policy random", "the demo trains the tiny policy, and excludes --policy"),
        ("demo --out run --mistakes 0.5 --profile tiny", "excludes --mistakes, --profile (add"),
        ("demo --out run --base-url http://127.0.0.1:1/v1 --model m", "excludes --base-url, --model (add"),
        ("demo --out run --coordinates seed=3", "excludes --marks/--coordinates, --set (add"),
        ("demo --out run --collect-only --weights w", "does not train, and excludes --weights"),
        ("demo --out run --collect-only --iterations 3", "does not train, and excludes --iterations"),
    ],
)
def test_what_is_wrong_is_found_before_websites_browsers_or_torch_start(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch, words: str, expected: str
) -> None:
    for module in ("torch", "webgym.train.start", "webgym.study.recipe"):
        monkeypatch.setitem(sys.modules, module, None)  # whose import would be another error
    monkeypatch.setattr(OfflineWeb, "__init__", lambda *_, **__: pytest.fail("websites are made"))
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    said = calls.printed(*words.split(), code=2)
    assert expected in one_line(said)
    assert not Path("run").exists()
    assert "resume with" not in said


def test_settings_that_are_nested_without_end_are_one_line(tmp_path: Path, calls: Calls) -> None:
    (tmp_path / "deep.yaml").write_text("a: " + "[" * 5_000)
    given = ("--config", tmp_path / "deep.yaml", "--out", tmp_path / "run")
    line = one_line(calls.printed("rollout", *given, code=2))
    assert line.endswith("deep.yaml is nested too deeply (settings have a few levels)")


@pytest.mark.parametrize("name", ["summary.json", "trajectories/00001.jsonl", "verdicts/one.jsonl"])
def test_a_pipe_in_a_run_or_a_training_is_not_waited_for(tmp_path: Path, calls: Calls, name: str) -> None:
    run, training = tmp_path / "run", tmp_path / "training"

    async def make() -> None:
        async with await RunWriter.create(run, {"seed": 7}, tasks(1)):
            pass

    asyncio.run(make())
    for file in (run / name, training / "metrics.jsonl", training / "evaluations" / "0000.json"):
        file.parent.mkdir(exist_ok=True, parents=True)
        os.mkfifo(file)
    for words in (("report", run), ("verify", run), ("report", training), ("train", "--resume", training)):
        assert "is a pipe, a device or a socket (delete it)" in one_line(calls.printed(*words, code=2))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((), "--out or --resume"),
        (("--out", "x", "--resume", "y"), "--out or --resume"),
        (("--out", "x", "--split", "dev"), "split"),
        (("--out", "x", "--policy", "openai"), "--base-url"),
        (("--out", "x", "--profile", "qwen9"), "choose one of generic, gpt-4"),
        (("--out", "x", "--base-url", "ftp://x", "--model", "m"), "http"),
        (("--out", "x", "--config", "none.yaml"), "none.yaml"),
        (("--resume", "nowhere"), "is not a run: it does not exist"),
        (("--out", "x", "--sessions", "0"), "--sessions"),
        (("--out", "x", "--token-file", "none"), "token file"),
        (("--out", "x", "--limit", "3", "--server", "http://127.0.0.1:9"), "sites"),
    ],
)
def test_options_that_make_no_run(
    tmp_path: Path, calls: Calls, few_websites: tuple[object, ...], options: tuple[str, ...], expected: str
) -> None:
    given = [str(tmp_path / each) if each in ("x", "y", "none.yaml", "nowhere") else each for each in options]
    assert expected in one_line(calls.printed("rollout", *few_websites, *given, code=2))


@pytest.mark.parametrize("verb", ["serve", "check"])
@pytest.mark.parametrize("factor", ["inf", "nan", "101"])
def test_a_latency_that_websites_do_not_take(calls: Calls, verb: str, factor: str) -> None:
    assert "'--latency'" in one_line(calls.printed("sites", verb, "--latency", factor, code=2))


@pytest.mark.parametrize(
    "call",
    [
        "server --seconds",
        "server --think",
        "server --thinking",
        "rollout --mean-steps",
        "rollout --reply-tokens",
    ],
)
def test_a_benchmark_that_would_never_end(calls: Calls, call: str) -> None:
    assert f"'{call.split()[1]}'" in one_line(calls.printed("bench", *call.split(), "inf", code=2))


SHARED = "/nowhere/claims"


@pytest.mark.parametrize(
    ("command", "options", "unused"),
    [
        ("rollout", ("--samples", "3", "--seed", "9", "--policy", "random"), "--samples, --policy, --seed"),
        ("rollout", ("--coordinates", "--sessions", "2"), "--sessions, --marks/--coordinates"),
        ("rollout", ("--config", "none.yaml", "--server", "http://127.0.0.1:9"), "--config"),
        ("rollout", ("--share", "/nowhere/else"), "--share"),
        ("eval", ("--base-url", "http://127.0.0.1:9/v1", "--model", "B", "--json"), "--base-url, --model"),
        ("eval", ("--budget", "1,2,3"), "--budget"),
        ("rollout", ("--server", "http://127.0.0.1:9", "--sites", "http://127.0.0.1:9"), ""),
        ("rollout", ("--retry-errors", "--skip-corrupt", "--no-report", "--share", SHARED), ""),
        ("eval", ("--no-report", "--markdown"), ""),
    ],
)
def test_options_that_a_resumed_run_would_ignore_are_refused(
    tmp_path: Path,
    calls: Calls,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    options: tuple[str, ...],
    unused: str,
) -> None:
    async def make() -> None:
        settings = RunConfig.model_validate({"collector": {"sharing": {"folder": SHARED}}})
        async with await RunWriter.create(tmp_path / "run", settings.model_dump(mode="json"), []):
            pass

    async def resumed(*_: object, **__: object) -> None:
        raise StoreFull("it was resumed")

    asyncio.run(make())
    monkeypatch.setattr("webgym.run.collect.resume", resumed)
    code = 2 if unused else 1
    expected = f"--resume keeps the run's settings, and excludes {unused} (" if unused else "it was resumed"
    assert expected in one_line(calls.printed(command, "--resume", tmp_path / "run", *options, code=code))


@pytest.mark.parametrize(
    "text", ["seed: [", "- a list", "sed: 3", "collector: {sessions: 0}", "sites: {latency: fast}"]
)
def test_settings_that_make_no_run(tmp_path: Path, calls: Calls, text: str) -> None:
    (tmp_path / "run.yaml").write_text(text)
    given = ("--config", tmp_path / "run.yaml", "--out", tmp_path / "run")
    assert "run.yaml" in one_line(calls.printed("rollout", *given, code=2))


@pytest.mark.browser
def test_a_broken_line_is_named_and_the_rest_runs(tmp_path: Path, calls: Calls) -> None:
    file, settings = tmp_path / "tasks.jsonl", tmp_path / "run.yaml"
    write_tasks(file, tasks(2))
    file.write_bytes(file.read_bytes() + b'{"id": "half", "instr\n')
    held = {"sites": SITES, "tasks": {"split": "all"}, "collector": {"sessions": 2}}
    settings.write_text(yaml.safe_dump(held))
    said = calls.printed(
        "rollout", "--config", settings, "--tasks", file, "--out", tmp_path / "run", "--no-report"
    )
    assert "tasks.jsonl:3: " in said
    summary = RunReader(tmp_path / "run").summary
    assert summary is not None
    assert summary["attempts"] == 2


def without_truth(path: Path) -> Path:
    write_tasks(path, [msgspec.structs.replace(task, truth=None) for task in tasks(1)])
    return path


def judged_by(endpoint: Endpoint) -> tuple[str, ...]:
    return ("--split", "all", "--judge-base-url", endpoint.url(), "--judge-model", "m")


def test_a_judge_that_cannot_judge_the_tasks_is_refused_before_anything_starts(
    tmp_path: Path, calls: Calls
) -> None:
    mixed = [msgspec.structs.replace(task, split=None) for task in tasks(3)]
    mixed[1] = msgspec.structs.replace(mixed[1], truth=None)
    write_tasks(tmp_path / "tasks.jsonl", mixed)
    options = ("--tasks", tmp_path / "tasks.jsonl", "--out", tmp_path / "run")
    for verb in ("rollout", "eval"):
        said = calls.printed(verb, *options, WEBGYM_BROWSER=str(tmp_path / "no-browser"), code=2)
        line = one_line(said)
        assert f"cannot judge 1 of 3 tasks: {mixed[1].id} has no hidden truth" in line
        assert "--judge-base-url" in line
    assert not (tmp_path / "run").exists()


def test_an_unreachable_server(tmp_path: Path, calls: Calls) -> None:
    file = without_truth(tmp_path / "tasks.jsonl")
    with beside(serve()) as judge:
        options = ("--tasks", file, "--out", tmp_path / "run", "--server", "http://127.0.0.1:9")
        said = calls.printed("rollout", *options, *judged_by(judge), WEBGYM_TOKEN="x" * 20, code=1)
    assert "127.0.0.1:9" in one_line(said)


@pytest.mark.browser
def test_a_wrong_token(tmp_path: Path, calls: Calls) -> None:
    file = without_truth(tmp_path / "tasks.jsonl")
    with beside(running_server(ServerConfig(slots=1))) as server, beside(serve()) as judge:
        options = ("--tasks", file, "--out", tmp_path / "run", "--server", server.url, *judged_by(judge))
        said = calls.printed("rollout", *options, WEBGYM_TOKEN="x" * 20, code=1)
    assert "token" in one_line(said)


@pytest.mark.parametrize(
    "content",
    [b"", f"{'a' * 20}\n{'b' * 20}\n".encode(), ("\u00e9" * 20).encode(), b"\xe9" * 20],
    ids=["empty", "two lines", "not ascii", "not utf-8"],
)
@pytest.mark.parametrize("shortest", [None, 1], ids=["token", "key"])
def test_a_file_without_a_token(tmp_path: Path, content: bytes, shortest: int | None) -> None:
    (tmp_path / "token").write_bytes(content)
    with pytest.raises(ConfigError, match="token is not a token: one line of"):
        _read_or_create_token(tmp_path / "token", shortest)


def test_a_short_key_of_the_authors_clients(tmp_path: Path) -> None:
    (tmp_path / "key").write_text("default_key\n")
    assert _read_or_create_token(tmp_path / "key", 1) == "default_key"
    with pytest.raises(ConfigError, match="16 or more"):
        _read_or_create_token(tmp_path / "key")


def test_a_token_of_the_environment_that_is_not_ascii(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WEBGYM_TOKEN", "\u00e9" * 20)
    line = one_line(calls.printed("serve", "--browser", tmp_path / "none", code=2))
    assert "WEBGYM_TOKEN is not a token" in line


def test_a_taken_port_of_the_authors_api(tmp_path: Path, calls: Calls) -> None:
    """It is noticed before a worker is started."""
    with closing(listen(ServerConfig())) as taken:
        port = taken.getsockname()[1]
        compat = ("--compat", "--compat-port", port)
        said = calls.printed("serve", "--port", 0, *compat, "--browser", tmp_path / "none", code=2)
    assert f":{port} cannot be listened on" in one_line(said)
    assert "choose another --compat-port" in said


def test_a_missing_browser(tmp_path: Path, calls: Calls, few_websites: tuple[object, ...]) -> None:
    options = ("rollout", *few_websites, "--limit", 1, "--out", tmp_path / "run")
    said = calls.printed(*options, WEBGYM_BROWSER=str(tmp_path / "no-browser"), code=1)
    assert "no-browser" in one_line(said)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own with room for a few screenshots."""
    path = tmp_path / "disk"
    path.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", str(path)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip("mounting a small file system needs rights that this user has not")
    yield path
    subprocess.run(["umount", str(path)], check=True)


@pytest.mark.browser
async def test_a_full_disk_stops_the_run_and_what_was_counted_stays(tmp_path: Path, small_disk: Path) -> None:
    write_tasks(tmp_path / "tasks.jsonl", tasks(12, "large"))  # whose pictures fill a disk
    settings = RunConfig.model_validate(
        {
            "tasks": {"file": tmp_path / "tasks.jsonl", "split": "all"},
            "sites": SITES | {"collection": "large"},
            "collector": {"sessions": 2},
        }
    )
    with pytest.raises((StoreFull, ExceptionGroup)) as caught:
        await collect(settings, small_disk / "run")
    assert any(isinstance(error, StoreFull) for error in leaves(caught.value))
    for trajectory in RunReader(small_disk / "run").trajectories():
        for seen in trajectory.episode.observations:
            assert RunReader(small_disk / "run").image(seen.screenshot)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def served() -> AsyncIterator[tuple[ServerChoice, Secrets]]:
    """Browsers and websites for several runs."""
    config = RunConfig.model_validate({"sites": SITES, "collector": {"sessions": 2}})
    async with services(config, Secrets()) as reached:
        yield reached


@pytest.mark.browser
@pytest.mark.asyncio(loop_scope="module")
@pytest.mark.parametrize("behaviour", ["500", "trickle"])  # test_openai_policy.py has every kind
async def test_an_endpoint_that_never_completes_stops_the_run(
    tmp_path: Path, behaviour: str, served: tuple[ServerChoice, Secrets]
) -> None:
    async with serve() as endpoint:
        await endpoint_stops_the_run(tmp_path, endpoint, behaviour, *served)


async def endpoint_stops_the_run(
    tmp_path: Path, endpoint: Endpoint, behaviour: str, where: ServerChoice, secrets: Secrets
) -> None:
    write_tasks(tmp_path / "tasks.jsonl", tasks(8))
    chat = {
        "base_url": endpoint.url(behaviour),
        "model": "tiny-1",
        "total_seconds": 2.0,
        "retry": {"tries": 2, "first_seconds": 0.01},
    }
    settings = RunConfig.model_validate(
        {
            "tasks": {"file": tmp_path / "tasks.jsonl", "split": "all"},
            "policy": {"name": "openai", "chat": chat, "check": False},  # as if it broke afterwards
            "sites": SITES,
            "collector": {"sessions": 2, "give_up_after": 4},
            "retries": 0,
            "server": where,
        }
    )
    with pytest.raises((WebGymError, ExceptionGroup)) as caught:
        await collect(settings, tmp_path / "run", secrets=secrets)
    (error,) = leaves(caught.value)
    assert isinstance(error, PolicyError)
    assert "attempts in a row" in str(error)
    trajectories = list(RunReader(tmp_path / "run").trajectories())
    assert len(trajectories) >= 4
    assert {each.outcome for each in trajectories} <= {Outcome.POLICY_ERROR, Outcome.CANCELLED}
    summary = RunReader(tmp_path / "run").summary
    assert summary is not None
    assert sum(summary["outcomes"].values()) == len(trajectories)
    assert summary["success_rate"]["overall"] is None


def test_a_demo_of_weights_that_are_not_there(tmp_path: Path, calls: Calls) -> None:
    said = calls.printed("demo", "--out", tmp_path / "run", "--weights", "w", code=2)
    assert "cannot load the model w" in one_line(said)
    assert not (tmp_path / "run").exists()
