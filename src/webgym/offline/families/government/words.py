"""Word stock of the public authorities' websites."""

from __future__ import annotations

from webgym.offline.data import Table, load


class Body(Table, frozen=True):
    """A kind of authority.

    Attributes:
        suffixes: second words of brands.
        taglines: one is taken.
        groups: the groups of services it offers.
        council: what its decisions are made by.
        matters: what it decides on.
        troubles: what people report to it.
        permits: what people apply for in one form.
        price: what the calculator works out: a name, and the answers to two of its questions.
        rounds: what the calendar by street is called, and what comes by in a street.
    """

    suffixes: tuple[str, ...]
    taglines: tuple[str, ...]
    groups: tuple[str, ...]
    council: tuple[str, ...]
    matters: tuple[str, ...]
    troubles: tuple[str, ...]
    permits: tuple[str, ...]
    price: tuple[str, tuple[str, ...], tuple[str, ...]]
    rounds: tuple[tuple[str, ...], tuple[str, str, str, str]]


class Words(Table, frozen=True):
    """``words.toml``.

    Attributes:
        papers: what services ask for.
        services: by group.
        bodies: by kind.
    """

    papers: tuple[str, ...]
    streets: tuple[str, ...]
    offices: tuple[str, ...]
    services: dict[str, tuple[str, ...]]
    bodies: dict[str, Body]


WORDS = load("webgym.offline.families.government", "words.toml", Words)
