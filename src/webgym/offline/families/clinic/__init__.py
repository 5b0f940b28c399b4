"""Clinics: doctors, their hours and fees, treatments, reviews and appointments."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Clinic(SpecifiedWebsite):
    """A clinic."""

    family: ClassVar[str] = "clinic"
