"""The kinds of websites of the offline web, one package each.

A family is a ``spec.toml`` (:mod:`webgym.offline.engine.spec`) and a class that may name its items.
"""

from __future__ import annotations

from webgym.offline.engine.specified import SpecifiedWebsite
from webgym.offline.families.bank import Bank
from webgym.offline.families.clinic import Clinic
from webgym.offline.families.encyclopedia import Encyclopedia
from webgym.offline.families.events import Events
from webgym.offline.families.forum import Forum
from webgym.offline.families.government import Government
from webgym.offline.families.jobs import Jobs
from webgym.offline.families.lettings import Lettings
from webgym.offline.families.recipes import Recipes
from webgym.offline.families.shop import Shop
from webgym.offline.families.sights import Sights
from webgym.offline.families.timetable import Timetable
from webgym.offline.families.tracker import Tracker

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
