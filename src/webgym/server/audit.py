"""The audit log: a JSON line for every session opened and ended, in a file that may be rotated."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener, WatchedFileHandler
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import msgspec

from webgym.core.errors import ConfigError

log = logging.getLogger(__name__)

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
