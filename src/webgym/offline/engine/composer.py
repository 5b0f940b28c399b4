"""How tasks are put together from parts that are drawn until they are well posed."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from webgym.offline.engine.navigation import Site
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import stream

Ask: TypeAlias = Callable[[Site, random.Random, int], Part | None]
"""Makes a part with this many facts, or none if this draw does not give a well-posed one."""

DRAWS = 60
"""How often a part is drawn until one is well posed."""
SINGLES_PER_SITE = 20
SHAPES = ((3, 1), (3, 1), (3, 2), (3, 3), (3, 3), (4, 3))
"""Sizes of the parts of tasks that can be decomposed."""
LAST_SHAPES = ((3, 2, 1), (5, 3, 1))


@dataclass
class Composer:
    """Puts tasks of a website together.

    Attributes:
        site: the website.
        single: name of a part, what makes it, and how many facts it may have.
        large: what makes parts of three facts.
        small: what makes parts of one or two facts beside a large one.
        deed: what makes parts of four or five facts.
        once: kinds of which a task has one part at most: two would change what the other finds.
    """

    site: Site
    single: Sequence[tuple[str, Ask, tuple[int, ...]]]
    large: Sequence[tuple[str, Ask]]
    small: Sequence[tuple[str, Ask]]
    deed: tuple[str, Ask]
    once: frozenset[str] = frozenset()

    def assignments(self) -> Iterator[Assignment]:
        """Tasks of one part, and tasks of several that can be decomposed."""
        rng, taken = stream(self.site.seed, "assignments"), set[str]()
        made = 0
        for name, ask, sizes in rng.sample(self.single, len(self.single)):
            part = self._draw(ask, name, rng.choice(sizes), taken)
            if part is not None and made < SINGLES_PER_SITE:
                made += 1
                yield Assignment(name, (part,))
        for nth, shape in enumerate((*SHAPES, rng.choice(LAST_SHAPES)), start=1):
            parts = self._compose(rng, f"combined {nth}", shape, taken)
            if parts is not None:
                yield Assignment(f"combined-{nth}", parts)

    def _draw(self, ask: Ask, name: str, facts: int, taken: set[str]) -> Part | None:
        """A well-posed part that was not asked before, if some draw gives one."""
        rng = stream(self.site.seed, "part", name, facts)
        for _ in range(DRAWS):
            part = ask(self.site, rng, facts)
            if part is not None and part.ask not in taken:
                taken.add(part.ask)
                return part
        return None

    def _compose(
        self, rng: random.Random, name: str, shape: Sequence[int], taken: set[str]
    ) -> tuple[Part, ...] | None:
        large = rng.sample(self.large, len(self.large))
        small = rng.sample(self.small, len(self.small))
        parts: list[Part] = []
        used, stated = set[str](), set[str]()
        for size in shape:
            candidates = [self.deed] if size > 3 else large if size == 3 else small
            while candidates:
                kind, ask = candidates.pop()
                if kind in used & self.once:
                    continue
                part = self._draw(ask, f"{name} {kind}", size, taken)
                if part is not None and stated.isdisjoint(fact.text for fact in part.facts):
                    parts.append(part)
                    used.add(kind)
                    stated |= {fact.text for fact in part.facts}
                    break
            else:
                return None
        return tuple(parts)
