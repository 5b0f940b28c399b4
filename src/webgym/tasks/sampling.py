"""Choosing tasks: a sampler that goes on from draw to draw (SYSTEM.md 5), and single draws.

    sampler = Sampler(tasks, SamplerConfig(seed=7, ratio={"easy": 2, "medium": 1, "hard": 1}))
    batch = sampler.draw(1_024)
    state = sampler.state()  # small, for JSON; restore() goes on from there

A sampler draws without replacement. Each level with a share of its own is a stratum; a stratum is shuffled,
drawn from until it is used up, over as many draws as that takes, and shuffled again. Weights
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
"""How likely each task of a stratum is to come next, in its order; 0 for never. Asked per shuffle."""

_ALL: Final = "all"


class SamplerConfig(Selection):
    """Which tasks are drawn, in which shares and in which order."""

    seed: int = 0
    """Of every shuffle."""
    shard: int = Field(default=0, ge=0)
    """Which worker this is, from 0. Workers with the same seed and tasks draw from disjoint parts."""
    shards: int = Field(default=1, ge=1)
    """How many workers there are; together they have all tasks."""

    @model_validator(mode="after")
    def _check_shard(self) -> SamplerConfig:
        if self.shard >= self.shards:
            raise ValueError(f"there is no shard {self.shard} of {self.shards}: they count from 0")
        return self


class Stratum:
    """The tasks of one stratum, and how many of them have been drawn.

    Attributes:
        name: of the stratum: a level, or "all".
        tasks: in an order that never changes.
        epoch: how many times all of its tasks have been drawn.
        position: how many tasks have been drawn since.
        dealt: how many tasks have been drawn in all.
    """

    def __init__(self, name: str, tasks: list[Task], seed: int) -> None:
        self.name = name
        self.tasks = tasks
        self.epoch = self.position = self.dealt = 0
        self._seed = seed
        self._order: NDArray[np.intp] | None = None

    @cached_property
    def places(self) -> dict[str, int]:
        """Where in :attr:`tasks` a task is, by id."""
        return {task.id: place for place, task in enumerate(self.tasks)}

    @cached_property
    def brands(self) -> list[str]:
        """The brand that the website of each task is of."""
        return [brand_or_text(task.website) for task in self.tasks]

    def deal(
        self, count: int, blocked: Collection[str], passed_over: Counter[str], weigh: Weigh | None
    ) -> list[Task]:
        """The next tasks, those on blocked websites passed over until the next shuffle; test tasks never are.

        Args:
            count: how many.
            blocked: websites.
            passed_over: counts the tasks passed over, by website.
            weigh: how likely each is to come next.

        Raises:
            NothingToDraw: all of them are passed over.
        """
        dealt: list[Task] = []
        whole, before = self.position == 0, 0
        while len(dealt) < count:
            order = self._order if self._order is not None else self._shuffle(weigh)
            hand = order[self.position : self.position + count - len(dealt)]
            for task in map(self.tasks.__getitem__, hand):
                if blocked and task.split != "test" and (site := host_or_text(task.website)) in blocked:
                    passed_over[site] += 1
                else:
                    dealt.append(task)
            self.position += len(hand)
            if self.position == len(order):
                if whole and len(dealt) == before:
                    raise NothingToDraw(
                        f"there is no task left to draw: all {len(order):,} in {self.name!r} are on blocked "
                        "websites or have no weight",
                        hint="unblock a website, or give more tasks",
                    )
                whole, before = True, len(dealt)
                self.next_epoch()
        self.dealt += count
        return dealt

    def next_epoch(self) -> None:
        """Shuffle before the next task is dealt."""
        self.epoch, self.position, self._order = self.epoch + 1, 0, None

    def stand(self, epoch: int, position: int, dealt: int) -> None:
        """Go to where a stratum with the same tasks stood."""
        self.epoch, self.position, self.dealt, self._order = epoch, position, dealt, None

    def _shuffle(self, weigh: Weigh | None) -> NDArray[np.intp]:
        """Draw without replacement, each next task in proportion to its weight (Efraimidis and Spirakis)."""
        rng = _rng(self._seed, "epoch", self.name, self.epoch)
        keys = -np.log1p(-rng.random(len(self.tasks)))
        if weigh is not None:
            weights = weigh(self)
            keys = np.divide(keys, weights, out=np.full(len(keys), np.inf), where=weights > 0)
        self._order = np.argsort(keys)[: int(np.isfinite(keys).sum())]
        return self._order


class Sampler:
    """Draws tasks without replacement until there are none left, and then begins again.

    Args:
        tasks: the whole set, in the same order for every worker and after every restart. Only its training
            tasks are drawn, unless the config names another split (:mod:`webgym.tasks.selection`).
        config: which of them, and in which shares.
        blocked: names websites that nothing is drawn from for now, and is asked before every draw: a
            blocklist whose entries expire (:meth:`webgym.rollout.blocklist.Blocklist.blocked`).
        weigh: what should come early; asked anew for every pass through the tasks.
        anew: draw every time from all tasks, not from those that are left; for weights that change with what
            happened since. A task may then come again in the next draw, but not in the same.

    Raises:
        NothingToDraw: there is no task, or none of a level that the ratio asks for.
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
        """Tasks that the last draw passed over because their website is blocked, by website."""
        self.selected = select(tasks, self.config)
        """What is drawn from."""
        if not self.selected.tasks:
            raise NothingToDraw(
                f"there is no task to draw among {len(tasks):,}: {self.selected.told()}",
                hint="choose another split or more domains",
            )
        tasks = self.selected.tasks
        names = "\n".join(task.id for task in tasks)
        settings = self.config.model_dump_json()
        self._of = hashlib.blake2b(f"{settings}\n{names}".encode(), digest_size=8).hexdigest()
        self._strata = _strata(tasks, self.config)
        ratio: Mapping[Any, float] = self.config.ratio or {_ALL: 1.0}
        total = sum(ratio[stratum.name] for stratum in self._strata)
        self._shares = [ratio[stratum.name] / total for stratum in self._strata]

    @property
    def blocked(self) -> frozenset[str]:
        """The hosts that no task is drawn from, as :func:`host_of` names them."""
        return frozenset(self._blocked)

    def block(self, *websites: str) -> None:
        """Draw no task that begins on the host of one of these websites from now on."""
        self._blocked.update(map(host_of, websites))

    def unblock(self, *websites: str) -> None:
        """Draw from these websites again. What was passed over comes back when its stratum is shuffled."""
        self._blocked.difference_update(map(host_of, websites))

    def draw(self, count: int) -> list[Task]:
        """The next tasks, levels mixed. A task comes twice only if a pass ends within the draw.

        Test tasks are drawn whatever is blocked: a test set stays the same set.

        Raises:
            NothingToDraw: every task that there is to draw from is blocked.
        """
        batch: list[Task] = []
        is_test = self.config.split == "test"  # also of a set that does not say what it is for
        blocked = () if is_test else self._blocked.union(self._blocked_for_now())
        self.passed_over = Counter()
        for stratum, quota in zip(self._strata, self._quotas(count), strict=True):
            if self._anew and stratum.position:
                stratum.next_epoch()
            batch += stratum.deal(quota, blocked, self.passed_over, self._weigh)
        order = _rng(self.config.seed, "mix", self._draws).random(count).argsort(kind="stable")
        self._draws += 1
        return [batch[place] for place in order]

    def state(self) -> dict[str, Any]:
        """Where the sampler stands, for JSON: a few numbers per stratum, and the blocked websites."""
        return {
            "of": self._of,
            "draws": self._draws,
            "decks": {
                stratum.name: [stratum.epoch, stratum.position, stratum.dealt] for stratum in self._strata
            },
            "blocked": sorted(self._blocked),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from where another sampler of the same tasks, settings and weights stood.

        Raises:
            ConfigError: the state is of other tasks or settings.
        """
        if state.get("of") != self._of:
            raise ConfigError(
                "the sampler's state is of other tasks or settings",
                hint="give the tasks, in their order, and the settings it was saved with; or begin anew",
            )
        self._draws = state["draws"]
        self._blocked = set(state["blocked"])
        for stratum in self._strata:
            stratum.stand(*state["decks"][stratum.name])

    def _quotas(self, count: int) -> list[int]:
        """How many tasks each stratum gives, so that all it has given is as near to its share as can be."""
        total = sum(stratum.dealt for stratum in self._strata) + count
        owed = [
            max(0.0, share * total - stratum.dealt)
            for share, stratum in zip(self._shares, self._strata, strict=True)
        ]
        quotas = [int(each) for each in owed]
        rest = sorted(range(len(owed)), key=lambda place: quotas[place] - owed[place])
        for place in rest[: count - sum(quotas)]:
            quotas[place] += 1
        return quotas


def near_success(
    results: Mapping[str, tuple[int, int]], *, target: float = 0.5, width: float = 0.2, least: float = 0.02
) -> Weigh:
    """A curriculum: tasks come early that succeed about as often as ``target``; use it with ``anew=True``.

    Args:
        results: (successes, attempts) by task id; looked at again for every draw, so it may grow. A task
            without attempts counts as one that is right on target, and one with few leans that way.
        target: success rate that there is most to learn from, 0 to 1.
        width: how far from it a rate may be, roughly.
        least: weight of a task that is hopeless or mastered, against 1 on target.
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
    """Diversity: a brand with n tasks, on however many websites, comes as if it had n^(1 - power) of them:
    with 1, as if one."""

    def weigh(stratum: Stratum) -> NDArray[np.float64]:
        sizes = Counter(stratum.brands)
        return np.array([sizes[brand] for brand in stratum.brands], dtype=float) ** -power

    return weigh


def parse_ratio(text: str) -> dict[Level, float]:
    """Shares of easy, medium and hard tasks from a text such as ``2:1:1``.

    Raises:
        ConfigError: it is none.
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
    found = ", ".join(f"{len(of_level):,} {level}" for level, of_level in members.items())
    strata = []
    for level, share in config.ratio.items():
        if not share:
            continue
        if not members[level]:
            raise NothingToDraw(
                f"there is no {level} task to draw, and the ratio asks for some: there are {found}",
                hint="give another ratio, or more tasks",
            )
        strata.append(_shard(level, members[level], config))
    return strata


def _shard(name: str, members: list[Task], config: SamplerConfig) -> Stratum:
    """A worker's part of a stratum: every so many-th of it, shuffled so that the parts are alike."""
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
    """A stream of its own for every purpose."""
    digest = hashlib.blake2b("/".join(map(str, ("tasks", seed, *names))).encode(), digest_size=16).digest()
    return Generator(PCG64(int.from_bytes(digest, "little")))


def draw(tasks: Iterable[T], count: int | None, seed: int) -> list[T]:
    """``count`` of the tasks, uniformly and without replacement, in a seeded order.

    Args:
        count: ``None`` for all; more than there are gives all.
    """
    shuffled = list(tasks)
    random.Random(f"tasks/{seed}").shuffle(shuffled)
    return shuffled[:count]


def draw_spread(tasks: Iterable[T], count: int | None, seed: int, *, key: Callable[[T], str]) -> list[T]:
    """As :func:`draw`, but every group of tasks is drawn from before any is drawn from again.

    Args:
        key: the group of a task, such as its website.
    """
    groups: dict[str, list[T]] = {}
    for task in draw(tasks, None, seed):
        groups.setdefault(key(task), []).append(task)
    rounds = zip_longest(*groups.values())
    spread = [task for turn in rounds for task in turn if task is not None]
    return spread[:count]
