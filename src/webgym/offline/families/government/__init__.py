"""Public authorities: services, offices, decisions, reports and permits."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Government(SpecifiedWebsite):
    """An authority's website."""

    family: ClassVar[str] = "government"
