"""``webgym serve`` as a process: told to stop, and killed."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
import stat
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Sequence
from pathlib import Path

import httpx
import psutil
import pytest
from tests.documented import documented

from webgym.browser.profiles import ProfileRoot
from webgym.core.action import Navigate
from webgym.core.errors import LeaseLost, ServerUnreachable
from webgym.server.client import BrowserClient
from webgym.server.messages import SessionOptions

from .conftest import Site, quick

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


async def start(folder: Path, *more: str, page: Sequence[str] = ("serve",)) -> tuple[Process, str]:
    command = "from webgym.cli import main; main()"
    allow = ["--allow-host", "127.0.0.1"]
    arguments = [*page, "--port", "0", "--slots", "2", "--token-file", str(folder / "token"), *allow, *more]
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        command,
        *arguments,
        stdout=PIPE,
        stderr=DEVNULL,
        env={**os.environ, "TMPDIR": str(folder)},
    )
    assert process.stdout is not None
    said: dict[str, str] = {}
    while "sandbox" not in said:
        name, _, value = (await process.stdout.readline()).decode().strip().partition(" ")
        assert name, "the server did not come up"
        said[name] = value.strip()
    return process, said["server"]


def browsers(folder: Path) -> list[psutil.Process]:
    return [
        process
        for process in psutil.process_iter(["cmdline", "status"])
        if process.info["status"] != psutil.STATUS_ZOMBIE
        and any(f"--user-data-dir={folder}" in part for part in process.info["cmdline"] or ())
    ]


async def gone(folder: Path) -> None:
    async with asyncio.timeout(100):
        while browsers(folder):
            await asyncio.sleep(0.05)


async def test_the_authors_api_beside_it(site: Site, tmp_path: Path) -> None:
    page = documented("webgym serve --compat --compat-port 7001 --compat-key-file ~/.webgym-key")
    key_file = tmp_path / "key"
    process, _ = await start(tmp_path, "--compat-port", "0", "--compat-key-file", str(key_file), page=page)
    assert process.stdout is not None
    name, url = (await process.stdout.readline()).decode().split()
    assert name == "compat"
    headers = {"x-api-key": key_file.read_text().strip()}
    async with httpx.AsyncClient(base_url=url, headers=headers, trust_env=False, timeout=30) as http:
        instance = (await http.post("/get", params={"lifetime_mins": 45})).json()
        visit = {"visit_page": {"url": site.url()}, **instance}
        assert (await http.post("/execute", json=visit)).json() == {"status": "success"}
        assert (await http.get("/screenshot", params=instance)).content.startswith(b"\x89PNG")
        [node] = (await http.get("/info")).json()["nodes"]
        assert (node["capacity"], node["instances"]) == (2, [instance["instance_id"]])
    process.terminate()
    assert await asyncio.wait_for(process.wait(), 30) == 0
    await gone(tmp_path)


async def test_told_to_stop_it_leaves_nothing(site: Site, tmp_path: Path) -> None:
    allowed = documented(
        "webgym serve --allow-host intranet.example --allow-host 10.20.0.0/16 "
        "--allow-host staging.example=10.1.2.3:8080 --allow-host tracker.example=nowhere"
    )
    process, url = await start(tmp_path, page=allowed)
    token = (tmp_path / "token").read_text().strip()
    assert stat.S_IMODE((tmp_path / "token").stat().st_mode) == 0o600
    async with BrowserClient(url, token=token, limits=quick()) as client:
        session = await client.open(SessionOptions(text=True))
        assert (await session.step(Navigate(site.url()))).observation.title == "Home"
        for running in (process.pid, browsers(tmp_path)[0].pid):
            soft, hard = resource.prlimit(running, resource.RLIMIT_NOFILE)
            assert soft == hard, "as many files as may be"
        process.terminate()
        assert await process.wait() == 0
        with pytest.raises(ServerUnreachable):
            await session.step()
    await gone(tmp_path)
    assert list((tmp_path / f"webgym-{os.getuid()}").iterdir()) == []


def in_tree(folder: Path) -> list[psutil.Process]:
    """All processes of the server: gateway, workers, browsers."""
    return [
        process
        for process in psutil.process_iter(["environ", "status"])
        if process.info["status"] != psutil.STATUS_ZOMBIE
        and (process.info["environ"] or {}).get("TMPDIR", "").startswith(str(folder))
    ]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_told_to_stop_before_it_is_up(tmp_path: Path, number: signal.Signals) -> None:
    """A browser that never comes up is not waited for."""
    started = tmp_path / "started"
    hangs = tmp_path / "hangs"
    hangs.write_text(f"""#!/bin/sh
if [ "$1" = --version ]; then echo Chromium 156.0.0.0; exit; fi
touch {started}
exec sleep 600
""")
    hangs.chmod(0o755)
    command = "from webgym.cli import main; main()"
    arguments = ["serve", "--port", "0", "--slots", "1", "--workers", "1", "--browser", str(hangs)]
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", command, *arguments, stdout=PIPE, env={**os.environ, "TMPDIR": str(tmp_path)}
    )
    async with asyncio.timeout(60):
        while not started.exists():
            await asyncio.sleep(0.05)
        process.send_signal(number)
        said, _ = await process.communicate()
    assert (process.returncode, said) == (0, b"")
    await gone(tmp_path)
    assert list(tmp_path.glob("webgym-*/*")) == []


async def test_killed_and_started_again(site: Site, tmp_path: Path) -> None:
    """kill -9 of the gateway: no worker, no browser and no profile outlives it. Its sessions are gone, and
    their holders are told, also by the one that is started in its place."""
    process, url = await start(tmp_path, page=documented("webgym serve --slots 64"))
    token = (tmp_path / "token").read_text().strip()
    async with (
        BrowserClient(url, token=token, limits=quick()) as client,
        BrowserClient(url, token=token, limits=quick(direct=False)) as relayed,
    ):
        session, other = await client.open(), await relayed.open()
        await session.navigate(site.url())
        assert session.is_direct
        assert len(in_tree(tmp_path)) > 3
        process.kill()
        await process.wait()
        async with asyncio.timeout(100):
            while in_tree(tmp_path):
                await asyncio.sleep(0.05)
        assert list((tmp_path / f"webgym-{os.getuid()}").iterdir()) == []
        for gone in (session, other):
            with pytest.raises(ServerUnreachable):
                await gone.step()
        process, _ = await start(tmp_path, "--port", url.rpartition(":")[2])
        for gone in (session, other):
            with pytest.raises(LeaseLost):
                await gone.step()
        assert (await (await client.open()).navigate(site.url())).title == "Home"
    process.terminate()
    assert await process.wait() == 0


async def test_all_killed_at_once_the_next_one_clears_up(site: Site, tmp_path: Path) -> None:
    process, url = await start(tmp_path)
    token = (tmp_path / "token").read_text().strip()
    async with BrowserClient(url, token=token, limits=quick()) as client:
        session = await client.open()
        await session.navigate(site.url())
        # Stopped processes hear of nothing by themselves; that they end all the same is the point.
        async with asyncio.timeout(100):
            while {one.status() for one in browsers(tmp_path)} != {psutil.STATUS_STOPPED}:
                await asyncio.sleep(0.05)
        workers = psutil.Process(process.pid).children()
        for each in (psutil.Process(process.pid), *workers):
            each.suspend()  # so that none does anything about the end of another
        for each in (psutil.Process(process.pid), *workers):
            each.kill()
        await process.wait()
        with pytest.raises(ServerUnreachable):
            await session.step()
    await gone(tmp_path)
    root = ProfileRoot(tmp_path)
    assert len(await asyncio.to_thread(root.sweep)) == 1
    assert list(root.path.parent.iterdir()) == []


async def test_the_token_is_on_no_command_line(tmp_path: Path) -> None:
    process, _ = await start(tmp_path, "--compat-port", "0", page=documented("webgym serve --compat"))
    token = (tmp_path / "token").read_text().strip()
    for each in in_tree(tmp_path):
        assert token not in " ".join(each.cmdline())
        assert token not in each.environ().values()
    process.terminate()
    assert await process.wait() == 0
