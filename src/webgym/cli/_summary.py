"""Terminal output when a run has ended."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from webgym.cli._print import coloured, say
from webgym.core.outcome import Outcome, outcomes_line
from webgym.core.tables import DASH, Table, put
from webgym.core.task import LEVELS
from webgym.core.text import plain, shortened
from webgym.results.rates import Interval
from webgym.results.summary import REASONS, Summary
from webgym.rollout.live import duration


def all_failed(summary: Summary) -> bool:
    """Whether a run made attempts and all of them ended in errors."""
    failed = sum(summary["outcomes"].get(outcome, 0) for outcome in Outcome if outcome.is_error)
    return 0 < failed == summary["attempts"]


def print_summary(summary: Summary, console: Console) -> None:
    """Print a run's outcomes and success rates."""
    columns = ("", "success", "95 %", "judged", "success", "95 %", "planned", "median steps")
    rows = []
    for level in ("overall", *LEVELS):
        group = summary if level == "overall" else summary["by_level"][level]
        judged = sum(count for name, count in group["outcomes"].items() if Outcome(name).is_rewarded)
        steps = group["steps_per_attempt"]["p50"]
        cells = (
            *_rate(summary["success_rate"][level], summary["success_interval"][level]),
            str(judged),
            *_rate(summary["success_rate_of_planned"][level], summary["success_interval_of_planned"][level]),
            str(summary["planned"][level]),
            DASH if steps is None else f"{steps:.0f}",
        )
        rows.append((level, *cells))
    step, invalid = summary["step_milliseconds"], summary["invalid_reply_rate"]
    more = ""
    if step["p50"] is not None and step["p95"] is not None:
        more = f", step latency {step['p50']:.0f} ms (p50) {step['p95']:.0f} ms (p95)"
    if invalid is not None:
        more += f", {invalid:.1%} of replies invalid"
    console.print()
    put(Table("", columns, rows), console)
    console.print()
    console.print(coloured(outcomes_line(summary["outcomes"])))
    if faults := summary.get("faults"):
        say(f"  failed by {', '.join(f'{count} {fault}' for fault, count in faults.items())}", console)
    print_losses(summary, console)
    if hosts := summary["blocked_hosts"]:
        named = ", ".join(f"{plain(host)} ({count})" for host, count in list(hosts.items())[:REASONS])
        others = f", and {len(hosts) - REASONS} others" if len(hosts) > REASONS else ""
        say(f"  blocked by {named}{others}", console)
    for note in summary["notes"]:
        console.print(Text.assemble(("note ", "yellow"), shortened(note)), soft_wrap=True)
    say(
        f"{summary['attempts']} trajectories, {summary['steps']} steps in "
        f"{duration(summary['wall_seconds'])}: {summary['steps_per_second']:.1f} steps/s{more}",
        console,
    )


def _rate(rate: float | None, interval: Interval | None) -> tuple[str, str]:
    return (
        DASH if rate is None else f"{rate:.1%}",
        DASH if interval is None else f"{interval[0]:.1%}–{interval[1]:.1%}",
    )


def print_retry(summary: Summary, command: str, console: Console) -> None:
    """Print how to retry samples that ended in errors, and how to judge attempts without a verdict."""
    if count := summary["lost_samples"]:
        lost = "1 sample ended in an error" if count == 1 else f"{count} samples ended in errors"
        say(f"errors   {lost}; retry with: {command} --retry-errors", console)
    print_unjudged(summary["outcomes"][Outcome.JUDGE_ERROR], command, console)


def print_unjudged(count: int, command: str, console: Console) -> None:
    """Print how to judge attempts without a verdict, if there are any."""
    if count:
        unjudged = "1 attempt has" if count == 1 else f"{count} attempts have"
        say(f"unjudged {unjudged} no verdict; judge with: {command}", console)


def print_losses(summary: Summary, console: Console) -> None:
    """Print why attempts have no reward, the most frequent reasons first."""
    for code, loss in list(summary["losses"].items())[:REASONS]:
        reason = f": {shortened(loss['message'])}" if loss["message"] else ""
        say("  " + plain(f"{loss['count']} {code}{reason} ({loss['attempt_id']})"), console)
