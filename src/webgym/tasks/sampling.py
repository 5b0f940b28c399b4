"""Drawing tasks: a sampler that continues from draw to draw (SYSTEM.md 5), and single draws.

    sampler = Sampler(tasks, SamplerConfig(seed=7, ratio={"easy": 2, "medium": 1, "hard": 1}))
    batch = sampler.draw(1_024)
    state = sampler.state()  # small, JSON-serialisable; restore() continues from it

A sampler draws without replacement. Each level with its own share is a stratum; a stratum is shuffled, drawn
from until all of its tasks have been drawn, over several draws if necessary, and shuffled again. Weights
(:func:`near_success`, :func:`spread_websites`) only change which tasks of a stratum are likely to come early.
"""

from __future__ import annotations

import hashlib
import random
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cached_property
from itertools import zip_longest
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np
from numpy.random import PCG64, Generator
from numpy.typing import NDArray
from pydantic import Field, model_validator

from webgym.core.errors import ConfigError, NothingToDraw
from webgym.core.task import LEVELS, Level, Task
from webgym.core.websites import host_of, host_or_text
from webgym.tasks.brands import brand_or_text
from webgym.tasks.selection import Selection, select

T = TypeVar("T")

Weigh: TypeAlias = "Callable[[Stratum], NDArray[np.float64]]"
"""Returns the weights of a stratum's tasks, in its order; 0 for never. Called for every shuffle."""

_ALL: Final = "all"


class SamplerConfig(Selection):
    """Which tasks are drawn, in which shares and in which order."""

    seed: int = 0
    """Seed of all shuffles."""
    shard: int = Field(default=0, ge=0)
    """Index of this worker, from 0. Workers with the same seed and tasks draw from disjoint parts."""
    shards: int = Field(default=1, ge=1)
    """Number of workers; together they draw from all tasks."""

    @model_validator(mode="after")
    def _check_shard(self) -> SamplerConfig:
        if self.shard >= self.shards:
            raise ValueError(f"there is no shard {self.shard} of {self.shards}: they count from 0")
        return self


class Stratum:
    """The tasks of one stratum, and how many of them have been drawn.

    Attributes:
        name: of the stratum: a level, or "all".
        tasks: its tasks, in a fixed order.
        epoch: number of complete passes through the tasks.
        position: number of tasks drawn or skipped in the current pass.
        drawn: number of tasks drawn in total.
    """

    def __init__(self, name: str, tasks: list[Task], seed: int) -> None:
        self.name = name
        self.tasks = tasks
        self.epoch = self.position = self.drawn = 0
        self._seed = seed
        self._order: NDArray[np.intp] | None = None

    @cached_property
    def places(self) -> dict[str, int]:
        """Index in :attr:`tasks` of each task, by id."""
        return {task.id: place for place, task in enumerate(self.tasks)}

    @cached_property
    def brands(self) -> list[str]:
        """The brand of each task's website, in the order of :attr:`tasks`."""
        return [brand_or_text(task.website) for task in self.tasks]

    def draw(
        self, count: int, blocked: Collection[str], passed_over: Counter[str], weigh: Weigh | None
    ) -> list[Task]:
        """Draw the next tasks. Tasks on blocked websites are skipped until the next shuffle, except test
        tasks.

        Args:
            count: number of tasks to draw.
            blocked: blocked websites.
            passed_over: counter of the skipped tasks by website, which is updated.
            weigh: weights of the tasks; ``None`` for equal ones.

        Raises:
            NothingToDraw: all tasks are skipped.
        """
        drawn: list[Task] = []
        whole, before = self.position == 0, 0
        while len(drawn) < count:
            order = self._order if self._order is not None else self._shuffle(weigh)
            batch = order[self.position : self.position + count - len(drawn)]
            for task in map(self.tasks.__getitem__, batch):
                if blocked and task.split != "test" and (site := host_or_text(task.website)) in blocked:
                    passed_over[site] += 1
                else:
                    drawn.append(task)
            self.position += len(batch)
            if self.position == len(order):
                if whole and len(drawn) == before:
                    raise NothingToDraw(
                        f"there is no task left to draw: all {len(order):,} in {self.name!r} are on blocked "
                        "websites or have no weight",
                        hint="unblock a website, or give more tasks",
                    )
                whole, before = True, len(drawn)
                self.next_epoch()
        self.drawn += count
        return drawn

    def next_epoch(self) -> None:
        """End the current pass: the tasks are shuffled before the next draw."""
        self.epoch, self.position, self._order = self.epoch + 1, 0, None

    def restore(self, epoch: int, position: int, drawn: int) -> None:
        """Restore the state of a stratum with the same tasks."""
        self.epoch, self.position, self.drawn, self._order = epoch, position, drawn, None

    def _shuffle(self, weigh: Weigh | None) -> NDArray[np.intp]:
        """A weighted random order of the tasks with positive weight (Efraimidis and Spirakis)."""
        rng = _rng(self._seed, "epoch", self.name, self.epoch)
        keys = -np.log1p(-rng.random(len(self.tasks)))
        if weigh is not None:
            weights = weigh(self)
            keys = np.divide(keys, weights, out=np.full(len(keys), np.inf), where=weights > 0)
        self._order = np.argsort(keys)[: int(np.isfinite(keys).sum())]
        return self._order


class Sampler:
    """Draws tasks without replacement until all have been drawn, and then starts again.

    Args:
        tasks: the whole set, in the same order for every worker and after every restart. Only its training
            tasks are drawn, unless the config selects another split (:mod:`webgym.tasks.selection`).
        config: which tasks are drawn, and in which shares.
        blocked: called before every draw; returns the websites from which nothing is drawn for now, such as
            those that refuse or are dead (:meth:`webgym.rollout.site_health.SiteHealth.blocked`).
        weigh: weights of the tasks, computed for every pass; ``None`` for equal ones.
        anew: draw from all tasks every time, not only from those that are left in the pass; for weights that
            change over time. A task may then occur in the next draw again, but not twice in the same.

    Raises:
        NothingToDraw: there is no task, or none of a level in the ratio.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        config: SamplerConfig | None = None,
        *,
        blocked: Callable[[], Collection[str]] = tuple,
        weigh: Weigh | None = None,
        anew: bool = False,
    ) -> None:
        self.config = config or SamplerConfig()
        self._weigh = weigh
        self._anew = anew
        self._blocked: set[str] = set()
        self._blocked_for_now = blocked
        self._draws = 0
        self.passed_over: Counter[str] = Counter()
        """Number of tasks that the last draw skipped because their website is blocked, by website."""
        self.selected = select(tasks, self.config)
        """The tasks that are drawn from."""
        if not self.selected.tasks:
            raise NothingToDraw(
                f"there is no task to draw among {len(tasks):,}: {self.selected.told()}",
                hint="choose another split or more domains",
            )
        tasks = self.selected.tasks
        names = "\n".join(task.id for task in tasks)
        settings = self.config.model_dump_json()
        self._fingerprint = hashlib.blake2b(f"{settings}\n{names}".encode(), digest_size=8).hexdigest()
        self._strata = _strata(tasks, self.config)
        ratio: Mapping[Any, float] = self.config.ratio or {_ALL: 1.0}
        total = sum(ratio[stratum.name] for stratum in self._strata)
        self._shares = [ratio[stratum.name] / total for stratum in self._strata]

    @property
    def blocked(self) -> frozenset[str]:
        """The hosts from which no task is drawn, as from :func:`host_of`."""
        return frozenset(self._blocked)

    def block(self, *websites: str) -> None:
        """Draw no more tasks that start on the hosts of these websites."""
        self._blocked.update(map(host_of, websites))

    def unblock(self, *websites: str) -> None:
        """Draw from these websites again. Skipped tasks return when their stratum is shuffled."""
        self._blocked.difference_update(map(host_of, websites))

    def draw(self, count: int) -> list[Task]:
        """Draw the next tasks, with levels mixed. A task can occur twice only if a pass ends within the draw.

        Test tasks are drawn even if their website is blocked, so that a test set stays the same.

        Raises:
            NothingToDraw: all tasks are on blocked websites.
        """
        batch: list[Task] = []
        is_test = self.config.split == "test"  # also if the set has no splits
        blocked = () if is_test else self._blocked.union(self._blocked_for_now())
        self.passed_over = Counter()
        for stratum, quota in zip(self._strata, self._quotas(count), strict=True):
            if self._anew and stratum.position:
                stratum.next_epoch()
            batch += stratum.draw(quota, blocked, self.passed_over, self._weigh)
        order = _rng(self.config.seed, "mix", self._draws).random(count).argsort(kind="stable")
        self._draws += 1
        return [batch[place] for place in order]

    def state(self) -> dict[str, Any]:
        """The state, JSON-serialisable: a few numbers per stratum, and the blocked websites."""
        return {
            "of": self._fingerprint,
            "draws": self._draws,
            "decks": {
                stratum.name: [stratum.epoch, stratum.position, stratum.drawn] for stratum in self._strata
            },
            "blocked": sorted(self._blocked),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from the state of a sampler with the same tasks, settings and weights.

        Raises:
            ConfigError: the state belongs to other tasks or settings.
        """
        if state.get("of") != self._fingerprint:
            raise ConfigError(
                "the sampler's state belongs to other tasks or settings",
                hint="give the same tasks, in the same order, and the same settings; or start again",
            )
        self._draws = state["draws"]
        self._blocked = set(state["blocked"])
        for stratum in self._strata:
            stratum.restore(*state["decks"][stratum.name])

    def _quotas(self, count: int) -> list[int]:
        """The number of tasks from each stratum that keeps the totals as close to the shares as possible."""
        total = sum(stratum.drawn for stratum in self._strata) + count
        owed = [
            max(0.0, share * total - stratum.drawn)
            for share, stratum in zip(self._shares, self._strata, strict=True)
        ]
        quotas = [int(amount) for amount in owed]
        rest = sorted(range(len(owed)), key=lambda place: quotas[place] - owed[place])
        for place in rest[: count - sum(quotas)]:
            quotas[place] += 1
        return quotas


def near_success(
    results: Mapping[str, tuple[int, int]], *, target: float = 0.5, width: float = 0.2, least: float = 0.02
) -> Weigh:
    """Weights of a curriculum: tasks with a success rate near ``target`` come early; use it with
    ``anew=True``.

    Args:
        results: (successes, attempts) by task id; read for every draw, so it may be updated. The rate of a
            task is smoothed with one attempt at the target rate.
        target: preferred success rate, 0 to 1.
        width: standard deviation of the Gaussian around it, as a success rate.
        least: weight of a task far from the target; a task on target has weight 1.
    """

    def weigh(stratum: Stratum) -> NDArray[np.float64]:
        known = [(stratum.places[id], *result) for id, result in results.items() if id in stratum.places]
        places, successes, attempts = np.array(known, dtype=np.intp).reshape(-1, 3).T
        off = (successes + target) / (attempts + 1) - target
        weights = np.ones(len(stratum.tasks))
        weights[places] = least + (1 - least) * np.exp(-0.5 * (off / width) ** 2)
        return weights

    return weigh


def spread_websites(power: float = 1.0) -> Weigh:
    """Weights for diversity: a brand with n tasks, on all its websites together, is drawn as if it had
    n^(1 - power) tasks; with power 1, as if it had one."""

    def weigh(stratum: Stratum) -> NDArray[np.float64]:
        sizes = Counter(stratum.brands)
        return np.array([sizes[brand] for brand in stratum.brands], dtype=float) ** -power

    return weigh


def parse_ratio(text: str) -> dict[Level, float]:
    """Shares of easy, medium and hard tasks from a text such as ``2:1:1``.

    Raises:
        ConfigError: the text is not three numbers separated by colons.
    """
    try:
        easy, medium, hard = (float(part) for part in text.split(":"))
    except ValueError as error:
        raise ConfigError(f"{text!r} is not a ratio", hint="give easy:medium:hard, such as 2:1:1") from error
    return {"easy": easy, "medium": medium, "hard": hard}


def _strata(tasks: Sequence[Task], config: SamplerConfig) -> list[Stratum]:
    members: dict[str, list[Task]] = {level: [] for level in LEVELS} if config.ratio else {_ALL: []}
    for task in tasks:
        members[task.level if config.ratio else _ALL].append(task)
    if not config.ratio:
        return [_shard(_ALL, members[_ALL], config)]
    counts = ", ".join(f"{len(of_level):,} {level}" for level, of_level in members.items())
    strata = []
    for level, share in config.ratio.items():
        if not share:
            continue
        if not members[level]:
            raise NothingToDraw(
                f"there is no {level} task to draw, which the ratio requires: there are {counts}",
                hint="give another ratio, or more tasks",
            )
        strata.append(_shard(level, members[level], config))
    return strata


def _shard(name: str, members: list[Task], config: SamplerConfig) -> Stratum:
    """A worker's part of a stratum: every ``shards``-th task of a shuffled order."""
    if config.shards > 1:
        order = _rng(config.seed, "shards", name).random(len(members)).argsort(kind="stable")
        members = [members[place] for place in order[config.shard :: config.shards]]
        if not members:
            raise NothingToDraw(
                f"shard {config.shard} of {config.shards} has no task in {name!r}: there are fewer tasks",
                hint="use fewer shards",
            )
    return Stratum(name, members, config.seed)


def _rng(seed: int, *names: str | int) -> Generator:
    """A random generator for one purpose, independent of those for others."""
    digest = hashlib.blake2b("/".join(map(str, ("tasks", seed, *names))).encode(), digest_size=16).digest()
    return Generator(PCG64(int.from_bytes(digest, "little")))


def draw(tasks: Iterable[T], count: int | None, seed: int) -> list[T]:
    """``count`` of the tasks, drawn uniformly without replacement, in random order.

    Args:
        tasks: the tasks to draw from.
        count: ``None``, or a number larger than that of the tasks, draws all.
        seed: of the random order.
    """
    shuffled = list(tasks)
    random.Random(f"tasks/{seed}").shuffle(shuffled)
    return shuffled[:count]


def draw_spread(tasks: Iterable[T], count: int | None, seed: int, *, key: Callable[[T], str]) -> list[T]:
    """As :func:`draw`, but one task of every group is drawn before a second one of any.

    Args:
        tasks: the tasks to draw from.
        count: as for :func:`draw`.
        seed: of the random order.
        key: returns the group of a task, such as its website.
    """
    groups: dict[str, list[T]] = {}
    for task in draw(tasks, None, seed):
        groups.setdefault(key(task), []).append(task)
    rounds = zip_longest(*groups.values())
    spread = [task for turn in rounds for task in turn if task is not None]
    return spread[:count]
