"""What a website knows: records with fields, how a visitor comes to see them, and what else could be said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from webgym.core.truth import Move


@dataclass(frozen=True)
class Value:
    """What stands in a field.

    Attributes:
        text: as the page shows it.
        spellings: other ways in which an answer may spell it.
        rank: its place among other values of the field, if they have an order.
        is_text: whether the page shows it as text; else it is drawn, and the page's address stands for it.
    """

    text: str
    spellings: tuple[str, ...] = ()
    rank: float | None = None
    is_text: bool = True

    @property
    def options(self) -> tuple[str, ...]:
        """All ways to spell it."""
        return (self.text, *self.spellings)


@dataclass(frozen=True)
class Record:
    """One thing of the table.

    Attributes:
        name: as pages and instructions call it.
        fields: its values by field.
        traits: words it can be counted by.
        place: what an instruction must add so that it can be found; empty if the name says enough.
    """

    name: str
    fields: Mapping[str, Value]
    traits: frozenset[str] = field(default=frozenset())
    place: str = ""

    @property
    def called(self) -> str:
        """The name, with the place where one is needed."""
        return f"{self.name} from {self.place}" if self.place else self.name

    def rank(self, of: str) -> float:
        """The rank of one of its values.

        Raises:
            ValueError: the field has no order.
        """
        rank = self.fields[of].rank
        if rank is None:
            raise ValueError(f"the {of} of {self.name} has no rank")
        return rank


@dataclass(frozen=True)
class Shown:
    """Where something can be seen.

    Attributes:
        moves: from the front page until it is in view.
        path: regular expression of the path and query of the page that shows it, from start to end.
    """

    moves: tuple[Move, ...]
    path: str


@dataclass(frozen=True)
class ListPage:
    """One page of a list.

    Attributes:
        moves: from the page before it; of the first, from the front page.
        path: as in :class:`Shown`.
        records: on it, in order.
    """

    moves: tuple[Move, ...]
    path: str
    records: Sequence[Record]


class Guide(Protocol):
    """What a website tells about the way to its records."""

    def way(self, record: Record) -> Shown:
        """Where the fields of a record can be seen."""
        ...

    def pages(self, place: str) -> Sequence[ListPage]:
        """The pages of a list."""
        ...

    def candidates(self, of: str) -> Sequence[str]:
        """All that an answer could name where a value of this field is asked for; ``"name"`` for names."""
        ...
