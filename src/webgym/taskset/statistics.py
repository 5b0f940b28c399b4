"""Statistics of a task set (paper §3; SYSTEM.md 1.6), from which figures and tables are made."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, Literal, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from webgym.core.tables import Table, printed
from webgym.core.task import LEVELS, Level, Task, level_of
from webgym.core.websites import site_or_text
from webgym.tasks.taxonomy import DOMAINS

Part: TypeAlias = Literal["train", "test", "decomposed", "unsplit"]
PARTS: Final[tuple[Part, ...]] = ("train", "test", "decomposed", "unsplit")

TOP: Final = 20
"""Number of websites that are listed by name; in the paper's set they have about half of all tasks."""
_GRID: Final = 512


class DomainRow(msgspec.Struct, frozen=True):
    """Number of tasks of one subdomain, by level."""

    domain: str
    subdomain: str
    easy: int
    medium: int
    hard: int

    @property
    def tasks(self) -> int:
        """Number of tasks of all levels."""
        return self.easy + self.medium + self.hard


class SourceRow(msgspec.Struct, frozen=True):
    """Counts of one source; ``tasks`` includes the ``derived`` ones."""

    source: str
    websites: int
    tasks: int
    derived: int
    train: int
    test: int


class Lengths(msgspec.Struct, frozen=True):
    """Lengths of the trajectories of one level, in steps.

    Attributes:
        counts: number of trajectories by number of steps.
        mean: mean number of steps.
        mode: maximum of a Gaussian kernel density estimate with Scott's bandwidth.
    """

    counts: dict[int, int]
    mean: float
    mode: float

    @property
    def trajectories(self) -> int:
        """Number of trajectories."""
        return sum(self.counts.values())


class Statistics(msgspec.Struct, frozen=True):
    """Counts of a task set.

    Attributes:
        tasks: number of tasks.
        sizes: (number of tasks, number of websites with that number of tasks), descending.
        top: the websites with the most tasks and their numbers of tasks, descending, at most :data:`TOP`.
        difficulties: number of tasks by number of facts, for every part with tasks. ``decomposed`` tasks are
            counted in ``train``, ``test`` or ``unsplit``, too.
        domains: one row per subdomain of the taxonomy, in its order; then subdomains outside it.
        sources: one row per source, by number of tasks, descending.
        lengths: by level, easy first; empty without trajectories.
    """

    tasks: int
    sizes: list[tuple[int, int]]
    top: list[tuple[str, int]]
    difficulties: dict[Part, dict[int, int]]
    domains: list[DomainRow]
    sources: list[SourceRow]
    lengths: dict[Level, Lengths] = {}

    @property
    def websites(self) -> int:
        """Number of websites."""
        return sum(count for _, count in self.sizes)

    @property
    def top_share(self) -> float:
        """The share of all tasks that are on the top websites, 0 to 1."""
        return sum(count for _, count in self.top) / self.tasks if self.tasks else 0.0

    def levels(self, part: Part) -> dict[Level, int]:
        """Number of tasks of a part, by level."""
        counts: dict[Level, int] = dict.fromkeys(LEVELS, 0)
        for facts, count in self.difficulties.get(part, {}).items():
            counts[level_of(facts)] += count
        return counts

    def __str__(self) -> str:
        return printed(self.tables())

    def tables(self) -> list[Table]:
        """The statistics as tables."""
        result = [
            Table(
                "Tasks by source",
                ("source", "websites", "tasks", "derived", "train", "test"),
                [
                    (row.source, *_texts(row.websites, row.tasks, row.derived, row.train, row.test))
                    for row in self.sources
                ],
            ),
            Table(
                "Difficulty",
                ("part", "tasks", *(heading for level in LEVELS for heading in (level, f"{level}, %"))),
                [_difficulty_row(self, part) for part in self.difficulties],
            ),
            Table(
                "Tasks by domain",
                ("domain", "subdomain", "tasks", *LEVELS),
                [
                    (row.domain, row.subdomain, *_texts(row.tasks, row.easy, row.medium, row.hard))
                    for row in self.domains
                    if row.tasks
                ],
                names=2,
            ),
            Table(
                f"The {len(self.top)} largest of {self.websites:,} websites: {self.top_share:.1%} of tasks",
                ("website", "tasks"),
                [(website, str(count)) for website, count in self.top],
            ),
        ]
        if self.lengths:
            result.append(
                Table(
                    "Steps per trajectory",
                    ("level", "trajectories", "mean", "mode"),
                    [
                        (level, str(length.trajectories), f"{length.mean:.1f}", f"{length.mode:.1f}")
                        for level, length in self.lengths.items()
                    ],
                )
            )
        return result


def describe(tasks: Iterable[Task], lengths: Mapping[Level, Sequence[int]] | None = None) -> Statistics:
    """Compute the statistics of tasks.

    Args:
        tasks: of a set or a part of it.
        lengths: number of steps of each trajectory, by level of its task.
    """
    websites: Counter[str] = Counter()
    difficulties: dict[Part, Counter[int]] = {part: Counter() for part in PARTS}
    domains: Counter[tuple[str, str, Level]] = Counter()
    sources: dict[str, Counter[str]] = defaultdict(Counter)
    websites_by_source: dict[str, set[str]] = defaultdict(set)
    for task in tasks:
        site, facts = site_or_text(task.website), task.difficulty
        websites[site] += 1
        websites_by_source[task.source].add(site)
        difficulties[task.split or "unsplit"][facts] += 1
        domains[task.domain, task.subdomain, level_of(facts)] += 1
        sources[task.source][task.split or "unsplit"] += 1
        if task.parent_id is not None:
            difficulties["decomposed"][facts] += 1
            sources[task.source]["decomposed"] += 1
    return Statistics(
        tasks=websites.total(),
        sizes=sorted(Counter(websites.values()).items(), reverse=True),
        top=sorted(websites.items(), key=lambda item: (-item[1], item[0]))[:TOP],
        difficulties={part: dict(sorted(counts.items())) for part, counts in difficulties.items() if counts},
        domains=_domain_rows(domains),
        sources=_source_rows(sources, websites_by_source),
        lengths={level: measure(lengths[level]) for level in LEVELS if lengths and lengths.get(level)},
    )


def measure(steps: Sequence[int]) -> Lengths:
    """Mean and mode of the lengths of trajectories, in steps; there must be at least one."""
    counts = dict(sorted(Counter(steps).items()))
    grid, density = kernel_density(counts)
    return Lengths(counts, float(np.mean(steps)), float(grid[int(density.argmax())]))


def kernel_density(counts: Mapping[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A Gaussian kernel density estimate with Scott's bandwidth, from 0 to beyond the largest value.

    Returns:
        Grid and density. Apart from the part below 0, which is cut off, the density's integral is 1.
    """
    values = np.array(list(counts), dtype=float)
    weights = np.array(list(counts.values()), dtype=float)
    total = weights.sum()
    mean = float((values * weights).sum() / total)
    spread = float(np.sqrt((weights * (values - mean) ** 2).sum() / max(total - 1, 1)))
    width = (spread or 0.5) * float(total) ** -0.2
    grid = np.linspace(0.0, values.max() + 3 * width, _GRID)
    kernels = np.exp(-0.5 * ((grid[:, None] - values[None, :]) / width) ** 2)
    return grid, kernels @ weights / (total * width * np.sqrt(2 * np.pi))


def _domain_rows(counts: Mapping[tuple[str, str, Level], int]) -> list[DomainRow]:
    known = [(domain, subdomain) for domain, subdomains in DOMAINS.items() for subdomain in subdomains]
    outside_taxonomy = sorted({key[:2] for key in counts} - set(known))
    return [
        DomainRow(*place, *(counts.get((*place, level), 0) for level in LEVELS))
        for place in [*known, *outside_taxonomy]
    ]


def _source_rows(
    counts: Mapping[str, Counter[str]], websites_by_source: Mapping[str, set[str]]
) -> list[SourceRow]:
    rows = [
        SourceRow(
            source=source,
            websites=len(websites_by_source[source]),
            tasks=by_part["train"] + by_part["test"] + by_part["unsplit"],
            derived=by_part["decomposed"],
            train=by_part["train"],
            test=by_part["test"],
        )
        for source, by_part in counts.items()
    ]
    return sorted(rows, key=lambda row: (-row.tasks, row.source))


def _texts(*counts: int) -> tuple[str, ...]:
    return tuple(str(count) for count in counts)


def _difficulty_row(statistics: Statistics, part: Part) -> tuple[str, ...]:
    levels = statistics.levels(part)
    total = sum(levels.values())
    shares = (text for count in levels.values() for text in (str(count), f"{100 * count / total:.1f}"))
    return (part, str(total), *shares)
