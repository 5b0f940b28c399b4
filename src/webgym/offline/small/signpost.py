"""Signposts: a sign on one page says what to find on another page, so that it must be remembered."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from webgym.core.truth import Click, Evidence, Home, Move, Remember
from webgym.offline.engine.records import Record
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream
from webgym.offline.small.catalog import Catalog, Kind
from webgym.offline.small.design import Sign
from webgym.offline.small.questions import Questions, answer_is, field_evidence, phrases, sample
from webgym.offline.small.screen import Block, Tile, singles
from webgym.offline.website import Response, Visit, page

FRONT = "the first page"
MOST_HOPS = 5


class Signpost(Catalog):
    """A website with signs that name things.

    Attributes:
        sign_kind: what signs show: the whole thing, its colour, or its icon.
        meanings: the thing that the sign of a page stands for, by the page's word; :data:`FRONT` is the front
            page.
        successors: the thing on the sign of a thing's page, by the name of the latter; empty without chains.
    """

    family: ClassVar[str] = "signpost"
    topic: ClassVar[tuple[str, str]] = ("Travel & Transportation", "Travel & Accommodation")
    kinds: ClassVar[tuple[Kind, ...]] = ("color", "icon")
    sign_kind: Literal["thing", "color", "icon"]
    meanings: dict[str, Record]
    successors: dict[str, Record]

    def fill(self) -> None:
        """Draw the sections, and what the signs mean."""
        super().fill()
        rng = stream(self.seed, "signs")
        self.sign_kind = rng.choice(("thing", "thing", "color", "icon"))
        things = self.records()
        pages = [FRONT, *self.design.stock.words[: rng.randint(3, 4)]]
        self.meanings = dict(zip(pages, rng.sample(things, len(pages)), strict=True))
        order = rng.sample(things, len(things))
        chained = rng.random() < 0.6
        self.successors = {
            thing.name: next_thing
            for thing, next_thing in zip(order, [*order[1:], order[0]], strict=True)
            if chained
        }

    def page_sign(self, page_name: str) -> Sign:
        """The sign of a page."""
        thing = self.signs[self.meanings[page_name].name]
        if self.sign_kind == "color":
            return Sign(color=thing.color)
        return Sign(icon=thing.icon) if self.sign_kind == "icon" else thing

    # --- pages ------------------------------------------------------------------------------------

    def front_tiles(self) -> list[Tile]:
        """The sections, then the pages with signs."""
        words = [page_name for page_name in self.meanings if page_name != FRONT]
        return [
            *super().front_tiles(),
            *(Tile(Sign(text=word), f"/sign/{self.token(word)}") for word in words),
        ]

    def front_mark(self) -> Sign | None:
        """The sign of the front page."""
        return self.page_sign(FRONT)

    @page("/sign/{token}")
    def sign_page(self, visit: Visit, token: str) -> Response:
        """A page with nothing but a sign."""
        page_name = next((word for word in self.meanings if self.token(word) == token), None)
        if page_name is None:
            return self.missing(visit)
        return self.show(visit, singles([Tile(self.page_sign(page_name))]), mark=Sign(text=page_name))

    def thing_blocks(self, record: Record) -> list[Block]:
        """The thing, its number, and the sign of its successor."""
        blocks = list(super().thing_blocks(record))
        if record.name in self.successors:
            blocks += singles([Tile(self.signs[self.successors[record.name].name])])
        return blocks

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Parts that read signs and find their things, follow chains of signs, look up, compare and count."""
        rng = stream(self.seed, "parts")
        questions, things = Questions(self, phrases(self.family), rng), self.records()
        for page_name in self.meanings:
            for _ in phrases(self.family)["thing"]:
                yield self._meaning_part(questions, page_name)
        words = [page_name for page_name in self.meanings if page_name != FRONT]
        for first_page, second_page in zip(words, [*words[1:], words[0]], strict=True):
            numbers = {self.meanings[page_name].rank("number") for page_name in (first_page, second_page)}
            if len(numbers) == 2 and self.sign_kind == "thing":
                yield self._comparison_part(questions, first_page, second_page)
        for record in sample(rng, things, 8 if self.successors else 0):
            yield self._chain_part(questions, record, rng.choice((1, 1, 2, 2, 3, 4, MOST_HOPS)))
        for record in sample(rng, things, 8):
            yield questions.look_up(record, "number")
        for first, second in zip(sample(rng, things, 3), sample(rng, things, 3), strict=True):
            if first.rank("number") != second.rank("number"):
                yield questions.compare(first, second, "number", larger=rng.random() < 0.5)
        yield questions.count(rng.choice(list(self.lists)))

    def _read_sign(self, page_name: str) -> tuple[Fact, tuple[Move, ...]]:
        """The fact that the sign of a page was seen, and the moves that see and note it."""
        path = "/$" if page_name == FRONT else f"/sign/{self.token(page_name)}$"
        fact = Fact(f"the sign on {self._page_phrase(page_name)} is seen", (Evidence((), path),))
        note = Remember("sign" if page_name == FRONT else page_name, self.page_sign(page_name).name)
        return fact, (note,) if page_name == FRONT else (Click(page_name), note)

    def _page_phrase(self, page_name: str) -> str:
        return page_name if page_name == FRONT else f"the {page_name} page"

    def _meaning_part(self, questions: Questions, page_name: str) -> Part:
        """Say the number of the thing that a page's sign stands for."""
        record, thing = self.meanings[page_name], self.signs[self.meanings[page_name].name]
        other_trait = {"color": {"rest": thing.icon}, "icon": {"rest": thing.color}}.get(self.sign_kind, {})
        fact, moves = self._read_sign(page_name)
        location, value = self.locate(record), record.fields["number"]
        text = "the number of the thing that it shows is given"
        value_fact = questions.answered(text, value, "number", (field_evidence(location, value),))
        return Part(
            ask=questions.ask(self.sign_kind, page=self._page_phrase(page_name), **other_trait),
            description=f"The number of what the sign on {self._page_phrase(page_name)} shows",
            facts=(fact, value_fact),
            moves=(*moves, Home(), *location.moves, answer_is(value.text)),
        )

    def _comparison_part(self, questions: Questions, first: str, second: str) -> Part:
        """Name the thing with the larger number of those on two signs."""
        signs = [self._read_sign(page_name) for page_name in (first, second)]
        facts, moves, winner = questions.compared(
            self.meanings[first], self.meanings[second], "number", larger=True
        )
        text = "the one with the larger number is named"
        winner_fact = questions.named(text, winner, facts[winner.name].evidence)
        sign_moves = [move for _, moves in signs for move in (*moves, Home())]
        return Part(
            ask=questions.ask("which", page=self._page_phrase(first), other=self._page_phrase(second)),
            description=f"Which has the larger number: what {first} or what {second} shows",
            facts=(*(fact for fact, _ in signs), *facts.values(), winner_fact),
            moves=(*sign_moves, *moves, answer_is(winner.name)),
        )

    def _chain_part(self, questions: Questions, record: Record, hops: int) -> Part:
        """Say the number of the last thing of a chain of signs."""
        facts, moves, thing = list[Fact](), list[Move](), record
        location = self.locate(record)
        for hop in range(1, hops + 1):
            facts.append(Fact(f"sign {hop} on the way is seen", (Evidence((), location.path),)))
            thing = self.successors[thing.name]
            moves += [*location.moves, Remember(f" sign {hop}", thing.name), Home()]
            location = self.locate(thing)
        value = thing.fields["number"]
        text = "the number of the last thing is given"
        value_fact = questions.answered(text, value, "number", (field_evidence(location, value),))
        return Part(
            ask=questions.ask("chain", item=record.name, times="1 sign" if hops == 1 else f"{hops} signs"),
            description=f"The number after {hops} signs from the {record.name}",
            facts=(*facts, value_fact),
            moves=(*moves, *location.moves, answer_is(value.text)),
        )
