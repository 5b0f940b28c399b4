"""What the next observation of an episode reports, whichever of its windows it comes from."""

from __future__ import annotations

import contextlib

from webgym.core.observation import Fault, Notice, NoticeKind

NOTICES_PER_OBSERVATION = 12
"""Most notices in an observation; further ones are only counted."""


class Notices:
    """The notices and faults that no observation has reported yet."""

    def __init__(self) -> None:
        self._notices: list[Notice] = []
        self._more = 0
        self._faults: list[Fault] = []
        self._happened: list[Notice] = []

    def begin_action(self) -> None:
        """Start an action: nothing has happened since."""
        self._happened.clear()

    def add(self, kind: NoticeKind, text: str) -> None:
        """Add a notice to the next observation."""
        if len(self._happened) < NOTICES_PER_OBSERVATION:
            self._happened.append(Notice(kind, text))
        if len(self._notices) < NOTICES_PER_OBSERVATION:
            self._notices.append(Notice(kind, text))
        else:
            self._more += 1

    def drop(self, kind: NoticeKind, text: str) -> None:
        """Take a notice back that no observation has reported yet, if it is there."""
        for notices in (self._happened, self._notices):
            with contextlib.suppress(ValueError):
                notices.remove(Notice(kind, text))

    def add_fault(self, fault: Fault) -> None:
        """Add a fault. The loss of a renderer is always kept."""
        if fault.kind == "renderer" or len(self._faults) < NOTICES_PER_OBSERVATION:
            self._faults.append(fault)

    @property
    def happened(self) -> tuple[Notice, ...]:
        """The notices since the last action began, which the next observation contains too."""
        return tuple(self._happened)

    def take(self) -> tuple[Notice, ...]:
        """The notices since the last call."""
        notices, more = self._notices, self._more
        if more:
            last = notices[-1]
            notices[-1] = Notice(last.kind, f"{last.text} (and {more} more notices)")
        self._notices, self._more = [], 0
        return tuple(notices)

    def take_faults(self) -> tuple[Fault, ...]:
        """The faults since the last call."""
        faults, self._faults = self._faults, []
        return tuple(faults)
