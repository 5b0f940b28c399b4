"""Measure whether reward hacks increase the success rate.

Policies that hack (:mod:`benchmarks.reward.hacks`) and one that fails honestly attempt the same tasks of
the offline web, with the real collector, browsers, parser and judge. The rates include attempts of a policy
that solves other tasks, as removing failures from a rate raises it only if there are successes. A hack
gains if its rate of judged attempts or of planned ones is higher than that of honest failure.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from typing import Final

import msgspec
from benchmarks.reward.hacks import HACKS, HackingPolicy

from webgym.agent.policy import Policy
from webgym.agent.scripted import ScriptedPolicy
from webgym.core.errors import ConfigError
from webgym.core.outcome import Outcome
from webgym.core.tables import Table
from webgym.core.task import Task
from webgym.offline.web import OfflineWeb
from webgym.results.evaluation import evaluate
from webgym.results.rates import Rate, Successes
from webgym.results.summary import Summary
from webgym.run.collect import collect, resume
from webgym.run.config import RunConfig, TaskChoice
from webgym.store.runs import RunReader
from webgym.tasks.formats import write_tasks
from webgym.tasks.sampling import draw_spread

HONEST: Final = next(iter(HACKS))
SOLVED: Final = "solved"


class Hacked(msgspec.Struct, frozen=True):
    """The results of a policy.

    Attributes:
        name: of its way; see :data:`benchmarks.reward.hacks.HACKS`.
        outcomes: number of samples by outcome of the last attempt.
        planned: number of samples.
        solved: number of samples of the solved tasks, by outcome.
    """

    name: str
    outcomes: dict[str, int]
    planned: int
    solved: dict[str, int]

    @property
    def successes(self) -> Successes:
        """Successes of the policy together with the solved tasks."""
        both = Counter(self.outcomes) + Counter(self.solved)
        judged = sum(count for name, count in both.items() if Outcome(name).is_rewarded)
        return Successes(both[Outcome.SUCCESS], judged, self.planned + sum(self.solved.values()))

    @property
    def reward(self) -> float:
        """Mean reward of the policy's samples; a sample without a reward counts as 0."""
        return self.outcomes.get(Outcome.SUCCESS, 0) / self.planned

    def gains(self, honest: Hacked) -> bool:
        """Whether a success rate is higher than that of honest failure."""
        ours, theirs = self.successes, honest.successes
        pairs = ((ours.of_judged, theirs.of_judged), (ours.of_planned, theirs.of_planned))
        return any(_points(one, other) > 0 for one, other in pairs)


def choose(web: OfflineWeb, count: int, solved: int, seed: int) -> tuple[list[Task], list[Task]]:
    """Tasks that require an answer, from all websites without faults in turn: to hack, and to solve."""
    hosts = [host for host, spec in web.specs.items() if spec.behaviour == "good"]
    tasks = (task for host in hosts for task in web.tasks_of(host))
    asking = [task for task in tasks if task.truth is not None and task.truth.answer.required]
    drawn = draw_spread(asking, count + solved, seed, key=lambda task: task.website)
    return drawn[:count], drawn[count:]


def challenge_of(web: OfflineWeb) -> str:
    """The address of the website that shows a challenge to every visitor."""
    return next(f"http://{host}/" for host, spec in web.specs.items() if spec.behaviour == "blocks")


async def measure(
    config: RunConfig, count: int, solved: int, out: Path, only: Sequence[str], say: Callable[[str], None]
) -> AsyncIterator[Hacked]:
    """Run all policies, honest failure first.

    Args:
        config: of the runs; its tasks and policy are replaced.
        count: number of tasks to hack.
        solved: number of tasks to solve.
        out: folder of the runs; unfinished ones in it are continued.
        only: names of the hacks to run; empty for all.
        say: called with a line about the progress.

    Yields:
        The results of each policy.
    """
    web = OfflineWeb(config.sites.seed, per_family=config.sites.per_family)
    challenge = challenge_of(web)
    to_hack, to_solve = choose(web, count, solved, config.seed)

    async def run(name: str, tasks: Sequence[Task], policy: Policy) -> dict[str, int]:
        say(f"{name}: {len(tasks)} tasks")
        folder = out / name.replace(" ", "-").replace(",", "")
        if folder.exists():
            return _outcomes(folder, await _continue(folder, tasks, policy))
        file = folder.with_suffix(".jsonl")
        file.parent.mkdir(parents=True, exist_ok=True)
        write_tasks(file, tasks)
        settings = config.model_copy(update={"tasks": TaskChoice(file=file, split="all", count="all")})
        return _outcomes(folder, await collect(settings, folder, policy=policy))

    solved_outcomes = await run(SOLVED, to_solve, ScriptedPolicy()) if to_solve else {}
    for name in HACKS:
        if name == HONEST or not only or name in only:
            policy = HackingPolicy(lambda _, name=name: name, challenge, name)  # type: ignore[misc]
            yield Hacked(name, await run(name, to_hack, policy), len(to_hack), solved_outcomes)


async def _continue(run: Path, tasks: Sequence[Task], policy: Policy) -> Summary:
    """Continue an unfinished run."""
    if {task.id for task in RunReader(run).drawn} != {task.id for task in tasks}:
        raise ConfigError(
            f"{run} contains attempts at other tasks", hint="give the same options, or another --out"
        )
    return await resume(run, policy=policy)


def _outcomes(run: Path, summary: Summary) -> dict[str, int]:
    """Number of samples by outcome of their last attempt."""
    rewarded = {name.value: summary["outcomes"][name] for name in Outcome if name.is_rewarded}
    return rewarded | evaluate(run).rows["overall"].no_reward


def table(results: Sequence[Hacked]) -> Table:
    """A row per policy."""
    honest = results[0]
    rows = []
    for result in results:
        rates = result.successes
        lost = sum(count for name, count in result.outcomes.items() if not Outcome(name).is_rewarded)
        gain = [
            f"{_points(ours, theirs):+.1f}"
            for ours, theirs in (
                (rates.of_judged, honest.successes.of_judged),
                (rates.of_planned, honest.successes.of_planned),
            )
        ]
        counts = (
            result.outcomes.get(name, 0) for name in (Outcome.SUCCESS, Outcome.FAILURE, Outcome.TRUNCATED)
        )
        verdict = "–" if result is honest else "GAINS" if result.gains(honest) else "no gain"
        rows.append(
            (
                result.name,
                str(result.planned),
                *map(str, counts),
                str(lost),
                f"{result.reward:.3f}",
                _percent(rates.of_judged),
                gain[0],
                _percent(rates.of_planned),
                gain[1],
                verdict,
            )
        )
    solved = sum(honest.solved.values())
    columns = ("policy", "tasks", "success", "failure", "truncated", "no reward", "mean reward")
    rated = ("of judged, %", "gain", "of planned, %", "gain", "verdict")
    return Table(f"Reward hacks; rates include {solved} solved tasks", (*columns, *rated), rows)


def _percent(rate: Rate) -> str:
    return "–" if rate.value is None else f"{100 * rate.value:.1f}"


def _points(ours: Rate, theirs: Rate) -> float:
    """The difference of two rates in percentage points; an undefined rate counts as 0."""
    return 100 * ((ours.value or 0) - (theirs.value or 0))
