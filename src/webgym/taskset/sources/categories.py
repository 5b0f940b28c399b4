"""Maps a source's own categories to the taxonomy, where they are unambiguous."""

from __future__ import annotations

from functools import cache
from typing import Final, TypeAlias

from webgym.tasks.taxonomy import DOMAIN_OF

Place: TypeAlias = tuple[str, str]
"""Domain and subdomain; empty if they have to be inferred."""

UNKNOWN: Final[Place] = ("", "")


def subdomain(name: str) -> Place:
    """A subdomain of the taxonomy, with its domain."""
    return DOMAIN_OF[name], name


def named(*names: object) -> Place:
    """The subdomain that one of a record's own categories names, ignoring case and punctuation; else unknown.

    A domain alone is not used, because a model infers both or none.

    Args:
        names: the record's subdomain, domain or category, the most specific first.
    """
    for name in names:
        if isinstance(name, str) and (place := _places().get(_folded(name))):
            return place
    return UNKNOWN


@cache
def _places() -> dict[str, Place]:
    return {_folded(name): (domain, name) for name, domain in DOMAIN_OF.items()}


def _folded(name: str) -> str:
    return "".join(letter for letter in name.casefold().replace("&", "and") if letter.isalnum())
