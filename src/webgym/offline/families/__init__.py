"""The kinds of websites of the offline web, one package each.

A family's package defines its :class:`~webgym.offline.website.Website`; the modules beside it hold its
catalogue, its pages' helpers and its tasks, TOML files its words. The private modules here are shared.
"""

from __future__ import annotations

from webgym.offline.families.encyclopedia import Encyclopedia
from webgym.offline.families.events import Events
from webgym.offline.families.forum import Forum
from webgym.offline.families.government import Government
from webgym.offline.families.jobs import Jobs
from webgym.offline.families.recipes import Recipes
from webgym.offline.families.shop import Shop
from webgym.offline.families.timetable import Timetable
from webgym.offline.website import Website

FAMILIES: tuple[type[Website], ...] = (
    Encyclopedia,
    Events,
    Forum,
    Government,
    Jobs,
    Recipes,
    Shop,
    Timetable,
)
