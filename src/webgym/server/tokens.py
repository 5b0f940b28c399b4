"""Valid tokens: the server's own, and those of a file.

A line of the file is a name and its token; text after ``#`` is a comment. A name may have several lines, so
that an old and a new token are both valid during a change. The file is read again when it changes, so that
tokens can be added and revoked while the server runs.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from stat import S_IROTH

from webgym.core.errors import ConfigError

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
