"""``webgym doctor``: check this machine, and print how to fix what is missing.

Its last check starts the browser as the server does and renders a page.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib.metadata
import importlib.util
import io
import json
import logging
import os
import platform
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import msgspec
import psutil
import typer
from PIL import Image
from rich.console import Console
from rich.table import Table
from rich.text import Text

from webgym.browser.cdp_messages import Attached, CreatedTarget, Screenshot
from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import FoundBrowser, find_browser, run_bounded
from webgym.browser.process import BrowserProcess, launch_sandboxed
from webgym.browser.profiles import ProfileRoot
from webgym.browser.questions import ask_own, differences, headed_answers
from webgym.browser.sandbox import remedy
from webgym.core.errors import BrowserError, BrowserNotFound, BrowserTimeout, ConfigError, WebGymError
from webgym.core.text import plain
from webgym.server.admission import allowed_cores

Status: TypeAlias = Literal["ok", "note", "missing"]

DISTRIBUTION = "webgym-rl"
FONT_PACKAGES = {"Latin": "fonts-liberation", "CJK": "fonts-wqy-zenhei", "emoji": "fonts-noto-color-emoji"}
"""By writing system of the test page: the package of Debian and Ubuntu that contains its fonts."""

_SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - only its size is read
_MIB = 2**20
_GIB = 2**30
_MARKS: dict[Status, tuple[str, str]] = {
    "ok": ("✓", "green"),
    "note": ("!", "yellow"),
    "missing": ("✗", "red"),
}


MEMORY_GIB = 2.0
"""Free memory below which doctor reports a problem; eight sessions and Python need about one GiB."""

DISK_GIB = 2.0
"""The same for disk space; a thousand trajectories need about one GiB."""

SHARED_MEMORY_MIB = 256.0
"""The same for shared memory; the usual 64 MiB of a container are too few."""

OPEN_FILES = 4096
"""The same for file descriptors of a process; a slot needs about ten."""

PROGRAM_SECONDS = 10.0
"""Time limit of a program such as nvidia-smi."""

BROWSER_SECONDS = 60.0
"""Time limit to start the browser, render a page and end it."""


class Check(msgspec.Struct, frozen=True):
    """The result of one check.

    Attributes:
        name: what was checked.
        status: ``missing`` if something essential is missing, which makes doctor exit with 1; ``note`` if it
            works but could be better.
        found: what was found.
        fix: a command or advice; empty if there is nothing to fix.
    """

    name: str
    status: Status
    found: str
    fix: str = ""

    def __str__(self) -> str:
        fix = f"\n→ {self.fix}" if self.fix else ""
        return f"{_MARKS[self.status][0]} {self.name}: {self.found}{fix}"


def command(
    as_json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
    browser: Annotated[
        Path | None, typer.Option(help="Check this executable instead of searching for one.")
    ] = None,
    base_url: Annotated[
        str | None, typer.Option(help="Check a model, too: its OpenAI-compatible endpoint.")
    ] = None,
    model: Annotated[str, typer.Option(help="Name of the model.", show_default=False)] = "",
    profile: Annotated[
        str | None, typer.Option(help="Profile of the model's family.", show_default="by the model's name")
    ] = None,
) -> None:
    """Check this machine: what is installed, what is missing, and how to fix it.

    Starts the browser and renders a page. With --base-url and --model, a model is asked about test pages:
    whether it acts, points by the scale of its profile, and answers in the form that it is asked for. Exits
    with 1 if something essential is missing.
    """
    # The table contains the same problems, with their fixes.
    logging.getLogger("webgym.browser").setLevel(logging.ERROR)
    if bool(base_url) != bool(model):
        raise ConfigError("a model to check has an endpoint and a name", hint="give --base-url and --model")
    console = Console(highlight=False)
    busy = contextlib.nullcontext() if as_json else console.status("starting the browser")
    with busy:
        checks = list(examine(browser))
        if base_url:
            checks.append(asyncio.run(check_model(base_url, model, profile)))
    missing = [check.name for check in checks if check.status == "missing"]
    if as_json:
        print(json.dumps({"ready": not missing, "checks": msgspec.to_builtins(checks)}, indent=2))
    else:
        console.print(table(checks))
        verdict = f"missing: {', '.join(missing)}" if missing else "everything that is needed is installed"
        console.print(f"[bold {'red' if missing else 'green'}]{verdict}[/]")
    if missing:
        raise typer.Exit(1)


def table(checks: list[Check]) -> Table:
    """The results as a table for a terminal, with fixes under the problems."""
    rich = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    rich.add_column(no_wrap=True)
    rich.add_column(style="bold", no_wrap=True)
    rich.add_column(overflow="fold")
    for check in checks:
        mark, colour = _MARKS[check.status]
        found = Text(check.found)
        if check.fix:
            found.append(f"\n→ {check.fix}", style=colour)
        rich.add_row(Text(mark, style=colour), check.name, found)
    return rich


def examine(browser: Path | None = None) -> Iterator[Check]:
    """Run all checks, in the order in which problems should be fixed.

    Args:
        browser: the executable to check; by default it is searched for.
    """
    yield check_python()
    yield check_packages()
    yield check_uvloop()
    yield from check_browser(browser)
    yield check_shared_memory()
    yield check_cores()
    yield check_memory()
    yield check_open_files()
    yield check_disk()
    yield check_gpu()


# --- Python ------------------------------------------------------------------------------------------


def check_python() -> Check:
    """The interpreter. (With one that is too old, this module cannot be imported.)"""
    return Check("Python", "ok", f"{platform.python_version()} ({sys.executable})")


def check_packages() -> Check:
    """The packages that :mod:`webgym` requires, according to its metadata."""
    installed, absent = [], []
    for requirement in importlib.metadata.requires(DISTRIBUTION) or ():
        match = re.match(r"[A-Za-z0-9._-]+", requirement)
        if match is None or "extra ==" in requirement or match[0] == "uvloop":
            continue
        try:
            installed.append(f"{match[0]} {importlib.metadata.version(match[0])}")
        except importlib.metadata.PackageNotFoundError:
            absent.append(match[0])
    if absent:
        return Check("Packages", "missing", f"not installed: {', '.join(absent)}", "make setup")
    own = importlib.metadata.version(DISTRIBUTION)
    return Check("Packages", "ok", f"webgym {own}, {', '.join(installed)}")


def check_uvloop() -> Check:
    """uvloop, the faster event loop."""
    if importlib.util.find_spec("uvloop") is None:
        return Check("uvloop", "note", "not installed: the slower event loop is used", "pip install uvloop")
    return Check("uvloop", "ok", importlib.metadata.version("uvloop"))


# --- browser -----------------------------------------------------------------------------------------


def check_browser(explicit: Path | None) -> Iterator[Check]:
    """The browser: its path, whether it starts and renders, its sandbox, its fonts."""
    try:
        found = find_browser(explicit)
    except BrowserNotFound as error:
        yield Check("Browser", "missing", error.message, error.hint)
        return
    yield Check("Browser", "ok", f"{found.kind} {found.version} ({found.path}, {_ORIGINS[found.origin]})")
    try:
        trial = asyncio.run(try_browser(found.path, BROWSER_SECONDS))
    except BrowserError as error:
        yield Check("Rendering", "missing", error.message, _fix_launch(found, error))
        return
    width, height = trial.size
    yield Check("Rendering", "ok", f"{width}×{height} picture {trial.seconds:.1f} s after the start")
    yield _sandbox(trial)
    yield _fonts(trial)
    yield check_desktop(found.path)


_ORIGINS = {"setting": "set by you", "playwright": "Playwright's", "system": "the system's"}


def _fix_launch(found: FoundBrowser, error: BrowserError) -> str:
    if "shared librar" in error.message:
        return f"{sys.executable} -m playwright install-deps chromium-headless-shell"
    return f"see the output of: {found.path} --headless --no-sandbox --screenshot about:blank"


def _sandbox(trial: LaunchCheck) -> Check:
    if trial.sandbox:
        found = trial.sandbox_reason or "pages run in namespaces of their own, with filtered system calls"
        return Check("Sandbox", "ok", f"on: {found}")
    return Check("Sandbox", "note", f"OFF, pages are not isolated: {trial.sandbox_reason}", remedy())


def _fonts(trial: LaunchCheck) -> Check:
    absent = [name for name, renders in trial.fonts.items() if not renders]
    if not absent:
        return Check("Fonts", "ok", ", ".join(trial.fonts))
    packages = " ".join(FONT_PACKAGES[name] for name in absent)
    status: Status = "missing" if "Latin" in absent else "note"
    found = f"no fonts for {' and '.join(absent)}"
    return Check("Fonts", status, found, f"{_sudo()}apt-get install {packages}")


def check_desktop(browser: Path) -> Check:
    """What pages are told that a headed browser would answer differently."""
    name, headed = "Desktop", headed_answers()
    try:
        found = differences(asyncio.run(ask_own(browser)), headed)
    except (BrowserError, TimeoutError) as error:
        return Check(name, "note", f"the browser was not asked: {error}")
    same = f"{len(headed) - len(found)} of {len(headed)} answers to pages are a headed browser's"
    text = "\n".join([same, *map(str, found)])
    is_as_wanted = all(one.reason for one in found)
    return Check(name, "ok", text) if is_as_wanted else Check(name, "note", text, "update the browser")


# --- machine -----------------------------------------------------------------------------------------


def check_shared_memory() -> Check:
    """Shared memory of processes. Without enough of it, Chromium uses files instead."""
    name = "Shared memory"
    if not _SHARED_MEMORY.is_dir():
        return Check(name, "note", f"no {_SHARED_MEMORY}", f"{_sudo()}mount -t tmpfs tmpfs {_SHARED_MEMORY}")
    size = shutil.disk_usage(_SHARED_MEMORY).total
    found = f"{_size(size)} in {_SHARED_MEMORY}"
    if size < SHARED_MEMORY_MIB * _MIB:
        return Check(name, "note", found, "start the container with --shm-size=1g")
    return Check(name, "ok", found)


def check_cores() -> Check:
    """The number of cores that this process may use."""
    usable, total = len(os.sched_getaffinity(0)), os.cpu_count() or 1
    found = f"{usable}" if usable == total else f"{usable} of {total}"
    quota = allowed_cores(Path("/sys/fs/cgroup"))
    return Check("Cores", "ok", found if quota is None else f"{found}, limited to {quota:g} by the container")


def check_memory() -> Check:
    """Free memory."""
    memory = psutil.virtual_memory()
    found = f"{_size(memory.available)} free of {_size(memory.total)}"
    if memory.available < MEMORY_GIB * _GIB:
        return Check("Memory", "note", found, "use fewer sessions, e.g. --sessions 4")
    return Check("Memory", "ok", found)


def check_open_files() -> Check:
    """The limit of open files per process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    found = "unlimited" if soft == resource.RLIM_INFINITY else f"{soft}"
    if soft != resource.RLIM_INFINITY and soft < OPEN_FILES:
        reachable = OPEN_FILES if hard == resource.RLIM_INFINITY else min(OPEN_FILES, hard)
        raised = f"ulimit -n {reachable}" if reachable > soft else "an administrator raises the hard limit"
        return Check("Open files", "note", found, raised)
    return Check("Open files", "ok", found)


def check_disk() -> Check:
    """Free space in the folders of runs and of browser profiles."""
    here, temporary = Path.cwd(), Path(tempfile.gettempdir())
    free = {path: shutil.disk_usage(path).free for path in (here, temporary)}
    found = f"{_size(free[here])} free here, {_size(free[temporary])} in {temporary}"
    if min(free.values()) < DISK_GIB * _GIB:
        fullest = min(free, key=lambda path: free[path])
        return Check("Disk", "note", found, f"free space in {fullest}")
    return Check("Disk", "ok", found)


def check_gpu() -> Check:
    """GPUs, which are only needed to serve or train a model."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return Check("GPU", "ok", "none; only needed to serve or train a model")
    query = [program, "--query-gpu=name,memory.total", "--format=csv,noheader"]
    try:
        answer = run_bounded(query, PROGRAM_SECONDS)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Check("GPU", "note", f"nvidia-smi failed: {error}", "see the output of `nvidia-smi`")
    cards = [line.strip() for line in answer.stdout.splitlines() if line.strip()]
    if answer.returncode != 0 or not cards:
        message = " ".join((answer.stderr or answer.stdout).split()) or "no output"
        return Check("GPU", "note", f"nvidia-smi failed: {message}", "see the output of `nvidia-smi`")
    return Check("GPU", "ok", "; ".join(cards))


async def check_model(base_url: str, model: str, profile: str | None) -> Check:
    """A model: whether it acts, points by its profile's scale, and answers in the form asked for."""
    from webgym.agent.agent import Agent
    from webgym.agent.config import AgentConfig
    from webgym.agent.openai_policy import OpenAIPolicy
    from webgym.agent.preflight import answer_in_words, check_policy
    from webgym.agent.profiles import choose_profile
    from webgym.llm.config import ChatConfig
    from webgym.rollout.config import AttemptConfig

    viewport = AttemptConfig().viewport
    try:
        chosen = choose_profile(profile, model)
        policy = OpenAIPolicy(ChatConfig(base_url=base_url, model=model), chosen)
        async with Agent(policy, AgentConfig(profile=profile), chosen) as agent:
            await check_policy(agent, viewport)
            words = await answer_in_words(agent, viewport)
    except WebGymError as error:
        return Check("Model", "missing", error.message, error.hint)
    if words:
        fix = "answers of the offline web are the values alone: this model will fail by form"
        return Check(
            "Model", "note", f"{model} answers {plain(words)!r} where the value alone is asked for", fix
        )
    return Check("Model", "ok", f"{model} acts on a test page and answers as asked (profile {chosen.name})")


def _sudo() -> str:
    return "" if os.geteuid() == 0 else "sudo "


def _size(count: float) -> str:
    return f"{count / _GIB:.1f} GiB" if count >= _GIB else f"{count / _MIB:.0f} MiB"


SIZE = (640, 200)
"""Width and height of the test page, pixels."""

SAMPLES = {"Latin": "agW", "CJK": "漢字書", "emoji": "😀🚀🍎"}
"""Three different characters of each writing system that the offline websites use."""

# Characters without a font are all drawn as the same box. Emoji must also have colour.
_DRAWS = """
(samples) => {
  const draw = (character) => {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 48;
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.font = "32px sans-serif";
    context.fillText(character, 4, 36);
    const pixels = Array.from(context.getImageData(0, 0, 48, 48).data);
    const coloured = pixels.some((value, at) => at % 4 < 2 && value !== pixels[at + 1]);
    return { drawing: pixels.join(), blank: pixels.every((value) => value === 0), coloured };
  };
  const renders = ([name, text]) => {
    const drawn = Array.from(text, draw);
    const differ = new Set(drawn.map((glyph) => glyph.drawing)).size === drawn.length;
    return [name, differ && !drawn.some((glyph) => glyph.blank || (name === "emoji" && !glyph.coloured))];
  };
  document.body.style.font = "40px sans-serif";
  document.body.textContent = Object.values(samples).join(" ");
  return Object.fromEntries(Object.entries(samples).map(renders));
}
"""


class LaunchCheck(msgspec.Struct, frozen=True):
    """The result of the check.

    Attributes:
        seconds: time from the start of the process to the screenshot.
        size: ``(width, height)`` of the screenshot, pixels.
        sandbox: whether Chromium's sandbox is on, as it would be in a server.
        sandbox_reason: why the sandbox is off; empty if it is on.
        fonts: by writing system, whether its characters are rendered.
    """

    seconds: float
    size: tuple[int, int]
    sandbox: bool
    sandbox_reason: str
    fonts: dict[str, bool]


class _Value(msgspec.Struct, frozen=True):
    value: dict[str, bool]


class _Evaluated(msgspec.Struct, frozen=True):
    result: _Value


async def try_browser(executable: Path, seconds: float) -> LaunchCheck:
    """Start a browser, render a page, take a screenshot, and end the browser.

    Args:
        executable: the browser.
        seconds: the time limit for all of it.

    Raises:
        BrowserError: it did not start, respond or render within the limit; none of its processes is left.
    """
    config = BrowserConfig()
    started = time.monotonic()
    try:
        async with asyncio.timeout(seconds):
            async with Egress(config.egress) as egress:
                process, sandbox = await launch_sandboxed(
                    config, executable, ProfileRoot(), None, egress.main
                )
                try:
                    fonts, picture = await _draw(process, seconds)
                finally:
                    await process.kill()
    except TimeoutError:
        raise BrowserTimeout(f"the browser rendered no page within {seconds:g} s") from None
    return LaunchCheck(
        seconds=time.monotonic() - started,
        size=_size_of(picture),
        sandbox=sandbox.on,
        sandbox_reason=sandbox.reason,
        fonts=fonts,
    )


async def _draw(process: BrowserProcess, seconds: float) -> tuple[dict[str, bool], bytes]:
    width, height = SIZE
    call = process.connection.call
    target = await call(
        "Target.createTarget",
        {"url": "about:blank", "width": width, "height": height},
        reply=CreatedTarget,
        seconds=seconds,
    )
    attached = await call(
        "Target.attachToTarget",
        {"targetId": target.target_id, "flatten": True},
        reply=Attached,
        seconds=seconds,
    )
    evaluated = await call(
        "Runtime.evaluate",
        {"expression": f"({_DRAWS})({json.dumps(SAMPLES)})", "returnByValue": True},
        reply=_Evaluated,
        seconds=seconds,
        session_id=attached.session_id,
    )
    picture = await call(
        "Page.captureScreenshot",
        {"format": "png"},
        reply=Screenshot,
        seconds=seconds,
        session_id=attached.session_id,
    )
    return evaluated.result.value, picture.data


def _size_of(picture: bytes) -> tuple[int, int]:
    """The size of a screenshot.

    Raises:
        BrowserError: the screenshot is empty.
    """
    with Image.open(io.BytesIO(picture)) as image:
        colours = image.convert("L").getextrema()
        if colours[0] == colours[1]:
            raise BrowserError("the browser renders empty pages")
        return image.size
