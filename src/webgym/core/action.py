"""What an agent can do (paper §5, appendix C): seven actions, in two interaction modes.

In *coordinates* mode a target is a point on a 0-1000 grid over the viewport, whatever its size in
pixels. In *marks* mode (Set-of-Marks) a target is the number drawn on an element.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

GRID = 1000
"""Coordinates run from 0 to this, left to right and top to bottom (Qwen3-VL's convention)."""

Mode: TypeAlias = Literal["coordinates", "marks"]
Direction: TypeAlias = Literal["up", "down"]

MAX_WAIT_SECONDS = 10.0
"""The longest ``wait`` that is carried out; longer ones are cut to it."""


class Target(msgspec.Struct, frozen=True, omit_defaults=True):
    """Where an action lands: exactly one of a grid point or an element number.

    Attributes:
        coordinate: ``(x, y)`` on the 0-1000 grid.
        element: the number of a marked element in the observation that the agent saw.
    """

    coordinate: tuple[float, float] | None = None
    element: int | None = None

    def __post_init__(self) -> None:
        if (self.coordinate is None) == (self.element is None):
            raise ValueError("a target is either a coordinate or an element number")
        if self.coordinate is not None and not all(0 <= value <= GRID for value in self.coordinate):
            raise ValueError(f"a coordinate lies between 0 and {GRID}")


class LeftClick(msgspec.Struct, frozen=True, tag_field="name", tag="left_click"):
    """Press and release the left mouse button on the target."""

    target: Target


class Type(msgspec.Struct, frozen=True, tag_field="name", tag="type"):
    """Click the target, clear it, type the text, press Enter."""

    target: Target
    text: str


class Scroll(msgspec.Struct, frozen=True, tag_field="name", tag="scroll"):
    """Turn the mouse wheel over the middle of the viewport."""

    direction: Direction


class Wait(msgspec.Struct, frozen=True, tag_field="name", tag="wait"):
    """Let the page go on for ``time`` seconds."""

    time: float


class GoBack(msgspec.Struct, frozen=True, tag_field="name", tag="go_back"):
    """Go one entry back in the tab's history."""


class Navigate(msgspec.Struct, frozen=True, tag_field="name", tag="navigate"):
    """Open a URL in the tab."""

    url: str


class Answer(msgspec.Struct, frozen=True, tag_field="name", tag="answer"):
    """End the attempt with this text. Never sent to a browser."""

    text: str


BrowserAction: TypeAlias = LeftClick | Type | Scroll | Wait | GoBack | Navigate
"""The actions that a browser carries out."""

Action: TypeAlias = BrowserAction | Answer
