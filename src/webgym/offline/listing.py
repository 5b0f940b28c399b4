"""Lists of things: pages of results, in the order and number that a visitor asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from webgym.offline.website import Visit

T = TypeVar("T")


@dataclass(frozen=True)
class Paged(Generic[T]):
    """One page of a list.

    Attributes:
        items: on this page.
        total: in the whole list.
        number: of this page, from 1.
        count: of pages.
    """

    items: Sequence[T]
    total: int
    number: int
    count: int


def paged(items: Sequence[T], visit: Visit, size: int) -> Paged[T]:
    """The page that the visit's ``page`` parameter asks for; one out of range gives the nearest."""
    count = max(1, -(-len(items) // size))
    asked = visit.query.get("page", "1")
    number = min(max(int(asked), 1), count) if asked.isdecimal() and len(asked) < 6 else 1
    return Paged(items[(number - 1) * size : number * size], len(items), number, count)
