"""The kinds of websites of the offline web, one package each.

A family's package defines its :class:`~webgym.offline.website.Website`; the modules beside it hold its
catalogue, its pages' helpers and its tasks, TOML files its words. The private modules here are shared.
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
from webgym.offline.website import Website

SPECIFIED: tuple[type[SpecifiedWebsite], ...] = (
    Bank,
    Clinic,
    Events,
    Forum,
    Government,
    Jobs,
    Lettings,
    Recipes,
    Shop,
    Sights,
    Tracker,
)
"""Families that follow from a specification alone."""

FAMILIES: tuple[type[Website], ...] = (
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
