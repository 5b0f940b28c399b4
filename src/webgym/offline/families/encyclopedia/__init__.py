"""Encyclopedias of one subject: entries with figures and text, versions, editors and collections."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Encyclopedia(SpecifiedWebsite):
    """An encyclopedia."""

    family: ClassVar[str] = "encyclopedia"
