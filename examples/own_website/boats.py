"""A family of websites of your own: what they know is in spec.toml, and here is how their boats are called.

Run it to have a few of them checked: every task is played in Chromium, and must not be solved by less.
"""

import asyncio
import random

from webgym.offline.engine.specified import SpecifiedWebsite
from webgym.offline.names import GIVEN, towns
from webgym.testing import check_family


class Boats(SpecifiedWebsite):
    """A boat rental."""

    family = "boats"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Names of boats: each once."""
        return [f"{rng.choice(GIVEN)} of {town}" for town in towns(rng, count)]


if __name__ == "__main__":
    faults = asyncio.run(check_family(Boats, websites=1, tasks_per_website=10))
    print("\n".join(faults) or "no fault was found")
