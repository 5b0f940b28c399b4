"""A small client of the DevTools protocol over a pipe: no port is opened, and when one end dies the
other notices.

Messages are JSON, each terminated by a NUL byte. One connection carries many flat sessions; a session belongs
to one target (a page), and commands without a session go to the browser itself.
"""

from __future__ import annotations

import asyncio
import logging
import re
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar, cast

import msgspec

from webgym.browser.cdp_messages import EmptyReply
from webgym.core.errors import BrowserCrashed, BrowserError, BrowserTimeout

log = logging.getLogger(__name__)

T = TypeVar("T")
Handler = Callable[[msgspec.Raw], None]
Unsubscribe = Callable[[], None]

_BROWSER = ""
"""The session id of the browser itself."""


class CommandFailed(BrowserError):
    """The browser understood a command and refused it; the message is the browser's own."""

    code = "browser_command_failed"


class TargetGone(BrowserError):
    """The target page of a command is closed or crashed."""

    code = "browser_target_gone"


_CRASHED = "Target crashed"
"""Chromium's error for a command that needs a renderer that has crashed."""


class _CommandError(msgspec.Struct, frozen=True):
    code: int
    message: str
    data: str = ""


class _Incoming(msgspec.Struct, frozen=True, rename="camel"):
    id: int | None = None
    method: str | None = None
    params: msgspec.Raw = msgspec.Raw(b"{}")
    result: msgspec.Raw = msgspec.Raw(b"{}")
    error: _CommandError | None = None
    session_id: str = _BROWSER


class _Command(msgspec.Struct, frozen=True, rename="camel", omit_defaults=True):
    id: int
    method: str
    params: dict[str, Any] = {}
    session_id: str = _BROWSER


class _Pending(msgspec.Struct, frozen=True):
    method: str
    session_id: str
    reply: asyncio.Future[msgspec.Raw]


_read = msgspec.json.Decoder(_Incoming).decode

_ESCAPE = re.compile(
    rb"\\(?:u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}|(u[dD][89a-fA-F][0-9a-fA-F]{2})|.)",
    re.DOTALL,
)


def _decode(message: bytes) -> _Incoming:
    """Decode a message. Pages truncate text in the middle of an emoji, and Chromium then sends lone
    surrogates,
    which are invalid JSON: they are replaced by U+FFFD."""
    try:
        return _read(message)
    except msgspec.DecodeError:
        return _read(_ESCAPE.sub(lambda match: rb"\ufffd" if match[1] else match[0], message))


_encode = msgspec.json.Encoder().encode


class Connection(asyncio.Protocol):
    """The connection to one browser, as the protocol of an asyncio stream transport."""

    def __init__(self) -> None:
        self._transport: asyncio.Transport | None = None
        self._parts: list[bytes] = []
        self._pending: dict[int, _Pending] = {}
        self._handlers: dict[tuple[str, str], list[Handler]] = {}
        self._last_id = 0
        self._lost: BrowserCrashed | None = None
        self._lost_handlers: list[Callable[[], None]] = []
        self.paused: BrowserError | None = None
        """Raised for the commands of all sessions while their pages wait for something else."""
        self.why_lost: Callable[[], BrowserCrashed | None] = lambda: None
        """Called when the pipe closes: may return a more specific error than "the pipe closed"."""
        self.starved: Callable[[], Awaitable[float]] | None = None
        """Called at a deadline: the share of the time, 0 to 1, that the pages lack processors."""

    # --- transport ----------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The transport is up."""
        self._transport = cast(asyncio.Transport, transport)  # uvloop's is not a subclass

    def data_received(self, data: bytes) -> None:
        """Handle received bytes: a part of a message, or several messages."""
        end = data.find(b"\0")
        if end < 0:
            self._parts.append(data)
            return
        start = 0
        while end >= 0:
            self._parts.append(data[start:end])
            message = b"".join(self._parts)
            self._parts.clear()
            self._dispatch(message)
            start = end + 1
            end = data.find(b"\0", start)
        if start < len(data):
            self._parts.append(data[start:])

    def connection_lost(self, exc: Exception | None) -> None:
        """The pipe has closed: fail all pending commands."""
        self.abandon(
            self.why_lost() or BrowserCrashed(f"the browser's pipe closed{f': {exc}' if exc else ''}")
        )

    def abandon(self, error: BrowserCrashed) -> None:
        """Fail every waiting and every later command with ``error``, and close."""
        if self._lost is None:
            self._lost = error
        for pending in self._pending.values():
            if not pending.reply.done():
                pending.reply.set_exception(error)
        self._pending.clear()
        self._handlers.clear()
        handlers, self._lost_handlers = self._lost_handlers, []
        for handler in handlers:
            handler()
        if self._transport is not None:
            self._transport.abort()

    @property
    def is_lost(self) -> bool:
        """Whether the browser can no longer be reached."""
        return self._lost is not None

    @property
    def lost(self) -> BrowserCrashed | None:
        """Why the browser can no longer be reached; ``None`` if it can."""
        return self._lost

    def _dispatch(self, message: bytes) -> None:
        incoming = _decode(message)
        if incoming.id is not None:
            pending = self._pending.pop(incoming.id, None)
            if pending is None or pending.reply.done():
                return
            if incoming.error is None:
                pending.reply.set_result(incoming.result)
            else:
                detail = f" {incoming.error.data}" if incoming.error.data else ""
                kind = TargetGone if incoming.error.message == _CRASHED else CommandFailed
                pending.reply.set_exception(kind(f"{pending.method}: {incoming.error.message}{detail}"))
        elif incoming.method is not None:
            for handler in tuple(self._handlers.get((incoming.session_id, incoming.method), ())):
                handler(incoming.params)

    # --- commands -----------------------------------------------------------------------------------

    def send(self, method: str, params: dict[str, Any] | None = None, session_id: str = _BROWSER) -> int:
        """Send a command without waiting for the reply, so that its errors are ignored. Returns its id."""
        if self._lost is not None:
            raise self._lost
        assert self._transport is not None, "the connection is not up yet"
        self._last_id += 1
        command = _Command(self._last_id, method, params or {}, session_id)
        self._transport.write(_encode(command) + b"\0")
        return self._last_id

    async def call(
        self,
        method: str,
        params: dict[str, Any] | None = None,
        *,
        reply: type[T],
        seconds: float,
        session_id: str = _BROWSER,
    ) -> T:
        """Send a command and wait for its reply.

        Raises:
            CommandFailed: the browser replied with an error.
            TargetGone: the session's page was closed or crashed before it answered.
            BrowserTimeout: no answer within ``seconds``.
            BrowserCrashed: the browser is gone.
        """
        number = self.send(method, params, session_id)
        future: asyncio.Future[msgspec.Raw] = asyncio.get_running_loop().create_future()
        self._pending[number] = _Pending(method, session_id, future)
        try:
            raw = await self.wait(future, seconds)
        except TimeoutError:
            raise BrowserTimeout(f"{method} gave no answer within {seconds:g} s") from None
        finally:
            self._pending.pop(number, None)
        return msgspec.json.decode(raw, type=reply)

    async def wait(self, future: asyncio.Future[T], seconds: float) -> T:
        """Wait for a page. The time in which it lacks processors is added once: the machine is slow then, and
        a script that does nothing wrong would be ended.

        Raises:
            TimeoutError: it took longer.
        """
        done, _ = await asyncio.wait([future], timeout=seconds)
        if not done and self.starved is not None:
            await asyncio.wait([future], timeout=seconds * await self.starved())
        if not future.done():
            raise TimeoutError
        return future.result()

    # --- events -------------------------------------------------------------------------------------

    def on(
        self, method: str, shape: type[T], handler: Callable[[T], None], session_id: str = _BROWSER
    ) -> Unsubscribe:
        """Call ``handler`` with every event of this name, until unsubscribed."""

        def handle(params: msgspec.Raw) -> None:
            handler(msgspec.json.decode(params, type=shape))

        handlers = self._handlers.setdefault((session_id, method), [])
        handlers.append(handle)

        def unsubscribe() -> None:
            if handle in handlers:
                handlers.remove(handle)

        return unsubscribe

    def when_lost(self, handler: Callable[[], None]) -> Unsubscribe:
        """Call ``handler`` when the browser can no longer be reached, until unsubscribed."""
        self._lost_handlers.append(handler)

        def unsubscribe() -> None:
            if handler in self._lost_handlers:
                self._lost_handlers.remove(handler)

        return unsubscribe

    def drop_session(self, session_id: str, error: BrowserError) -> None:
        """Remove a session's handlers and fail its pending commands."""
        for key in [key for key in self._handlers if key[0] == session_id]:
            del self._handlers[key]
        self.fail_session(session_id, error)

    def fail_session(self, session_id: str, error: BrowserError) -> None:
        """Fail the pending commands of a session; its handlers stay."""
        for pending in self._pending.values():
            if pending.session_id == session_id and not pending.reply.done():
                pending.reply.set_exception(error)


class Session:
    """The session of one target on a connection.

    Attributes:
        connection: the browser's connection.
        id: the session's id.
        crashed: set while the target's renderer is gone, because commands that need it would not be answered.
    """

    def __init__(self, connection: Connection, session_id: str) -> None:
        self.connection = connection
        self.id = session_id
        self.crashed: TargetGone | None = None

    async def call(
        self, method: str, params: dict[str, Any] | None = None, *, reply: type[T], seconds: float
    ) -> T:
        """See :meth:`Connection.call`."""
        if why := self.crashed or self.connection.paused:
            raise why
        return await self.connection.call(method, params, reply=reply, seconds=seconds, session_id=self.id)

    async def do(self, method: str, params: dict[str, Any] | None = None, *, seconds: float) -> None:
        """Send a command whose reply is empty, and wait for it."""
        await self.call(method, params, reply=EmptyReply, seconds=seconds)

    def send(self, method: str, params: dict[str, Any] | None = None) -> None:
        """See :meth:`Connection.send`."""
        self.connection.send(method, params, self.id)

    def on(self, method: str, shape: type[T], handler: Callable[[T], None]) -> Unsubscribe:
        """See :meth:`Connection.on`."""
        return self.connection.on(method, shape, handler, self.id)
