"""Records of a website, where a visitor can see them, and the possible values of their fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from webgym.core.truth import Move


@dataclass(frozen=True)
class Value:
    """The value of a field.

    Attributes:
        text: its text on the page.
        spellings: other texts that an answer may use for it.
        rank: number by which values of the field are ordered; ``None`` if they have no order.
        is_text: whether the page shows it as text; if not, it is a picture, and evidence is the page's
            address alone.
    """

    text: str
    spellings: tuple[str, ...] = ()
    rank: float | None = None
    is_text: bool = True

    @property
    def options(self) -> tuple[str, ...]:
        """All accepted spellings."""
        return (self.text, *self.spellings)


@dataclass(frozen=True)
class Record:
    """A record.

    Attributes:
        name: its name on pages and in instructions.
        fields: its values, by field.
        traits: words by which instructions can select it for counting.
        place: name of the list that has it, where instructions must give it; empty if the name is enough.
    """

    name: str
    fields: Mapping[str, Value]
    traits: frozenset[str] = field(default=frozenset())
    place: str = ""

    @property
    def full_name(self) -> str:
        """The name in instructions, with the place if there is one."""
        return f"{self.name} from {self.place}" if self.place else self.name

    def rank(self, field_name: str) -> float:
        """The rank of a field's value.

        Raises:
            ValueError: the field has no order.
        """
        rank = self.fields[field_name].rank
        if rank is None:
            raise ValueError(f"the {field_name} of {self.name} has no rank")
        return rank


@dataclass(frozen=True)
class Location:
    """Where something can be seen.

    Attributes:
        moves: moves from the front page that bring it into view.
        path: regular expression for the path and query of the page that shows it; matches from start to end.
    """

    moves: tuple[Move, ...]
    path: str


@dataclass(frozen=True)
class ListPage:
    """One page of a list.

    Attributes:
        moves: moves from the page before it, or from the front page for the first page.
        path: as in :class:`Location`.
        records: the records on it, in order.
    """

    moves: tuple[Move, ...]
    path: str
    records: Sequence[Record]


class Guide(Protocol):
    """Where the records of a website can be seen."""

    def locate(self, record: Record) -> Location:
        """The page that shows the fields of a record."""
        ...

    def pages(self, place: str) -> Sequence[ListPage]:
        """The pages of a list."""
        ...

    def candidates(self, field: str) -> Sequence[str]:
        """All possible values of a field; of ``"name"``, all names of records."""
        ...
