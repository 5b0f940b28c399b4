"""The base class of small websites: a design, pages of signs, and tasks in a small vocabulary.

Tasks are composed of parts, in a mix of difficulties.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from webgym.core.task import LARGE_GROUP_AT_LEAST, FactGroup, Level, Rubric, level_of
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import number, stream
from webgym.offline.small.design import Design, Sign, control, design
from webgym.offline.small.screen import Block, Tile, bar_room, page
from webgym.offline.website import Response, Visit, Website, slug

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
            added = Counter(level_of(sum(len(part.facts) for part in task)) for task in tasks)
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


class SmallWebsite(Website):
    """Base class of the small families.

    A family overrides :meth:`fill`, :meth:`parts` and, if it has controls of its own, :meth:`controls`.
    """

    mix: ClassVar[Mix] = Mix()
    topic: ClassVar[tuple[str, str]] = ("Misc.", "General Info.")
    """Domain and subdomain, by which :class:`webgym.tasks.selection.Selection` can exclude tasks."""
    design: Design

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """Brand and hostname label of a new website: ``("Fernhill", "fernhill-small-market")``."""
        del seed
        return stem, f"{slug(stem)}-small-{cls.family}"

    def build(self) -> None:
        """Draw the design and the records."""
        (self.domain, self.subdomain), self.tagline = self.topic, ""
        self.design = design(self.seed, self.split)
        self.fill()

    def fill(self) -> None:
        """Draw the records from the seed and the design's signs."""
        raise NotImplementedError

    def parts(self) -> Iterable[Part]:
        """All parts of which tasks can be composed."""
        raise NotImplementedError

    def assignments(self) -> Iterable[Assignment]:
        """The tasks, composed of the parts."""
        return compose(stream(self.seed, "compose"), list(self.parts()), self.mix)

    # --- pages ------------------------------------------------------------------------------------

    def token(self, *names: object) -> str:
        """A part of an address that does not reveal what the page shows: six hexadecimal digits."""
        return f"{number(self.seed, 'token', *names) % 16**6:06x}"

    def controls(self, visit: Visit) -> list[Tile]:
        """The controls in the bar of every page."""
        return [] if visit.path == "/" else [Tile(control("home"), "/")]

    def show(
        self,
        visit: Visit,
        blocks: Sequence[Block],
        *controls: Tile,
        mark: Sign | None = None,
        status: int = 200,
    ) -> Response:
        """Render a page.

        Args:
            visit: the request.
            blocks: the content of the page.
            controls: controls of this page, after those of every page.
            mark: a sign at the end of the bar without a link; left out if there is no room.
            status: HTTP status.
        """
        bar = [*self.controls(visit), *controls]
        if mark is not None and len(bar) < bar_room(self.design.layout):
            bar.append(Tile(mark))
        return Response(page(self.design, self.brand, bar, blocks).encode(), status)

    def missing(self, visit: Visit, status: int = 404) -> Response:
        """A page with only the controls."""
        return self.show(visit, [], status=status)
