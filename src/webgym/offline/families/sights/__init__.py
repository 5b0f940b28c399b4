"""Guides to a region: places to visit with prices, hours and ways, tickets and tours."""

from __future__ import annotations

import random
from typing import ClassVar

from webgym.offline import names
from webgym.offline.engine.specified import SpecifiedWebsite

_SECOND = "Hall House Court Park Rock Tower Grounds Works Terrace Heights Springs Quay".split()


class Sights(SpecifiedWebsite):
    """A visitors' guide."""

    family: ClassVar[str] = "sights"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Names of places."""
        return [f"{town} {rng.choice(_SECOND)}" for town in names.towns(rng, count)]
