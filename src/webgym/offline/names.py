"""Made-up names of companies, people and places. Any likeness to real ones is by chance."""

from __future__ import annotations

import random

from webgym.offline.seeds import stream

FIRST = (
    "Fern Alder Birch Cedar Copper Amber Silver Raven Heron Otter Maple Willow Harbor Lantern Meadow North "
    "River Stone Thistle Velvet Winter Summer Juniper Hazel Ivory Cobalt Saffron Marble Clover Falcon Linden "
    "Orchard Pebble Quill Rowan Sparrow Timber Umber Vale Wren Yarrow Zephyr Anchor Beacon Bramble Cinder "
    "Drift Ember Frost Granite Hollow Indigo Jasper Kestrel Lark Mossy Nimbus Ochre Poplar Russet"
).split()
SECOND = (
    "hill field wood ford well gate bridge stead croft mere dale port crest haven leaf stone brook lane "
    "wick moor view point mark land bank"
).split()
GIVEN = (
    "Ada Bruno Clara Dmitri Elif Farah Goran Hana Ivo Jun Keiko Lars Mina Nadia Omar Priya Quentin Rosa "
    "Samir Tess Ulla Viktor Wanda Ximena Yusuf Zoe Anton Beatriz Chidi Dalia Emre Freya Gita Henrik Ines "
    "Jamal Katya Leon Maren Noor"
).split()
"""Given names of people."""
FAMILY = (
    "Abbott Brandt Castell Dorsey Eklund Farrow Galloway Hartmann Ishida Jansen Kovacs Lindqvist Moreau "
    "Novak Okafor Petrov Quiroga Rossi Sandoval Tanaka Urbano Varga Whitlock Xenakis Yilmaz Zeller Amari "
    "Bergman Calloway Dunne Ekwueme Ferrant Grau Hollis Ibarra Jelinek Kimura Lachance Mbeki Nilsen"
).split()
"""Family names of people."""
TOWN_FIRST = (
    "Ash Brook Clay Dun East Fair Glen High Iron King Lake Mill New Oak Pine Red Salt Stan Thorn West Wind "
    "Wolf Black Cold Deep Elm Fox Gold Hart Long"
).split()
TOWN_SECOND = (
    "bury ton ham ford field mouth port by stead worth combe minster dale wick cliff haven bourne gate"
).split()


def stems(*names: object) -> list[str]:
    """All stems of brand names ("Fernhill") in a random order, seeded by ``names``."""
    combined = [first + second for first in FIRST for second in SECOND]
    stream("stems", *names).shuffle(combined)
    return combined


def person(rng: random.Random) -> str:
    """A full name.

    Args:
        rng: draws it.
    """
    return f"{rng.choice(GIVEN)} {rng.choice(FAMILY)}"


def people(rng: random.Random, count: int) -> list[str]:
    """Different full names.

    Args:
        rng: draws them.
        count: number of names.
    """
    drawn: dict[str, None] = {}
    while len(drawn) < count:
        drawn[person(rng)] = None
    return list(drawn)


def towns(rng: random.Random, count: int) -> list[str]:
    """Different names of towns.

    Args:
        rng: draws them.
        count: number of names.

    Raises:
        ValueError: there are not that many.
    """
    combined = [first + second for first in TOWN_FIRST for second in TOWN_SECOND]
    return rng.sample(combined, count)
