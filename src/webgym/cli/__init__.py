"""The command line: one module per verb, imported when its verb is called.

To add a verb, write ``src/webgym/cli/<verb>.py`` with either

* ``def command(...) -> None``, a function whose parameters are Typer's, or
* ``app = typer.Typer()`` with commands of its own, for a verb that has sub-verbs,

and add it to :data:`VERBS`. A verb raises :class:`webgym.core.errors.WebGymError` when it cannot go on and
``typer.Exit(code)`` when it has said itself what is wrong; :func:`main` does the rest.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import typer

from webgym.core.errors import UsageError, WebGymError
from webgym.core.text import plain

EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells expect


@dataclass(frozen=True, slots=True)
class Verb:
    """A command and where it lives.

    Attributes:
        name: what the user types; its module has the same name.
        help: one line for ``webgym --help``, which imports no verb.
        attribute: ``command`` (a function) or ``app`` (a Typer with sub-verbs).
    """

    name: str
    help: str
    attribute: str = "command"

    @property
    def module(self) -> str:
        """Dotted name of the module."""
        return f"{__name__}.{self.name}"

    @property
    def is_there(self) -> bool:
        """Whether this installation has the verb's module."""
        return importlib.util.find_spec(self.module) is not None


VERBS: tuple[Verb, ...] = (
    Verb("demo", "Run the main job end to end on the offline web and show the report."),
    Verb("doctor", "Check this machine: what it has, what is missing, how to fix it."),
    Verb("serve", "Start a browser server."),
    Verb("sites", "Serve or list the websites of the offline web.", "app"),
    Verb("tasks", "List, check and write task sets.", "app"),
    Verb("llm", "Say what models have cost, and read batch results.", "app"),
    Verb("rollout", "Collect trajectories into a run folder, or resume a run."),
    Verb("judge", "Judge a stored run again (webgym judge RUN), and compare judges.", "app"),
    Verb("eval", "Attempt a test set and print success by difficulty with intervals."),
    Verb("compare", "Test whether one run is better than another by more than chance."),
    Verb("train", "Learn from outcomes: roll out, judge, update, publish, evaluate."),
    Verb("pretrain", "Pretrain the initial weights of the tiny policy."),
    Verb("study", "Repeat the paper's study in miniature."),
    Verb("report", "Write the report of a run or of a training."),
    Verb("view", "Browse a run or a task set in a web browser."),
    Verb("merge", "Merge the runs of collectors that shared one task list."),
    Verb("verify", "Check that a run is complete and intact; set aside records that are not."),
    Verb("export", "Write a run's steps, or tasks, for other programs: Parquet, JSON lines, ShareGPT."),
    Verb("simulate", "Size a rollout system: throughput, bottleneck and price, by a model."),
    Verb("bench", "Measure this machine: speed, density, settling, faults.", "app"),
)


def build(wanted: str | None) -> typer.Typer:
    """The command line, with the module of one verb imported and the others as names and help texts."""
    app = typer.Typer(
        name="webgym",
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_globals)
    for verb in VERBS:
        if not verb.is_there:
            continue
        if verb.name != wanted:
            app.command(verb.name, help=verb.help)(_unloaded)
            continue
        target = getattr(importlib.import_module(verb.module), verb.attribute)
        if isinstance(target, typer.Typer):
            app.add_typer(target, name=verb.name, help=verb.help)
        else:
            app.command(verb.name)(target)
    return app


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Exits with 0 on success, 2 if what the user gave cannot be used, 130 on Ctrl-C, else 1. An error is
    one line on stderr; ``--debug``, wherever it stands, adds the traceback.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    given = [argument for argument in given if argument != "--debug"] or ["--help"]
    wanted = next((argument for argument in given if not argument.startswith("-")), None)
    try:
        # Not standalone: Typer would print a usage error in its own way, over several lines. What comes
        # back is the code of a typer.Exit, or whatever the command returned.
        result = build(wanted)(args=given, prog_name="webgym", standalone_mode=False)
    except SystemExit:
        raise
    except BaseException as error:  # a cancellation that nobody took is no success either
        sys.exit(_report(error, wanted or "", debug=debug))
    sys.exit(result if isinstance(result, int) else 0)


def _report(error: BaseException, verb: str, *, debug: bool) -> int:
    """Say on stderr what went wrong; the exit code."""
    causes = list(_leaves(error))
    if any(isinstance(cause, KeyboardInterrupt) for cause in causes):
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    if debug:
        traceback.print_exception(error)
    # A bug beside a typed error is the one to be told about.
    cause = min(causes, key=lambda leaf: isinstance(leaf, WebGymError))
    if isinstance(cause, WebGymError):
        line, code = str(cause), EXIT_USAGE if isinstance(cause, UsageError) else EXIT_FAILED
    elif isinstance(cause, typer.Abort):
        line, code = "stopped", EXIT_FAILED
    elif usage := _usage_problem(cause, verb):
        line, code = usage, EXIT_USAGE
    else:
        advice = "" if debug else "; run again with --debug"
        line, code = f"unexpected error {type(cause).__name__}: {cause}{advice}", EXIT_FAILED
    print("webgym:", plain(line), file=sys.stderr)
    return code


def _usage_problem(error: BaseException, verb: str) -> str:
    """What was wrong with the arguments, if that is what Typer says; else empty.

    Known by its shape: Typer's releases take these errors from different packages, none of them public.
    """
    if not hasattr(error, "format_message"):
        return ""
    context = getattr(error, "ctx", None)
    path = context.command_path if context else f"webgym {verb}".rstrip()
    said = error.format_message().rstrip(".") or "a command is missing"  # the help was shown already
    return f"{said} (see `{path} --help`)"


def _leaves(error: BaseException) -> Iterator[BaseException]:
    """The errors inside nested exception groups, or the error itself."""
    if isinstance(error, BaseExceptionGroup):
        for inner in error.exceptions:
            yield from _leaves(inner)
    else:
        yield error


def _unloaded() -> None:
    raise AssertionError("main() loads the verb that is called")


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"webgym {version('webgym-rl')}")
        raise typer.Exit


def _globals(
    debug: bool = typer.Option(False, "--debug", help="Show tracebacks. May stand anywhere."),
    version: bool = typer.Option(
        False, "--version", help="Print the version and exit.", callback=_version, is_eager=True
    ),
) -> None:
    """A training environment for visual web agents: real browsers, judged trajectories."""
