"""Terminal output when a run has ended."""

from __future__ import annotations

from rich.console import Console

from webgym.cli._print import coloured, say
from webgym.core.outcome import Outcome
from webgym.core.tables import show
from webgym.results.summary import Summary, loss_lines, summary_parts


def all_failed(summary: Summary) -> bool:
    """Whether a run made attempts and all of them ended in errors."""
    failed = sum(summary["outcomes"].get(outcome, 0) for outcome in Outcome if outcome.is_error)
    return 0 < failed == summary["attempts"]


def print_summary(summary: Summary, console: Console) -> None:
    """Print a run's outcomes and success rates, in colours."""
    console.print()
    for part in summary_parts(summary):
        if isinstance(part, str):
            console.print(coloured(part), soft_wrap=True)
        else:
            show([part], console)
            console.print()


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
    for line in loss_lines(summary):
        say(line, console)
