"""The state of the offline web's visitors, limited in number."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

REMEMBERED = 50_000
"""Most visitor states that are kept; the least recently used are dropped first. A state is about 1 kB."""


class Visitors:
    """Stores the state per visitor and website.

    A visitor is identified by a cookie. The collector sets it for each attempt, so that it can request the
    state afterwards; a browser without it gets a random one.
    """

    def __init__(self) -> None:
        self._states: OrderedDict[tuple[str, str], dict[str, Any]] = OrderedDict()

    def state(self, visitor: str, host: str) -> dict[str, Any]:
        """The state, created if there is none; the caller may modify it."""
        key = (visitor, host)
        state = self._states.setdefault(key, {})
        self._states.move_to_end(key)
        if len(self._states) > REMEMBERED:
            self._states.popitem(last=False)
        return state

    def known(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a visitor, or ``None`` if there is none."""
        return self._states.get((visitor, host))
