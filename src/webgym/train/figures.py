"""The metrics of an iteration, as written to ``metrics.jsonl`` and as a line of text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from statistics import fmean, median
from typing import Any, Final

from webgym.core.errors import TrainingError
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS
from webgym.core.text import duration
from webgym.results.summary import Summary
from webgym.store.runs import RunReader
from webgym.train.config import CollapseAction
from webgym.train.progress import TrainingProgress

Tell = Callable[[str], object]


def judged(figures: Mapping[str, Any]) -> int:
    """The number of attempts that a success rate is over: those with a reward."""
    return sum(figures["outcomes"][outcome.value] for outcome in Outcome if outcome.is_rewarded)


def success_line(figures: Mapping[str, Any]) -> str:
    """A line about a run's success rate: overall with its interval, and by level."""
    rates, interval = figures["success_rate"], figures["success_interval"]["overall"]
    if rates["overall"] is None:
        return f"success unknown, none of {figures['attempts']} attempts was judged"
    levels = [f"{level} {rates[level]:.1%}" for level in LEVELS if rates[level] is not None]
    spread = f" ({interval[0]:.1%} to {interval[1]:.1%})"
    success = f"success {rates['overall']:.1%}{spread} of {judged(figures)} judged attempts"
    return ", ".join([success, *levels])


def iteration_line(row: Mapping[str, Any], progress: TrainingProgress) -> str:
    """A line about a finished iteration: success, trained steps, left-out steps by reason, and duration."""
    replay, counts, update = row["replay"], row["replay"]["counts"], row["update"]
    left_out = {
        "attempts without a reward": counts["unrewarded"],
        "attempts without an advantage": counts["left_out"],
        "replies without an action": counts.get("unreadable", 0),  # older trainings did not count them
        "steps that changed nothing": counts["unchanged"],
        "steps used up": replay["used_up"],
        "steps of stale weights": replay["stale"],
        **update.get("dropped", {}),
    }
    dropped = ", ".join(f"{count} {reason}" for reason, count in left_out.items() if count)
    learned = f"{update['samples']} steps, loss {update['loss']:.3g}" if update else "nothing to train on"
    left = progress.seconds_left
    eta = f"; {duration(left)} left" if left else ""
    return (
        f"iteration {row['iteration']} of {progress.iterations}: {success_line(row['collect'])}; {learned}"
        f" (left out: {dropped or 'nothing'}); {duration(sum(row['seconds'].values()))}{eta}"
    )


def figures_of(run: RunReader, summary: Summary) -> dict[str, Any]:
    """The figures of a run for a training's curves: rates, lengths, blocks, unchanged screenshots.

    Args:
        run: the run, all attempts on disk.
        summary: of the run.
    """
    steps = unchanged = unreadable = replies = tokens = 0
    lengths: dict[bool, list[int]] = {True: [], False: []}  # of successes and of failures
    versions: Counter[str] = Counter()
    for trajectory in run.trajectories():
        if not trajectory.outcome.is_rewarded:
            continue
        lengths[trajectory.outcome is Outcome.SUCCESS].append(len(trajectory.episode.steps))
        for step in trajectory.episode.steps:
            steps += 1
            unchanged += step.changed is False
            unreadable += step.action is None
            replies += len(step.reply.text)
            tokens += step.reply.completion_tokens
            versions[step.reply.weight_version] += 1
    return {
        **rates_of(summary),
        "steps_per_trajectory": _mean([*lengths[True], *lengths[False]]),
        "steps_of_successes": _mean(lengths[True]),
        "steps_of_failures": _mean(lengths[False]),
        "unchanged_share": unchanged / steps if steps else None,
        "unreadable_share": unreadable / steps if steps else None,
        "reply_characters": replies / steps if steps else None,
        "reply_tokens": tokens / steps if steps else None,
        "weight_versions": dict(versions),
    }


def _mean(values: Sequence[float]) -> float | None:
    return fmean(values) if values else None


_OFTEN: Final = 2
"""Signs of a collapse that are one: each alone also comes with learning."""
_FIRST: Final = 3
"""Iterations whose median later ones are compared with."""


def collapse_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """What the newest iteration shows of a policy that repeats itself; empty if it does not.

    The signs: what was sampled is twice as sure as in the first iterations (its mean log-probability halved),
    replies are half as long again, and a tenth more of them cannot be read.

    Args:
        rows: of ``metrics.jsonl``.
    """

    def change(*path: str) -> tuple[float, float] | None:
        found = [value for row in rows if (value := figure(row, *path)) is not None]
        if len(found) <= _FIRST or figure(rows[-1], *path) is None:
            return None
        return median(found[:_FIRST]), found[-1]

    signs = []
    if (sure := change("update", "extra", "logprob")) and sure[1] > sure[0] / 2:
        signs.append(f"log-probabilities rose from {sure[0]:.3f} to {sure[1]:.3f}")
    if (length := change("collect", "reply_characters")) and length[1] > 1.5 * length[0]:
        signs.append(f"replies grew from {length[0]:.0f} to {length[1]:.0f} characters")
    if (lost := change("collect", "unreadable_share")) and lost[1] > lost[0] + 0.1:
        signs.append(f"unreadable replies grew from {lost[0]:.0%} to {lost[1]:.0%}")
    return "; ".join(signs) if len(signs) >= _OFTEN else ""


def watch_for_collapse(rows: Sequence[Mapping[str, Any]], action: CollapseAction, tell: Tell) -> None:
    """Warn of a collapse, or stop.

    Args:
        rows: of ``metrics.jsonl``.
        action: what to do about it.
        tell: called with the warning.

    Raises:
        TrainingError: there are signs, and ``action`` is ``stop``.
    """
    if action == "ignore" or not (signs := collapse_of(rows)):
        return
    if action == "stop":
        raise TrainingError(
            f"the policy seems to collapse: {signs}",
            hint="begin anew from earlier weights, with a lower learn.update.learning_rate or a larger "
            "batch; or set learn.on_collapse to warn in config.yaml, and --resume",
        )
    tell(f"the policy seems to collapse: {signs}; learn.on_collapse: stop would end the training here")


def figure(row: Mapping[str, Any], *path: str) -> float | None:
    """A number in a row of ``metrics.jsonl`` by its path; ``None`` if there is none."""
    value: Any = row
    for key in path:
        value = value.get(key) if value else None
    return None if value is None else float(value)


def rates_of(summary: Summary) -> dict[str, Any]:
    """Success, outcomes and blocks of a run, from its summary."""
    attempts, outcomes = summary["attempts"], summary["outcomes"]
    return {
        "attempts": attempts,
        "outcomes": outcomes,
        "success_rate": summary["success_rate"],
        "success_rate_of_planned": summary["success_rate_of_planned"],
        "success_interval": summary["success_interval"],
        "success_interval_of_planned": summary["success_interval_of_planned"],
        "blocked_share": outcomes["blocked"] / attempts if attempts else None,
        "steps": summary["steps"],
        "steps_per_second": summary["steps_per_second"],
    }
