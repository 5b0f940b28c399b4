"""Pagination of lists."""

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
        total: number of items in the whole list.
        number: of this page, from 1.
        count: number of pages.
    """

    items: Sequence[T]
    total: int
    number: int
    count: int


def paged(items: Sequence[T], visit: Visit, size: int) -> Paged[T]:
    """The page of the visit's ``page`` parameter, limited to the existing pages."""
    count = max(1, -(-len(items) // size))
    requested = visit.query.get("page", "1")
    number = min(max(int(requested), 1), count) if requested.isdecimal() and len(requested) < 6 else 1
    return Paged(items[(number - 1) * size : number * size], len(items), number, count)
