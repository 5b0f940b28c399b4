"""Websites that blocked the agent are not attempted for a while (paper §4; 12 h in the authors' code).

A file of lines ``{"host", "at", "reason"}`` that grows by one line per blocked attempt and may be shared by
the runs of one machine. The host that blocked decides: another of the same website may well let the agent in.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final

import msgspec
from pydantic import AfterValidator, Field

from webgym.core.websites import host_or_text
from webgym.rollout.files import Log, disk_errors
from webgym.settings import Settings

_SHOWN: Final = 5
"""Websites that a person is told by name."""


class BlocklistConfig(Settings):
    """Where it is kept, and for how long a website stays on it."""

    file: Annotated[Path, AfterValidator(Path.absolute)] | None = None
    """Where; without one, nobody is left out and nothing is noted."""

    hours: float = Field(default=12.0, ge=0)
    """How long after it blocked an attempt a website is left out."""


class Block(msgspec.Struct, frozen=True):
    """A website that blocked an attempt.

    Attributes:
        host: as :func:`webgym.core.websites.host_of` names it.
        at: when, Unix time, seconds.
        reason: the judge's.
    """

    host: str
    at: float
    reason: str = ""


class Blocklist:
    """The hosts that have blocked somebody lately. Blocks: call it from a thread.

    Args:
        config: where, and for how long.
        now: tells the time, Unix, seconds.
    """

    def __init__(self, config: BlocklistConfig, now: Callable[[], float] = time.time) -> None:
        self._config = config
        self._now = now

    def blocked(self) -> dict[str, Block]:
        """The last block of every host that is still left out.

        Raises:
            StoreError: the file is there and cannot be read. A line that is none, as of a writer that was
                killed, is passed over.
        """
        file = self._config.file
        if file is None or not file.exists():
            return {}
        found: dict[str, Block] = {}
        since = self._now() - self._config.hours * 3600
        with disk_errors(f"reading {file}"), file.open("rb") as lines:
            for line in lines:
                try:
                    block = msgspec.json.decode(line, type=Block)
                except msgspec.DecodeError:
                    continue
                if block.at > since and block.at >= found.get(block.host, block).at:
                    found[block.host] = block
        return found

    def told(self) -> str:
        """Who is left out now, and until when, for a person; the longest first, and empty if nobody is.

        Raises:
            StoreError: as for :meth:`blocked`.
        """
        held = sorted(self.blocked().values(), key=lambda block: -block.at)
        ends = (datetime.fromtimestamp(block.at + self._config.hours * 3600, UTC) for block in held)
        told = [f"{block.host} until {end:%Y-%m-%d %H:%M} UTC" for block, end in zip(held, ends, strict=True)]
        others = [f"and {len(told) - _SHOWN:,} others"] if len(told) > _SHOWN else []
        return ", ".join(told[:_SHOWN] + others)

    def is_blocked(self, website: str) -> bool:
        """Whether a website is left out now."""
        return host_or_text(website) in self.blocked()

    def add(self, website: str, reason: str) -> None:
        """Note that a website, by its host, blocked an attempt just now.

        Raises:
            StoreError: it cannot be written down.
        """
        file = self._config.file
        if file is None:
            return
        with disk_errors(f"writing {file}"):
            file.parent.mkdir(parents=True, exist_ok=True)
            log = Log(file)
            try:
                block = Block(host_or_text(website), self._now(), reason)
                # In front, too: a line that a dead writer left unfinished must not swallow this one.
                log.append(b"\n" + msgspec.json.encode(block) + b"\n", durable=True)
            finally:
                log.close()
