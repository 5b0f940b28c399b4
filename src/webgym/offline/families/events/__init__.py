"""Organisers of one kind: events, venues, reviews, tickets."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Events(SpecifiedWebsite):
    """An organiser's website."""

    family: ClassVar[str] = "events"
