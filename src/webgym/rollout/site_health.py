"""Which websites answer: ``sites.jsonl``, from which the sampler learns whom to leave out for a while.

Rows are sums of visits, so the file is both a log and a table: every visit appends a row, and rows of the
same host, identity and route add up, whoever wrote them. :meth:`SiteHealth.tidy` leaves one row of each.
Hosts are compared, not websites: another host of the same website may refuse nobody.

A website that refused is left out for 12 h (paper §4; the authors' code), and one that was dead for a time
that grows with every visit that finds it dead again.
"""

from __future__ import annotations

import fcntl
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from pydantic import AfterValidator, Field

from webgym.core.outcome import Outcome
from webgym.core.settings import Settings
from webgym.core.trajectory import Trajectory
from webgym.core.websites import host_or_text
from webgym.judge.blocking import blocking_host
from webgym.store.files import disk_errors, write_lines

SLOW_SECONDS: Final = 10.0
"""A start page that takes longer is slow."""

DEAD_HOURS: Final = (1, 6, 24, 168)
"""How long a website is left out that was found dead once, twice, three times and more in a row, hours."""

_SHOWN: Final = 5
"""Most websites that :meth:`SiteHealth.description` names."""


class HealthConfig(Settings):
    """The record of which websites answer."""

    file: Annotated[Path, AfterValidator(Path.absolute)] | None = None
    """A file that runs share, such as the one of ``webgym tasks probe``, beside a run's own ``sites.jsonl``:
    what it says refuses or is dead is not attempted for now, except by test tasks."""

    refused_hours: float = Field(default=12.0, ge=0)
    """How long a website is left out after it refused an attempt, hours."""


class SiteRow(msgspec.Struct, frozen=True, omit_defaults=True):
    """Visits of a host with one identity and route.

    Attributes:
        host: as returned by :func:`webgym.core.websites.host_of`.
        identity, route: see :class:`~webgym.core.trajectory.Arrival`.
        opened, refused, dead: number of visits by what they found; one that was let in and kept out later
            counts as both opened and refused.
        slow: number of visits whose start page took longer than :data:`SLOW_SECONDS`.
        has_login_wall: whether the last visit that was let in met one.
        bytes: sent to and received from the host.
        state: what the last visit found.
        code: why it was dead; else empty.
        why: the same, or why it refused, for people.
        dead_in_a_row: how often it was found dead since it last was not, without visits before the last
            expiry.
        refused_at, dead_at: when it last was, Unix time, seconds; 0 if it never was.
        seen: when it was last visited, Unix time, seconds.
    """

    host: str
    identity: str = ""
    route: str = "direct"
    opened: int = 0
    refused: int = 0
    dead: int = 0
    slow: int = 0
    has_login_wall: bool = False
    bytes: int = 0
    state: Literal["open", "refused", "dead"] = "open"
    code: str = ""
    why: str = ""
    dead_in_a_row: int = 0
    refused_at: float = 0.0
    dead_at: float = 0.0
    seen: float = 0.0

    @property
    def key(self) -> tuple[str, str, str]:
        """What tells it from other rows."""
        return self.host, self.identity, self.route

    @property
    def dead_until(self) -> float:
        """Until when it counts as dead, Unix time, seconds; 0 if it is not."""
        if self.dead_in_a_row and self.code == "robots":
            return math.inf  # a wish does not pass by itself
        nth = min(self.dead_in_a_row, len(DEAD_HOURS))
        return self.dead_at + DEAD_HOURS[nth - 1] * 3600 if nth else 0.0

    def __add__(self, later: SiteRow) -> SiteRow:
        """The sum with visits that came later, or at the same time."""
        in_a_row, is_other = later.dead_in_a_row, later.opened or later.refused
        if later.dead and not is_other:
            is_again = later.dead_at >= self.dead_until
            in_a_row = self.dead_in_a_row + in_a_row if is_again else max(self.dead_in_a_row, in_a_row)
        was_let_in = later if later.opened else self
        return msgspec.structs.replace(
            later,
            opened=self.opened + later.opened,
            refused=self.refused + later.refused,
            dead=self.dead + later.dead,
            slow=self.slow + later.slow,
            has_login_wall=was_let_in.has_login_wall,
            bytes=self.bytes + later.bytes,
            dead_in_a_row=in_a_row,
            refused_at=max(self.refused_at, later.refused_at),
            dead_at=max(self.dead_at, later.dead_at),
            seen=max(self.seen, later.seen),
        )


class SiteHealth:
    """The record of which websites answer. Its methods do blocking I/O: call them in a thread.

    Args:
        config: the shared file, and how long a website that refused is left out.
        own: the run's own file.
        identity: of the browsers: others may be refused where these are not; ``None`` for any.
        now: returns the Unix time, seconds.
    """

    def __init__(
        self,
        config: HealthConfig,
        own: Path | None = None,
        identity: str | None = None,
        now: Callable[[], float] = time.time,
    ) -> None:
        self._config = config
        self._files = [file for file in (config.file, own) if file is not None]
        self._identity = identity
        self._now = now

    def rows(self) -> dict[tuple[str, str, str], SiteRow]:
        """All rows, of the shared file if there is one.

        Raises:
            StoreError: the file exists but cannot be read. Invalid lines, such as of a writer that was
                killed, are skipped.
        """
        return _read(self._files[0]) if self._files and self._files[0].exists() else {}

    def blocked(self) -> dict[str, SiteRow]:
        """The hosts to leave out for now: those that refused this identity, and those that are dead.

        Raises:
            StoreError: as for :meth:`rows`.
        """
        return {row.host: row for row in self.rows().values() if self._until(row) > self._now()}

    def asked(self, hours: float | None) -> set[str]:
        """The hosts that this identity asked within so many hours; or ever, if there is no number."""
        since = self._now() - hours * 3600 if hours is not None else 0.0
        rows = self.rows().values()
        return {row.host for row in rows if self._identity in (None, row.identity) and row.seen > since}

    def _until(self, row: SiteRow) -> float:
        is_refused = row.refused_at and (not row.identity or self._identity in (None, row.identity))
        return max(row.dead_until, row.refused_at + self._config.refused_hours * 3600 if is_refused else 0.0)

    def description(self) -> str:
        """The hosts that are left out and until when, as text, the latest first; empty if there are none.

        Raises:
            StoreError: as for :meth:`rows`.
        """
        rows = sorted(self.blocked().values(), key=lambda row: -row.seen)
        items = [f"{row.host} {_ends(self._until(row))}" for row in rows[:_SHOWN]]
        others = [f"and {len(rows) - _SHOWN:,} others"] if len(rows) > _SHOWN else []
        return ", ".join(items + others)

    def note(self, website: str, trajectory: Trajectory) -> None:
        """Record what an attempt at a task of this website found there.

        Raises:
            StoreError: a file cannot be written.
        """
        arrival, now, host = trajectory.episode.arrival, self._now(), host_or_text(website)
        if arrival is not None:
            observations = trajectory.episode.observations
            is_refused, is_dead = arrival.state == "refused", arrival.state == "dead"
            row = SiteRow(
                host,
                arrival.identity,
                arrival.route,
                opened=int(arrival.state == "open"),
                refused=int(is_refused),
                dead=int(is_dead),
                slow=int(arrival.seconds > SLOW_SECONDS),
                has_login_wall=arrival.has_login_wall,
                bytes=sum(
                    size
                    for seen in observations
                    for name, size in seen.bytes.items()
                    if host_or_text(name) == host
                ),
                state=arrival.state,
                code=arrival.code,
                why=arrival.why,
                dead_in_a_row=int(is_dead),
                refused_at=now * is_refused,
                dead_at=now * is_dead,
                seen=now,
            )
            self.add(row)
        self.note_block(website, trajectory)

    def note_block(self, website: str, trajectory: Trajectory) -> None:
        """Record the host that blocked an attempt later, by its verdict, if one did.

        Raises:
            StoreError: a file cannot be written.
        """
        verdict, arrival, now = trajectory.verdict, trajectory.episode.arrival, self._now()
        if trajectory.outcome is not Outcome.BLOCKED or verdict is None:
            return
        host = blocking_host(website, trajectory.episode, verdict.blocked)
        who = (arrival.identity, arrival.route) if arrival else ("", "direct")
        why = verdict.blocked.reason
        self.add(SiteRow(host, *who, refused=1, state="refused", why=why, refused_at=now, seen=now))

    def add(self, row: SiteRow) -> None:
        """Record visits.

        Raises:
            StoreError: a file cannot be written.
        """
        for file in self._files:
            with disk_errors(f"writing {file}"), _locked(file) as fd:
                # Also before the line, in case a killed writer has left an incomplete one.
                os.write(fd, b"\n" + msgspec.json.encode(row) + b"\n")

    def tidy(self) -> None:
        """Leave one row of each host, identity and route in the files.

        Raises:
            StoreError: a file cannot be read or written.
        """
        for file in self._files:
            if file.exists():
                with disk_errors(f"writing {file}"), _locked(file):
                    write_lines(file, (msgspec.json.encode(row) + b"\n" for row in _read(file).values()))


def _ends(until: float) -> str:
    return (
        "for good" if until == math.inf else f"until {datetime.fromtimestamp(until, UTC):%Y-%m-%d %H:%M} UTC"
    )


def _read(file: Path) -> dict[tuple[str, str, str], SiteRow]:
    decoder, rows = msgspec.json.Decoder(SiteRow), dict[tuple[str, str, str], SiteRow]()
    with disk_errors(f"reading {file}"), file.open("rb") as lines:
        for line in lines:
            if not line.strip():
                continue
            try:
                row = decoder.decode(line)
            except (ValueError, RecursionError):
                continue
            rows[row.key] = rows[row.key] + row if row.key in rows else row
    return rows


@contextmanager
def _locked(file: Path) -> Iterator[int]:
    """The file, open to append to it; nobody else writes it until the block ends."""
    file.parent.mkdir(parents=True, exist_ok=True)
    while True:
        fd = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            with suppress(OSError):  # NFS may lock nothing: lines still are whole there
                fcntl.flock(fd, fcntl.LOCK_EX)
            if os.path.samestat(os.fstat(fd), file.stat()):  # not one that was tidied away meanwhile
                yield fd
                return
        finally:
            os.close(fd)
