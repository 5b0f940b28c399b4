"""One page of the corpus: what it is, where it is, and what is done with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from webgym.core.action import BrowserAction, LeftClick, Navigate, Scroll, Target, Type

Kind: TypeAlias = Literal["open", "click", "type", "scroll"]
Group: TypeAlias = Literal[
    "plain",
    "requests",
    "streams",
    "redirects",
    "scripts",
    "timers",
    "rendering",
    "endless",
    "apps",
    "fleeting",
    "late",
]

_MIDDLE = (0.1, 0.05)
"""Where ``#go`` is, as a share of the viewport."""


@dataclass(frozen=True, slots=True)
class HardPage:
    """One page, and what is done with it.

    Attributes:
        name: also its path.
        group: what is hard about it.
        says: in a few words, what happens after the action.
        body: HTML after the head.
        action: what the clock starts with; for all but ``open`` the page is opened before.
        path: where the action ``open`` leads, if not to the page itself.
    """

    name: str
    group: Group
    says: str
    body: str
    action: Kind = "open"
    path: str = ""

    def url(self, origin: str, pace: float = 1.0) -> str:
        """Where to open it."""
        path = self.path or f"/p/{self.name}"
        return f"{origin}{path}{'&' if '?' in path else '?'}pace={pace}"

    def act(self, origin: str, pace: float = 1.0) -> BrowserAction:
        """The action that the clock starts with."""
        x, y = _MIDDLE
        target = Target(coordinate=(x * 1000, y * 1000))
        match self.action:
            case "open":
                return Navigate(self.url(origin, pace))
            case "click":
                return LeftClick(target)
            case "type":
                return Type(target, "settle")
            case "scroll":
                return Scroll("down")
