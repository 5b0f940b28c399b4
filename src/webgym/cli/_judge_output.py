"""Terminal output of ``webgym judge``: progress, outcomes, cost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from webgym.core.outcome import Outcome
from webgym.core.tables import Table, put
from webgym.core.verdict import Cost
from webgym.llm.ledger import Ledger
from webgym.llm.prices import Usage
from webgym.rollout.live import COLORS
from webgym.rollout.rejudge import Judging


@contextmanager
def progress_bar(console: Console) -> Iterator[Callable[[Judging], None]]:
    """Show a progress bar with the cost so far until the block ends; nothing if there is no terminal.

    Yields:
        A function that updates the bar.
    """
    columns = (
        TextColumn("judging"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}", markup=False),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        bar = bars.add_task("", total=None)

        def show(state: Judging) -> None:
            bars.update(bar, total=state.total, completed=state.done, description=cost_line(state.spent))

        yield show


def outcomes_line(state: Judging) -> Text:
    """The number of attempts by outcome, on one line."""
    line = Text()
    for outcome in Outcome:
        if count := state.outcomes[outcome]:
            line.append(f"{count} ", style="bold")
            line.append(f"{outcome}   ", style=COLORS[outcome])
    return line


def cost_line(cost: Cost) -> str:
    """The number of model calls, their tokens and their price, on one line."""
    if not cost.calls:
        return "no model was called"
    parts = [f"{cost.calls:,} replies"]
    if cost.cached:
        parts.append(f"{cost.cached:,} from the cache")
    if cost.repeats:
        parts.append(f"{cost.repeats:,} repeated")
    parts.append(f"{cost.prompt_tokens:,} + {cost.completion_tokens:,} tokens")
    parts.append(f"${cost.dollars:.4f}" if cost.dollars else "price unknown")
    return ", ".join(parts)


def print_costs(ledger: Ledger, console: Console) -> None:
    """Print the cost of every stage and model, including earlier calls of ``webgym judge`` for the run."""
    columns = ("stage", "model", "paid", "cached", "prompt tokens", "reply tokens", "dollars")
    rows = [
        (
            purpose,
            model,
            *map(str, (usage.calls, usage.hits, usage.prompt_tokens, usage.completion_tokens)),
            "unknown" if usage.unpriced else f"{usage.dollars:.4f}",
        )
        for (purpose, model), usage in sorted(ledger.rows.items())
    ]
    console.print("all calls to judge models for this run:", style="dim", highlight=False)
    put(Table("", columns, rows, names=2), console)


def spent_since(before: Usage, now: Usage) -> Cost:
    """The cost of all calls between two states of a ledger, whether or not they led to a verdict."""
    return Cost(
        calls=now.calls - before.calls,
        prompt_tokens=now.prompt_tokens - before.prompt_tokens,
        completion_tokens=now.completion_tokens - before.completion_tokens,
        dollars=now.dollars - before.dollars,
    )
