"""What a subject of an encyclopedia is made of, and what stands in its articles."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date

from webgym.offline.data import Row, Table, load

NONE = "None"
"""What an infobox says where something is missing."""


class Measure(Row, frozen=True):
    """A number in the infobox.

    Attributes:
        key: in addresses.
        label: in the infobox.
        unit: behind the number; may be empty.
        low, high, step: the numbers it can be.
        most, least: superlatives: ``"the mountain with the greatest height"``.
    """

    key: str
    label: str
    unit: str
    low: int
    high: int
    step: int
    most: str = "greatest"
    least: str = "smallest"

    def show(self, value: int) -> str:
        """The number as pages show it."""
        return f"{value:,} {self.unit}".strip()


class Trait(Row, frozen=True):
    """A word in the infobox, one of a few."""

    key: str
    label: str
    values: tuple[str, ...]


class Lack(Row, frozen=True):
    """Something that one article of every group has not got.

    Attributes:
        label: in the infobox.
        values: what the others have.
        phrase: of the one without: ``"has no lighthouse"``.
    """

    label: str
    values: tuple[str, ...]
    phrase: str


class Detail(Row, frozen=True):
    """A number that stands in the running text alone.

    Attributes:
        ask: ``"how many breeding pairs the latest survey counted"``.
        fact: ``"the number of breeding pairs in the latest survey"``.
        sentence: with ``{mark}`` where the number and its noun stand.
        mark: ``"{n} breeding pairs"``.
        low, high: the numbers it can be.
    """

    ask: str
    fact: str
    sentence: str
    mark: str
    low: int
    high: int


class Section(Row, frozen=True):
    """A section of running text with one detail in it."""

    title: str
    fillers: tuple[str, ...]
    detail: Detail


class Subject(Table, frozen=True):
    """An encyclopedia's subject.

    Attributes:
        noun, plural: what an article is about.
        domain, subdomain: of the Mind2Web-2 taxonomy.
        brands: second parts of the website's name.
        picture: kind of illustration.
        group_label: what a group is called: ``"Order"``.
        groups: last words of names, by group; without any, those of the subject.
        first: the list of :class:`Stock` that first words of names come from.
        second: last words of names.
        pattern: of a name.
        measures: numbers; a website takes four.
        traits: words; a website takes all.
        lack: what one member of every group lacks.
        event: label and verb of the article's year: ``("First described", "was first described")``.
        role: label of the article's person.
        profession: of these people.
        place: label of the article's place.
        sections: of running text.
        era: years in which these people were born.
    """

    noun: str
    plural: str
    domain: str
    subdomain: str
    brands: tuple[str, ...]
    picture: str
    group_label: str
    groups: dict[str, tuple[str, ...]]
    first: str
    measures: tuple[Measure, ...]
    traits: tuple[Trait, ...]
    lack: Lack
    event: tuple[str, str]
    role: str
    profession: str
    place: str
    sections: tuple[Section, ...]
    second: tuple[str, ...] = ()
    pattern: str = "{first} {second}"
    era: tuple[int, int] = (1702, 1940)


class Stock(Table, frozen=True):
    """``subjects.toml``.

    Attributes:
        fillers: sentences of running text.
        comments: of edits.
        schools: where people studied.
        words: first words of names, for one subject or several.

    Raises:
        ValueError: a subject names a list that is not there.
    """

    fillers: tuple[str, ...]
    comments: tuple[str, ...]
    schools: tuple[str, ...]
    words: dict[str, tuple[str, ...]]
    subjects: tuple[Subject, ...]

    def __post_init__(self) -> None:
        for subject in self.subjects:
            if subject.first not in self.words:
                raise ValueError(f"{subject.plural}: there are no words {subject.first!r}")


STOCK = load("webgym.offline.families.encyclopedia", "subjects.toml", Stock)


@dataclass(frozen=True)
class Person:
    """Someone with a biography."""

    name: str
    slug: str
    born: int
    died: int
    birthplace: str
    school: str
    profession: str


@dataclass(frozen=True)
class Revision:
    """One edit of an article."""

    day: date
    editor: str
    comment: str
    size: int


@dataclass(frozen=True)
class Article:
    """An article about one thing.

    Attributes:
        numbers: value of every measure, by key.
        traits: value of every trait, by key.
        lacking: what stands where one of the group has nothing.
        details: the number in every section's running text, by the section's title.
        seealso: slugs of other articles.
        revisions: newest first.
        number: in the permanent link.
    """

    title: str
    slug: str
    group: str
    numbers: dict[str, int]
    traits: dict[str, str]
    lacking: str
    year: int
    person: Person
    place: str
    texts: dict[str, list[str]]
    details: dict[str, int]
    seealso: tuple[str, ...]
    revisions: tuple[Revision, ...]
    number: int
