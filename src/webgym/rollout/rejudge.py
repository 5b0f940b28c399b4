"""Judges a stored run again, with any number of judges; each judges an attempt once.

Trajectories are not changed. Verdicts are stored by the judge's name (:mod:`webgym.store.verdicts`), and an
attempt with a verdict is not judged again, so that an interrupted judging continues where it stopped.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import Field

from webgym.core.errors import JudgeError
from webgym.core.outcome import Outcome, outcomes_line
from webgym.core.settings import Settings
from webgym.core.task import Task
from webgym.core.text import counted, shortened
from webgym.core.trajectory import Episode, Trajectory
from webgym.core.verdict import Cost, Verdict
from webgym.judge.base import Judge
from webgym.results.summary import REASONS, oracle_notes
from webgym.rollout.judging import JudgedEpisode, Rejudging, judge_episode
from webgym.store.runs import RunReader, verdicts_of
from webgym.store.verdicts import Judged, VerdictLog


class RejudgeConfig(Settings):
    """Limits of judging a run again."""

    judges: int = Field(default=8, ge=1)
    """Episodes being judged at the same time."""

    judge_seconds: float = Field(default=600.0, gt=0)
    """Time limit of a verdict; after it, the attempt counts as unjudged."""

    limit: int | None = Field(default=None, ge=1)
    """Judge at most this many attempts; by default all."""

    judge_again: int = Field(default=2, ge=0)
    """How often attempts without a verdict are judged again after all others."""

    give_up_after: int = Field(default=20, ge=1)
    """Stop after this many attempts in a row without a verdict: the endpoint has failed, or the model cannot
    judge."""

    again: bool = False
    """Judge everything again; the latest verdict counts, which a failure to give one does not replace."""


@dataclass
class Judging:
    """Progress and results of judging a run again.

    Attributes:
        judge: its name.
        total: number of attempts that can be judged.
        earlier: number of attempts that this judge had judged before.
        skipped: attempts that are not judged: they ended in an error, or belong to another collector.
        left_out: records that are damaged or lack their task, with the reason.
        done: number of judged attempts, including the earlier ones.
        outcomes: number of judged attempts by outcome.
        cost: of all verdicts.
        spent: cost of the verdicts made in this session.
        paid: cost of all calls in this session, also of those that led to no verdict, if it is known.
        failures: number of attempts without a verdict, by reason.
        policies: whose attempts they are.
    """

    judge: str
    total: int = 0
    earlier: int = 0
    skipped: int = 0
    left_out: list[str] = field(default_factory=list)
    done: int = 0
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    cost: Cost = field(default_factory=Cost)
    spent: Cost = field(default_factory=Cost)
    paid: Cost = field(default_factory=Cost)
    failures: Counter[str] = field(default_factory=Counter)
    policies: set[str] = field(default_factory=set)

    def count(self, judged: Judged, *, now: bool) -> None:
        """Count a judgement; ``now`` if it was made in this session."""
        self._add(judged, 1)
        cost = judged.verdict.cost if judged.verdict and judged.verdict.cost else Cost()
        self.cost += cost
        if now:
            self.spent += cost

    def discount(self, judged: Judged) -> None:
        """Subtract a judgement without a verdict, which is made again."""
        self._add(judged, -1)
        self.failures = +self.failures  # remove reasons whose count is 0

    def _add(self, judged: Judged, number: int) -> None:
        self.done += number
        self.outcomes[judged.outcome] += number
        if judged.failure:
            self.failures[judged.failure.message] += number

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        yield f"judge      {shortened(self.judge)}"
        judged = self.done - sum(self.failures.values())
        skipped = f"; {self.skipped} were cut off or belong to another collector" if self.skipped else ""
        yield f"judged     {judged} of {self.total} attempts judged, {self.earlier} of them earlier{skipped}"
        if self.left_out:
            yield f"left out   {counted(len(self.left_out), 'record')} that cannot be judged"
        yield from (f"  {shortened(why)}" for why in self.left_out[:REASONS])
        yield f"outcomes   {outcomes_line(self.outcomes)}"
        yield from (f"note       {note}" for note in oracle_notes(sorted(self.policies)))
        for message, count in self.failures.most_common(REASONS):
            yield f"  {count} {shortened(message)}"
        yield f"cost       {self.cost}"
        if self.paid.calls > self.spent.calls - self.spent.cached:
            # The costs of attempts without a verdict are in no verdict.
            yield f"paid now   {self.paid}"
        elif self.earlier:
            yield f"cost now   {self.spent}"


async def judge_run(
    run: Path,
    judge: Judge,
    config: RejudgeConfig | None = None,
    *,
    show: Callable[[Judging], None] | None = None,
) -> Judging:
    """Judge a stored run.

    Args:
        run: the run folder; if it is still being written to, the attempts so far are judged.
        judge: the judge.
        config: limits.
        show: called with the progress after every attempt.

    Raises:
        RunFolderError: the folder is not a run folder.
        JudgeError: too many attempts in a row had no verdict.
        StoreError: a verdict cannot be stored.
    """
    config = config or RejudgeConfig()
    reader = RunReader(run, skip_corrupt=True)
    state = Judging(judge.name)
    with VerdictLog(run, judge.name) as verdict_log:
        waiting = await asyncio.to_thread(_waiting, reader, verdict_log, state, config)
        if show:
            show(state)
        made: dict[str, Judged] = {}
        writing = asyncio.Lock()

        async def pictures(name: str) -> bytes:
            return await asyncio.to_thread(reader.image, name)

        async def decide(task: Task, episode: Episode) -> JudgedEpisode:
            return await judge_episode(judge, task, episode, pictures, config.judge_seconds)

        async def record(trajectory: Trajectory, found: JudgedEpisode) -> None:
            attempt_id, now = trajectory.episode.attempt_id, time.time()
            ended = (found.outcome, now, found.seconds, found.verdict, found.failure)
            judged = Judged(attempt_id, judge.name, *ended)
            async with writing:
                if (before := made.get(attempt_id)) is not None:
                    state.discount(before)
                earlier = verdict_log.latest.get(attempt_id)
                if judged.verdict or not (earlier and earlier.verdict):  # a failure replaces no verdict
                    await asyncio.to_thread(verdict_log.append, judged)
            made[attempt_id] = judged
            state.count(judged, now=True)
            if show:
                show(state)

        again = Rejudging(reader, reader.tasks, decide, record, config.judges, config.give_up_after)
        waiting = await again.round(waiting[: config.limit])
        if not again.may_continue and again.failure is not None:
            raise JudgeError(
                f"{again.failed_in_a_row} attempts in a row had no verdict: {again.failure.message}",
                hint="the verdicts so far are stored; fix the cause, then call again",
            )
        for _ in range(config.judge_again):
            waiting = await again.round(waiting)
    return state


def _waiting(reader: RunReader, verdict_log: VerdictLog, state: Judging, config: RejudgeConfig) -> list[str]:
    """The attempts that remain to be judged. The others are counted in ``state``."""
    waiting = []
    for trajectory in reader.trajectories():
        episode = trajectory.episode
        if not trajectory.is_judged:
            state.skipped += 1
            continue
        if episode.task_id not in reader.tasks:
            state.left_out.append(f"{episode.attempt_id}: the run does not hold its task {episode.task_id}")
            continue
        state.total += 1
        state.policies.add(episode.policy)
        judged = verdict_log.latest.get(episode.attempt_id)
        if judged is not None and judged.verdict is not None and not config.again:
            state.earlier += 1
            state.count(judged, now=False)
        else:
            waiting.append(episode.attempt_id)
    state.left_out += map(str, reader.skipped)
    return waiting


@dataclass(frozen=True)
class Difference:
    """An attempt on which two judges differ."""

    attempt_id: str
    one: Judged
    other: Judged

    def why(self) -> str:
        """The reasons of both judges, in one line."""
        return f"{_reason(self.one)} / {_reason(self.other)}"

    def __str__(self) -> str:
        outcomes = f"{self.one.outcome} / {self.other.outcome}"
        return f"  {shortened(self.attempt_id)}: {outcomes}: {shortened(self.why(), 600)}"


@dataclass(frozen=True)
class Comparison:
    """Two judges on the same attempts.

    Attributes:
        judges: their names.
        both: number of attempts to which both gave a reward.
        agreed: number of attempts to which both gave the same reward.
        unjudged: number of attempts without a reward from one or both judges.
        differences: the attempts with different rewards or different outcomes, in order.
    """

    judges: tuple[str, str]
    both: int
    agreed: int
    unjudged: int
    differences: tuple[Difference, ...]

    def __str__(self) -> str:
        one, other = map(shortened, self.judges)
        share = f"{self.agreed / self.both:.1%}" if self.both else "–"
        rewards = f"{self.agreed} of {self.both} rewards ({share}); {self.unjudged} attempts lack one"
        head = (f"compared   {one}", f"with       {other}", f"agreement  {rewards}")
        return "\n".join((*head, *map(str, self.differences)))


def compare_judges(run: Path, one: str, other: str) -> Comparison:
    """Compare the verdicts of two judges of a run.

    Args:
        run: the run folder.
        one, other: names of the judges, or the beginnings of them; see
            :func:`webgym.store.runs.verdicts_of`.

    Raises:
        RunFolderError: there is no such judge.
    """
    one, verdicts = verdicts_of(run, one)
    other, other_verdicts = verdicts_of(run, other)
    both = agreed = unjudged = 0
    differences = []
    for attempt_id in (key for key in verdicts if key in other_verdicts):
        a, b = verdicts[attempt_id], other_verdicts[attempt_id]
        rewards = [judged.verdict.reward if judged.verdict else None for judged in (a, b)]
        if None in rewards:
            unjudged += 1
        else:
            both += 1
            agreed += rewards[0] == rewards[1]
        if a.outcome != b.outcome or rewards[0] != rewards[1]:
            differences.append(Difference(attempt_id, a, b))
    return Comparison((one, other), both, agreed, unjudged, tuple(differences))


def _reason(judged: Judged) -> str:
    verdict = judged.verdict
    if verdict is None:
        return judged.failure.message if judged.failure else "no verdict"
    return _why(verdict)


def _why(verdict: Verdict) -> str:
    if verdict.blocked.passed:
        return f"blocked: {verdict.blocked.reason}"
    for judgement in (verdict.reference, verdict.response):
        if judgement is not None and judgement.passed is False:
            return judgement.reason
    failed = next((fact for fact in verdict.facts if fact.judgement.passed is False), None)
    if failed is not None:
        return f"“{failed.fact}”: {failed.judgement.reason}"
    return "everything holds" if verdict.reward else "no answer was given"
