"""The type of a page: its content, its address and the action on it."""

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
"""Position of ``#go``, as shares of the viewport."""


@dataclass(frozen=True, slots=True)
class HardPage:
    """A page and the action on it.

    Attributes:
        name: its name and path.
        group: the kind of difficulty.
        says: a short description of what happens after the action.
        body: HTML after the head.
        action: the action that is timed; for all but ``open``, the page is opened before.
        path: the target of the action ``open``, if it is not the page itself.
    """

    name: str
    group: Group
    says: str
    body: str
    action: Kind = "open"
    path: str = ""

    def url(self, origin: str, pace: float = 1.0) -> str:
        """The URL of the page."""
        path = self.path or f"/p/{self.name}"
        return f"{origin}{path}{'&' if '?' in path else '?'}pace={pace}"

    def act(self, origin: str, pace: float = 1.0) -> BrowserAction:
        """The action that is timed."""
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
