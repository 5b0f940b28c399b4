"""How tasks say things: lists, and the ways to write a time, a day or a price; and moves they share."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from typing import Protocol

from webgym.core.truth import Click, Move
from webgym.offline.website import Website

COUNTED = (
    "no one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen".split()
)


class Priced(Protocol):
    """A website that writes prices in its own way."""

    def money(self, cents: int) -> str:
        """A price."""


def listed(things: Sequence[str]) -> str:
    """``"a, b and c"``."""
    *first, last = things
    return f"{', '.join(first)} and {last}" if first else last


def the(nouns: Sequence[str]) -> str:
    """``"the price and the arrival time"``."""
    return listed([f"the {noun}" for noun in nouns])


def first_up(text: str) -> str:
    """``text`` with a capital letter first."""
    return text[:1].upper() + text[1:]


def count_words(count: int) -> tuple[str, ...]:
    """A small number in figures and in words."""
    return (str(count), COUNTED[count]) if count < len(COUNTED) else (str(count),)


def times(minute: int) -> tuple[str, ...]:
    """Ways to write a time of day."""
    hour, rest = divmod(minute % 1440, 60)
    half, twelve = ("am" if hour < 12 else "pm"), hour % 12 or 12
    ways = (
        f"{hour:02d}:{rest:02d}",
        f"{hour}:{rest:02d}",
        f"{twelve}:{rest:02d} {half}",
        f"{twelve}:{rest:02d}{half}",
    )
    return tuple(dict.fromkeys(ways))


def days(day: date) -> tuple[str, ...]:
    """Ways to write a day."""
    number = day.day
    ways = (f"{number} {day:%b %Y}", f"{number} {day:%b}", f"{number} {day:%B}", f"{day:%B} {number}")
    return (*ways, f"{day:%b} {number}", day.isoformat())


def spans(minutes: int) -> tuple[str, ...]:
    """Ways to write a length of time."""
    hours, rest = divmod(minutes, 60)
    ways = [f"{minutes} min", f"{minutes} minutes"]
    if hours:
        for pad in ("02d", "d"):
            short = f"{rest:{pad}}"
            ways += [
                f"{hours} h {short} min",
                f"{hours}h {short}min",
                f"{hours}h {short}m",
                f"{hours}h{short}",
            ]
            ways += [
                f"{hours}:{short}",
                f"{hours} hours {short} minutes",
                f"{hours} hours and {short} minutes",
            ]
            ways += [f"{hours} hour {short} minutes", f"{hours} hour and {short} minutes"]
    return tuple(dict.fromkeys(ways))


def sums(site: Priced, cents: int) -> tuple[str, ...]:
    """Ways to write a price."""
    shown = site.money(cents)
    plain = f"{cents / 100:.2f}"
    ways = [shown, plain]
    if cents % 100 == 0:
        ways.append(str(cents // 100))
    elif plain.endswith("0"):
        ways.append(plain[:-1])
    return tuple(dict.fromkeys(ways))


def having(path: str, **query: object) -> str:
    """A regular expression for addresses with this path and at least these parameters."""
    wanted = "".join(rf"(?=.*[?&]{key}={re.escape(str(value))}(?:&|$))" for key, value in query.items())
    return re.escape(path) + (wanted or r"(?:\?|$)")


def in_section(site: Website, titles: Sequence[str], title: str) -> tuple[Move, ...]:
    """Make a section of a page visible, as the website's look has it."""
    if site.look.detail == "plain" or title == titles[0]:
        return ()
    return (Click(name=title, role="tab" if site.look.detail == "tabs" else None),)


def further(site: Website, pages: int) -> tuple[Move, ...]:
    """Go on by some pages of a list."""
    label = {"numbers": "Page {}", "steps": "Next", "more": "Load more"}[site.look.pager]
    return tuple(Click(name=label.format(number + 2)) for number in range(pages))
