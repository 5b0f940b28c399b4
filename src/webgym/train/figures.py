"""The metrics of an iteration, as written to ``metrics.jsonl`` and as a line of text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS
from webgym.results.summary import Summary
from webgym.rollout.live import duration
from webgym.store.runs import RunReader
from webgym.train.progress import TrainingProgress


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
    steps = unchanged = replies = tokens = rewarded = 0
    versions: Counter[str] = Counter()
    for trajectory in run.trajectories():
        if not trajectory.outcome.is_rewarded:
            continue
        rewarded += 1
        for step in trajectory.episode.steps:
            steps += 1
            unchanged += step.changed is False
            replies += len(step.reply.text)
            tokens += step.reply.completion_tokens
            versions[step.reply.weight_version] += 1
    return {
        **rates_of(summary),
        "steps_per_trajectory": steps / rewarded if rewarded else None,
        "unchanged_share": unchanged / steps if steps else None,
        "reply_characters": replies / steps if steps else None,
        "reply_tokens": tokens / steps if steps else None,
        "weight_versions": dict(versions),
    }


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
