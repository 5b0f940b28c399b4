"""The progress of a running collector, which it updates and displays read."""

from __future__ import annotations

import heapq
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import msgspec

from webgym.core.calls import CallQueue, LoopLag
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS, Level
from webgym.core.trajectory import Failure, Trajectory
from webgym.results.rates import Successes
from webgym.results.summary import Digest, digest_of, form_notes

State: TypeAlias = Literal["opening", "acting", "thinking", "judging"]
STATES: tuple[State, ...] = ("opening", "acting", "thinking", "judging")

RECENT_SECONDS = 20.0
"""Time span over which the rate of steps is measured."""

ENDED_SECONDS = 300.0
"""Time span over which the rate of trajectories is measured; with large models one takes minutes."""


_FEW: Final = 3
"""Errors in a row that are shown with their reason: something that all attempts need may have failed."""


class Queue(NamedTuple):
    """Current load of calls of one kind, such as ``navigate`` or ``policy``.

    Attributes:
        waiting: calls that wait.
        running: calls in progress.
        wait: median waiting time of recent calls, seconds; ``None`` before the first.
        service: median duration of recent calls, seconds; ``None`` before the first.
    """

    waiting: int
    running: int
    wait: float | None
    service: float | None


def queues_of(calls: Mapping[str, CallQueue]) -> dict[str, Queue]:
    """The load of all queues that have been used."""
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
        attempt_id: the attempt.
        place: its position in the grid, from 0: the lowest that was free when it started.
        state: ``None`` between two states, as while an ended attempt waits for a free judge.
        steps: number of steps so far.
        since: when the state was entered, on the clock of :func:`time.monotonic`.
    """

    attempt_id: str
    place: int
    state: State | None
    steps: int
    since: float


class _EventRate:
    """The rate of an event over a sliding time span."""

    def __init__(self, span: float) -> None:
        self._span = span
        self._times: deque[float] = deque()

    def count(self) -> None:
        """Count an event now."""
        self._times.append(time.monotonic())
        self._forget()

    def _forget(self) -> None:
        oldest = time.monotonic() - self._span
        while self._times and self._times[0] < oldest:
            self._times.popleft()

    def per_second(self, age: float) -> float:
        """Events per second over the span, or over ``age`` seconds if that is less."""
        self._forget()
        span = min(age, self._span)
        return len(self._times) / span if span > 0 else 0.0


@dataclass
class Progress:
    """Counts of a running collector.

    Attributes:
        total: number of planned samples.
        done: samples done, including earlier sessions.
        earlier: samples done before this session.
        states: number of attempts by state.
        cells: the attempts in progress, by attempt id.
        outcomes: number of recorded attempts, by outcome; like all counts, of the whole run.
        levels: difficulty of the tasks, by id.
        by_level: number of recorded attempts by difficulty and outcome.
        done_by_level: number of samples that are done by difficulty.
        faults: number of failures by what was wrong with them, as far as the judge says.
        errors: number of failures that ended attempts or prevented verdicts, by code.
        steps: number of steps.
        invalid: steps whose replies hold no valid action.
        note: a caveat about all figures; empty for none.
        problem: returns the problem that attempts currently wait for; empty if there is none.
        browser_problem: why new attempts wait for a browser; empty if none does.
        queues: returns the load of the collector's queues by kind of call.
        tracker_error: message about a failed tracker; empty if there is none.
        feed_error: why the last write of ``live.json`` failed; empty if it did not.
        last: the latest ended attempts, newest first: (outcome, task id, steps).
        calls: the queues themselves, by kind of call.
        lag: the event loop's lag.
    """

    total: int
    done: int = 0
    earlier: int = 0
    states: Counter[State] = field(default_factory=Counter)
    cells: dict[str, Cell] = field(default_factory=dict)
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    levels: Mapping[str, Level] = field(default_factory=dict)
    by_level: Counter[tuple[Level, Outcome]] = field(default_factory=Counter)
    done_by_level: Counter[Level] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    steps: int = 0
    invalid: int = 0
    note: str = ""
    problem: Callable[[], str] = str
    queues: Callable[[], Mapping[str, Queue]] = dict
    browser_problem: str = ""
    feed_error: str = ""
    tracker_error: str = ""
    last: deque[tuple[Outcome, str, int]] = field(default_factory=lambda: deque(maxlen=6))
    calls: Mapping[str, CallQueue] = field(default_factory=dict)
    lag: LoopLag = field(default_factory=LoopLag)
    started: float = field(default_factory=time.monotonic)
    _stepped: _EventRate = field(default_factory=lambda: _EventRate(RECENT_SECONDS))
    _faults: int = 0
    """Number of latest attempts in a row that ended in an error."""
    _fault: str = ""
    _ended: _EventRate = field(default_factory=lambda: _EventRate(ENDED_SECONDS))
    _free: list[int] = field(default_factory=list)

    def move(self, before: State | None, after: State | None, attempt_id: str | None = None) -> None:
        """Move an attempt from one state to another; ``None`` is no state.

        Args:
            before: the previous state.
            after: the new state.
            attempt_id: shows the attempt as a cell until :meth:`ended`. Without it the attempt is only
                counted.
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
        """Count a step of an attempt, whose reply held a valid action or not."""
        self.steps += 1
        self.invalid += not is_valid
        self._stepped.count()
        if attempt_id is not None and (cell := self.cells.get(attempt_id)) is not None:
            cell.steps += 1

    def recorded(self, attempt: Digest) -> None:
        """Count an attempt of an earlier session, which adds nothing to the rates over time."""
        self._count(attempt, attempt.error, 1)
        self.steps += attempt.steps
        self.invalid += attempt.invalid

    def ended(self, trajectory: Trajectory) -> None:
        """Count a recorded attempt and remove its cell."""
        attempt, failure = digest_of(trajectory), _failure_of(trajectory)
        self._count(attempt, failure.code, 1)
        self._ended.count()
        self.last.appendleft((attempt.outcome, attempt.task_id, attempt.steps))
        if attempt.outcome.is_error and failure.code:
            self._faults, self._fault = self._faults + 1, failure.message
        elif attempt.outcome is not Outcome.CANCELLED:
            self._faults = 0
        if (cell := self.cells.pop(attempt.attempt_id, None)) is not None:
            heapq.heappush(self._free, cell.place)

    def judged_again(self, before: Trajectory, after: Trajectory) -> None:
        """Replace the counts of an attempt that was judged again."""
        self._count(digest_of(before), _failure_of(before).code, -1)
        self._count(digest_of(after), _failure_of(after).code, 1)

    def _count(self, attempt: Digest, error: str, by: int) -> None:
        self.outcomes[attempt.outcome] += by
        if level := self.levels.get(attempt.task_id):
            self.by_level[level, attempt.outcome] += by
        if attempt.fault:
            self.faults[attempt.fault] += by
        if error:
            self.errors[error] += by

    @property
    def seconds(self) -> float:
        """Wall time of this session."""
        return time.monotonic() - self.started

    @property
    def steps_per_second(self) -> float:
        """Rate over the last :data:`RECENT_SECONDS`."""
        return self._stepped.per_second(self.seconds)

    @property
    def trajectories_per_minute(self) -> float:
        """Rate over the last :data:`ENDED_SECONDS`."""
        return 60 * self._ended.per_second(self.seconds)

    @property
    def seconds_left(self) -> float | None:
        """Estimated remaining seconds at this session's rate; ``None`` before any sample is done."""
        done_now = self.done - self.earlier
        return (self.total - self.done) * self.seconds / done_now if done_now else None

    @property
    def successes(self) -> Successes:
        """Success so far; only samples that are done count as planned."""
        return _successes(self.outcomes, self.done)

    def successes_of(self, level: Level) -> Successes:
        """Success so far at tasks of a difficulty."""
        ended = {outcome: self.by_level[level, outcome] for outcome in Outcome}
        return _successes(ended, self.done_by_level[level])

    @property
    def warnings(self) -> list[str]:
        """Caveats about the figures, problems that attempts wait for, and failures of displays."""
        invalid = f"{self.invalid / self.steps:.1%} of replies invalid" if self.invalid else ""
        feed = f"the monitor's page is out of date: {self.feed_error}" if self.feed_error else ""
        waits = (self.problem(), self.browser_problem)
        faults = f"the last {self._faults} attempts ended in errors: {self._fault}"
        faults = faults if self._faults >= _FEW else ""
        form = "".join(form_notes(self.successes.judged, self.faults))
        return [text for text in (invalid, form, self.note, *waits, faults, feed, self.tracker_error) if text]

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
        """All figures of a monitor: those of :meth:`metric` and the momentary ones."""
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


def _failure_of(trajectory: Trajectory) -> Failure:
    """What ended an attempt or prevented its verdict; without a code if nothing did."""
    return trajectory.episode.failure or trajectory.judge_failure or Failure("", "")


def _successes(ended: Mapping[Outcome, int], done: int) -> Successes:
    rewarded = sum(count for outcome, count in ended.items() if outcome.is_rewarded)
    # An attempt is recorded a moment before its sample is done.
    return Successes(ended.get(Outcome.SUCCESS, 0), rewarded, max(done, rewarded))


def _rates(successes: Successes) -> dict[str, Any]:
    return {
        "won": successes.won,
        "judged": successes.judged,
        "done": successes.planned,
        "of_judged": successes.of_judged.value,
        "of_done": successes.of_planned.value,
    }
