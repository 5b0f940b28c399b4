"""What stands in a forum, made from a seed and a hobby."""

from __future__ import annotations

import random
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from functools import cached_property

from webgym.offline import names
from webgym.offline.families.forum.schema import (
    KINDS,
    STOCK,
    Ask,
    Hobby,
    Kind,
    Message,
    Poll,
    Post,
    Thread,
    User,
)
from webgym.offline.seeds import stream
from webgym.offline.website import TODAY, slug

USERS = 32
NOW = datetime.combine(TODAY, time(9, 30))

REASONS = ("Spam", "Insult", "Wrong board", "Advertising", "Dangerous advice", "Double post")
"""Why a thread can be reported."""
DIGESTS = ("Never", "Once a day", "Once a week", "Once a month")
"""How often an account's owner is written to."""


@dataclass(frozen=True)
class Account:
    """What a visitor can sign in with."""

    name: str
    password: str


@dataclass(frozen=True)
class Catalogue:
    """Everything that stands in one forum.

    Attributes:
        boards: name and description, in order.
        threads: those with the latest posts first.
        messages: to the account, newest first.
    """

    hobby: Hobby
    boards: tuple[tuple[str, str], ...]
    users: tuple[User, ...]
    threads: tuple[Thread, ...]
    account: Account
    messages: tuple[Message, ...]

    @cached_property
    def by_number(self) -> dict[int, Thread]:
        """Threads by number."""
        return {thread.number: thread for thread in self.threads}

    @cached_property
    def user_by_slug(self) -> dict[str, User]:
        """Members by the name in their address."""
        return {slug(user.name): user for user in self.users}

    def on_board(self, board: str) -> list[Thread]:
        """Threads of a board, latest posts first."""
        return [thread for thread in self.threads if thread.board == board]

    def started_by(self, user: User) -> list[Thread]:
        """Threads that a member started."""
        return [thread for thread in self.threads if thread.author is user]


def make(seed: int, hobby: Hobby) -> Catalogue:
    """The contents that belong to a seed."""
    rng = stream(seed, "forum")
    handles = [
        f"{given}{rng.choice(names.SECOND).title()}" for given in rng.sample(names.GIVEN, len(names.GIVEN))
    ]
    users = _users(rng, hobby, handles[:USERS])
    word = rng.choice(names.FIRST).lower()
    account = Account(handles[USERS], f"{word}-{rng.randint(100, 999)}")
    texts = {
        "start": "No question is too small.",
        "craft": "How it is done, and how it is done better.",
        "gear": "What to buy, and what to leave.",
        "show": "Pictures, please.",
        "market": "Members only, at your own risk.",
        "talk": "Everything else.",
    }
    boards = tuple((name, texts[kind]) for name, kind in zip(hobby.boards, KINDS, strict=True))
    threads = _threads(rng, hobby, users)
    return Catalogue(hobby, boards, users, threads, account, _messages(rng, users))


def _users(rng: random.Random, hobby: Hobby, handles: list[str]) -> tuple[User, ...]:
    days = rng.sample(range(160, 4200), len(handles))
    posts = rng.sample(range(14, 9800), len(handles))
    thanks = rng.sample(range(12, 6400), len(handles))
    places = names.towns(rng, len(handles))
    made = [
        User(
            name,
            TODAY - timedelta(days=days[i]),
            posts[i],
            thanks[i],
            places[i],
            rng.choice(hobby.things),
            rng.randint(1994, 2025),
            moderates=i < 3,
        )
        for i, name in enumerate(handles)
    ]
    return tuple(sorted(made, key=lambda user: user.name))


def _titles(rng: random.Random, hobby: Hobby) -> list[tuple[Kind, str, str, Ask | None]]:
    """(kind of board, title, thing, question) of all threads."""
    asked = [(ask, thing) for ask in hobby.questions for thing in hobby.things]
    found: list[tuple[Kind, str, str, Ask | None]] = []
    for ask, thing in rng.sample(asked, rng.randint(20, 27)):
        kind: Kind = rng.choice(("start", "craft", "craft", "gear"))
        found.append((kind, ask.title.format(thing=thing), thing, ask))
    for kind in KINDS:
        pairs = [(title, thing) for title in STOCK.titles[kind] for thing in hobby.things]
        for title, thing in rng.sample(pairs, rng.randint(2, 4) if kind in KINDS[:3] else rng.randint(6, 9)):
            found.append((kind, title.format(thing=thing), thing, None))
    rng.shuffle(found)
    return found


def _threads(rng: random.Random, hobby: Hobby, users: tuple[User, ...]) -> tuple[Thread, ...]:
    titles = _titles(rng, hobby)
    numbers = sorted(rng.sample(range(1200, 9900), len(titles)))
    views = rng.sample(range(320, 48_000), len(titles))
    likes = rng.sample(range(3, 940), len(titles))
    silent = {kind: next(i for i, found in enumerate(titles) if found[0] == kind and not found[3])
              for kind in KINDS}  # fmt: skip
    days = sorted(rng.sample(range(4, 700), len(titles)), reverse=True)
    polls = {i for i, found in enumerate(titles) if found[0] in ("show", "talk")} - set(silent.values())
    voted = set(rng.sample(sorted(polls), 3))
    made = []
    for i, (kind, title, thing, ask) in enumerate(titles):
        start = NOW - timedelta(days=days[i], minutes=rng.randint(0, 1300))
        count = 0 if i in silent.values() else rng.choice((2, 3, 4, 5, 6, 7, 8, 9, 12, 15, 19, 24, 27))
        cast = rng.sample(users, count + 1)
        price = rng.randint(25, 890) if kind == "market" else 0
        text = (
            f"It is in good shape. I am asking {price} dollars for it."
            if price
            else rng.choice(STOCK.openings)
        )
        replies = _replies(rng, cast[1:], ask, start)
        answers = [place for place, reply in enumerate(replies) if reply.mark]
        made.append(
            Thread(
                number=numbers[i],
                title=title,
                slug=slug(title),
                board=hobby.boards[KINDS.index(kind)],
                tag=rng.choice(hobby.tags),
                opening=Post(cast[0], start, text, likes[i]),
                replies=replies,
                views=views[i],
                accepted=rng.choice(answers) if answers and rng.random() < 0.75 else None,
                question=ask,
                price=price,
                poll=_poll(rng, hobby, thing) if i in voted else None,
            )
        )
    return tuple(sorted(made, key=lambda thread: (thread.latest.when, thread.number), reverse=True))


def _replies(rng: random.Random, cast: list[User], ask: Ask | None, start: datetime) -> tuple[Post, ...]:
    """Replies by different members, with different numbers of likes and different recommendations."""
    span = min(NOW - start - timedelta(hours=8), timedelta(days=45))
    minutes = sorted(rng.sample(range(11, int(span.total_seconds() // 60)), len(cast)))
    likes = rng.sample(range(140), len(cast))
    values = (
        rng.sample(range(ask.low, ask.high + 1), min(len(cast), (ask.high - ask.low) // 2)) if ask else []
    )
    talk = rng.sample(STOCK.chatter, len(STOCK.chatter))
    made = []
    for place, user in enumerate(cast):
        mark, text = "", talk[place % len(talk)]
        if ask and values and (place == 0 or rng.random() < 0.7):
            mark = ask.mark.format(n=f"{values.pop():,}")
            text = ask.reply.format(mark=mark) + rng.choice(STOCK.shades)
        made.append(Post(user, start + timedelta(minutes=minutes[place]), text, likes[place], mark))
    return tuple(made)


def _poll(rng: random.Random, hobby: Hobby, thing: str) -> Poll:
    options = rng.sample([other for other in hobby.things if other != thing], 4)
    votes = rng.sample(range(11, 480), 4)
    return Poll("Which one could you not do without?", tuple(zip(map(_capital, options), votes, strict=True)))


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _messages(rng: random.Random, users: tuple[User, ...]) -> tuple[Message, ...]:
    letters = rng.sample(STOCK.letters, 5)
    days = sorted(rng.sample(range(2, 90), 5))
    made = []
    for (subject, text, mark), sender, age in zip(letters, rng.sample(users, 5), days, strict=True):
        said = mark.format(n=rng.randint(112, 989))
        day: date = TODAY - timedelta(days=age)
        made.append(Message(sender, subject, text.format(mark=said), said, day))
    return tuple(made)
