"""Printing: lines, tables in a format, progress bars."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any, TypeAlias

import msgspec
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from webgym.core.errors import UsageError
from webgym.core.tables import Table, latex, markdown, show
from webgym.core.text import plain

AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
AsMarkdown: TypeAlias = Annotated[bool, typer.Option("--markdown", help="Print the tables as Markdown.")]
AsLatex: TypeAlias = Annotated[bool, typer.Option("--latex", help="Print the tables as LaTeX (booktabs).")]

LINE_SECONDS = 10.0
"""Between two lines of progress where there is no terminal."""

Advance: TypeAlias = Callable[..., None]
"""Called with a bar's name, the number done and, if known, that of all and a text behind the bar."""


def say(text: object, console: Console) -> None:
    """Print text as it is: without markup, colours and line breaks of its own."""
    console.print(str(text), highlight=False, soft_wrap=True, markup=False)


def coloured(line: str) -> Text:
    """A line with the names of outcomes in their colours, and their numbers in bold; a note in yellow."""
    from webgym.rollout.live import COLORS

    text = Text(line)
    text.highlight_regex(r"^note\b", "yellow")
    for outcome, colour in COLORS.items():
        text.highlight_regex(rf"\d+(?= {outcome}\b)", "bold")
        text.highlight_regex(rf"(?<=\d ){outcome}\b", colour)
    return text


def say_some(entries: Iterable[object], limit: int, console: Console, indent: str = "    ") -> None:
    """Print the first entries of a list, and how many more there are."""
    listed = list(entries)
    for entry in listed[:limit]:
        say(f"{indent}{plain(str(entry))}", console)
    if limit and len(listed) > limit:
        say(f"{indent}and {len(listed) - limit:,} more (--lines)", console)


def refuse_several(**given: bool) -> None:
    """Refuse output formats that exclude each other.

    Raises:
        UsageError: more than one was given.
    """
    if sum(given.values()) > 1:
        names = [f"--{name}" for name in given]
        raise UsageError(
            f"{', '.join(names[:-1])} and {names[-1]} exclude each other", hint="give one of them"
        )


def print_json(result: Any) -> None:
    """Print a result as JSON on stdout."""
    print(msgspec.json.format(msgspec.json.encode(result), indent=2).decode())


def print_tables(
    tables: Iterable[Table], console: Console, *, as_markdown: bool = False, as_latex: bool = False
) -> None:
    """Print tables to a terminal, or on stdout as a document."""
    if as_markdown or as_latex:
        print((markdown if as_markdown else latex)(tables), end="")
    else:
        show(tables, console)


@contextmanager
def bars(console: Console | None = None) -> Iterator[Advance]:
    """Show progress bars until the block ends; without a terminal, a line now and then.

    Args:
        console: by default stderr.

    Yields:
        A function that moves the bar of a name, which appears with its first call.
    """
    console = console or Console(stderr=True)
    every = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[details]}", markup=False),
    )
    with Progress(*every, console=console, transient=True, disable=not console.is_terminal) as progress:
        shown: dict[str, Any] = {}
        line_at = time.monotonic() + LINE_SECONDS

        def advance(name: str, done: int, total: int | None = None, details: str = "") -> None:
            nonlocal line_at
            if name not in shown:
                shown[name] = progress.add_task(name, total=None, details="")
            progress.update(shown[name], total=total or None, completed=done, details=details)
            if progress.disable and time.monotonic() >= line_at:
                line_at = time.monotonic() + LINE_SECONDS
                say(f"{name}: {done}{f' of {total}' if total else ''} {details}".rstrip(), console)

        yield advance
