"""The progress and the tables of ``webgym bench soak``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from webgym.bench.soak.counts import Counts
from webgym.bench.soak.leaks import Census
from webgym.bench.soak.run import Soak, Watch
from webgym.core.tables import Table


def progress_line(counts: Counts) -> str:
    """The counts so far, on one line."""
    return (
        f"{counts.opened} opened, {counts.closed} closed, {counts.lost.total()} lost, "
        f"{counts.vanished} dropped, {counts.live} live; {counts.steps} steps; {counts.faults.total()} faults"
    )


def soak_tables(result: Soak) -> Iterator[Table]:
    """Tables of sessions, faults, and of what exists before and afterwards."""
    counts, plan = result.counts, result.plan
    yield Table(
        f"{plan.seconds:g} s, {plan.clients} clients, {plan.slots} slots, {plan.workers} workers, "
        f"seed {plan.seed}",
        ("", "count"),
        [
            ("sessions opened", str(counts.opened)),
            ("  closed by their client", str(counts.closed)),
            *_rows("  lost: ", counts.lost),
            ("  dropped by their client", str(counts.vanished)),
            *_rows("session refused: ", counts.refused),
            ("successful calls", str(counts.steps)),
            *_rows("pages opened: ", counts.pages),
            *_rows("notices: ", counts.notices),
            ("slowest call, s", f"{counts.slowest[0]:.1f} ({counts.slowest[1]})"),
        ],
    )
    faults = [*_rows("", counts.faults), ("all", str(counts.faults.total()))]
    if result.disk:
        faults.append(("disk full: not tried", result.disk))
    yield Table("Faults", ("", "count"), faults)
    yield Table("Check", ("", "before", "after"), list(_check(result)))


def _rows(prefix: str, counts: Counter[str]) -> list[tuple[str, str]]:
    return [(f"{prefix}{name}", str(count)) for name, count in counts.most_common()]


def _check(result: Soak) -> Iterator[tuple[str, str, str]]:
    counts = result.counts
    accounted = counts.closed + counts.lost.total() + counts.vanished
    yield "sessions: opened, and accounted for", str(counts.opened), str(accounted)
    yield (
        "sessions since the gateway's last start: granted, and received",
        str(result.granted[0]),
        str(result.granted[1]),
    )
    yield (
        "half-open connections: opened, and closed by the server",
        str(counts.half_open),
        str(counts.hung_up_on),
    )
    yield "errors without a type", "", str(len(counts.untyped))
    served, gone = result.rest_seconds
    yield "time until every slot served again, s", "", f"{served:.1f}"
    yield "time until nothing was left, including idle connections, s", "", f"{gone:.1f}"
    before, after = result.before, result.after
    if after is None:
        return
    for name in ("workers", "browsers", "zombies", "profiles", "folders"):
        yield name, str(getattr(before, name)), str(getattr(after, name))
    for process in before.descriptors:
        yield f"open descriptors of a {process}", _sum(before, process), _sum(after, process)
    yield "stray processes and files", _strays(before), _strays(after)
    yield "memory of gateway and workers, MB", f"{before.megabytes:.0f}", f"{after.megabytes:.0f}"


def _strays(census: Census) -> str:
    return str(len(census.strays) + len(census.others))


def _sum(census: Census, process: str) -> str:
    return str(sum(census.descriptors[process].values()))


_LINE_SECONDS = 10.0


@contextmanager
def progress(console: Console, seconds: float) -> Iterator[Watch]:
    """Show the progress until the block ends.

    Args:
        console: where.
        seconds: the planned duration.

    Yields:
        A function to call every second.
    """
    if not console.is_terminal:
        due = _LINE_SECONDS

        def print_line(counts: Counts, now: float) -> None:
            nonlocal due
            if now >= due:
                due += _LINE_SECONDS
                console.print(f"{now:.0f} of {seconds:.0f} s: {progress_line(counts)}", highlight=False)

        yield print_line
        return
    columns = (BarColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=seconds)
        yield lambda counts, now: bar.update(task, completed=now, description=progress_line(counts))
