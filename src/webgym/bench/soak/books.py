"""What was done, what came of it, and whether it adds up."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import dataclass, field

from webgym.core.errors import BrowserError, ServerError, WebGymError

log = logging.getLogger(__name__)

_TOO_GENERAL = (WebGymError, ServerError, BrowserError)
"""Say that something failed, not what."""


@dataclass
class Books:
    """Counts of one soak.

    Attributes:
        opened: sessions that a client was given.
        closed: those that it gave back, alive to the end.
        lost: those that ended with an error, by its code.
        vanished: those whose client went without goodbye.
        refused: calls for a session that came to an error instead, by its code.
        untyped: errors of no type of their own, as text.
        steps: calls that were answered.
        pages: opened, by their group.
        notices: that observations brought, by kind.
        faults: that happened, by kind.
        half_open: connections that stopped halfway, and those of them that the server has hung up on.
        slowest: the longest that a call took, seconds, and which.
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
        """Sessions whose end is not written down yet."""
        return self.opened - self.closed - self.lost.total() - self.vanished

    def name(self, error: Exception) -> str:
        """An error's code. One that has no type of its own is written down as such."""
        if isinstance(error, WebGymError) and type(error) not in _TOO_GENERAL:
            return error.code
        self.untyped.append(f"{type(error).__name__}: {error}")
        log.error("an error without a type", exc_info=error)
        return "untyped"

    def lose(self, error: Exception) -> None:
        """A session ended with this error."""
        self.lost[self.name(error)] += 1

    def refuse(self, error: Exception) -> None:
        """No session was to be had."""
        self.refused[self.name(error)] += 1

    def took(self, seconds: float, what: str) -> None:
        """A call took so long."""
        self.slowest = max(self.slowest, (seconds, what))

    def problems(self) -> list[str]:
        """What does not add up, when all is over."""
        found = [f"an error without a type: {text}" for text in self.untyped]
        if self.live:
            found.append(
                f"{self.opened} sessions opened, but {self.closed} closed, {self.lost.total()} lost and "
                f"{self.vanished} left: {self.live} unaccounted for"
            )
        if self.hung_up_on != self.half_open:
            found.append(f"{self.half_open - self.hung_up_on} half-open connections were not hung up on")
        return found
