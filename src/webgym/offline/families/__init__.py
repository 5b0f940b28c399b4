"""The kinds of websites of the offline web: a specification each, in a TOML file beside this one.

:mod:`webgym.offline.engine.spec` says what a specification holds.
"""

from __future__ import annotations

import random

from webgym.offline import names
from webgym.offline.engine.specified import SpecifiedWebsite


class Lettings(SpecifiedWebsite, spec="lettings.toml"):
    """Letting agencies: flats with rents and charges, viewings and questions."""

    family = "lettings"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Addresses."""
        streets = ("Road", "Street", "Lane", "Avenue", "Close", "Terrace")
        roads = [f"{town} {rng.choice(streets)}" for town in names.towns(rng, count)]
        return [f"{rng.randint(2, 98)} {road}" for road in roads]


def _family(name: str) -> type[SpecifiedWebsite]:
    """The family of a specification that says everything, its items' names too."""
    members = {"__module__": __name__, "family": name}
    return type(name.capitalize(), (SpecifiedWebsite,), members, spec=f"{name}.toml")


FAMILIES: tuple[type[SpecifiedWebsite], ...] = (
    *map(_family, ("encyclopedia", "events", "forum", "government", "jobs", "recipes", "shop", "timetable")),
    *map(_family, ("bank", "clinic")),
    Lettings,
    *map(_family, ("sights", "tracker")),
)
"""All, in the order in which the websites that misbehave are made of them."""
