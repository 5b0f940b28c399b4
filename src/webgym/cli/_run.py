"""Functions that ``rollout``, ``eval`` and ``demo`` share: settings, secrets, progress, interruption."""

from __future__ import annotations

import asyncio
import os
import shlex
import signal
import sys
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import uvloop
from pydantic import SecretStr
from rich.console import Console
from rich.text import Text

from webgym.core.errors import ConfigError
from webgym.core.outcome import Outcome
from webgym.core.text import plain
from webgym.report.write import write_report
from webgym.rollout.files import CONFIG
from webgym.rollout.live import showing
from webgym.rollout.progress import Progress
from webgym.rollout.store import RunReader
from webgym.rollout.summary import Summary
from webgym.run_config import RunConfig, Secrets
from webgym.settings import merged, read_files, validated, without_none

T = TypeVar("T")

SERVER_TOKEN = "WEBGYM_TOKEN"  # noqa: S105 - a variable's name
SITES_TOKEN = "WEBGYM_SITES_TOKEN"  # noqa: S105 - a variable's name


def run(
    job: Callable[[], Coroutine[Any, Any, T]],
    *,
    resumed_by: tuple[str, Path] | None = None,
    finishing: asyncio.Event | None = None,
    report: bool = False,
) -> T:
    """Run a coroutine; Ctrl-C and SIGTERM cancel it, so that what is in flight is recorded.

    Args:
        job: what to run.
        resumed_by: a command, and the folder that it resumes: told if the job does not come to its end.
        finishing: the first Ctrl-C sets this, on which the job is to end when what it has begun is done; the
            second cancels. When all that came of it is told, call :func:`end_early`.
        report: of a job that makes a run: write its report also when it is cancelled.

    Raises:
        KeyboardInterrupt: it was cancelled.
    """

    async def guarded() -> T:
        task = asyncio.ensure_future(job())
        loop = asyncio.get_running_loop()

        def interrupt() -> None:
            if finishing is None or finishing.is_set():
                task.cancel()
                return
            finishing.set()
            print("no attempt is begun any more; Ctrl-C again abandons those in flight", file=sys.stderr)

        loop.add_signal_handler(signal.SIGINT, interrupt)
        loop.add_signal_handler(signal.SIGTERM, task.cancel)
        try:
            return await task
        except asyncio.CancelledError:
            raise KeyboardInterrupt from None

    try:
        with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            return runner.run(guarded())
    except BaseException as error:
        if resumed_by is not None and (resumed_by[1] / CONFIG).is_file():
            if report and isinstance(error, KeyboardInterrupt):
                write_report(resumed_by[1])
            _tell_kept(*resumed_by)
        raise


def make_run(
    job: Callable[..., Coroutine[Any, Any, Summary]],
    *,
    resumed_by: tuple[str, Path],
    console: Console,
    token_file: Path | None,
    report: bool,
) -> tuple[Summary, asyncio.Event]:
    """Begin or resume a run, with tokens, progress, remarks and Ctrl-C as all commands have them.

    Args:
        job: takes ``secrets``, ``show``, ``tell`` and ``finishing`` of :func:`webgym.runs.collect`.
        resumed_by: the command, and the run folder.
        console: for progress and remarks.
        token_file: of a browser server that runs elsewhere.
        report: write the report also when the run is cancelled.

    Returns:
        The run's summary, and what the first Ctrl-C has set, for :func:`end_early`.
    """
    finishing = asyncio.Event()
    given = {"secrets": secrets(token_file), "show": show_on(console), "tell": tell_on(console)}
    summary = run(
        lambda: job(**given, finishing=finishing), resumed_by=resumed_by, finishing=finishing, report=report
    )
    return summary, finishing


def resuming(
    folder: Path, settings: Mapping[str, Any], *, skip_corrupt: bool, retry_errors: bool
) -> Callable[..., Coroutine[Any, Any, Summary]]:
    """The job of :func:`make_run` that resumes a run; of the settings only other servers are used."""
    from webgym.run_config import ServerChoice
    from webgym.runs import resume

    server = ServerChoice.model_validate(settings["server"]) if "server" in settings else None
    return partial(resume, folder, server=server, skip_corrupt=skip_corrupt, retry_errors=retry_errors)


def end_early(finishing: asyncio.Event, resumed_by: tuple[str, Path]) -> None:
    """End a command whose job Ctrl-C has asked to finish; nothing if it has not.

    Raises:
        KeyboardInterrupt: it was asked to.
    """
    if finishing.is_set():
        _tell_kept(*resumed_by)
        raise KeyboardInterrupt


def _tell_kept(command: str, folder: Path) -> None:
    entries = RunReader(folder, skip_corrupt=True).attempts.values()
    count = sum(entry.outcome is not Outcome.CANCELLED for entry in entries)
    kept = "what is done is" if not count else "1 attempt is" if count == 1 else f"{count:,} attempts are"
    told = f"{kept} kept; resume with: {command} --resume {shlex.quote(str(folder))}"
    print(told, file=sys.stderr)


def secrets(server_token_file: Path | None = None) -> Secrets:
    """Tokens from a file or the environment, never from the command line, where others could read them.

    Raises:
        ConfigError: the file cannot be read.
    """
    token = os.environ.get(SERVER_TOKEN)
    if server_token_file is not None:
        try:
            token = server_token_file.read_text().strip()
        except OSError as error:
            raise ConfigError(f"cannot read the token file {server_token_file}: {error.strerror}") from error
    sites = os.environ.get(SITES_TOKEN)
    return Secrets(
        server_token=SecretStr(token) if token else None, sites_token=SecretStr(sites) if sites else None
    )


def policy_section(held: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """A run's section ``policy``: what a file says of it, with command line options laid over it.

    An endpoint or a model alone means the openai policy.

    Raises:
        ConfigError: endpoint or model is missing, or there is an endpoint and no use for it.
    """
    chat, name = given.get("chat"), given.get("name")
    if chat and not name:
        name = "openai"
    section: dict[str, Any] = merged(held, {**given, "name": name} if name else given)
    if name == "openai" and not {"base_url", "model"} <= (section.get("chat") or {}).keys():
        raise ConfigError(
            "the openai policy needs an endpoint and a model", hint="give --base-url and --model"
        )
    if name not in (None, "openai"):
        if chat:
            raise ConfigError(f"the {name} policy has no endpoint", hint="leave --base-url out, or --policy")
        section.pop("chat", None)
    return section


def settings(files: Sequence[Path], given: Mapping[str, Any]) -> RunConfig:
    """Settings from YAML files, each laid over those before it, and from options, laid over all of them.

    Args:
        files: in their order.
        given: what options say, in the shape of the settings; ``None`` overrides nothing.

    Raises:
        ConfigError: a file cannot be read, or a setting is missing, unknown or out of range.
    """
    held, given = read_files(files, hint="see configs/ for examples"), without_none(given)
    if "policy" in given:
        own = held.get("policy")
        given["policy"] = policy_section(own if isinstance(own, Mapping) else {}, given["policy"])
        held.pop("policy", None)
    held = merged(held, given)
    return validated(RunConfig, held, ", ".join(map(str, files)) or "options")


def show_on(console: Console) -> Callable[[Progress], AbstractAsyncContextManager[None]]:
    """Progress on this console."""
    return lambda progress: showing(progress, console)


def tell_on(console: Console) -> Callable[[str], None]:
    """Remarks on this console."""
    return lambda line: console.print(Text.assemble(("note ", "yellow"), plain(line)), soft_wrap=True)
