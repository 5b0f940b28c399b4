"""Websites that blocked the agent are not attempted for a while (paper §4; 12 h in the authors' code).

A file of lines ``{"host", "at", "reason"}`` that grows by one line per blocked attempt and may be shared by
the runs of one machine. Entries are hosts: another host of the same website may not block the agent.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final

import msgspec
from pydantic import AfterValidator, Field

from webgym.core.outcome import Outcome
from webgym.core.settings import Settings
from webgym.core.trajectory import Trajectory
from webgym.core.websites import host_or_text
from webgym.judge.blocking import blocking_host
from webgym.store.files import Log, disk_errors

_SHOWN: Final = 5
"""Most websites that :meth:`Blocklist.description` names."""


class BlocklistConfig(Settings):
    """The file of the blocklist, and how long a website stays on it."""

    file: Annotated[Path, AfterValidator(Path.absolute)] | None = None
    """The file; without one, no website is excluded and nothing is recorded."""

    hours: float = Field(default=12.0, ge=0)
    """How long a website is excluded after it blocked an attempt, hours."""


class Block(msgspec.Struct, frozen=True):
    """A website that blocked an attempt.

    Attributes:
        host: as returned by :func:`webgym.core.websites.host_of`.
        at: Unix time, seconds.
        reason: the judge's reason.
    """

    host: str
    at: float
    reason: str = ""


class Blocklist:
    """The hosts that have recently blocked the agent. Its methods do blocking I/O: call them in a thread.

    Args:
        config: the file, and how long entries last.
        now: returns the Unix time, seconds.
    """

    def __init__(self, config: BlocklistConfig, now: Callable[[], float] = time.time) -> None:
        self._config = config
        self._now = now

    def blocked(self) -> dict[str, Block]:
        """The last block of every excluded host.

        Raises:
            StoreError: the file exists but cannot be read. Invalid lines, such as of a writer that was
                killed, are skipped.
        """
        file = self._config.file
        if file is None or not file.exists():
            return {}
        blocks: dict[str, Block] = {}
        since = self._now() - self._config.hours * 3600
        with disk_errors(f"reading {file}"), file.open("rb") as lines:
            for line in lines:
                try:
                    block = msgspec.json.decode(line, type=Block)
                except (ValueError, RecursionError):
                    continue
                if block.at > since and block.at >= blocks.get(block.host, block).at:
                    blocks[block.host] = block
        return blocks

    def description(self) -> str:
        """The excluded hosts and until when, as text, the latest first; empty if there are none.

        Raises:
            StoreError: as for :meth:`blocked`.
        """
        blocks = sorted(self.blocked().values(), key=lambda block: -block.at)
        items = []
        for block in blocks:
            end = datetime.fromtimestamp(block.at + self._config.hours * 3600, UTC)
            items.append(f"{block.host} until {end:%Y-%m-%d %H:%M} UTC")
        others = [f"and {len(items) - _SHOWN:,} others"] if len(items) > _SHOWN else []
        return ", ".join(items[:_SHOWN] + others)

    def is_blocked(self, website: str) -> bool:
        """Whether a website is currently excluded."""
        return host_or_text(website) in self.blocked()

    def note(self, website: str, trajectory: Trajectory) -> None:
        """Record the host that blocked an attempt at a task of this website, if one did.

        Raises:
            StoreError: the file cannot be written.
        """
        if trajectory.outcome is not Outcome.BLOCKED:
            return
        if trajectory.verdict is not None:
            blocked = trajectory.verdict.blocked
            self.add(blocking_host(website, trajectory.episode, blocked), blocked.reason)
        else:  # its start page
            failure = trajectory.episode.failure
            self.add(website, failure.message if failure else "")

    def add(self, website: str, reason: str) -> None:
        """Record that a website's host blocked an attempt now.

        Raises:
            StoreError: the file cannot be written.
        """
        file = self._config.file
        if file is None:
            return
        with disk_errors(f"writing {file}"):
            file.parent.mkdir(parents=True, exist_ok=True)
            log = Log(file)
            try:
                block = Block(host_or_text(website), self._now(), reason)
                # Also before the line, in case a killed writer has left an incomplete one.
                log.append(b"\n" + msgspec.json.encode(block) + b"\n", durable=True)
            finally:
                log.close()
