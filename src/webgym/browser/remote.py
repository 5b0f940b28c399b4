"""A browser that somebody else runs, over a WebSocket: hosted ones, and any Chromium with a debugging port.

Each slot has a connection of its own, and each session a browser context, which the browser disposes of when
it is told to, or when the connection ends. Sessions of others may be in the same browser.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import aiohttp
import msgspec

from webgym.browser.cdp import CommandFailed, Connection
from webgym.browser.cdp_messages import Version
from webgym.browser.config import BrowserConfig
from webgym.browser.desktop import Told
from webgym.browser.find import find_browser
from webgym.browser.sandbox import SandboxState
from webgym.core.errors import BrowserCrashed, BrowserLaunchFailed, BrowserTimeout, ConfigError

WITHOUT: Final = (
    "egress: pages reach whatever that browser reaches; no address policy, limits or upstream proxies",
    "freezing and memory: pages go on between two calls, and no limit ends one that grows",
    "identity: mouse, shared workers and the first request of a new window are as that browser was started",
    "pictures: fonts and colours are that machine's",
    "timers: what a page does later by a timer is not awaited",
    "files: a task's files cannot be uploaded",
    "sandbox: nobody has examined it",
)
"""What does not hold with a remote browser, a line each."""

SANDBOX: Final = SandboxState(False, "a remote browser, which nobody has examined")

CLOSE_SECONDS = 2.0
"""Closing a connection, before it is given up."""


def address_of(remote: str) -> str:
    """The endpoint of ``browser.remote``, with what it may hold of secrets.

    Raises:
        ConfigError: it is in an environment variable that holds none.
    """
    address = os.environ.get(remote[1:], "").strip() if remote.startswith("$") else remote
    parts = urlsplit(address)
    if parts.scheme not in ("ws", "wss", "http", "https") or not parts.hostname:
        raise ConfigError(
            f"browser.remote: {remote} holds no endpoint", hint="such as wss://HOST/PATH or http://HOST:9222"
        )
    return address


def executable_of(config: BrowserConfig) -> Path:
    """The browser to start; of a remote one, only how the settings call it.

    Raises:
        BrowserNotFound: there is none.
        ConfigError: the remote endpoint is in an environment variable that holds none.
    """
    if config.remote is not None:
        address_of(config.remote)
        return Path(config.remote)
    return find_browser(config.executable).path


class _Frames(asyncio.Transport):
    """Sends each message of a :class:`Connection` as a frame."""

    def __init__(self) -> None:
        super().__init__()
        self.outgoing: asyncio.Queue[bytes | None] = asyncio.Queue()

    def write(self, data: bytes | bytearray | memoryview[Any]) -> None:
        """Send a message, which ends with a NUL byte."""
        self.outgoing.put_nowait(bytes(data)[:-1])

    def abort(self) -> None:
        """Send no more, and close."""
        self.outgoing.put_nowait(None)


class RemoteBrowser:
    """A connection to a remote browser, in place of :class:`~webgym.browser.process.BrowserProcess`.

    Create one with :func:`connect`; call :meth:`kill` when done.
    """

    standing_bytes = 0
    relieved = ""

    def __init__(self, http: aiohttp.ClientSession, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._http, self._socket = http, socket
        self._frames = _Frames()
        self.connection = Connection()
        self.connection.connection_made(self._frames)
        self.connection.why_lost = lambda: BrowserCrashed("the connection to the remote browser was lost")
        self.version = ""
        self.told: Told
        self.started = asyncio.get_running_loop().time()
        self._tasks = [asyncio.create_task(self._send()), asyncio.create_task(self._receive())]

    async def _send(self) -> None:
        with contextlib.suppress(aiohttp.ClientError, OSError):
            while (message := await self._frames.outgoing.get()) is not None:
                await self._socket.send_str(message.decode())
        await self._socket.close()

    async def _receive(self) -> None:
        async for message in self._socket:
            if message.type is aiohttp.WSMsgType.TEXT:
                self.connection.data_received(message.data.encode() + b"\0")
        self.connection.connection_lost(None)

    @property
    def is_alive(self) -> bool:
        """Whether its connection is open."""
        return not self.connection.is_lost

    @property
    def age(self) -> float:
        """Seconds since it was opened."""
        return asyncio.get_running_loop().time() - self.started

    async def kill(self) -> None:
        """Close the connection, with which the browser disposes of its context. Safe to call twice."""
        self.connection.abandon(BrowserCrashed("the browser was closed"))
        await asyncio.wait(self._tasks, timeout=CLOSE_SECONDS)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._http.close()


async def connect(config: BrowserConfig) -> RemoteBrowser:
    """Connect to the remote browser of the settings.

    Raises:
        BrowserLaunchFailed: it cannot be connected to, or does not answer. The message never contains the
            endpoint's path and query, which may be secrets.
    """
    assert config.remote is not None
    address = address_of(config.remote)
    http, browser = aiohttp.ClientSession(), None
    try:
        async with asyncio.timeout(config.launch_seconds):
            endpoint = await _endpoint(http, address)
            # Chromium sends pictures of many MB in one message.
            socket = await http.ws_connect(endpoint, max_msg_size=0)
            browser = RemoteBrowser(http, socket)
            version = await browser.connection.call(
                "Browser.getVersion", reply=Version, seconds=config.launch_seconds
            )
    except BaseException as error:
        await (browser.kill() if browser is not None else http.close())
        failures = (OSError, aiohttp.ClientError, msgspec.MsgspecError, BrowserCrashed, BrowserTimeout)
        if not isinstance(error, (*failures, TimeoutError, CommandFailed)):
            raise
        status = getattr(error, "status", "")
        why = f"HTTP status {status}" if status else type(error).__name__
        host = urlsplit(address).hostname
        raise BrowserLaunchFailed(f"the remote browser at {host} cannot be used: {why}") from None
    browser.version = version.product
    number = re.search(r"\d+(\.\d+)*", version.product)
    browser.told = Told(config.identity, number[0] if number else "0")
    return browser


class _Debugger(msgspec.Struct, rename={"url": "webSocketDebuggerUrl"}):
    url: str


async def _endpoint(http: aiohttp.ClientSession, address: str) -> str:
    """The WebSocket of an address; one of HTTP is asked for it, and may not know its own name."""
    parts = urlsplit(address)
    if parts.scheme in ("ws", "wss"):
        return address
    asked = parts._replace(path=f"{parts.path.rstrip('/')}/json/version").geturl()
    async with http.get(asked, raise_for_status=True) as reply:
        found = urlsplit(msgspec.json.decode(await reply.read(), type=_Debugger).url)
    return found._replace(scheme=parts.scheme.replace("http", "ws"), netloc=parts.netloc).geturl()
