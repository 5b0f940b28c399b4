"""Trails: every page shows a sign and some tiles; the tile that matches the sign links to the next page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

from webgym.core.truth import Click, Evidence, Move, Remember
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream
from webgym.offline.small.design import Sign, number_sign, numbers
from webgym.offline.small.questions import answer_is, phrases
from webgym.offline.small.screen import Tile, capacity, singles
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, Visit, page

LENGTHS = (1, 2, 3, 3, 4, 5, 6, 7, 8, 9)
MOST_COUNTED = 4
"""Largest number of signs that an instruction gives; longer ways go to the end of the trail."""


@dataclass(frozen=True)
class Stop:
    """One page of a trail.

    Attributes:
        number: the number on it.
        sign: the sign that the correct tile matches; ``None`` on the last page.
        tiles: its tiles, in order.
        correct_tile: the tile that links to the next page; ``None`` on the last page.
    """

    number: int
    sign: Sign | None
    tiles: tuple[Sign, ...]
    correct_tile: Sign | None


class Trail(SmallWebsite):
    """A website of trails.

    Attributes:
        trails: the pages of each trail, by the word that names it.
        match: what the correct tile has in common with the sign.
        has_lost_page: whether wrong tiles link to an empty page; if not, they are no links.
    """

    family: ClassVar[str] = "trail"
    topic: ClassVar[tuple[str, str]] = ("Travel & Transportation", "Outdoor & Recreation")
    trails: dict[str, tuple[Stop, ...]]
    match: Literal["thing", "color", "icon"]
    has_lost_page: bool

    def fill(self) -> None:
        """Draw the trails."""
        rng, stock = stream(self.seed, "trail"), self.design.stock
        self.match = rng.choice(("thing", "color", "icon"))
        self.has_lost_page = rng.random() < 0.5
        lengths = [1, *rng.sample(LENGTHS[1:6], 3), rng.choice(LENGTHS[6:])]
        self.trails = {}
        for word, length in zip(stock.words, lengths, strict=False):
            end = Stop(self._number(word, -1), None, (), None)
            self.trails[word] = (*(self._stop(word, index) for index in range(length)), end)

    def _number(self, word: str, index: int) -> int:
        return stream(self.seed, "number", word, index).randint(0, int(numbers()[-1]))

    def _stop(self, word: str, index: int) -> Stop:
        rng, stock = stream(self.seed, "stop", word, index), self.design.stock
        count = min(rng.randint(3, 6), capacity(self.design.layout, 1))
        colors, icons = rng.sample(stock.colors, count), rng.sample(stock.icons, count)
        tiles = [Sign(color, icon) for color, icon in zip(colors, icons, strict=True)]
        correct_tile = tiles[0]
        rng.shuffle(tiles)
        signs = {
            "thing": correct_tile,
            "color": Sign(color=correct_tile.color),
            "icon": Sign(icon=correct_tile.icon),
        }
        return Stop(self._number(word, index), signs[self.match], tuple(tiles), correct_tile)

    # --- pages ------------------------------------------------------------------------------------

    def _stop_path(self, word: str, index: int) -> str:
        return f"/{self.token(word, index)}"

    @page("/")
    def front(self, visit: Visit) -> Response:
        """The front page: the words of the trails."""
        return self.show(
            visit, singles([Tile(Sign(text=word), self._stop_path(word, 0)) for word in self.trails])
        )

    @page("/lost")
    def lost(self, visit: Visit) -> Response:
        """The empty page to which wrong tiles link."""
        return self.show(visit, [])

    @page("/{token}")
    def stop(self, visit: Visit, token: str) -> Response:
        """A page of a trail: its number and its sign in the bar, and the tiles."""
        position = next(
            (
                (word, index, stop)
                for word, stops in self.trails.items()
                for index, stop in enumerate(stops)
                if self.token(word, index) == token
            ),
            None,
        )
        if position is None:
            return self.missing(visit)
        word, index, stop = position
        wrong = "/lost" if self.has_lost_page else None
        tiles = [
            Tile(tile, self._stop_path(word, index + 1) if tile == stop.correct_tile else wrong)
            for tile in stop.tiles
        ]
        signs = [Tile(stop.sign)] if stop.sign is not None else []
        return self.show(visit, singles(tiles), Tile(number_sign(stop.number)), *signs)

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Parts that follow a trail to its end, and parts that follow a given number of signs."""
        rng = stream(self.seed, "parts")
        for word, stops in self.trails.items():
            length = len(stops) - 1
            for phrase in phrases(self.family)["to_the_end"]:
                yield self._trail_part(word, length, phrase.format(trail=word), counts=False)
            for times in range(1, min(length - 1, MOST_COUNTED) + 1):
                times_text = "1 sign" if times == 1 else f"{times} signs"
                phrase = rng.choice(phrases(self.family)["steps"])
                yield self._trail_part(word, times, phrase.format(trail=word, times=times_text), counts=True)

    def _trail_part(self, word: str, steps: int, ask: str, *, counts: bool) -> Part:
        stops = self.trails[word]
        moves: list[Move] = [Click(word)]
        facts = []
        for index in range(steps):
            correct_tile = stops[index].correct_tile
            assert correct_tile is not None
            if counts:  # no page says how many came before it
                moves.append(Remember(f" sign {index + 1}", correct_tile.name))
            moves.append(Click(correct_tile.name))
            if index:
                text = f"page {index + 1} of the trail {word} is seen"
                facts.append(Fact(text, (Evidence((), self._stop_path(word, index) + "$"),)))
        number = str(stops[steps].number)
        wrong_numbers = tuple(other for other in numbers() if other != number)
        view = Evidence((number,), self._stop_path(word, steps) + "$")
        facts.append(
            Fact("the number of the last page is given", (view,), answer=(number,), wrong=wrong_numbers)
        )
        return Part(
            ask=ask,
            description=f"The number after {steps} signs of the trail {word}",
            facts=tuple(facts),
            moves=(*moves, answer_is(number)),
        )
