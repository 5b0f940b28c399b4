"""Issue trackers: issues with components, people and plans, comments and requests for changes."""

from __future__ import annotations

import random
from itertools import product
from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite

_WHAT = (
    "Crash", "Blank page", "Wrong total", "Slow response", "Lost settings", "Flickering", "Endless loop",
    "Typo", "Broken link", "Missing icon", "Double entry", "Time-out", "Garbled text", "Memory leak",
)  # fmt: skip
_WHEN = (
    "when saving a draft", "after sign-in", "in the side panel", "on large files", "with two windows",
    "while printing", "in the start menu", "after an update", "on slow networks", "in the preview",
    "when sorting columns", "with empty lists",
)  # fmt: skip


class Tracker(SpecifiedWebsite):
    """An issue tracker."""

    family: ClassVar[str] = "tracker"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Summaries of issues."""
        return rng.sample([f"{what} {when}" for what, when in product(_WHAT, _WHEN)], count)
