"""Who opened which session, and when it ended: a JSON line each, in a file that others may rotate."""

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
    """What is written down about sessions. Without a file, nothing is."""

    def __init__(self, handler: logging.Handler | None = None) -> None:
        self._handler = handler
        self._open: dict[str, tuple[float, str]] = {}
        """When each began, and the name of its token."""

    def opened(self, session: str, *, token: str, client: str, address: str) -> None:
        """A session begins.

        Args:
            token: name of the token that it was opened with.
            client: what the client calls itself.
            address: where it called from.
        """
        self._open[session] = (time.monotonic(), token)
        self._write("opened", session, token=token, client=client, address=address)

    def ended(self, session: str) -> None:
        """A session is over, however it ended."""
        if (known := self._open.pop(session, None)) is not None:
            began, token = known
            self._write("ended", session, token=token, seconds=round(time.monotonic() - began, 3))

    def _write(self, event: str, session: str, **more: Any) -> None:
        if self._handler is None:
            return
        record = _log.makeRecord(_log.name, logging.INFO, __file__, 0, "", (), None)
        line = {"time": round(record.created, 3), "event": event, "session": session} | more
        record.msg = msgspec.json.encode(line).decode()
        self._handler.handle(record)


@contextmanager
def audit_to(path: Path | None) -> Iterator[Audit]:
    """Append to this file, from a thread of its own, for the length of the block.

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
