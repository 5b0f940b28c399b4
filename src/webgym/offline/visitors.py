"""The state of the offline web's visitors, limited in number."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

REMEMBERED = 50_000
"""Most visitor states that are kept; the least recently used are dropped first. A state is about 1 kB."""


class Visitors:
    """Stores the state per visitor and website.

    A visitor is identified by a cookie. The collector sets it for each attempt, so that it can request the
    state afterwards; a browser without it gets a random one. A state that is lost, by a restart or as the
    least recently used one, begins again, and is not reported: what the visitor did before is missing in it.
    """

    def __init__(self) -> None:
        self._states: OrderedDict[tuple[str, str], dict[str, Any]] = OrderedDict()
        self._incomplete: set[tuple[str, str]] = set()

    def state(self, visitor: str, host: str, *, was_served: bool = False) -> dict[str, Any]:
        """The state, created if there is none; the caller may modify it.

        Args:
            visitor: the visitor.
            host: the website.
            was_served: whether the website has served the visitor before.
        """
        key = (visitor, host)
        if was_served and key not in self._states:
            self._incomplete.add(key)
        state = self._states.setdefault(key, {})
        self._states.move_to_end(key)
        if len(self._states) > REMEMBERED:
            self._incomplete.discard(self._states.popitem(last=False)[0])
        return state

    def known(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a visitor, or ``None`` if there is none, or a part of it was lost."""
        key = (visitor, host)
        return None if key in self._incomplete else self._states.get(key)
