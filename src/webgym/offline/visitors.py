"""What the offline web remembers of its visitors, bounded in number."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

REMEMBERED = 50_000
"""Visitor states kept at most; the longest unused goes first. A state is about 1 kB."""


class Visitors:
    """State per visitor and website.

    A visitor is the value of one cookie. The collector chooses it, one per attempt, so that it can ask
    for the state afterwards; a browser that comes without one is given a random one.
    """

    def __init__(self) -> None:
        self._states: OrderedDict[tuple[str, str], dict[str, Any]] = OrderedDict()

    def state(self, visitor: str, host: str) -> dict[str, Any]:
        """The state, new if there was none; the caller may change it in place."""
        key = (visitor, host)
        state = self._states.setdefault(key, {})
        self._states.move_to_end(key)
        if len(self._states) > REMEMBERED:
            self._states.popitem(last=False)
        return state

    def known(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a visitor who was here, or ``None``."""
        return self._states.get((visitor, host))
