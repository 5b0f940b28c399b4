"""Banks: accounts with fees, interest and conditions, applications and advice."""

from __future__ import annotations

import random
from itertools import product
from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite

_FIRST = (
    "Amber Azure Classic Cobalt Compact Crystal Double Easy Emerald First Flex Golden Green Level".split()
)
_SECOND = "Start Plus Saver Reserve Prime Direct Choice Partner Horizon Compass".split()


class Bank(SpecifiedWebsite):
    """A bank."""

    family: ClassVar[str] = "bank"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Names of accounts."""
        return rng.sample([f"{first} {second}" for first, second in product(_FIRST, _SECOND)], count)
