"""What a hobby's forum is made of, and what is posted there."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date, datetime
from functools import cached_property
from typing import Literal, TypeAlias

from webgym.offline.data import Row, Table, load

Kind: TypeAlias = Literal["start", "craft", "gear", "show", "market", "talk"]
KINDS: tuple[Kind, ...] = ("start", "craft", "gear", "show", "market", "talk")
"""What boards are for: beginners, technique, equipment, showing, buying and selling, everything else."""


class Ask(Row, frozen=True):
    """A question that everyone answers with a number.

    Attributes:
        title: with ``{thing}``.
        reply: with ``{mark}`` where the number and its unit stand.
        mark: ``"{n} hours"``.
        ask: ``"how many hours"``, followed by a name and ``"says"``.
        low, high: the numbers it can be.
    """

    title: str
    reply: str
    mark: str
    ask: str
    low: int
    high: int


class Hobby(Table, frozen=True):
    """A subject of forums.

    Attributes:
        boards: a name for every one of :data:`KINDS`.
        things: nouns in the singular, for titles.
        tags: of threads.
    """

    name: str
    domain: str
    subdomain: str
    brands: tuple[str, ...]
    boards: tuple[str, ...]
    things: tuple[str, ...]
    tags: tuple[str, ...]
    questions: tuple[Ask, ...]


class Stock(Table, frozen=True):
    """``hobbies.toml``.

    Attributes:
        openings: what opens a thread that sells nothing.
        chatter: replies without a number.
        shades: what may follow one with a number.
        letters: private messages: subject, text with ``{mark}``, and the mark with ``{n}``.
        titles: of threads, with ``{thing}``.
    """

    openings: tuple[str, ...]
    chatter: tuple[str, ...]
    shades: tuple[str, ...]
    letters: tuple[tuple[str, str, str], ...]
    titles: dict[Kind, tuple[str, ...]]
    hobbies: tuple[Hobby, ...]


STOCK = load("webgym.offline.families.forum", "hobbies.toml", Stock)


@dataclass(frozen=True)
class User:
    """A member."""

    name: str
    joined: date
    posts: int
    thanks: int
    town: str
    favourite: str
    since: int
    moderates: bool


@dataclass(frozen=True)
class Post:
    """A reply, or the text that opens a thread.

    Attributes:
        mark: the number that it recommends, with its unit; empty if it recommends none.
    """

    author: User
    when: datetime
    text: str
    likes: int
    mark: str = ""


@dataclass(frozen=True)
class Poll:
    """A vote: (option, votes), no two with the same number."""

    question: str
    options: tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Thread:
    """A discussion.

    Attributes:
        question: the question that its replies answer with numbers, if it has one.
        price: what is asked for, in dollars; 0 if nothing is for sale.
        accepted: place of the accepted answer among the replies; ``None`` if there is none.
    """

    number: int
    title: str
    slug: str
    board: str
    tag: str
    opening: Post
    replies: tuple[Post, ...]
    views: int
    accepted: int | None
    question: Ask | None = None
    price: int = 0
    poll: Poll | None = None

    @property
    def author(self) -> User:
        """Who started it."""
        return self.opening.author

    @property
    def likes(self) -> int:
        """Of the opening post."""
        return self.opening.likes

    @cached_property
    def latest(self) -> Post:
        """The last post."""
        return self.replies[-1] if self.replies else self.opening

    @property
    def solution(self) -> Post | None:
        """The accepted answer."""
        return None if self.accepted is None else self.replies[self.accepted]


@dataclass(frozen=True)
class Message:
    """A private message to the account that visitors can sign in to."""

    sender: User
    subject: str
    text: str
    mark: str
    day: date
