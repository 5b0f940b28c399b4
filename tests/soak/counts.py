"""Counts of sessions, errors and faults, and whether they add up."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import dataclass, field

from webgym.core.errors import BrowserError, ServerError, WebGymError

log = logging.getLogger(__name__)

_TOO_GENERAL = (WebGymError, ServerError, BrowserError)
"""Types of errors that do not say what failed."""


@dataclass
class Counts:
    """Counts of one soak.

    Attributes:
        opened: sessions that were opened.
        closed: sessions that were closed by their client without an error.
        lost: sessions that ended with an error, by its code.
        vanished: sessions whose client disconnected without closing them.
        refused: requests for a session that failed, by the code of the error.
        untyped: errors without a type of their own, as text.
        steps: calls that succeeded.
        pages: pages that were opened, by their group.
        notices: notices in observations, by kind.
        faults: faults, by kind.
        half_open: connections that stopped in the middle of a request.
        hung_up_on: half-open connections that the server closed.
        slowest: time of the slowest call in seconds, and its name.
    """

    opened: int = 0
    closed: int = 0
    lost: Counter[str] = field(default_factory=Counter)
    vanished: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    untyped: list[str] = field(default_factory=list)
    steps: int = 0
    pages: Counter[str] = field(default_factory=Counter)
    notices: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    half_open: int = 0
    hung_up_on: int = 0
    slowest: tuple[float, str] = (0.0, "")

    @property
    def live(self) -> int:
        """Sessions whose end has not been counted yet."""
        return self.opened - self.closed - self.lost.total() - self.vanished

    def code(self, error: Exception) -> str:
        """The code of an error; errors without a type of their own are added to ``untyped``."""
        if isinstance(error, WebGymError) and type(error) not in _TOO_GENERAL:
            return error.code
        self.untyped.append(f"{type(error).__name__}: {error}")
        log.error("an error without a type", exc_info=error)
        return "untyped"

    def count_lost(self, error: Exception) -> None:
        """Count a session that ended with an error."""
        self.lost[self.code(error)] += 1

    def count_refused(self, error: Exception) -> None:
        """Count a request for a session that failed."""
        self.refused[self.code(error)] += 1

    def count_time(self, seconds: float, name: str) -> None:
        """Record the time of a call."""
        self.slowest = max(self.slowest, (seconds, name))

    def problems(self) -> list[str]:
        """What does not add up after the last client."""
        problems = [f"an error without a type: {text}" for text in self.untyped]
        if self.live:
            problems.append(
                f"{self.opened} sessions opened, but {self.closed} closed, {self.lost.total()} lost and "
                f"{self.vanished} dropped by their client: {self.live} unaccounted for"
            )
        if self.hung_up_on != self.half_open:
            problems.append(
                f"{self.half_open - self.hung_up_on} half-open connections were not closed by the server"
            )
        return problems
