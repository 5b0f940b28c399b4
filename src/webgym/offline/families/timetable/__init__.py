"""Timetables: trains, ships, coaches and flights with their stops, fares, stations and notices."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Timetable(SpecifiedWebsite):
    """A carrier's timetable."""

    family: ClassVar[str] = "timetable"
