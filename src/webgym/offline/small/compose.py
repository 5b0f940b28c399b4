"""Compose the tasks of a small website from its parts, in a mix of difficulties."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from webgym.core.task import LARGE_GROUP_AT_LEAST, FactGroup, Level, Rubric, level_of
from webgym.offline.parts import Assignment, Part

MOST_PARTS = 4
ALONE = 0.75
"""Probability that an easy task is drawn as a single part."""

_TRIES = 400


@dataclass(frozen=True)
class Mix:
    """Number of tasks of each level on a website, including those derived by decomposition."""

    easy: int = 25
    medium: int = 5
    hard: int = 1

    def of(self, level: Level) -> int:
        """The number of tasks of a level."""
        return {"easy": self.easy, "medium": self.medium, "hard": self.hard}[level]


FACTS: dict[Level, tuple[int, int]] = {"easy": (1, 3), "medium": (4, 6), "hard": (7, 9)}
"""Smallest and largest number of facts of a task, by level."""


def compose(rng: random.Random, parts: Sequence[Part], mix: Mix) -> list[Assignment]:
    """Compose tasks from parts.

    Harder tasks come first, because the tasks derived from them count as well. A part may be in several
    tasks, but no two tasks have the same parts. If there are too few parts, there are fewer tasks than
    ``mix`` says.
    """
    counts: Counter[Level] = Counter()
    used: set[frozenset[str]] = set()
    assignments: list[Assignment] = []
    for level in ("hard", "medium", "easy"):
        for _ in range(_TRIES):
            if counts[level] >= mix.of(level):
                break
            chosen = _draw(rng, parts, level)
            tasks = _with_derived(chosen)
            asks = [frozenset(part.ask for part in task) for task in tasks]
            added = Counter(map(_level, tasks))
            fits = all(counts[other] + count <= mix.of(other) for other, count in added.items())
            if not chosen or not fits or used & set(asks):
                continue
            used.update(asks)
            counts.update(added)
            number = sum(assignment.name.startswith(level) for assignment in assignments) + 1
            assignments.append(Assignment(f"{level}-{number}", chosen))
    return assignments


def _draw(rng: random.Random, parts: Sequence[Part], level: Level) -> tuple[Part, ...]:
    """Draw parts that do not clash and have the number of facts of a level; empty if the draw fails."""
    least, most = FACTS[level]
    if level == "easy" and rng.random() < ALONE:
        part = rng.choice(parts)
        return (part,) if len(part.facts) <= most else ()
    wanted = rng.randint(least, most)
    chosen: list[Part] = []
    for part in rng.sample(list(parts), len(parts)):
        missing = wanted - sum(len(chosen_part.facts) for chosen_part in chosen)
        if len(part.facts) <= missing and not any(clash(part, other) for other in chosen):
            chosen.append(part)
        if len(chosen) == MOST_PARTS or missing == len(part.facts):
            break
    total = sum(len(part.facts) for part in chosen)
    return tuple(chosen) if least <= total <= most else ()


def clash(first: Part, second: Part) -> bool:
    """Whether two parts cannot be in one task: they have the same clause, or check the same state."""
    if first.ask == second.ask:
        return True
    for check in (check for fact in first.facts for check in fact.state):
        for other in (check for fact in second.facts for check in fact.state):
            if check.key != other.key:
                continue
            if not (isinstance(check.value, dict) and isinstance(other.value, dict)):
                return True
            if check.value.keys() & other.value.keys():
                return True
    return False


def _with_derived(chosen: tuple[Part, ...]) -> list[tuple[Part, ...]]:
    """The parts of a task, and of the tasks derived from it by decomposition (paper, Algorithm 1)."""
    if not any(len(part.facts) >= LARGE_GROUP_AT_LEAST for part in chosen):
        return [chosen] if chosen else []
    groups = tuple(FactGroup(index, "-", ("-",) * len(part.facts)) for index, part in enumerate(chosen))
    subsets = (rubric.groups for rubric in Rubric(groups).decompositions())
    return [chosen, *(tuple(chosen[group.id] for group in subset) for subset in subsets)]


def _level(parts: Sequence[Part]) -> Level:
    return level_of(sum(len(part.facts) for part in parts))
