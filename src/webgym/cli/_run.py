"""Functions that ``rollout``, ``eval`` and ``demo`` share: settings, secrets, progress, interruption."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import shlex
import signal
import sys
from collections.abc import Callable, Collection, Coroutine, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from functools import partial
from pathlib import Path
from typing import Any, Final, TextIO, TypeVar, cast

import typer
import uvloop
from pydantic import SecretStr
from rich.console import Console
from rich.text import Text

from webgym.cli import EXIT_INTERRUPTED
from webgym.cli._checks import check_policy_name
from webgym.cli._judge_options import judge_choice
from webgym.cli._print import say
from webgym.cli._summary import all_failed, print_retry
from webgym.core.errors import ConfigError, StoreCorrupt, StoreLocked, UsageError
from webgym.core.outcome import Outcome
from webgym.core.settings import merged, read_files, validated, without_none
from webgym.core.text import plain
from webgym.report.write import write_report
from webgym.results.summary import Summary
from webgym.rollout.live import showing
from webgym.rollout.progress import Progress
from webgym.run.config import RunConfig, Secrets
from webgym.store.files import CONFIG, is_training
from webgym.store.runs import RunReader

T = TypeVar("T")

_WITH_RESUME: Final = (
    *("resume", "server", "sites", "token_file", "skip_corrupt", "retry_errors", "report"),
    *("as_json", "as_markdown", "as_latex"),
)
"""Parameters of ``rollout`` and ``eval`` that apply to a resumed run."""
_REFUSALS: Final = (UsageError, StoreLocked, StoreCorrupt)
"""Errors that resuming with the same command does not change."""


def run(
    job: Callable[[], Coroutine[Any, Any, T]],
    *,
    resumed_by: tuple[str, Path] | None = None,
    finishing: asyncio.Event | None = None,
    has_begun: asyncio.Event | None = None,
    report: bool = False,
    kept: str = "",
) -> T:
    """Run a coroutine to its end. Ctrl-C, SIGTERM and SIGHUP cancel it, so that attempts in flight are
    recorded. Under ``nohup``, SIGHUP does not.

    Args:
        job: returns the coroutine.
        resumed_by: the command that resumes the job, and its folder: printed if the job does not complete.
        finishing: set by the first Ctrl-C: the job starts nothing more and returns when the attempts in
            flight have ended; the second Ctrl-C cancels it. Once the results are printed, call
            :func:`raise_if_interrupted`.
        has_begun: before it is set, nothing is in flight and the first Ctrl-C cancels the job.
        report: whether to write the report of the run in the folder when the job is cancelled.
        kept: of a job that the same command continues: what is stored, printed if it is cancelled.

    Raises:
        KeyboardInterrupt: the job was cancelled.
        typer.Exit: in its place, once it was printed what is kept.
    """

    async def guarded() -> T:
        task = asyncio.ensure_future(job())
        loop = asyncio.get_running_loop()

        def interrupt() -> None:
            is_idle = has_begun is not None and not has_begun.is_set()
            if finishing is None or finishing.is_set() or is_idle:
                task.cancel()
                return
            finishing.set()
            print("finishing the attempts in flight; press Ctrl-C again to abandon them", file=sys.stderr)

        loop.add_signal_handler(signal.SIGINT, interrupt)
        loop.add_signal_handler(signal.SIGTERM, task.cancel)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            loop.add_signal_handler(signal.SIGHUP, task.cancel)
        try:
            return await task
        except asyncio.CancelledError:
            raise KeyboardInterrupt from None

    try:
        with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            return runner.run(guarded())
    except BaseException as error:
        if kept and isinstance(error, KeyboardInterrupt):
            print(f"interrupted: {kept}; run the same command again to continue", file=sys.stderr)
            raise typer.Exit(EXIT_INTERRUPTED) from None
        is_refused = isinstance(error, _REFUSALS)
        if resumed_by is not None and not is_refused and (resumed_by[1] / CONFIG).is_file():
            if report and isinstance(error, KeyboardInterrupt):
                write_report(resumed_by[1])
            _print_how_to_resume(*resumed_by)
        raise


def make_run(
    job: Callable[..., Coroutine[Any, Any, Summary]],
    *,
    resumed_by: tuple[str, Path],
    console: Console,
    token_file: Path | None,
    report: bool,
) -> tuple[Summary, asyncio.Event]:
    """Start or resume a run, and show its progress.

    Args:
        job: takes ``secrets``, ``show``, ``tell`` and ``finishing`` of :func:`webgym.run.collect.collect`.
        resumed_by: the command that resumes the run, and the run folder.
        console: where progress and notes are printed.
        token_file: contains the token of a browser server that runs elsewhere.
        report: whether to write the report when the run is cancelled.

    Returns:
        The run's summary, and the event that the first Ctrl-C sets, for :func:`raise_if_interrupted`.
    """
    finishing, has_begun = asyncio.Event(), asyncio.Event()
    show_progress = show_progress_on(console)

    def show(progress: Progress) -> AbstractAsyncContextManager[None]:
        has_begun.set()
        return show_progress(progress)

    arguments = {
        "secrets": secrets(token_file),
        "show": show,
        "tell": print_notes_on(console),
        "finishing": finishing,
    }
    summary = run(
        lambda: job(**arguments),
        resumed_by=resumed_by,
        finishing=finishing,
        has_begun=has_begun,
        report=report,
    )
    return summary, finishing


def resume_job(
    folder: Path, settings: Mapping[str, Any], *, skip_corrupt: bool, retry_errors: bool
) -> Callable[..., Coroutine[Any, Any, Summary]]:
    """The job of :func:`make_run` that resumes a run.

    Args:
        folder: the run folder.
        settings: values of options; only ``server`` is used, as a resumed run keeps its other settings.
        skip_corrupt: ignore damaged records.
        retry_errors: retry samples that ended in errors and have exhausted their retries.
    """
    from webgym.run.collect import resume
    from webgym.run.config import ServerChoice

    server = ServerChoice.model_validate(settings["server"]) if "server" in settings else None
    return partial(resume, folder, server=server, skip_corrupt=skip_corrupt, retry_errors=retry_errors)


def refuse_unused_with_resume(context: typer.Context, folder: Path) -> None:
    """Refuse options that a resumed run would ignore.

    Args:
        context: of the command.
        folder: the run folder.

    Raises:
        RunFolderError: it is not one.
        UsageError: there is such an option.
    """
    sharing = RunReader(folder).config.get("collector", {}).get("sharing", {}).get("folder")
    shared = context.params.get("share")
    is_same = shared is not None and str(shared.absolute()) == sharing
    used = (*_WITH_RESUME, *(["share"] if is_same else []))
    refuse_unused(context, used, "--resume keeps the run's settings")


def refuse_unused(
    context: typer.Context,
    used: Collection[str],
    reason: str,
    hint: str = "leave out the latter, or give --out for a new run",
) -> None:
    """Refuse options that have no effect.

    Args:
        context: of the command.
        used: names of the parameters that have one.
        reason: why the others have none.
        hint: what to do instead.

    Raises:
        UsageError: there is such an option.
    """
    unused = [
        "/".join((*parameter.opts, *parameter.secondary_opts))
        for parameter in context.command.params
        if (name := parameter.name) is not None
        and name not in used
        and (source := context.get_parameter_source(name)) is not None
        and source.name == "COMMANDLINE"
    ]
    if unused:
        raise UsageError(f"{reason}, and excludes {', '.join(unused)}", hint=hint)


def end(
    summary: Summary,
    resumed_by: tuple[str, Path],
    console: Console,
    *,
    report: Path | None = None,
    finishing: asyncio.Event | None = None,
) -> None:
    """Print where a run is and how what is missing is made up for, and end the command.

    Args:
        summary: of the run.
        resumed_by: the command that resumes the run, and the run folder.
        console: where it is printed.
        report: the run's report, if it was written.
        finishing: the event that the first Ctrl-C sets.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
        typer.Exit: all attempts ended in errors.
    """
    command, folder = resumed_by
    quoted = shlex.quote(str(folder))
    say(f"\nrun      {folder}\nbrowse   webgym view {quoted}", console)
    if report is not None:
        say(f"report   {report}", console)
    print_retry(summary, f"{command} --resume {quoted}", console)
    if finishing is not None:
        raise_if_interrupted(finishing, resumed_by)
    if all_failed(summary):
        raise typer.Exit(1)


def raise_if_interrupted(finishing: asyncio.Event, resumed_by: tuple[str, Path]) -> None:
    """Print how to resume the run and raise, if Ctrl-C has ended it early.

    Args:
        finishing: the event that the first Ctrl-C sets.
        resumed_by: the command that resumes the run, and the run folder.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
    """
    if finishing.is_set():
        _print_how_to_resume(*resumed_by)
        raise KeyboardInterrupt


def _print_how_to_resume(command: str, folder: Path) -> None:
    entries = () if is_training(folder) else RunReader(folder, skip_corrupt=True).attempts.values()
    count = sum(entry.outcome is not Outcome.CANCELLED for entry in entries)
    stored = "finished work is" if not count else "1 attempt is" if count == 1 else f"{count:,} attempts are"
    print(f"{stored} stored; resume with: {command} --resume {shlex.quote(str(folder))}", file=sys.stderr)


def secrets(server_token_file: Path | None = None) -> Secrets:
    """Read tokens from a file or the environment, never from the command line, which other users can read.

    Args:
        server_token_file: contains the browser server's token; by default it is read from WEBGYM_TOKEN.

    Raises:
        ConfigError: the file cannot be read.
    """
    if server_token_file is None:
        return Secrets()
    try:
        token = server_token_file.read_text().strip()
    except OSError as error:
        raise ConfigError(f"cannot read the token file {server_token_file}: {error.strerror}") from error
    return Secrets(server_token=SecretStr(token) if token else None)


def policy_section(settings: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The section ``policy`` of a run's settings.

    An endpoint or a model without a policy's name selects the openai policy.

    Args:
        settings: the section of the settings files.
        given: values of options, which override the files.

    Raises:
        ConfigError: the endpoint or the model is missing, or the policy does not use an endpoint.
    """
    chat, name = given.get("chat"), given.get("name")
    if chat and not name:
        name = "openai"
    section: dict[str, Any] = merged(settings, {**given, "name": name} if name else given)
    if name == "openai" and not {"base_url", "model"} <= (section.get("chat") or {}).keys():
        raise ConfigError(
            "the openai policy needs an endpoint and a model", hint="give --base-url and --model"
        )
    if name not in (None, "openai"):
        if chat:
            raise ConfigError(f"the {name} policy uses no endpoint", hint="leave out --base-url, or --policy")
        section.pop("chat", None)
    return section


def settings(
    files: Sequence[Path], given: Mapping[str, Any], defaults: Mapping[str, Any] | None = None
) -> RunConfig:
    """The settings of a run, from YAML files and options.

    Args:
        files: later files override earlier ones.
        given: values of options, nested like the settings; they override the files, ``None`` does not.
        defaults: settings that the files override.

    Raises:
        ConfigError: a file cannot be read, or a setting is missing, unknown or out of range.
    """
    merged_files = merged(defaults or {}, read_files(files, hint="see configs/ for examples"))
    given = without_none(given)
    judge = given.pop("judge", None)
    if "policy" in given:
        policy = merged_files.pop("policy", None)
        given["policy"] = policy_section(policy if isinstance(policy, Mapping) else {}, given["policy"])
    config = validated(RunConfig, merged(merged_files, given), ", ".join(map(str, files)) or "options")
    check_policy_name(config.policy.name)
    return config.model_copy(update={"judge": judge_choice(judge, default=config.judge)}) if judge else config


def lasting_console(*, stderr: bool = False) -> Console:
    """A console for a long job, which goes on if nobody reads its output any more or the disk that takes it
    is full."""
    return Console(file=cast(TextIO, _Lasting(sys.stderr if stderr else sys.stdout)))


class _Lasting:
    """A stream that drops what it cannot write."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with self._dropping():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with self._dropping():
            self._stream.flush()

    @contextlib.contextmanager
    def _dropping(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno in (errno.EPIPE, errno.EIO):  # for good: others print to it, too
                devnull = os.open(os.devnull, os.O_WRONLY)
                os.dup2(devnull, self._stream.fileno())
                os.close(devnull)


def show_progress_on(console: Console) -> Callable[[Progress], AbstractAsyncContextManager[None]]:
    """A function that shows a run's progress on a console: ``show`` of :func:`webgym.run.collect.collect`."""
    return lambda progress: showing(progress, console)


def print_notes_on(console: Console) -> Callable[[str], None]:
    """A function that prints a note on a console: ``tell`` of :func:`webgym.run.collect.collect`."""
    return lambda line: console.print(Text.assemble(("note ", "yellow"), plain(line)), soft_wrap=True)
