"""Slots in a browser that runs elsewhere: a Chromium of ours behind a port, and a relay that drops."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import aiohttp
import pytest
import pytest_asyncio
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from webgym.browser import remote
from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.proxy import Egress
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import LeftClick, Navigate, Target
from webgym.core.errors import BrowserCrashed, BrowserLaunchFailed, ConfigError
from webgym.core.task import Attachment
from webgym.server.client import BrowserClient
from webgym.server.config import ServerConfig
from webgym.server.worker import running_server

from .canary import HERE
from .conftest import Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

LISTENS = re.compile(rb"DevTools listening on (ws://\S+)")


class Relay:
    """Forwards connections to a port, and drops them."""

    def __init__(self, target: int) -> None:
        self.target = target
        self.port = 0
        self.clients: set[asyncio.StreamWriter] = set()
        self.kept: list[asyncio.StreamWriter] = []
        """Ends at the browser that stay open when a client is dropped."""
        self.is_noticed = True
        """Whether the browser notices that a client was dropped."""

    def drop(self) -> None:
        for writer in tuple(self.clients):
            writer.transport.abort()

    async def __call__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection(HERE, self.target)
        self.clients.add(writer)

        async def forward(one: asyncio.StreamReader, other: asyncio.StreamWriter) -> None:
            with contextlib.suppress(ConnectionError):
                while data := await one.read(65536):
                    other.write(data)
                    await other.drain()

        ways = {asyncio.create_task(forward(reader, back)), asyncio.create_task(forward(there, writer))}
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        for way in ways:
            way.cancel()
        self.clients.discard(writer)
        writer.close()
        if self.is_noticed:
            back.close()
        else:
            self.kept.append(back)


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def endpoint(executable: Path, tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[str]:
    """A Chromium of nobody's; its WebSocket."""
    folder = tmp_path_factory.mktemp("remote")
    flags = ["--headless", "--remote-debugging-port=0", f"--user-data-dir={folder}", "--disable-gpu"]
    flags += ["--no-startup-window", "--mute-audio", "--no-first-run"]
    flags += ["--no-sandbox"] if os.geteuid() == 0 else []
    process = await asyncio.create_subprocess_exec(
        executable, *flags, stderr=asyncio.subprocess.PIPE, start_new_session=True
    )
    assert process.stderr is not None
    try:
        while not (found := LISTENS.search(line := await process.stderr.readline())):
            assert line, "the browser did not start"
        drain = asyncio.create_task(process.stderr.read())
        yield found[1].decode()
        drain.cancel()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, 9)
        await process.wait()


@pytest_asyncio.fixture(loop_scope="package")
async def relay(endpoint: str) -> AsyncIterator[Relay]:
    relay = Relay(int(re.findall(r":(\d+)/", endpoint)[0]))
    server = await asyncio.start_server(relay, HERE, 0)
    relay.port = server.sockets[0].getsockname()[1]
    yield relay
    server.close()
    relay.drop()
    for writer in relay.kept:
        writer.transport.abort()


async def contexts(endpoint: str, count: int) -> int:
    """How many browser contexts there are, once there are so many, or for two seconds."""
    async with aiohttp.ClientSession() as http, http.ws_connect(endpoint) as socket:
        for _ in range(40):
            await socket.send_json({"id": 1, "method": "Target.getBrowserContexts"})
            found = len((await socket.receive_json())["result"]["browserContextIds"])
            if found == count:
                break
            await asyncio.sleep(0.05)
    return found


@pytest_asyncio.fixture(loop_scope="package")
async def slots(
    relay: Relay, endpoint: str, egress: Egress, profiles: ProfileRoot
) -> AsyncIterator[tuple[Slot, Slot]]:
    config = BrowserConfig(remote=f"http://{HERE}:{relay.port}")
    made = Slot(config, Path(), profiles, egress), Slot(config, Path(), profiles, egress)
    yield made
    for slot in made:
        await slot.stop()
    assert await contexts(endpoint, 0) == 0, "nothing is left behind"


OPTIONS = PageOptions(viewport=(800, 600), text=True)


async def test_two_sessions_in_one_browser_do_not_meet(
    site: Site, slots: tuple[Slot, Slot], endpoint: str
) -> None:
    async def count(request: Request) -> Response:
        seen = int(request.cookies.get("seen", "0")) + 1
        answer = HTMLResponse(f"<title>{seen}</title><a href='/other' target=_blank style='{FILLS}'>more</a>")
        answer.set_cookie("seen", str(seen))
        return answer

    site.on("/count", count)
    other = site.page("<title>other</title>", "/other")
    for slot in slots:
        await slot.open(OPTIONS)
    assert await contexts(endpoint, 2) == 2
    for expected in "12":
        looks = await asyncio.gather(*(slot.step(Navigate(site.url("/count"))) for slot in slots))
        assert [look.observation.title for look in looks] == [expected, expected]
    assert looks[0].observation.viewport == (800, 600)
    assert looks[0].observation.picture_size == (800, 600)
    look = await slots[0].step(LeftClick(Target(coordinate=(500, 500))))  # opens a window
    assert (look.observation.url, look.observation.title) == (other, "other")
    with slots[0].awake():
        pass
    assert not slots[0].is_frozen, "nobody can stop it"
    await slots[0].close()
    assert await contexts(endpoint, 1) == 1
    assert (await slots[1].observe()).observation.title == "2"


FILLS = "position: fixed; inset: 0"


async def slow(_: Request) -> Response:
    await asyncio.sleep(3)
    return Response("late")


@pytest.mark.parametrize("is_noticed", [True, False], ids=["noticed", "unnoticed"])
async def test_a_drop_in_the_middle_of_a_step(
    site: Site, slots: tuple[Slot, Slot], relay: Relay, endpoint: str, is_noticed: bool
) -> None:
    slot, _ = slots
    relay.is_noticed = is_noticed
    await slot.open(OPTIONS)
    step = asyncio.create_task(slot.step(Navigate(site.on("/slow", slow))))
    await asyncio.sleep(0.3)
    relay.drop()
    with pytest.raises(BrowserCrashed, match="the connection to the remote browser was lost"):
        await step
    await slot.stop()
    if is_noticed:
        assert await contexts(endpoint, 0) == 0
    relay.is_noticed = True
    await slot.open(OPTIONS)
    assert (await slot.step(Navigate(site.page("<title>again</title>")))).observation.title == "again"
    assert await contexts(endpoint, 1) == 1, "that of the lost connection is gone"


async def test_a_server_says_what_does_not_hold_and_makes_its_slot_anew(site: Site, relay: Relay) -> None:
    browser = BrowserConfig(remote=f"http://{HERE}:{relay.port}", settle_seconds=2)
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(running_server(ServerConfig(slots=1, browser=browser)))
        client = await stack.enter_async_context(BrowserClient(server.url, token=server.token))
        info = await client.info()
        assert info.without == remote.WITHOUT
        assert "Chrome" in info.browser
        assert not info.sandboxed
        session = await client.open()
        step = asyncio.create_task(session.step(Navigate(site.on("/slow", slow))))
        await asyncio.sleep(0.3)
        relay.drop()
        with pytest.raises(BrowserCrashed):
            await step
        again = await client.open()
        view = await again.step(Navigate(site.page("<title>again</title>")))
        assert view.observation.title == "again"
        await again.close()


async def test_files_are_refused(slots: tuple[Slot, Slot]) -> None:
    files = (Attachment("a.txt", "a"),)
    with pytest.raises(Exception, match="cannot be uploaded into a remote browser"):
        await slots[0].open(PageOptions(files=files))


SECRET = "token=s3cret"


async def test_secrets_of_an_endpoint_are_told_nobody(
    relay: Relay, monkeypatch: pytest.MonkeyPatch, egress: Egress, profiles: ProfileRoot, caplog: Any
) -> None:
    with pytest.raises(ValidationError) as error:
        BrowserConfig(remote=f"wss://browsers.example/?{SECRET}")
    assert "s3cret" not in error.value.errors()[0]["msg"]
    config = BrowserConfig(remote="$BROWSER")
    slot = Slot(config, Path(), profiles, egress)
    for wrong in (f"ws://{HERE}:{relay.port}/devtools/nothing?{SECRET}", f"http://{HERE}:1/?{SECRET}"):
        monkeypatch.setenv("BROWSER", wrong)
        with pytest.raises(BrowserLaunchFailed) as failed:
            await slot.start()
        assert HERE in str(failed.value)
        assert "s3cret" not in f"{failed.value} {failed.value.__cause__} {caplog.text}"
    monkeypatch.setenv("BROWSER", f"http://{HERE}:{relay.port}/?{SECRET}")
    await slot.start()
    await slot.stop()
    assert "s3cret" not in json.dumps(config.model_dump(mode="json")) + str(remote.executable_of(config))
    monkeypatch.setenv("BROWSER", "s3cret")
    with pytest.raises(ConfigError) as missing:
        remote.executable_of(config)
    assert "s3cret" not in str(missing.value)
