"""Small tools for writing parts of tasks: addresses as patterns, equivalent answers, clean compositions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

from webgym.core.truth import Evidence
from webgym.offline.parts import Assignment, Part

BARE_FROM = 10
"""A number below this proves nothing without its unit."""


def exactly(path: str) -> str:
    """Pattern of a page's address, whatever its query."""
    return re.escape(path) + r"(?:\?|$)"


def shown(path: str, *texts: str) -> Evidence:
    """Evidence: these texts, together, at an address that matches ``path``."""
    return Evidence(texts, path)


def minutes(value: int) -> tuple[str, ...]:
    """Ways to say a duration."""
    said = [f"{value} min", f"{value} minutes", f"{value} mins"]
    hours, rest = divmod(value, 60)
    if hours:
        hour = "hour" if hours == 1 else "hours"
        tail = f" {rest} minutes" if rest else ""
        said += [f"{hours} {hour}{tail}", f"{hours} h {rest} min" if rest else f"{hours} h"]
        said += [f"{hours} {hour} and {rest} minutes"] if rest else []
    return (*said, str(value)) if value >= BARE_FROM else tuple(said)


def quantity(value: str, unit: str, *units: str) -> tuple[str, ...]:
    """Ways to say a quantity: ``quantity("12", "g", "grams")`` takes "12 g", "12g", "12 grams" and "12"."""
    said = [f"{value} {unit}", f"{value}{unit}", *(f"{value} {other}" for other in units)]
    return (*said, value) if float(value.replace(",", "")) >= BARE_FROM else tuple(said)


_NUMBERS = "no one two three four five six seven eight nine ten eleven twelve".split()


def count(value: int, *nouns: str) -> tuple[str, ...]:
    """Ways to say how many."""
    said = [str(value)]
    if 0 < value < len(_NUMBERS):
        said.append(_NUMBERS[value])
    elif value == 0:
        said += [f"{word} {noun}" for word in ("no", "zero") for noun in nouns] + ["none"]
    return tuple(said)


def compose(name: str, parts: Sequence[Part | None]) -> Iterable[Assignment]:
    """An assignment of these parts; nothing if one of them could not be made.

    What is a wrong answer to one part may have to be named for another, so it is not forbidden then.
    """
    made = [part for part in parts if part is not None]
    if len(made) < len(parts):
        return
    spoken = " ".join(f"{part.ask} {part.says}" for part in made).casefold()
    cleaned = tuple(
        replace(
            part,
            facts=tuple(
                replace(fact, wrong=tuple(w for w in fact.wrong if w.casefold() not in spoken))
                for fact in part.facts
            ),
        )
        for part in made
    )
    yield Assignment(name, cleaned)
