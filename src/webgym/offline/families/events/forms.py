"""Checking what visitors write into forms."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from webgym.offline.families.events import Events
    from webgym.offline.families.events.data import Event


def check_buyer(form: Mapping[str, str]) -> dict[str, str]:
    """What is wrong with a buyer's name and address."""
    errors = {}
    if len(form.get("name", "").split()) < 2:
        errors["name"] = "Please give first name and surname."
    if re.fullmatch(r"[^@\s]+@[^@\s]+\.[^@\s]+", form.get("email", "").strip()) is None:
        errors["email"] = "Please give a valid e-mail address."
    return errors


def check_choice(event: Event, form: Mapping[str, str]) -> dict[str, str]:
    """What is wrong with a choice of tickets."""
    band = next((band for band in event.bands if band.name == form.get("band")), None)
    count = form.get("count", "")
    if band is None:
        return {"band": "Please choose."}
    if not count.isdecimal() or not 1 <= int(count[:3]) <= 8:
        return {"count": "Please choose between 1 and 8 tickets."}
    if int(count) > band.left:
        return {"count": f"Only {band.left} tickets are left here." if band.left else "This is sold out."}
    return {}


def check_news(site: Events, given: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """The fields of a sign-up for the newsletter, and what is wrong with them."""
    form = {name: given.get(name, "").strip() for name in ("about", "often", "name", "email")}
    errors = check_buyer(form)
    if form["about"] not in dict(site.categories):
        errors["about"] = "Please choose."
    if form["often"] not in site.often:
        errors["often"] = "Please choose."
    return form, errors
