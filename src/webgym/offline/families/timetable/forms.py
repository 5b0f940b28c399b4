"""Checking what visitors write into forms."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from webgym.offline.families.timetable import Timetable


def is_email(text: str) -> bool:
    """Whether this looks like an e-mail address."""
    return re.fullmatch(r"[^@\s]+@[^@\s]+\.[^@\s]+", text) is not None


def _kept(given: Mapping[str, str], *names: str) -> dict[str, str]:
    return {name: given.get(name, "").strip() for name in names}


def check_passenger(site: Timetable, given: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """The fields of a booking, and what is wrong with them."""
    form, errors = _kept(given, "seat", "extra", "terms", "name", "email"), {}
    if form["seat"] not in site.mode.seats:
        errors["seat"] = "Please choose."
    if not form["terms"]:
        errors["terms"] = "Please accept the conditions to go on."
    if len(form["name"].split()) < 2:
        errors["name"] = "Please give first name and surname."
    if not is_email(form["email"]):
        errors["email"] = "Please give a valid e-mail address."
    return form, errors


def check_alert(site: Timetable, given: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """The fields of a sign-up for alerts, and what is wrong with them."""
    form, errors = _kept(given, "line", "often", "email"), {}
    if site.network.line(form["line"]) is None:
        errors["line"] = "Please choose."
    if form["often"] not in site.often:
        errors["often"] = "Please choose."
    if not is_email(form["email"]):
        errors["email"] = "Please give a valid e-mail address."
    return form, errors
