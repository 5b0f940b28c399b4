"""The command line: one module per verb, imported when its verb is called.

To add a verb, write ``src/webgym/cli/<verb>.py`` with either

* ``def command(...) -> None``, a function whose parameters are Typer's, or
* ``app = typer.Typer()`` with commands of its own, for a verb that has sub-verbs,

and add it to :data:`VERBS`. A verb that fails raises a :class:`webgym.core.errors.WebGymError`, whose message
:func:`main` prints, or ``typer.Exit(code)`` when it has printed the reason itself.
"""

from __future__ import annotations

import errno
import importlib
import importlib.util
import inspect
import io
import re
import sys
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from shutil import get_terminal_size

import typer
from typer.core import TyperCommand

from webgym.core.errors import UsageError, WebGymError
from webgym.core.text import plain

EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells expect
_BOXES = 100
"""Columns from which help is in boxes; in fewer, their narrow columns would cut long words."""


@dataclass(frozen=True, slots=True)
class Verb:
    """A command and the module that implements it.

    Attributes:
        name: the command's name and the name of its module.
        help: one line for ``webgym --help``, which imports no verb.
        attribute: the module's attribute: ``command`` (a function) or ``app`` (a Typer with sub-verbs).
    """

    name: str
    help: str
    attribute: str = "command"

    @property
    def module(self) -> str:
        """The dotted name of the module."""
        return f"{__name__}.{self.name}"

    @property
    def is_installed(self) -> bool:
        """Whether this installation contains the verb's module."""
        return importlib.util.find_spec(self.module) is not None


VERBS: tuple[Verb, ...] = (
    Verb("demo", "Run the whole pipeline on the offline web and write a report."),
    Verb("doctor", "Check this machine: what is installed, what is missing, how to fix it."),
    Verb("serve", "Start a browser server."),
    Verb("sites", "Serve or list the websites of the offline web.", "app"),
    Verb("tasks", "List, check and write task sets.", "app"),
    Verb("llm", "Report the cost of model calls, and import batch results.", "app"),
    Verb("rollout", "Collect trajectories into a run folder, or resume a run."),
    Verb("judge", "Judge a stored run again (webgym judge RUN), and compare judges.", "app"),
    Verb("eval", "Evaluate a policy on a test set: success rates by difficulty, with intervals."),
    Verb("compare", "Compare the success of two runs, and test whether the difference is more than chance."),
    Verb("train", "Train a policy: roll out, judge, update the weights, publish them, evaluate."),
    Verb("pretrain", "Pretrain the initial weights of the tiny policy."),
    Verb("study", "Repeat the paper's training study with the tiny policy."),
    Verb("report", "Write the report of a run or of a training."),
    Verb("login", "Sign in to a website by hand, and save that for runs."),
    Verb("view", "Browse a run or a task set in a web browser."),
    Verb("merge", "Merge the runs of collectors that shared one task list."),
    Verb("verify", "Check that a run is complete and intact; set aside records that are not."),
    Verb("export", "Write a run's steps, or tasks, for other programs: Parquet, JSON lines, ShareGPT."),
    Verb("simulate", "Simulate a rollout system of any size: throughput, bottleneck and price."),
    Verb("bench", "Benchmark this machine: browser server, rollout schedules, fault tolerance.", "app"),
)


def build(loaded: str | None) -> typer.Typer:
    """Build the command line.

    Args:
        loaded: the verb whose module is imported; the others are only listed with their help texts.
    """
    app = typer.Typer(
        name="webgym",
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich" if get_terminal_size().columns >= _BOXES else None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_globals)
    for verb in VERBS:
        if not verb.is_installed:
            continue
        if verb.name != loaded:
            app.command(verb.name, help=verb.help, short_help=verb.help)(_unloaded)
            continue
        target = getattr(importlib.import_module(verb.module), verb.attribute)
        if isinstance(target, typer.Typer):
            for command in target.registered_commands:
                command.cls = _command_class()
                # lists without boxes would cut the texts of commands
                told = command.help or inspect.getdoc(command.callback) or ""
                command.short_help = " ".join(told.partition("\n\n")[0].split())
            app.add_typer(target, name=verb.name, help=verb.help)
        else:
            app.command(verb.name, cls=_command_class())(target)
    return app


def _command_class() -> type[TyperCommand]:
    from webgym.cli._fields import SettingsCommand  # imports pydantic, which `webgym --help` does not need

    return SettingsCommand


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    The exit code is 0 on success, 2 if the arguments or the input cannot be used, 130 on Ctrl-C, else 1. An
    error is one line on stderr; ``--debug`` at any position adds the traceback.

    Args:
        arguments: what follows ``webgym``; by default those of the process.
    """
    for stream in (sys.stdout, sys.stderr):  # the terminal's encoding may lack a character
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    words = [argument for argument in words if argument != "--debug"] or ["--help"]
    verb = next((argument for argument in words if not argument.startswith("-")), None)
    try:
        # In standalone mode Typer would print usage errors itself, over several lines. The result is the
        # code of a typer.Exit, or what the command returned.
        result = build(verb)(args=words, prog_name="webgym", standalone_mode=False)
    except SystemExit:
        raise
    except BaseException as error:  # includes asyncio.CancelledError, which is no success either
        result = _report(error, verb or "", debug=debug)
    if result == EXIT_INTERRUPTED:
        _show_cursor()
    sys.exit(result if isinstance(result, int) else 0)


def _show_cursor() -> None:
    """Undo what rich leaves of a progress bar that is interrupted while it is drawn for the first time."""
    from rich.console import Console

    for is_stderr in (False, True):
        Console(stderr=is_stderr).show_cursor()


def _report(error: BaseException, verb: str, *, debug: bool) -> int:
    """Print an error on stderr and return the exit code."""
    causes = list(_leaves(error))
    if any(isinstance(cause, KeyboardInterrupt) for cause in causes):
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    if debug:
        traceback.print_exception(error)
    # Of several errors, report one that is not ours first: it is a bug.
    cause = min(causes, key=lambda leaf: isinstance(leaf, WebGymError))
    if isinstance(cause, WebGymError):
        line, code = str(cause), EXIT_USAGE if isinstance(cause, UsageError) else EXIT_FAILED
    elif isinstance(cause, ModuleNotFoundError) and (extra := _extra_with(cause.name or "")):
        line, code = f"this needs {cause.name} (pip install 'webgym-rl[{extra}]')", EXIT_USAGE
    elif isinstance(cause, typer.Abort):
        line, code = "aborted", EXIT_FAILED
    elif usage := _usage_problem(cause, verb):
        line, code = usage, EXIT_USAGE
    elif isinstance(cause, OSError) and cause.errno in (errno.ENAMETOOLONG, errno.ELOOP):
        line, code = f"{str(cause.filename)[:80]!r}: {cause.strerror}", EXIT_USAGE
    else:
        advice = "" if debug else "; run again with --debug"
        line, code = f"unexpected error {type(cause).__name__}: {cause}{advice}", EXIT_FAILED
    print("webgym:", plain(line), file=sys.stderr)
    return code


def _usage_problem(error: BaseException, verb: str) -> str:
    """The message of a usage error of Typer; empty for other errors.

    These errors are recognised by their methods, as their class differs between releases of Typer.
    """
    if not hasattr(error, "format_message"):
        return ""
    context = getattr(error, "ctx", None)
    path = context.command_path if context else f"webgym {verb}".rstrip()
    message = error.format_message().rstrip(".")
    if message.startswith("Usage: "):  # the help, which is printed already where it is in boxes
        print(message)
        message = ""
    message = message or "a command is missing"
    if (
        context
        and message.endswith((".yaml)", ".yml)"))
        and any(p.name == "config" for p in context.command.params)
    ):
        message += "; settings are given with --config"  # as `webgym train` takes them without
    return f"{message} (see `{path} --help`)"


def _extra_with(module: str) -> str:
    """The extra of this package that installs a module; empty if none does."""
    from importlib.metadata import requires

    package = module.partition(".")[0].replace("_", "-")
    for line in requires("webgym-rl") or ():
        named = re.fullmatch(r"""([\w.-]+).*extra == ['"]([\w-]+)['"].*""", line)
        if named and named[1].replace("_", "-") == package:
            return named[2]
    return ""


def _leaves(error: BaseException) -> Iterator[BaseException]:
    """The errors inside nested exception groups, or the error itself."""
    if isinstance(error, BaseExceptionGroup):
        for inner in error.exceptions:
            yield from _leaves(inner)
    else:
        yield error


def _unloaded() -> None:
    raise AssertionError("main() imports the module of the verb that is called")


def _version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        print(f"webgym {version('webgym-rl')}")
        raise typer.Exit


def _globals(
    debug: bool = typer.Option(False, "--debug", help="Show tracebacks. May be given at any position."),
    version: bool = typer.Option(
        False, "--version", help="Print the version and exit.", callback=_version, is_eager=True
    ),
) -> None:
    """A training environment for visual web agents: real browsers, judged trajectories."""
