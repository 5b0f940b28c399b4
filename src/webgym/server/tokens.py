"""Who may call: the holder of the server's own token, and those whom a file names.

A line of the file is a name and its token; what follows ``#`` is a comment. A name may have several lines, so
that an old and a new token are both good while a client changes over. The file is read again when it changes:
tokens are added and withdrawn while the server runs.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from webgym.core.errors import ConfigError

log = logging.getLogger(__name__)

OWN = "server"
"""The name of whoever holds the server's own token."""

SHORTEST = 16
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
_TOKEN = re.compile(rf"[\x21-\x7e]{{{SHORTEST},}}")


class Tokens:
    """Names by their tokens.

    Args:
        own: the server's token.
        file: of named tokens, if there is one.
        look_seconds: between two looks whether the file changed.

    Raises:
        ConfigError: the file cannot be read, or a line of it is not a name and a token.
    """

    def __init__(self, own: str, file: Path | None = None, look_seconds: float = 1.0) -> None:
        self._own = own
        self._file = file
        self._look_seconds = look_seconds
        self._named: tuple[tuple[bytes, str], ...] = ()
        self._stamp: tuple[int, ...] = ()
        self._look()

    def name_of(self, authorization: str) -> str | None:
        """Whose ``Authorization`` header this is; ``None`` for nobody's. Every guess takes the same time."""
        given = authorization.encode("utf-8", "replace")
        found = OWN if hmac.compare_digest(given, _header(self._own)) else None
        for expected, name in self._named:
            if hmac.compare_digest(given, expected):
                found = found or name
        return found

    @asynccontextmanager
    async def kept_fresh(self) -> AsyncIterator[None]:
        """Take changes of the file over for the length of the block."""
        watching = asyncio.create_task(self._watch()) if self._file else None
        try:
            yield
        finally:
            if watching is not None:
                watching.cancel()
                await asyncio.wait({watching})

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(self._look_seconds)
            try:
                await asyncio.to_thread(self._look)
            except ConfigError as error:  # half a file must not lock everybody out
                log.error("%s; the tokens of before stay good", error.message)

    def _look(self) -> None:
        """Read the file if it is not what was read last."""
        if self._file is None:
            return
        try:
            status = self._file.stat()
            stamp = (status.st_ino, status.st_mtime_ns, status.st_size)
            if stamp == self._stamp:
                return
            self._stamp = stamp  # a broken file is complained about once
            text = self._file.read_text("ascii")
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "it is not plain ASCII"
            if self._stamp == _UNREADABLE:
                return
            self._stamp = _UNREADABLE
            raise ConfigError(f"the file of tokens {self._file} cannot be read: {why}") from None
        self._named = tuple(_read(text, self._file))


_UNREADABLE = (-1,)


def _header(token: str) -> bytes:
    return f"Bearer {token}".encode()


def _read(text: str, file: Path) -> list[tuple[bytes, str]]:
    found: dict[bytes, str] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if (
            len(words) != 2
            or not _NAME.fullmatch(words[0])
            or words[0] == OWN
            or not _TOKEN.fullmatch(words[1])
        ):
            raise ConfigError(
                f"line {number} of {file} is not a name and a token of {SHORTEST} characters or more",
                hint=f"e.g. `alice {'x' * SHORTEST}`; `{OWN}` is the name of the server's own token",
            )
        if found.setdefault(_header(words[1]), words[0]) != words[0]:
            raise ConfigError(f"line {number} of {file}: {words[0]} has the same token as another name")
    return list(found.items())
