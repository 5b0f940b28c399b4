"""What ``webgym bench rollout`` measures: a workload, and the cells in which it is carried out."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.bench.rollout.endpoint import Script
from webgym.core.task import LEVELS, Task
from webgym.offline.config import SitesConfig
from webgym.offline.latency import MEDIAN_SECONDS
from webgym.offline.web import OfflineWeb
from webgym.simulate.config import Costs, Queues, Schedule, Workload
from webgym.simulate.demand import demand, draw_levels, draw_steps

PARTS: Final = ("calibration", "schedules", "capacity", "overload")
PageLatency: TypeAlias = Literal["offline", "paper"]
PAGE_LATENCIES: Final[dict[PageLatency, SitesConfig]] = {
    "offline": SitesConfig(),
    "paper": SitesConfig(latency=Costs().page_seconds / MEDIAN_SECONDS, latency_sigma=Costs().page_sigma),
}
"""``paper``: what every page takes on the network in the simulation that is fitted to the paper."""


class Mode(msgspec.Struct, frozen=True):
    """One way to schedule: settings of the collector and of the browser server."""

    schedule: Schedule = "async"
    queues: Queues = "per_operation"
    refills: bool = True

    @property
    def name(self) -> str:
        """For people."""
        name = self.schedule.replace("_", " ")
        name = name if self.refills else f"{name}, fixed group"
        return f"{name}, one queue" if self.queues == "global" else name


MODES: Final = (
    Mode(),
    Mode(queues="global"),
    Mode("step_barrier"),
    Mode("step_barrier", refills=False),
    Mode("episode_barrier"),
)
MODE_NAMES: Final = tuple(mode.name for mode in MODES)


class RolloutPlan(msgspec.Struct, frozen=True, kw_only=True):
    """How much is measured.

    Attributes:
        trajectories: of every cell.
        sessions: environments.
        cpus: processors that the browsers may use, a cell each.
        policy_gpus: of the cells that vary the processors: so many that the policy limits nothing where
            processors are scarce, as in the paper. With one GPU it does already at one processor.
        gpus: of the cells that vary the policy's capacity.
        mean_steps: of a trajectory (the paper's 13.2).
        reply_tokens: of a reply, on average.
        overload: environments of the overload cells.
        overload_seconds: after which finished and crashed attempts are counted there.
        page_latency: of every page and picture: the offline web's own, or the paper's.
        rounds: how often every cell but the calibration is measured, modes forwards and backwards in turn.
        seed: of everything random.
    """

    trajectories: int = 64
    sessions: int = 16
    cpus: tuple[int, ...] = (1, 2)
    policy_gpus: int = 8
    gpus: tuple[int, ...] = (1, 2)
    mean_steps: float = 13.2
    reply_tokens: float = 80.0
    overload: int = 48
    overload_seconds: float = 120.0
    page_latency: PageLatency = "offline"
    rounds: int = 3
    seed: int = 0

    @property
    def workload(self) -> Workload:
        """As the simulation takes it, with the same lengths."""
        return Workload(trajectories=self.trajectories, mean_steps=self.mean_steps, seed=self.seed)

    @property
    def costs(self) -> Costs:
        """Of which the endpoint uses the policy's speeds."""
        return Costs(reply_tokens=self.reply_tokens)

    @property
    def sites(self) -> SitesConfig:
        """Of the offline web."""
        return PAGE_LATENCIES[self.page_latency]

    def cells(self, parts: Sequence[str], modes: Sequence[str] = MODE_NAMES) -> Iterator[Cell]:
        """The cells of these parts, round by round, so that a disturbance does not meet one mode alone.

        Args:
            modes: names of those that the part ``schedules`` compares.
        """
        most = max(self.cpus)
        if "calibration" in parts:
            yield Cell(part="calibration", cpus=most, sessions=1, trajectories=min(4, self.trajectories))
        for number in range(self.rounds):
            cells = list(self._round(number, parts, modes))
            yield from cells if number % 2 == 0 else reversed(cells)

    def _round(self, number: int, parts: Sequence[str], modes: Sequence[str]) -> Iterator[Cell]:
        usual = Cell(
            part="schedules",
            cpus=max(self.cpus),
            gpus=self.policy_gpus,
            sessions=self.sessions,
            trajectories=self.trajectories,
            round=number,
        )
        if "schedules" in parts:
            for cpus in self.cpus:
                for mode in MODES:
                    if mode.name in modes:
                        yield msgspec.structs.replace(usual, cpus=cpus, **msgspec.structs.asdict(mode))
        if "capacity" in parts:
            for gpus in self.gpus:
                yield msgspec.structs.replace(usual, part="capacity", gpus=gpus, slow=CAPACITY_SLOWDOWN)
        if "overload" in parts:
            orders: tuple[Queues, ...] = ("per_operation", "global")
            for queues in orders:
                yield msgspec.structs.replace(
                    usual,
                    part="overload",
                    cpus=min(self.cpus),
                    queues=queues,
                    sessions=self.overload,
                    trajectories=max(self.trajectories, 4 * self.overload),
                    seconds=self.overload_seconds,
                )


CAPACITY_SLOWDOWN: Final = 4.0
"""How much slower the GPUs of the capacity cells are, so that the policy is what limits them."""


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """One measurement.

    Attributes:
        seconds: when it is stopped; ``None`` for when all is done.
        slow: divides the speed of every GPU.
        round: how many rounds went before.
    """

    part: str
    cpus: int
    schedule: Schedule = "async"
    queues: Queues = "per_operation"
    refills: bool = True
    gpus: int = 1
    slow: float = 1.0
    sessions: int
    trajectories: int
    seconds: float | None = None
    round: int = 0

    @property
    def name(self) -> str:
        """Of its file."""
        schedule = self.schedule if self.refills else f"{self.schedule}-fixed"
        return f"{self.part}-{self.cpus}cpus-{self.gpus}gpus-{schedule}-{self.queues}-{self.round}"

    @property
    def mode(self) -> str:
        """For people."""
        return Mode(self.schedule, self.queues, self.refills).name


def scripts_of(plan: RolloutPlan, web: OfflineWeb, count: int) -> list[Script]:
    """Attempts of the workload's mix and lengths, each at another task of the well-behaved websites.

    A website has few tasks of some levels, so the websites are gone through until every level has enough.
    """
    workload = plan.workload
    levels = [LEVELS[level] for level in draw_levels(workload, count)]
    wanted = {level: levels.count(level) for level in LEVELS}
    found: dict[str, list[Task]] = {level: [] for level in LEVELS}
    hosts = [host for host, spec in web.specs.items() if spec.behaviour == "good"]
    random.Random(plan.seed).shuffle(hosts)
    seen: set[str] = set()
    for host in hosts:
        if all(len(found[level]) >= wanted[level] for level in LEVELS):
            break
        tasks = list(web.tasks_of(host))
        random.Random(f"{plan.seed}\n{host}").shuffle(tasks)
        taken = dict.fromkeys(LEVELS, 0)
        for task in tasks:
            if task.instruction not in seen and taken[task.level] < _PER_HOST:
                seen.add(task.instruction)
                taken[task.level] += 1
                found[task.level].append(task)
    scripts = []
    for number, (level, steps) in enumerate(zip(levels, draw_steps(workload, count).tolist(), strict=True)):
        asked = demand(workload, plan.costs, number, steps)
        scripts.append(Script(found[level].pop(), steps, asked.tokens, plan.seed))
    return scripts


_PER_HOST: Final = 4
"""Tasks of one level on one website, so that a run sees many websites."""
