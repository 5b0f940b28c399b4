"""The audit log: a JSON line for every session opened and ended, in a file that may be rotated."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener, WatchedFileHandler
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import msgspec

from webgym.core.errors import ConfigError

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


@contextmanager
def audit_to(path: Path | None) -> Iterator[Audit]:
    """Append to a file during the block, from a background thread.

    Raises:
        ConfigError: the file cannot be written.
    """
    if path is None:
        yield Audit()
        return
    try:
        file = WatchedFileHandler(path, encoding="utf-8")
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
