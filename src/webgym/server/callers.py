"""Who calls: their tokens, how many sessions each may hold, and the log of who opened what.

Valid tokens are the server's own, and those of a file. A line of the file is a name and its token; text
after ``#`` is a comment. A name may have several lines, so that an old and a new token are both valid during
a change. The file is read again when it changes, so that tokens can be added and revoked while the server
runs.

A client is identified by the name of its token. Clients that share the server's own token are distinguished
by the names that they give: no protection against malicious clients, but one that leaks sessions does not use
up all slots.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import re
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from logging.handlers import QueueHandler, QueueListener, WatchedFileHandler
from pathlib import Path
from queue import SimpleQueue
from stat import S_IROTH
from typing import Any

import msgspec
from starlette.requests import Request

from webgym.core.errors import ConfigError, TooManySessions
from webgym.server.messages import CLIENT_HEADER

log = logging.getLogger(__name__)

SERVER_CALLER = "server"
"""The name of callers with the server's own token."""

SHORTEST = 16
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
_PRINTABLE = re.compile(r"[\x21-\x7e]+")
_TOKEN = re.compile(rf"[\x21-\x7e]{{{SHORTEST},}}")


def check_token(token: str, where: str, shortest: int = SHORTEST) -> None:
    """Check that a token can be sent in a header as it is.

    Args:
        token: the token.
        where: where it is from, for the error.
        shortest: its least number of characters.

    Raises:
        ConfigError: it is too short, has spaces or several lines, or is not ASCII.
    """
    if len(token) < shortest or not _PRINTABLE.fullmatch(token):
        raise ConfigError(
            f"{where} is not a token: one line of {shortest} or more ASCII characters, without spaces",
            hint="without one, `webgym serve` makes a random one",
        )


class Tokens:
    """Authenticates callers by their tokens.

    Args:
        own: the server's token.
        file: file of named tokens; ``None`` for none.
        check_seconds: interval at which the file is checked for changes.

    Raises:
        ConfigError: the file cannot be read, or a line of it is not a name and a token.
    """

    def __init__(self, own: str, file: Path | None = None, check_seconds: float = 1.0) -> None:
        self._own = own
        self._file = file
        self._check_seconds = check_seconds
        self._named: tuple[tuple[bytes, str], ...] = ()
        self._stamp: tuple[int, ...] = ()
        self._reload()

    def name_of(self, authorization: str) -> str | None:
        """The name for an ``Authorization`` header; ``None`` if its token is invalid. Takes constant time."""
        given = authorization.encode("utf-8", "replace")
        caller = SERVER_CALLER if hmac.compare_digest(given, _header(self._own)) else None
        for expected, name in self._named:
            if hmac.compare_digest(given, expected):
                caller = caller or name
        return caller

    @asynccontextmanager
    async def watching_file(self) -> AsyncIterator[None]:
        """Apply changes of the file during the block."""
        watching = asyncio.create_task(self._watch()) if self._file else None
        try:
            yield
        finally:
            if watching is not None:
                watching.cancel()
                await asyncio.wait({watching})

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(self._check_seconds)
            try:
                await asyncio.to_thread(self._reload)
            except ConfigError as error:  # a partly written file must not lock out all callers
                log.error("%s; the previous tokens remain valid", error.message)

    def _reload(self) -> None:
        """Read the file if it has changed."""
        if self._file is None:
            return
        try:
            status = self._file.stat()
            stamp = (status.st_ino, status.st_mtime_ns, status.st_size)
            if stamp == self._stamp:
                return
            self._stamp = stamp  # so that an invalid file is reported once
            text = self._file.read_text("ascii")
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "it is not plain ASCII"
            if self._stamp == _UNREADABLE:
                return
            self._stamp = _UNREADABLE
            raise ConfigError(f"the file of tokens {self._file} cannot be read: {why}") from None
        self._named = tuple(_read(text, self._file))
        if status.st_mode & S_IROTH:
            log.warning("every user can read the tokens in %s; `chmod 600` prevents it", self._file)


_UNREADABLE = (-1,)


def _header(token: str) -> bytes:
    return f"Bearer {token}".encode()


def _read(text: str, file: Path) -> list[tuple[bytes, str]]:
    tokens: dict[bytes, str] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if (
            len(words) != 2
            or not _NAME.fullmatch(words[0])
            or words[0] == SERVER_CALLER
            or not _TOKEN.fullmatch(words[1])
        ):
            raise ConfigError(
                f"line {number} of {file} is not a name and a token of {SHORTEST} characters or more",
                hint=f"e.g. `alice {'x' * SHORTEST}`; `{SERVER_CALLER}` names the server's own token",
            )
        if tokens.setdefault(_header(words[1]), words[0]) != words[0]:
            raise ConfigError(f"line {number} of {file}: {words[0]} has the same token as another name")
    return list(tokens.items())


def client_of(request: Request) -> str:
    """The client of a request: the name of its token, else the name that it gives, else its address."""
    caller = caller_of(request)
    named = f"token {caller['token']}" if caller["token"] != SERVER_CALLER else ""
    return named or caller["client"] or caller["address"]


def caller_of(request: Request) -> dict[str, str]:
    """The name of the caller's ``token``, the name that the ``client`` gives, and its ``address``."""
    return {
        "token": request.state.caller,
        "client": request.headers.get(CLIENT_HEADER, ""),
        "address": request.client.host if request.client else "",
    }


class Quota:
    """Counts the sessions of clients.

    Args:
        limit: sessions per client; ``None`` for no limit.
    """

    def __init__(self, limit: int | None) -> None:
        self._limit = limit
        self._counts: Counter[str] = Counter()
        self._holders: dict[str, str] = {}

    @contextmanager
    def requesting(self, client: str) -> Iterator[None]:
        """Count a requested session during the block.

        Raises:
            TooManySessions: the client has reached the limit.
        """
        if self._limit is not None and self._counts[client] >= self._limit:
            raise TooManySessions(
                f"this client holds {self._counts[client]} sessions, which is the limit",
                hint="close some, or let the server allow more with --sessions-per-client",
            )
        self._counts[client] += 1
        try:
            yield
        finally:
            self._decrement(client)

    def granted(self, client: str, session_id: str) -> None:
        """Count a session that was opened."""
        self._counts[client] += 1
        self._holders[session_id] = client

    def ended(self, session_id: str) -> None:
        """Stop counting a session that has ended."""
        client = self._holders.pop(session_id, None)
        if client is not None:
            self._decrement(client)

    def _decrement(self, client: str) -> None:
        self._counts[client] -= 1
        if not self._counts[client]:
            del self._counts[client]


_log = logging.getLogger("webgym.audit")


class Audit:
    """Writes the audit log. Without a handler it writes nothing."""

    def __init__(self, handler: logging.Handler | None = None) -> None:
        self._handler = handler
        self._open: dict[str, tuple[float, str]] = {}
        """Start time and token name of every open session."""

    def opened(self, session: str, *, token: str, client: str, address: str) -> None:
        """Record that a session was opened.

        Args:
            session: id of the session.
            token: name of the token that it was opened with.
            client: name that the client gives itself.
            address: network address of the client.
        """
        self._open[session] = (time.monotonic(), token)
        self._write("opened", session, token=token, client=client, address=address)

    def ended(self, session: str) -> None:
        """Record that a session has ended, for any reason."""
        if (opened := self._open.pop(session, None)) is not None:
            started, token = opened
            self._write("ended", session, token=token, seconds=round(time.monotonic() - started, 3))

    def _write(self, event: str, session: str, **more: Any) -> None:
        if self._handler is None:
            return
        record = _log.makeRecord(_log.name, logging.INFO, __file__, 0, "", (), None)
        line = {"time": round(record.created, 3), "event": event, "session": session} | more
        record.msg = msgspec.json.encode(line).decode()
        self._handler.handle(record)


class _File(WatchedFileHandler):
    """A file that may be full or away for a while: then lines are missing, which is logged once."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self._is_away = False

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line."""
        try:
            super().emit(record)
        except OSError as error:
            self._missed(error)
        else:
            self._is_away = False

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the name of the standard library
        """Called in :meth:`emit` instead of the error."""
        error = sys.exception()
        if not isinstance(error, OSError):
            super().handleError(record)
            return
        raise error

    def _missed(self, error: OSError) -> None:
        if not self._is_away:
            log.error("the audit file cannot be written, and lines will be missing: %s", error)
        self._is_away = True

    def close(self) -> None:
        """Close it, with what could not be written before."""
        try:
            super().close()
        except OSError as error:
            self._missed(error)


@contextmanager
def audit_to(path: Path | None) -> Iterator[Audit]:
    """Append to a file during the block, from a background thread. If it cannot be written for a while, lines
    are missing.

    Raises:
        ConfigError: the file cannot be written.
    """
    if path is None:
        yield Audit()
        return
    try:
        file = _File(path)
    except OSError as error:
        raise ConfigError(f"the audit file {path} cannot be written: {error.strerror}") from None
    queue: SimpleQueue[logging.LogRecord] = SimpleQueue()
    listener = QueueListener(queue, file)
    listener.start()
    try:
        yield Audit(QueueHandler(queue))
    finally:
        listener.stop()
        file.close()
