"""Compose tasks from parts; each part is drawn until it is well posed."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from webgym.offline.engine.navigation import Site
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import stream

PartMaker: TypeAlias = Callable[[Site, random.Random, int], Part | None]
"""Makes a part with the given number of facts; ``None`` if this draw gives no well-posed part."""

DRAWS = 60
"""Largest number of draws for one part."""
SINGLES_PER_SITE = 20
SHAPES = ((3, 1), (3, 1), (3, 2), (3, 3), (3, 3), (4, 3))
"""Number of facts in each part, of the tasks that can be decomposed."""
LAST_SHAPES = ((3, 2, 1), (5, 3, 1))


@dataclass
class Composer:
    """Composes the tasks of a website.

    Attributes:
        site: the website.
        single: tasks of one part: name, maker, and possible numbers of facts.
        large: kinds and makers of parts with three facts.
        small: kinds and makers of parts with one or two facts.
        form_task: kind and maker of parts with four or five facts.
        once: kinds of which a task has at most one part, because two would change each other's result.
    """

    site: Site
    single: Sequence[tuple[str, PartMaker, tuple[int, ...]]]
    large: Sequence[tuple[str, PartMaker]]
    small: Sequence[tuple[str, PartMaker]]
    form_task: tuple[str, PartMaker]
    once: frozenset[str] = frozenset()

    def assignments(self) -> Iterator[Assignment]:
        """Yield tasks of one part, then tasks of several parts, which can be decomposed."""
        rng, used_asks = stream(self.site.seed, "assignments"), set[str]()
        count = 0
        for name, make, sizes in rng.sample(self.single, len(self.single)):
            part = self._draw(make, name, rng.choice(sizes), used_asks)
            if part is not None and count < SINGLES_PER_SITE:
                count += 1
                yield Assignment(name, (part,))
        for nth, shape in enumerate((*SHAPES, rng.choice(LAST_SHAPES)), start=1):
            parts = self._compose(rng, f"combined {nth}", shape, used_asks)
            if parts is not None:
                yield Assignment(f"combined-{nth}", parts)

    def _draw(self, make: PartMaker, name: str, facts: int, used_asks: set[str]) -> Part | None:
        """Draw a well-posed part whose clause is not in ``used_asks``; ``None`` if no draw gives one."""
        rng = stream(self.site.seed, "part", name, facts)
        for _ in range(DRAWS):
            part = make(self.site, rng, facts)
            if part is not None and part.ask not in used_asks:
                used_asks.add(part.ask)
                return part
        return None

    def _compose(
        self, rng: random.Random, name: str, shape: Sequence[int], used_asks: set[str]
    ) -> tuple[Part, ...] | None:
        large = rng.sample(self.large, len(self.large))
        small = rng.sample(self.small, len(self.small))
        parts: list[Part] = []
        used_kinds, fact_texts = set[str](), set[str]()
        for size in shape:
            candidates = [self.form_task] if size > 3 else large if size == 3 else small
            while candidates:
                kind, make = candidates.pop()
                if kind in used_kinds & self.once:
                    continue
                part = self._draw(make, f"{name} {kind}", size, used_asks)
                if part is not None and fact_texts.isdisjoint(fact.text for fact in part.facts):
                    parts.append(part)
                    used_kinds.add(kind)
                    fact_texts |= {fact.text for fact in part.facts}
                    break
            else:
                return None
        return tuple(parts)
