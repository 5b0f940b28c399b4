"""From the parts that a website offers to its tasks, in a mix of difficulties."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from webgym.core.task import LARGE_GROUP_AT_LEAST, FactGroup, Level, Rubric, level_of
from webgym.offline.parts import Assignment, Part

MOST_PARTS = 4
ALONE = 0.75
"""Share of easy tasks that are one part."""

_TRIES = 400


@dataclass(frozen=True)
class Mix:
    """How many tasks of each level a website has, with those that are derived by decomposition."""

    easy: int = 25
    medium: int = 5
    hard: int = 1

    def of(self, level: Level) -> int:
        """The number for a level."""
        return {"easy": self.easy, "medium": self.medium, "hard": self.hard}[level]


FACTS: dict[Level, tuple[int, int]] = {"easy": (1, 3), "medium": (4, 6), "hard": (7, 9)}
"""How many facts a composition may have."""


def compose(rng: random.Random, parts: Sequence[Part], mix: Mix) -> list[Assignment]:
    """Tasks made of these parts.

    Harder ones come first, so that what is derived from them counts. A part stands in several tasks, but
    no two tasks have the same parts. A website with few parts has fewer tasks than the mix wants.
    """
    counts: Counter[Level] = Counter()
    used: set[frozenset[str]] = set()
    made: list[Assignment] = []
    for level in ("hard", "medium", "easy"):
        for _ in range(_TRIES):
            if counts[level] >= mix.of(level):
                break
            chosen = _draw(rng, parts, level)
            derived = _derived(chosen)
            asked = [frozenset(part.ask for part in some) for some in derived]
            room = all(
                counts[each] + more <= mix.of(each) for each, more in Counter(map(_level, derived)).items()
            )
            if not chosen or not room or used & set(asked):
                continue
            used.update(asked)
            counts.update(_level(some) for some in derived)
            made.append(Assignment(f"{level}-{sum(a.name.startswith(level) for a in made) + 1}", chosen))
    return made


def _draw(rng: random.Random, parts: Sequence[Part], level: Level) -> tuple[Part, ...]:
    """Parts that fit together and have the facts of a level; empty if the draw failed."""
    least, most = FACTS[level]
    if level == "easy" and rng.random() < ALONE:
        part = rng.choice(parts)
        return (part,) if len(part.facts) <= most else ()
    wanted = rng.randint(least, most)
    chosen: list[Part] = []
    for part in rng.sample(list(parts), len(parts)):
        left = wanted - sum(len(each.facts) for each in chosen)
        if len(part.facts) <= left and not any(clash(part, other) for other in chosen):
            chosen.append(part)
        if len(chosen) == MOST_PARTS or left == len(part.facts):
            break
    total = sum(len(part.facts) for part in chosen)
    return tuple(chosen) if least <= total <= most else ()


def clash(one: Part, other: Part) -> bool:
    """Whether two parts cannot stand in one task: they ask the same, or for different states."""
    if one.ask == other.ask:
        return True
    for check in (check for fact in one.facts for check in fact.state):
        for against in (check for fact in other.facts for check in fact.state):
            if check.key != against.key:
                continue
            if not (isinstance(check.value, dict) and isinstance(against.value, dict)):
                return True
            if check.value.keys() & against.value.keys():
                return True
    return False


def _derived(chosen: tuple[Part, ...]) -> list[tuple[Part, ...]]:
    """The composition and all that is derived from it (paper, Algorithm 1)."""
    if not any(len(part.facts) >= LARGE_GROUP_AT_LEAST for part in chosen):
        return [chosen] if chosen else []
    groups = tuple(FactGroup(at, "-", ("-",) * len(part.facts)) for at, part in enumerate(chosen))
    subsets = (rubric.groups for rubric in Rubric(groups).decompositions())
    return [chosen, *(tuple(chosen[group.id] for group in subset) for subset in subsets)]


def _level(parts: Sequence[Part]) -> Level:
    return level_of(sum(len(part.facts) for part in parts))
