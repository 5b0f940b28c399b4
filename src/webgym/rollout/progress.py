"""What a collector is doing right now: written by it, read by whoever shows it."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from webgym.core.outcome import Outcome
from webgym.core.trajectory import Trajectory
from webgym.rollout.rates import Successes

State: TypeAlias = Literal["opening", "acting", "thinking", "judging"]
STATES: tuple[State, ...] = ("opening", "acting", "thinking", "judging")

RECENT_SECONDS = 20.0
"""The span over which current throughput is measured."""


@dataclass
class Progress:
    """Counts of a running collector.

    Attributes:
        total: samples wanted.
        done: samples done, those of an earlier session included.
        earlier: samples done before this session.
        states: how many attempts are in which state.
        outcomes: of the attempts that ended in this session.
        steps: taken in this session.
        invalid: steps of this session whose replies hold no action.
        note: what all of the figures must be read with; empty for nothing.
        trouble: says what the attempts wait for at this moment, if it is out of the ordinary.
        last: the attempts that ended last, newest first: (outcome, task id, steps).
    """

    total: int
    done: int = 0
    earlier: int = 0
    states: Counter[State] = field(default_factory=Counter)
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    steps: int = 0
    invalid: int = 0
    note: str = ""
    trouble: Callable[[], str] = str
    last: deque[tuple[Outcome, str, int]] = field(default_factory=lambda: deque(maxlen=6))
    started: float = field(default_factory=time.monotonic)
    _recent: deque[float] = field(default_factory=deque)

    def move(self, before: State | None, after: State | None) -> None:
        """An attempt went from one state to another; ``None`` is outside."""
        if before is not None:
            self.states[before] -= 1
        if after is not None:
            self.states[after] += 1

    def stepped(self, *, is_valid: bool = True) -> None:
        """An attempt took a step, by a reply with or without an action."""
        self.steps += 1
        self.invalid += not is_valid
        now = time.monotonic()
        self._recent.append(now)
        while self._recent and now - self._recent[0] > RECENT_SECONDS:
            self._recent.popleft()

    def ended(self, trajectory: Trajectory) -> None:
        """An attempt was recorded."""
        episode = trajectory.episode
        self.outcomes[trajectory.outcome] += 1
        self.last.appendleft((trajectory.outcome, episode.task_id, len(episode.steps)))

    def judged_again(self, trajectory: Trajectory) -> None:
        """An attempt that had no verdict was recorded with one."""
        if self.outcomes[Outcome.JUDGE_ERROR]:  # else it ended in an earlier session
            self.outcomes[Outcome.JUDGE_ERROR] -= 1
            self.outcomes[trajectory.outcome] += 1

    @property
    def seconds(self) -> float:
        """Wall time of this session."""
        return time.monotonic() - self.started

    @property
    def steps_per_second(self) -> float:
        """Over the last seconds."""
        span = min(self.seconds, RECENT_SECONDS)
        newest = time.monotonic() - RECENT_SECONDS
        return sum(1 for at in self._recent if at > newest) / span if span > 0 else 0.0

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

    def metric(self) -> dict[str, Any]:
        """A line for ``metrics.jsonl``."""
        return {
            "at": time.time(),
            "done": self.done,
            "total": self.total,
            "steps": self.steps,
            "invalid_replies": self.invalid,
            "steps_per_second": round(self.steps_per_second, 3),
            "states": {state: self.states[state] for state in STATES},
            "outcomes": {outcome.value: self.outcomes[outcome] for outcome in Outcome},
        }
