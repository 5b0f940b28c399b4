"""Trails: every page shows a sign and some tiles; the tile that matches leads on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal

import msgspec

from webgym.core.truth import Click, Evidence, Move, Remember
from webgym.offline.data import load
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream
from webgym.offline.small.questions import answer_is, check_placeholders
from webgym.offline.small.screen import Tile, capacity, singles
from webgym.offline.small.signs import Sign, number_sign, numbers
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, Visit, page

LENGTHS = (1, 2, 3, 3, 4, 5, 6, 7, 8, 9)
MOST_COUNTED = 4
"""How many signs a task may ask to follow by number; more are followed to the end."""


class TrailPhrases(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a trail's tasks are asked."""

    to_the_end: tuple[str, ...]
    steps: tuple[str, ...]

    def __post_init__(self) -> None:
        for phrase in self.to_the_end:
            check_placeholders("to_the_end", phrase, frozenset({"trail"}))
        for phrase in self.steps:
            check_placeholders("steps", phrase, frozenset({"trail", "times"}))


@lru_cache(maxsize=1)
def phrases() -> TrailPhrases:
    """How a trail's tasks are asked."""
    return load("webgym.offline.small", "trail.toml", TrailPhrases)


@dataclass(frozen=True)
class Stop:
    """One page of a trail.

    Attributes:
        number: that it shows.
        sign: what the right tile matches; ``None`` on the last page.
        tiles: on it, in order.
        right: the tile that leads on.
    """

    number: int
    sign: Sign | None
    tiles: tuple[Sign, ...]
    right: Sign | None


class Trail(SmallWebsite):
    """A website of trails.

    Attributes:
        trails: their pages, by their word.
        match: what a tile must share with the sign.
        strays: whether wrong tiles lead astray; else they lead nowhere.
    """

    family: ClassVar[str] = "trail"
    topic: ClassVar[tuple[str, str]] = ("Travel & Transportation", "Outdoor & Recreation")
    trails: dict[str, tuple[Stop, ...]]
    match: Literal["thing", "color", "icon"]
    strays: bool

    def fill(self) -> None:
        """Lay the trails."""
        rng, stock = stream(self.seed, "trail"), self.design.stock
        self.match = rng.choice(("thing", "color", "icon"))
        self.strays = rng.random() < 0.5
        lengths = [1, *rng.sample(LENGTHS[1:6], 3), rng.choice(LENGTHS[6:])]
        self.trails = {
            word: (*(self._stop(word, at) for at in range(length)), self._end(word))
            for word, length in zip(stock.words, lengths, strict=False)
        }

    def _number(self, word: str, at: int) -> int:
        return stream(self.seed, "number", word, at).randint(0, int(numbers()[-1]))

    def _end(self, word: str) -> Stop:
        return Stop(self._number(word, -1), None, (), None)

    def _stop(self, word: str, at: int) -> Stop:
        rng, stock = stream(self.seed, "stop", word, at), self.design.stock
        count = min(rng.randint(3, 6), capacity(self.design.layout, 1))
        colors, icons = rng.sample(stock.colors, count), rng.sample(stock.icons, count)
        tiles = [Sign(color, icon) for color, icon in zip(colors, icons, strict=True)]
        right = tiles[0]
        rng.shuffle(tiles)
        signs = {"thing": right, "color": Sign(color=right.color), "icon": Sign(icon=right.icon)}
        return Stop(self._number(word, at), signs[self.match], tuple(tiles), right)

    # --- pages ------------------------------------------------------------------------------------

    def _at(self, word: str, at: int) -> str:
        return f"/{self.token(word, at)}"

    @page("/")
    def front(self, visit: Visit) -> Response:
        """The trails' words."""
        return self.show(visit, singles([Tile(Sign(text=word), self._at(word, 0)) for word in self.trails]))

    @page("/lost")
    def lost(self, visit: Visit) -> Response:
        """Where wrong tiles lead."""
        return self.show(visit, [])

    @page("/{token}")
    def stop(self, visit: Visit, token: str) -> Response:
        """A page of a trail: its sign and its number in the bar, then the tiles."""
        found = next(
            (
                (word, at, stop)
                for word, stops in self.trails.items()
                for at, stop in enumerate(stops)
                if self.token(word, at) == token
            ),
            None,
        )
        if found is None:
            return self.missing(visit)
        word, at, stop = found
        wrong = "/lost" if self.strays else None
        tiles = [Tile(tile, self._at(word, at + 1) if tile == stop.right else wrong) for tile in stop.tiles]
        signs = [Tile(stop.sign)] if stop.sign is not None else []
        return self.show(visit, singles(tiles), Tile(number_sign(stop.number)), *signs)

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Every trail to its end, and its first pages by their number."""
        rng = stream(self.seed, "parts")
        for word, stops in self.trails.items():
            length = len(stops) - 1
            for phrase in phrases().to_the_end:
                yield self._part(word, length, phrase.format(trail=word), counts=False)
            for times in range(1, min(length - 1, MOST_COUNTED) + 1):
                told = "1 sign" if times == 1 else f"{times} signs"
                phrase = rng.choice(phrases().steps)
                yield self._part(word, times, phrase.format(trail=word, times=told), counts=True)

    def _part(self, word: str, steps: int, ask: str, *, counts: bool) -> Part:
        stops = self.trails[word]
        moves: list[Move] = [Click(word)]
        facts = []
        for at in range(steps):
            right = stops[at].right
            assert right is not None
            if counts:  # nothing on a page says how many came before it
                moves.append(Remember(f" sign {at + 1}", right.name))
            moves.append(Click(right.name))
            if at:
                text = f"page {at + 1} of the trail {word} is seen"
                facts.append(Fact(text, (Evidence((), self._at(word, at) + "$"),)))
        number = str(stops[steps].number)
        others = tuple(each for each in numbers() if each != number)
        view = Evidence((number,), self._at(word, steps) + "$")
        facts.append(Fact("the number of the last page is given", (view,), answer=(number,), wrong=others))
        return Part(
            ask=ask,
            description=f"The number after {steps} signs of the trail {word}",
            facts=tuple(facts),
            moves=(*moves, answer_is(number)),
            says=number,
        )
