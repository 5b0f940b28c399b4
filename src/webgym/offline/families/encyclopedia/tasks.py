"""The tasks of an encyclopedia: which parts a website's assignments are composed of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

from webgym.offline.families.encyclopedia.acts import Acts
from webgym.offline.families.encyclopedia.look_ups import LookUps
from webgym.offline.families.encyclopedia.searches import Searches
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.encyclopedia import Encyclopedia

Maker: TypeAlias = Callable[[], "Part | None"]

ATTEMPTS = 6
"""How often an assignment is drawn anew before it is left out, because a part cannot be made or was asked."""


class Author(LookUps, Searches, Acts):
    """Writes the assignments of one encyclopedia.

    Every assignment has its own stream, and no two of its parts speak of the same article.
    """

    def __init__(self, site: Encyclopedia) -> None:
        super().__init__(site)
        self.asked: set[str] = set()

    @property
    def _small(self) -> dict[str, Maker]:
        """Parts of one or two facts."""
        return {
            "look-up": lambda: self.look_up(self.rng.randint(1, 2)),
            "extreme": self.extreme,
            "count": self.count,
            "lacking": self.lacking,
            "either": self.either,
            "detail": self.detail,
            "which": self.which,
            "earliest": self.earliest,
            "changes": self.changes,
            "letter-count": self.letter_count,
            "citation": self.citation,
            "help": self.help_topic,
            "in-year": self.in_year,
            "busiest": self.busiest,
        }

    @property
    def _large(self) -> dict[str, Maker]:
        """Parts of three facts."""
        return {
            "profile": lambda: self.look_up(3),
            "top-three": self.top_three,
            "difference": self.difference,
            "origin": self.origin,
            "version": self.version,
            "save": lambda: self.save(3),
            "correct": self.correct,
            "subscribe": self.subscribe,
        }

    def assignments(self) -> Iterator[Assignment]:
        """Single parts first, then compositions."""
        rng = stream(self.site.seed, "plan")
        small, large = list(self._small), list(self._large)
        # There is one person with the most articles: asked once, it is used up.
        often = [kind for kind in small if kind != "busiest"]
        for name in [*rng.sample(small, 9), *rng.sample(large, 4)]:
            yield from self._assignment(name, [name])
        yield from self._assignment("save-two", ["save-two"])
        for index in range(2):
            yield from self._assignment(f"tour-{index + 1}", [rng.choice(large), rng.choice(often)])
        chosen = rng.sample(large, 2)
        yield from self._assignment("study-1", [*chosen, rng.choice(often)])
        yield from self._assignment("study-2", rng.sample(large, 3))

    def _assignment(self, name: str, kinds: list[str]) -> Iterator[Assignment]:
        makers = self._small | self._large | {"save-two": lambda: self.save(2)}
        for attempt in range(ATTEMPTS):
            self.begin(f"{name} {attempt}")
            parts = [part for kind in kinds if (part := makers[kind]()) is not None]
            asks = {part.ask for part in parts}
            if len(parts) == len(kinds) and not asks & self.asked:
                self.asked |= asks
                yield Assignment(name, tuple(parts))
                return
