"""What a soak found, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from webgym.bench.soak.books import Books
from webgym.bench.soak.leaks import Census
from webgym.bench.soak.run import Soak
from webgym.tables import Table


def progress_line(books: Books) -> str:
    """Where it stands, in one line."""
    return (
        f"{books.opened} opened, {books.closed} closed, {books.lost.total()} lost, {books.vanished} left, "
        f"{books.live} live; {books.steps} steps; {books.faults.total()} faults"
    )


def soak_tables(found: Soak) -> Iterator[Table]:
    """What was done, and whether it adds up."""
    books, plan = found.books, found.plan
    yield Table(
        f"{plan.seconds:g} s, {plan.clients} clients, {plan.slots} slots, {plan.workers} workers, "
        f"seed {plan.seed}",
        ("", "count"),
        [
            ("sessions opened", str(books.opened)),
            ("  closed by their client", str(books.closed)),
            *_rows("  lost: ", books.lost),
            ("  left without goodbye", str(books.vanished)),
            *_rows("no session to be had: ", books.refused),
            ("steps and looks", str(books.steps)),
            *_rows("pages opened: ", books.pages),
            *_rows("told to agents: ", books.notices),
            ("slowest call, s", f"{books.slowest[0]:.1f} ({books.slowest[1]})"),
        ],
    )
    faults = [*_rows("", books.faults), ("all", str(books.faults.total()))]
    if found.disk:
        faults.append(("disk full: not tried", found.disk))
    yield Table("Faults", ("", "count"), faults)
    yield Table("The books", ("", "before", "after"), list(_balance(found)))


def _rows(prefix: str, counts: Counter[str]) -> list[tuple[str, str]]:
    return [(f"{prefix}{name}", str(count)) for name, count in counts.most_common()]


def _balance(found: Soak) -> Iterator[tuple[str, str, str]]:
    books = found.books
    accounted = books.closed + books.lost.total() + books.vanished
    yield "sessions: opened, and accounted for", str(books.opened), str(accounted)
    yield "given by the gateway's last run, and arrived", str(found.granted[0]), str(found.granted[1])
    yield "half-open connections, and hung up on", str(books.half_open), str(books.hung_up_on)
    yield "errors without a type", "", str(len(books.untyped))
    served, gone = found.rest_seconds
    yield "until every slot served again, s", "", f"{served:.1f}"
    yield "until nothing was left, idle connections included, s", "", f"{gone:.1f}"
    before, after = found.before, found.after
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
