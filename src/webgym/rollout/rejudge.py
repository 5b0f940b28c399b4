"""Judging a stored run again, any number of times; each attempt once per judge.

Trajectories stay as they are. Verdicts are kept by the judge's name (:mod:`webgym.rollout.verdicts`); what a
judge has said is not asked again, so that a judging that was killed goes on where it was.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import Field

from webgym.core.errors import JudgeError, RunFolderError
from webgym.core.outcome import Outcome
from webgym.core.verdict import Cost, Verdict
from webgym.judge.base import Judge
from webgym.rollout.judging import is_judged, judge_episode
from webgym.rollout.store import RunReader
from webgym.rollout.verdicts import Judged, VerdictLog, read_verdicts
from webgym.settings import Settings

RECORDED = "recorded"
"""What the verdicts are called that were made when the run was collected."""


class RejudgeConfig(Settings):
    """How many at once, and what is judged again."""

    judges: int = Field(default=8, ge=1)
    """Episodes being judged at the same time."""

    judge_seconds: float = Field(default=600.0, gt=0)
    """How long one verdict may take before the attempt counts as unjudged."""

    limit: int | None = Field(default=None, ge=1)
    """Judge at most this many attempts; by default all."""

    retry_failures: bool = True
    """Judge those again that this judge had no verdict on."""

    judge_again: int = Field(default=2, ge=0)
    """How often those without a verdict are judged again when all others are done."""

    give_up_after: int = Field(default=20, ge=1)
    """The judging stops when so many attempts in a row had no verdict: the endpoint is gone, or the model is
    not up to it."""

    again: bool = False
    """Judge everything again; the latest verdict counts."""


@dataclass
class Judging:
    """Progress and results of judging a run again.

    Attributes:
        judge: its name.
        total: attempts of the run that can be judged.
        earlier: how many of them this judge had judged before.
        skipped: attempts that did not end of their own, or are another collector's, and are not judged.
        left_out: records that cannot be trusted or lack their task, and why.
        done: judged by now, the earlier ones included.
        outcomes: of those.
        cost: of all verdicts.
        spent: of the verdicts that were made now.
        failed_in_a_row: the latest attempts without a verdict.
        failures: why attempts have no verdict, and how many have none for this reason.
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
    failed_in_a_row: int = 0
    failures: Counter[str] = field(default_factory=Counter)

    def count(self, judged: Judged, *, now: bool) -> None:
        """Take note of a judgement."""
        self._add(judged, 1)
        cost = judged.verdict.cost if judged.verdict and judged.verdict.cost else Cost()
        self.cost += cost
        if now:
            self.spent += cost

    def discount(self, judged: Judged) -> None:
        """Forget a judgement that had no verdict: it is made again."""
        self._add(judged, -1)
        self.failures = +self.failures  # a reason that is none any more is not told

    def _add(self, judged: Judged, number: int) -> None:
        self.done += number
        self.outcomes[judged.outcome] += number
        if judged.failure:
            self.failures[judged.failure.message] += number


async def judge_run(
    run: Path,
    judge: Judge,
    config: RejudgeConfig | None = None,
    *,
    show: Callable[[Judging], None] | None = None,
) -> Judging:
    """Judge a stored run.

    Args:
        run: the run folder; it may still be written to, and is judged as far as it has come.
        judge: who judges.
        config: limits.
        show: is told after every attempt.

    Raises:
        RunFolderError: the folder is no run.
        JudgeError: too many attempts in a row had no verdict.
        StoreError: a verdict cannot be kept.
    """
    config = config or RejudgeConfig()
    reader = RunReader(run, skip_corrupt=True)
    state = Judging(judge.name)
    with VerdictLog(run, judge.name) as book:
        waiting = await asyncio.to_thread(_waiting, reader, book, state, config)
        if show:
            show(state)
        waiting = waiting[: config.limit]
        await _judge_all(reader, judge, book, waiting, state, config, show)
        for _ in range(config.judge_again):
            waiting = [one for one in waiting if book.held[one].verdict is None]
            await _judge_all(reader, judge, book, waiting, state, config, show, is_again=True)
    return state


def _waiting(reader: RunReader, book: VerdictLog, state: Judging, config: RejudgeConfig) -> list[str]:
    """The attempts that are still to be judged. Those that are not are counted."""
    waiting = []
    for trajectory in reader.trajectories():
        episode = trajectory.episode
        if not is_judged(trajectory):
            state.skipped += 1
            continue
        if episode.task_id not in reader.tasks:
            state.left_out.append(f"{episode.attempt_id}: the run does not hold its task {episode.task_id}")
            continue
        state.total += 1
        held = book.held.get(episode.attempt_id)
        is_kept = held is not None and (held.verdict is not None or not config.retry_failures)
        if held is not None and is_kept and not config.again:
            state.earlier += 1
            state.count(held, now=False)
        else:
            waiting.append(episode.attempt_id)
    state.left_out += map(str, reader.skipped)
    return waiting


async def _judge_all(
    reader: RunReader,
    judge: Judge,
    book: VerdictLog,
    waiting: list[str],
    state: Judging,
    config: RejudgeConfig,
    show: Callable[[Judging], None] | None,
    *,
    is_again: bool = False,
) -> None:
    """Judge these. Those that are judged again have been counted without a verdict, and may stay without."""
    left = iter(waiting)
    writing = asyncio.Lock()

    async def pictures(name: str) -> bytes:
        return await asyncio.to_thread(reader.image, name)

    async def work() -> None:
        for attempt_id in left:
            episode = (await asyncio.to_thread(reader.trajectory, attempt_id)).episode
            started = time.monotonic()
            found = await judge_episode(
                judge, reader.tasks[episode.task_id], episode, pictures, config.judge_seconds
            )
            seconds = time.monotonic() - started
            judged = Judged(
                attempt_id, judge.name, found.outcome, time.time(), seconds, found.verdict, found.failure
            )
            async with writing:
                if is_again:
                    state.discount(book.held[attempt_id])
                await asyncio.to_thread(book.append, judged)
            state.count(judged, now=True)
            if show:
                show(state)
            failed = judged.failure
            state.failed_in_a_row = state.failed_in_a_row + 1 if failed else 0
            if failed and state.failed_in_a_row >= config.give_up_after:
                if is_again:
                    return
                raise JudgeError(
                    f"{state.failed_in_a_row} attempts in a row had no verdict: {failed.message}",
                    hint="what was judged is kept; fix the cause, then call again",
                )

    try:
        async with asyncio.TaskGroup() as group:
            for _ in range(min(config.judges, len(waiting))):
                group.create_task(work())
    except ExceptionGroup as errors:
        raise errors.exceptions[0] from errors


@dataclass(frozen=True)
class Difference:
    """An attempt that two judges see differently."""

    attempt_id: str
    one: Judged
    other: Judged

    def why(self) -> str:
        """Where they part, in a few words."""
        return f"{_found(self.one)} / {_found(self.other)}"


@dataclass(frozen=True)
class Comparison:
    """Two judges on the same attempts.

    Attributes:
        both: attempts that both gave a reward.
        agreed: those that got the same from both.
        unjudged: attempts that only one of them gave a reward, or neither.
        differences: the attempts with different rewards or different outcomes, in order.
    """

    both: int
    agreed: int
    unjudged: int
    differences: tuple[Difference, ...]


def compare(one: Mapping[str, Judged], other: Mapping[str, Judged]) -> Comparison:
    """Compare two judges' verdicts, by attempt."""
    both = agreed = unjudged = 0
    differences = []
    for attempt_id in (key for key in one if key in other):
        a, b = one[attempt_id], other[attempt_id]
        rewards = [each.verdict.reward if each.verdict else None for each in (a, b)]
        if None in rewards:
            unjudged += 1
        else:
            both += 1
            agreed += rewards[0] == rewards[1]
        if a.outcome != b.outcome or rewards[0] != rewards[1]:
            differences.append(Difference(attempt_id, a, b))
    return Comparison(both, agreed, unjudged, tuple(differences))


def verdicts_of(run: Path, judge: str) -> tuple[str, dict[str, Judged]]:
    """A judge's verdicts on the attempts that a run holds.

    Args:
        run: the run folder.
        judge: its name or how that begins, or :data:`RECORDED`.

    Returns:
        The judge's whole name and its judgements by attempt.

    Raises:
        RunFolderError: there are none, or several judges' names begin so.
    """
    if judge == RECORDED:
        return RECORDED, recorded(run)
    held = read_verdicts(run)
    fitting = [judge] if judge in held else [name for name in held if name.startswith(judge)]
    if len(fitting) != 1:
        known = ", ".join([RECORDED, *held])
        raise RunFolderError(
            f"{'no judge' if not fitting else 'more than one judge'} of this run is called {judge!r}",
            hint=f"there are: {known}",
        )
    attempts = RunReader(run, skip_corrupt=True).attempts
    return fitting[0], {key: judged for key, judged in held[fitting[0]].items() if key in attempts}


def recorded(run: Path) -> dict[str, Judged]:
    """The verdicts that were made when the run was collected."""
    found = {}
    for trajectory in RunReader(run, skip_corrupt=True).trajectories():
        episode, verdict = trajectory.episode, trajectory.verdict
        if is_judged(trajectory):
            found[episode.attempt_id] = Judged(
                episode.attempt_id,
                verdict.judge if verdict else RECORDED,
                trajectory.outcome,
                episode.started_at + episode.seconds,
                trajectory.judge_seconds,
                verdict,
                trajectory.judge_failure,
            )
    return found


def _found(judged: Judged) -> str:
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
