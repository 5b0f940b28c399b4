"""How numbers, days and lists are written in tasks, and which spellings a right answer may use."""

from __future__ import annotations

import random
from collections.abc import Sequence
from datetime import date

from webgym.offline import names

WORDS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven",
         "twelve")  # fmt: skip

MAIL_HOSTS = ("post.example", "mail.example", "letters.example")


def figure(value: int) -> tuple[str, ...]:
    """How an answer may write a number."""
    written = tuple(dict.fromkeys((f"{value:,}", str(value))))
    return (*written, WORDS[value]) if value < len(WORDS) else written


def word(text: str) -> tuple[str, ...]:
    """How an answer may write a word of the infobox: ``"Three"`` is also 3."""
    small = text.lower()
    return (text, str(WORDS.index(small))) if small in WORDS else (text,)


def listing(items: Sequence[str]) -> str:
    """``"a"``, ``"a and b"``, ``"a, b and c"``."""
    return " and ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)


def day_texts(day: date) -> tuple[str, ...]:
    """How an answer may write a day; the first is how pages show it."""
    return (
        f"{day.day} {day:%b %Y}",
        f"{day.day} {day:%B %Y}",
        f"{day:%B} {day.day}, {day.year}",
        f"{day:%b} {day.day}, {day.year}",
        day.isoformat(),
    )


def mail_address(rng: random.Random) -> str:
    """An e-mail address of nobody."""
    given, family = names.person(rng).lower().split()
    return f"{given}.{family}@{rng.choice(MAIL_HOSTS)}"


NICE_STEPS = (5000, 1000, 500, 100, 50, 20, 10, 5, 2, 1)


def nice_between(low: int, high: int) -> int:
    """The roundest number with ``low <= number < high``."""
    for step in NICE_STEPS:
        number = -(-low // step) * step
        if number < high:
            return number
    return low
