"""The kinds of websites of the offline web: a specification each, and names of items for some.

The specifications lie beside this file, a TOML file per family (:mod:`webgym.offline.engine.spec`).
"""

from __future__ import annotations

import random
from itertools import product

from webgym.offline import names
from webgym.offline.engine.specified import SpecifiedWebsite


class Encyclopedia(SpecifiedWebsite, spec="encyclopedia.toml"):
    """Encyclopedias of one subject: entries with figures and text, versions, editors and collections."""

    family = "encyclopedia"


class Events(SpecifiedWebsite, spec="events.toml"):
    """Organisers of one kind: events, venues, reviews, tickets."""

    family = "events"


class Forum(SpecifiedWebsite, spec="forum.toml"):
    """Forums about one hobby: threads, posts, members."""

    family = "forum"


class Government(SpecifiedWebsite, spec="government.toml"):
    """Public authorities: services, offices, decisions, reports and permits."""

    family = "government"


class Jobs(SpecifiedWebsite, spec="jobs.toml"):
    """Job boards of one sector: jobs, employers, pay grades, applications."""

    family = "jobs"


class Recipes(SpecifiedWebsite, spec="recipes.toml"):
    """Cooking websites of one cuisine: recipes, cooks, charts."""

    family = "recipes"


class Shop(SpecifiedWebsite, spec="shop.toml"):
    """Shops of one sector: articles with reviews and brands, stores, a cart and an account."""

    family = "shop"


class Timetable(SpecifiedWebsite, spec="timetable.toml"):
    """Timetables: trains, ships, coaches and flights with their stops, fares, stations and notices."""

    family = "timetable"


class Clinic(SpecifiedWebsite, spec="clinic.toml"):
    """Clinics: doctors, their hours and fees, treatments, reviews and appointments."""

    family = "clinic"


_ACCOUNTS = (
    "Amber Azure Classic Cobalt Compact Crystal Double Easy Emerald First Flex Golden Green Level".split(),
    "Start Plus Saver Reserve Prime Direct Choice Partner Horizon Compass".split(),
)


class Bank(SpecifiedWebsite, spec="bank.toml"):
    """Banks: accounts with fees, interest and conditions, applications and advice."""

    family = "bank"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Names of accounts."""
        return rng.sample([f"{first} {second}" for first, second in product(*_ACCOUNTS)], count)


_STREETS = ("Road", "Street", "Lane", "Avenue", "Close", "Terrace")


class Lettings(SpecifiedWebsite, spec="lettings.toml"):
    """Letting agencies: flats with rents and charges, viewings and questions."""

    family = "lettings"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Addresses."""
        roads = [f"{town} {rng.choice(_STREETS)}" for town in names.towns(rng, count)]
        return [f"{rng.randint(2, 98)} {road}" for road in roads]


_PLACES = "Hall House Court Park Rock Tower Grounds Works Terrace Heights Springs Quay".split()


class Sights(SpecifiedWebsite, spec="sights.toml"):
    """Guides to a region: places to visit with prices, hours and ways, tickets and tours."""

    family = "sights"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Names of places."""
        return [f"{town} {rng.choice(_PLACES)}" for town in names.towns(rng, count)]


_ISSUES = (
    (
        "Crash", "Blank page", "Wrong total", "Slow response", "Lost settings", "Flickering", "Endless loop",
        "Typo", "Broken link", "Missing icon", "Double entry", "Time-out", "Garbled text", "Memory leak",
    ),
    (
        "when saving a draft", "after sign-in", "in the side panel", "on large files", "with two windows",
        "while printing", "in the start menu", "after an update", "on slow networks", "in the preview",
        "when sorting columns", "with empty lists",
    ),
)  # fmt: skip


class Tracker(SpecifiedWebsite, spec="tracker.toml"):
    """Issue trackers: issues with components, people and plans, comments and requests for changes."""

    family = "tracker"

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Summaries of issues."""
        return rng.sample([f"{what} {when}" for what, when in product(*_ISSUES)], count)


FAMILIES: tuple[type[SpecifiedWebsite], ...] = (
    Encyclopedia,
    Events,
    Forum,
    Government,
    Jobs,
    Recipes,
    Shop,
    Timetable,
    Bank,
    Clinic,
    Lettings,
    Sights,
    Tracker,
)
"""All, in the order in which the websites that misbehave are made of them."""
