"""Signposts: a sign seen on one page is needed on another, where it can no longer be seen."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import ClassVar, Literal

from webgym.core.truth import Click, Evidence, Home, Move, Remember
from webgym.offline.data import load
from webgym.offline.engine.table import Record, Shown
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream
from webgym.offline.small.catalog import Catalog, Kind
from webgym.offline.small.questions import NAME, Phrases, Questions, answer_is, seen, some
from webgym.offline.small.screen import Block, Tile, singles
from webgym.offline.small.signs import Sign
from webgym.offline.website import Response, Visit, page

FRONT = "the first page"
MOST_HOPS = 5


class SignpostPhrases(Phrases, frozen=True, forbid_unknown_fields=True):
    """How a signpost's tasks are asked.

    ``thing``, ``color`` and ``icon``: what the sign shows; ``rest`` is what it does not show.
    """

    thing: tuple[str, ...] = ()
    color: tuple[str, ...] = ()
    icon: tuple[str, ...] = ()
    which: tuple[str, ...] = ()
    chain: tuple[str, ...] = ()

    placeholders: ClassVar[dict[str, str]] = {
        **Phrases.placeholders,
        "thing": "page",
        "color": "rest page",
        "icon": "rest page",
        "which": "page other",
        "chain": "item times",
    }


@lru_cache(maxsize=1)
def phrases() -> SignpostPhrases:
    """How a signpost's tasks are asked."""
    return load("webgym.offline.small", "signpost.toml", SignpostPhrases)


class Signpost(Catalog):
    """A website with signs that name things.

    Attributes:
        shows: what its signs show: the whole thing, its colour, or its icon.
        notices: which thing is meant on which page: pages by their word, the front page by :data:`FRONT`.
        follows: where every thing's own sign leads.
    """

    family: ClassVar[str] = "signpost"
    topic: ClassVar[tuple[str, str]] = ("Travel & Transportation", "Travel & Accommodation")
    kinds: ClassVar[tuple[Kind, ...]] = ("color", "icon")
    shows: Literal["thing", "color", "icon"]
    notices: dict[str, Record]
    follows: dict[str, Record]

    def fill(self) -> None:
        """Choose what the signs mean."""
        super().fill()
        rng = stream(self.seed, "signs")
        self.shows = rng.choice(("thing", "thing", "color", "icon"))
        things = self.records()
        pages = [FRONT, *self.design.stock.words[: rng.randint(3, 4)]]
        self.notices = dict(zip(pages, rng.sample(things, len(pages)), strict=True))
        order = rng.sample(things, len(things))
        chained = rng.random() < 0.6
        self.follows = {
            one.name: two for one, two in zip(order, [*order[1:], order[0]], strict=True) if chained
        }

    def notice(self, where: str) -> Sign:
        """The sign of a page."""
        thing = self.signs[self.notices[where].name]
        if self.shows == "color":
            return Sign(color=thing.color)
        return Sign(icon=thing.icon) if self.shows == "icon" else thing

    # --- pages ------------------------------------------------------------------------------------

    def front_tiles(self) -> list[Tile]:
        """The sections, then the pages with signs."""
        words = [where for where in self.notices if where != FRONT]
        return [
            *super().front_tiles(),
            *(Tile(Sign(text=word), f"/sign/{self.token(word)}") for word in words),
        ]

    def front_mark(self) -> Sign | None:
        """The front page's own sign."""
        return self.notice(FRONT)

    @page("/sign/{token}")
    def sign_page(self, visit: Visit, token: str) -> Response:
        """A page that shows a sign and nothing else."""
        where = next((word for word in self.notices if self.token(word) == token), None)
        if where is None:
            return self.missing(visit)
        return self.show(visit, singles([Tile(self.notice(where))]), mark=Sign(text=where))

    def thing_blocks(self, record: Record) -> list[Block]:
        """The thing, its number, and its own sign."""
        blocks = list(super().thing_blocks(record))
        if record.name in self.follows:
            blocks += singles([Tile(self.signs[self.follows[record.name].name])])
        return blocks

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Read signs and find what they mean; follow signs; look up."""
        rng = stream(self.seed, "parts")
        ask, things = Questions(self, phrases(), rng), self.records()
        for where in self.notices:
            for _ in phrases().thing:
                yield self._meant(ask, where)
        words = [where for where in self.notices if where != FRONT]
        for one, two in zip(words, [*words[1:], words[0]], strict=True):
            numbers = {self.notices[where].rank("number") for where in (one, two)}
            if len(numbers) == 2 and self.shows == "thing":
                yield self._which(ask, one, two)
        for record in some(rng, things, 8 if self.follows else 0):
            yield self._chain(ask, record, rng.choice((1, 1, 2, 2, 3, 4, MOST_HOPS)))
        for record in some(rng, things, 8):
            yield ask.look_up(record, "number")
        for first, second in zip(some(rng, things, 3), some(rng, things, 3), strict=True):
            if first.rank("number") != second.rank("number"):
                yield ask.compare(first, second, "number", larger=rng.random() < 0.5)
        yield ask.count(rng.choice(list(self.sections)))

    def _sign(self, where: str) -> tuple[Fact, tuple[Move, ...]]:
        """Seeing the sign of a page."""
        path = "/$" if where == FRONT else f"/sign/{self.token(where)}$"
        fact = Fact(f"the sign on {self._called(where)} is seen", (Evidence((), path),))
        shown = Remember("sign" if where == FRONT else where, self.notice(where).name)
        return fact, (shown,) if where == FRONT else (Click(where), shown)

    def _called(self, where: str) -> str:
        return where if where == FRONT else f"the {where} page"

    def _meant(self, ask: Questions, where: str) -> Part:
        """The number of the thing that a page's sign shows."""
        record, thing = self.notices[where], self.signs[self.notices[where].name]
        rest = {"color": {"rest": thing.icon}, "icon": {"rest": thing.color}}.get(self.shows, {})
        fact, moves = self._sign(where)
        shown, value = self.way(record), record.fields["number"]
        said = Fact(
            "the number of the thing that it shows is given",
            (seen(shown, value),),
            answer=value.options,
            wrong=ask.others("number", value.text),
        )
        return Part(
            ask=ask.ask(self.shows, page=self._called(where), **rest),
            description=f"The number of what the sign on {self._called(where)} shows",
            facts=(fact, said),
            moves=(*moves, Home(), *shown.moves, answer_is(value.text)),
            says=value.text,
        )

    def _which(self, ask: Questions, one: str, two: str) -> Part:
        """Which of the things on two signs has the larger number."""
        signs = [self._sign(where) for where in (one, two)]
        looked, moves, winner = ask.compared(self.notices[one], self.notices[two], "number", larger=True)
        named = Fact(
            "the one with the larger number is named",
            looked[winner.name].evidence,
            answer=(winner.name,),
            wrong=ask.others(NAME, winner.name),
        )
        way = [move for _, moves in signs for move in (*moves, Home())]
        return Part(
            ask=ask.ask("which", page=self._called(one), other=self._called(two)),
            description=f"Which has the larger number: what {one} or what {two} shows",
            facts=(*(fact for fact, _ in signs), *looked.values(), named),
            moves=(*way, *moves, answer_is(winner.name)),
            says=winner.name,
        )

    def _chain(self, ask: Questions, record: Record, hops: int) -> Part:
        """The number at the end of a chain of signs."""
        facts, moves, at = list[Fact](), list[Move](), record
        shown: Shown = self.way(record)
        for hop in range(1, hops + 1):
            facts.append(Fact(f"sign {hop} on the way is seen", (Evidence((), shown.path),)))
            at = self.follows[at.name]
            moves += [*shown.moves, Remember(f" sign {hop}", at.name), Home()]
            shown = self.way(at)
        value = at.fields["number"]
        said = Fact(
            "the number of the last thing is given",
            (seen(shown, value),),
            answer=value.options,
            wrong=ask.others("number", value.text),
        )
        return Part(
            ask=ask.ask("chain", item=record.name, times="1 sign" if hops == 1 else f"{hops} signs"),
            description=f"The number after {hops} signs from the {record.name}",
            facts=(*facts, said),
            moves=(*moves, *shown.moves, answer_is(value.text)),
            says=value.text,
        )
