"""What a collector is doing right now: written by it, read by whoever shows it."""

from __future__ import annotations

import heapq
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias

import msgspec

from webgym.core.calls import CallQueue, LoopLag
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS, Level
from webgym.core.trajectory import Trajectory
from webgym.rollout.rates import Successes

State: TypeAlias = Literal["opening", "acting", "thinking", "judging"]
STATES: tuple[State, ...] = ("opening", "acting", "thinking", "judging")

RECENT_SECONDS = 20.0
"""The span over which the current pace of steps is measured."""

ENDED_SECONDS = 300.0
"""The span over which the current pace of trajectories is measured: with large models one takes minutes."""


class Queue(NamedTuple):
    """Calls of one kind, such as ``navigate`` or ``policy``, at this moment.

    Attributes:
        waiting: how many wait for their turn.
        running: how many are served.
        wait: how long the calls served last had waited, seconds, median; ``None`` before the first.
        service: how long serving them took, seconds, median; ``None`` before the first.
    """

    waiting: int
    running: int
    wait: float | None
    service: float | None


def queues_of(calls: Mapping[str, CallQueue]) -> dict[str, Queue]:
    """What a monitor shows of the queues that were used."""
    loads = {kind: queue.load for kind, queue in calls.items()}
    return {
        kind: Queue(load.waiting, load.running, load.wait, load.service)
        for kind, load in loads.items()
        if load.done or load.running or load.waiting
    }


@dataclass(slots=True)
class Cell:
    """An attempt in progress, as a monitor draws it.

    Attributes:
        attempt_id: which.
        place: the lowest place in the grid that was free when it began, from 0; it keeps it to its end.
        state: ``None`` between two states, as while an ended attempt waits for a free judge.
        steps: taken so far.
        since: when it came into this state, on the clock of :func:`time.monotonic`.
    """

    attempt_id: str
    place: int
    state: State | None
    steps: int
    since: float


class _Pace:
    """How often something happens, over the last seconds."""

    def __init__(self, span: float) -> None:
        self._span = span
        self._moments: deque[float] = deque()

    def count(self) -> None:
        """It happened now."""
        self._moments.append(time.monotonic())
        self._forget()

    def _forget(self) -> None:
        oldest = time.monotonic() - self._span
        while self._moments and self._moments[0] < oldest:
            self._moments.popleft()

    def per_second(self, age: float) -> float:
        """Over the span, or over the age of what is measured if that is less."""
        self._forget()
        span = min(age, self._span)
        return len(self._moments) / span if span > 0 else 0.0


@dataclass
class Progress:
    """Counts of a running collector.

    Attributes:
        total: samples wanted.
        done: samples done, those of an earlier session included.
        earlier: samples done before this session.
        states: how many attempts are in which state.
        cells: the attempts in progress, by attempt id.
        outcomes: of the attempts that ended in this session.
        levels: difficulty of the tasks by their ids, for the success by difficulty.
        by_level: how many attempts ended so, by difficulty and outcome.
        errors: codes of the failures that ended attempts or left them without a verdict.
        steps: taken in this session.
        invalid: steps of this session whose replies hold no action.
        note: what all of the figures must be read with; empty for nothing.
        problem: says what the attempts wait for at this moment, if it is out of the ordinary.
        queues: the collector's queues by kind of call. Everything that shows queues asks this.
        tracker_error: which of ``trackers`` has failed, and why; empty if none has.
        feed_error: why ``live.json`` could not be written last time; empty if it was.
        last: the attempts that ended last, newest first: (outcome, task id, steps).
        calls: the queues of the kinds of calls.
        lag: how late the collector's event loop is.
    """

    total: int
    done: int = 0
    earlier: int = 0
    states: Counter[State] = field(default_factory=Counter)
    cells: dict[str, Cell] = field(default_factory=dict)
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    levels: Mapping[str, Level] = field(default_factory=dict)
    by_level: Counter[tuple[Level, Outcome]] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    steps: int = 0
    invalid: int = 0
    note: str = ""
    problem: Callable[[], str] = str
    queues: Callable[[], Mapping[str, Queue]] = dict
    feed_error: str = ""
    tracker_error: str = ""
    last: deque[tuple[Outcome, str, int]] = field(default_factory=lambda: deque(maxlen=6))
    calls: Mapping[str, CallQueue] = field(default_factory=dict)
    lag: LoopLag = field(default_factory=LoopLag)
    started: float = field(default_factory=time.monotonic)
    _stepped: _Pace = field(default_factory=lambda: _Pace(RECENT_SECONDS))
    _ended: _Pace = field(default_factory=lambda: _Pace(ENDED_SECONDS))
    _free: list[int] = field(default_factory=list)

    def move(self, before: State | None, after: State | None, attempt_id: str | None = None) -> None:
        """An attempt went from one state to another; ``None`` is outside.

        Args:
            before: the state it was in.
            after: the state it is in now.
            attempt_id: gives it a cell, until :meth:`ended`. Without one it is counted only.
        """
        if before is not None:
            self.states[before] -= 1
        if after is not None:
            self.states[after] += 1
        if attempt_id is None:
            return
        now = time.monotonic()
        if (cell := self.cells.get(attempt_id)) is not None:
            cell.state, cell.since = after, now
        elif after is not None:
            place = heapq.heappop(self._free) if self._free else len(self.cells)
            self.cells[attempt_id] = Cell(attempt_id, place, after, 0, now)

    def stepped(self, attempt_id: str | None = None, *, is_valid: bool = True) -> None:
        """An attempt took a step, by a reply with or without an action."""
        self.steps += 1
        self.invalid += not is_valid
        self._stepped.count()
        if attempt_id is not None and (cell := self.cells.get(attempt_id)) is not None:
            cell.steps += 1

    def ended(self, trajectory: Trajectory) -> None:
        """An attempt was recorded."""
        episode = trajectory.episode
        self._count(trajectory, 1)
        self._ended.count()
        self.last.appendleft((trajectory.outcome, episode.task_id, len(episode.steps)))
        if (cell := self.cells.pop(episode.attempt_id, None)) is not None:
            heapq.heappush(self._free, cell.place)

    def judged_again(self, before: Trajectory, after: Trajectory) -> None:
        """An attempt that had no verdict was recorded with one."""
        if self.outcomes[before.outcome]:  # else it ended in an earlier session
            self._count(before, -1)
            self._count(after, 1)

    def _count(self, trajectory: Trajectory, by: int) -> None:
        self.outcomes[trajectory.outcome] += by
        if level := self.levels.get(trajectory.episode.task_id):
            self.by_level[level, trajectory.outcome] += by
        if failure := trajectory.episode.failure or trajectory.judge_failure:
            self.errors[failure.code] += by

    @property
    def seconds(self) -> float:
        """Wall time of this session."""
        return time.monotonic() - self.started

    @property
    def steps_per_second(self) -> float:
        """Over the last seconds."""
        return self._stepped.per_second(self.seconds)

    @property
    def trajectories_per_minute(self) -> float:
        """Over the last minutes."""
        return 60 * self._ended.per_second(self.seconds)

    @property
    def seconds_left(self) -> float | None:
        """How long the rest takes at this session's pace; ``None`` before anything is done."""
        here = self.done - self.earlier
        return (self.total - self.done) * self.seconds / here if here else None

    @property
    def successes(self) -> Successes:
        """Of this session; planned are the samples that are done, those still to come are not."""
        rewarded = sum(count for outcome, count in self.outcomes.items() if outcome.is_rewarded)
        done = max(self.done - self.earlier, rewarded)  # one is recorded a moment before it is done
        return Successes(self.outcomes[Outcome.SUCCESS], rewarded, done)

    def successes_of(self, level: Level) -> Successes:
        """Of this session's attempts at tasks of a difficulty."""
        ended = {outcome: self.by_level[level, outcome] for outcome in Outcome}
        rewarded = sum(count for outcome, count in ended.items() if outcome.is_rewarded)
        return Successes(ended[Outcome.SUCCESS], rewarded, sum(ended.values()))

    @property
    def warnings(self) -> list[str]:
        """What the figures must be read with, what the attempts wait for, what cannot be shown."""
        invalid = f"{self.invalid / self.steps:.1%} of replies invalid" if self.invalid else ""
        feed = f"the monitor's page is out of date: {self.feed_error}" if self.feed_error else ""
        return [told for told in (invalid, self.note, self.problem(), feed, self.tracker_error) if told]

    def metric(self) -> dict[str, Any]:
        """A line for ``metrics.jsonl``."""
        note = {"note": self.note} if self.note else {}
        return {
            **note,
            "at": time.time(),
            "done": self.done,
            "total": self.total,
            "steps": self.steps,
            "invalid_replies": self.invalid,
            "steps_per_second": round(self.steps_per_second, 3),
            "trajectories_per_minute": round(self.trajectories_per_minute, 3),
            "states": {state: self.states[state] for state in STATES},
            "outcomes": {outcome.value: self.outcomes[outcome] for outcome in Outcome},
            "calls": {kind: msgspec.to_builtins(queue.load) for kind, queue in self.calls.items()},
            "loop_lag_milliseconds": {
                "p50": round(self.lag.milliseconds(0.5), 3),
                "p99": round(self.lag.milliseconds(0.99), 3),
            },
        }

    def snapshot(self) -> dict[str, Any]:
        """All that a monitor shows: the figures of :meth:`metric`, and what is only of this moment."""
        now = time.monotonic()
        return {
            **self.metric(),
            "earlier": self.earlier,
            "seconds": round(self.seconds, 1),
            "seconds_left": self.seconds_left,
            "success": _rates(self.successes),
            "levels": {level: _rates(self.successes_of(level)) for level in LEVELS},
            "errors": dict(self.errors.most_common()),
            "queues": {kind: queue._asdict() for kind, queue in self.queues().items()},
            "warnings": self.warnings,
            "cells": [
                [cell.place, cell.attempt_id, cell.state, cell.steps, round(now - cell.since, 1)]
                for cell in self.cells.values()
            ],
        }


def _rates(successes: Successes) -> dict[str, Any]:
    return {
        "won": successes.won,
        "judged": successes.judged,
        "done": successes.planned,
        "of_judged": successes.of_judged.value,
        "of_done": successes.of_planned.value,
    }
