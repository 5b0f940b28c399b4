"""Letting agencies: flats with rents and charges, viewings and questions."""

from __future__ import annotations

import random
from typing import ClassVar

from webgym.offline import names
from webgym.offline.engine.specified import SpecifiedWebsite

_STREETS = ("Road", "Street", "Lane", "Avenue", "Close", "Terrace")


class Lettings(SpecifiedWebsite):
    """A letting agency."""

    family: ClassVar[str] = "lettings"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Addresses."""
        roads = [f"{town} {rng.choice(_STREETS)}" for town in names.towns(rng, count)]
        return [f"{rng.randint(2, 98)} {road}" for road in roads]
