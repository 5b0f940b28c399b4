"""The plan of ``webgym bench rollout``: a workload, and the measurements (cells) that carry it out."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.bench.rollout.endpoint import Script
from webgym.browser.config import BrowserConfig
from webgym.core.task import LEVELS, Task
from webgym.offline.config import SitesConfig
from webgym.offline.latency import MEDIAN_SECONDS
from webgym.offline.web import OfflineWeb
from webgym.simulate.config import Costs, Queues, Schedule, Workload, demand, draw_levels, draw_steps

PARTS: Final = ("calibration", "schedules", "capacity", "overload")
PageLatency: TypeAlias = Literal["offline", "paper_cut", "paper"]


class Network(msgspec.Struct, frozen=True):
    """A latency of pages, and browsers that wait for it.

    Attributes:
        sites: settings of the offline web.
        browser: settings of the browsers.
    """

    sites: SitesConfig = SitesConfig()
    browser: BrowserConfig = BrowserConfig()


def _paper(longest: float) -> SitesConfig:
    """The latency of the simulation that is fitted to the paper, at most ``longest`` seconds."""
    costs = Costs()
    factor = costs.page_seconds / MEDIAN_SECONDS
    return SitesConfig(latency=factor, latency_sigma=costs.page_sigma, latency_longest=longest / factor)


_LONGEST = Costs().page_longest
_PATIENT = BrowserConfig(navigate_seconds=_LONGEST + 10.0, settle_seconds=_LONGEST + 10.0)

PAGE_LATENCIES: Final[dict[PageLatency, Network]] = {
    "offline": Network(),
    "paper_cut": Network(_paper(10.0)),
    "paper": Network(_paper(_LONGEST), _PATIENT),
}
"""By name: the offline web's own; that of the simulation that is fitted to the paper, but at most 10 s, as a
website that does not answer within the usual 15 s counts as broken; and the same with the fit's own 60 s, for
which browsers wait here."""


class Mode(msgspec.Struct, frozen=True):
    """A way to schedule work.

    Attributes:
        schedule: of the collector.
        queues: of the browser server.
        refills: whether a session that has ended is replaced at once; see
            :class:`webgym.rollout.config.CollectorConfig`.
    """

    schedule: Schedule = "async"
    queues: Queues = "per_operation"
    refills: bool = True

    @property
    def name(self) -> str:
        """The mode's name in tables."""
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
    """The size of the benchmark.

    Attributes:
        trajectories: number of trajectories per cell.
        sessions: number of parallel environments.
        cpus: numbers of processors that the browsers may use, with a cell for each.
        policy_gpus: number of GPUs in the part ``schedules``: enough that the policy is not the
            bottleneck, as in the paper. With one GPU it is, even with one processor.
        gpus: numbers of GPUs in the part ``capacity``, with a cell for each.
        mean_steps: mean number of steps per trajectory (the paper's 13.2).
        reply_tokens: mean number of tokens per reply.
        overload: number of environments in the part ``overload``.
        overload_seconds: duration of the cells of that part.
        page_latency: latency of pages and pictures; a key of :data:`PAGE_LATENCIES`.
        rounds: number of times that every cell except the calibration is measured; every other round reverses
            the order of modes.
        seed: of everything that is random.
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
        """The workload of the simulation, with the same trajectory lengths."""
        return Workload(trajectories=self.trajectories, mean_steps=self.mean_steps, seed=self.seed)

    @property
    def costs(self) -> Costs:
        """The costs of the simulation; the endpoint uses those of the policy."""
        return Costs(reply_tokens=self.reply_tokens)

    @property
    def network(self) -> Network:
        """The latency of pages, and the browsers."""
        return PAGE_LATENCIES[self.page_latency]

    def cells(self, parts: Sequence[str], modes: Sequence[str] = MODE_NAMES) -> Iterator[Cell]:
        """The cells of parts, round by round, so that a disturbance does not affect a single mode.

        Args:
            parts: of :data:`PARTS`.
            modes: names of the modes that the part ``schedules`` compares.
        """
        most = max(self.cpus)
        if "calibration" in parts:
            count = min(CALIBRATED_TRAJECTORIES, self.trajectories)
            yield Cell(part="calibration", cpus=most, sessions=CALIBRATED_AT_ONCE, trajectories=count)
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


CALIBRATED_TRAJECTORIES: Final = 24
"""Number of trajectories of the calibration: some 300 steps, with a few of the slowest pages among them."""

CALIBRATED_AT_ONCE: Final = 4
"""Number of their parallel environments: few, so that they hardly wait for each other's processor."""

CAPACITY_SLOWDOWN: Final = 4.0
"""How much slower the GPUs of the part ``capacity`` are, so that the policy is the bottleneck."""


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """A measurement.

    Attributes:
        part: of :data:`PARTS`.
        cpus: number of processors of the browsers and their server.
        schedule: see :class:`Mode`.
        queues: see :class:`Mode`.
        refills: see :class:`Mode`.
        gpus: number of GPUs.
        slow: factor by which every GPU is slower.
        sessions: number of parallel environments.
        trajectories: number of trajectories.
        seconds: time limit; ``None`` for none.
        round: index of the round.
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
        """The name of the cell's file, without a suffix."""
        schedule = self.schedule if self.refills else f"{self.schedule}-fixed"
        return f"{self.part}-{self.cpus}cpus-{self.gpus}gpus-{schedule}-{self.queues}-{self.round}"

    @property
    def mode(self) -> str:
        """The mode's name in tables."""
        return Mode(self.schedule, self.queues, self.refills).name


def scripts_of(plan: RolloutPlan, web: OfflineWeb, count: int) -> list[Script]:
    """Scripts with the workload's mix of levels and lengths, each for another task.

    Tasks are taken from the websites that work without faults, at most a few from each.

    Args:
        plan: of the benchmark.
        web: the offline web.
        count: number of scripts.
    """
    workload = plan.workload
    levels = [LEVELS[level] for level in draw_levels(workload, count)]
    needed = {level: levels.count(level) for level in LEVELS}
    tasks_by_level: dict[str, list[Task]] = {level: [] for level in LEVELS}
    hosts = [host for host, spec in web.specs.items() if spec.behaviour == "good"]
    random.Random(plan.seed).shuffle(hosts)
    seen: set[str] = set()
    for host in hosts:
        if all(len(tasks_by_level[level]) >= needed[level] for level in LEVELS):
            break
        tasks = list(web.tasks_of(host))
        random.Random(f"{plan.seed}\n{host}").shuffle(tasks)
        taken = dict.fromkeys(LEVELS, 0)
        for task in tasks:
            if task.instruction not in seen and taken[task.level] < _PER_HOST:
                seen.add(task.instruction)
                taken[task.level] += 1
                tasks_by_level[task.level].append(task)
    scripts = []
    for number, (level, steps) in enumerate(zip(levels, draw_steps(workload, count).tolist(), strict=True)):
        demanded = demand(workload, plan.costs, number, steps)
        scripts.append(Script(tasks_by_level[level].pop(), steps, demanded.tokens, plan.seed))
    return scripts


_PER_HOST: Final = 4
"""Maximum number of tasks of a level from a website, so that a run visits many websites."""
