"""A Chromium in its own process group, all of which is ended with it."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import logging
import os
import re
import resource
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

from webgym.browser.cdp import CommandFailed, Connection
from webgym.browser.cdp_messages import Version
from webgym.browser.config import BrowserConfig
from webgym.browser.desktop import Told
from webgym.browser.egress.proxy import ProxyListener
from webgym.browser.find import version_of
from webgym.browser.memory import Cgroup, bound, new_cgroup, process_type
from webgym.browser.profiles import ProfileRoot
from webgym.browser.sandbox import SandboxState, examine_sandbox, is_sandbox_failure, planned_sandbox, remedy
from webgym.core.errors import (
    BrowserCrashed,
    BrowserError,
    BrowserLaunchFailed,
    BrowserOutOfMemory,
    BrowserTimeout,
    ConfigError,
)

log = logging.getLogger(__name__)

PICTURE_FLAGS = (
    "--force-color-profile=srgb",
    "--force-device-scale-factor=1",
    "--font-render-hinting=none",
    "--hide-scrollbars",
    "--disable-smooth-scrolling",
    "--force-prefers-reduced-motion",
    "--disable-lcd-text",
    "--disable-partial-raster",  # drawn again in part, round edges differ by a shade
    "--lang=en-US",
)
"""Flags for reproducible screenshots: the same page gives the same picture."""

_FLAGS = (
    "--remote-debugging-pipe",
    "--headless",
    "--no-first-run",
    "--no-default-browser-check",
    "--no-startup-window",
    *PICTURE_FLAGS,
    # No background activity, no requests to the vendor.
    "--disable-background-networking",
    "--disable-breakpad",
    "--disable-crash-reporter",
    "--disable-client-side-phishing-detection",
    "--disable-component-extensions-with-background-pages",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-domain-reliability",
    "--disable-extensions",
    "--disable-search-engine-choice-screen",
    "--disable-sync",
    "--metrics-recording-only",
    "--no-pings",
    "--password-store=basic",
    "--use-mock-keychain",
    "--mute-audio",
    "--deny-permission-prompts",
    # Every page is drawn, and none is slowed down: the one in front is any of them.
    "--disable-background-timer-throttling",
    "--disable-backgrounding-occluded-windows",
    "--disable-renderer-backgrounding",
    "--disable-hang-monitor",
    "--disable-popup-blocking",
    # One renderer per slot: half the memory, and frames of other origins are observed like the rest.
    # A context has nothing of value, and is disposed of after each episode.
    "--disable-site-isolation-trials",
    "--disable-features="
    "IsolateOrigins,site-per-process,BackForwardCache,Prerender2,SpareRendererForSitePerProcess,"
    "Translate,OptimizationHints,MediaRouter,DialMediaRouteProvider,AcceptCHFrame,"
    "AutofillServerCommunication,CertificateTransparencyComponentUpdater,HttpsUpgrades,"
    "PaintHolding,InterestFeedContentSuggestions,GlobalMediaControls,"
    # A new frame for every document of the same website: a tenth of the CPU of a step, for nothing here.
    "RenderDocument",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    # Saves a process and 9 MB per slot. On Linux it would have no sandbox of its own anyway.
    "--enable-features=NetworkServiceInProcess2",
)

_SECRET_NAME = re.compile(r"TOKEN|SECRET|PASS|KEY|CRED|AUTH|COOKIE|PROXY|URL|URI|DSN", re.IGNORECASE)
"""Names of environment variables that may contain a secret."""

_SCREEN = ("XAUTHORITY", "XDG_RUNTIME_DIR", "XDG_SESSION_TYPE")
"""Names of environment variables by which a program reaches the screen."""

_FIRST_FREE_FD = 10
"""Lower descriptors are reserved for the child's numbering (3 and 4 are the pipe)."""

_LOG_TAIL_BYTES = 16_384
_LOG_LINES = 3
_REASON_MARKERS = ("FATAL:", "Check failed:", "sandbox!", "sandbox helper")
"""Text in a log line that says why Chromium ended; a stack trace may follow the line."""

_FEW_FILES = 100
"""With fewer open files, Chromium ends without a word."""

_SAMPLE_SECONDS = 0.5
"""How long to look whether the renderers lack processors."""

_FORK_SECONDS = 1.0
"""Longest time that a fork takes on a busy machine."""

_FIRST_PAUSE_SECONDS = 0.01

_EXIT_POLL_SECONDS = (0.001, 0.05)
"""First and longest pause while waiting for a killed process group to end."""

KILL_SECONDS = 10.0
"""From SIGKILL until every process of the group must have ended."""


class BrowserProcess:
    """A running browser: its connection, its process group and its profile.

    Create one with :func:`launch`; call :meth:`kill` when done.
    """

    def __init__(
        self,
        pid: int,
        connection: Connection,
        profile: Path,
        root: ProfileRoot,
        told: Told,
        cgroup: Cgroup | None = None,
    ) -> None:
        self.pid = pid
        self.connection = connection
        self.profile = profile
        self.version = ""
        self.told = told
        self.started = asyncio.get_running_loop().time()
        self.is_frozen = False
        self._stopped = -_FORK_SECONDS
        self._again: asyncio.TimerHandle | None = None
        self.standing_bytes = 0
        """Memory use without renderers at the last check, bytes."""
        self.relieved = ""
        """Why its renderer was last ended; empty if it was not."""
        self._root = root
        self._cgroup = cgroup
        self._exited = asyncio.Event()
        self._ending: asyncio.Task[None] | None = None
        connection.why_lost, connection.starved = self._why_lost, self._starved
        self._pidfd = os.pidfd_open(pid)
        asyncio.get_running_loop().add_reader(self._pidfd, self._on_exit)

    def _on_exit(self) -> None:
        self._close_pidfd()
        self.connection.abandon(self._why_lost() or BrowserCrashed("the browser process ended"))

    def _why_lost(self) -> BrowserCrashed | None:
        """The reason, if the machine ended the browser."""
        if self._cgroup is not None and self._cgroup.ran_out:
            return BrowserOutOfMemory("the kernel ended the browser: it took too much memory")
        files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        if 0 <= files < _FEW_FILES:
            why = f"the browser process ended; only {files} files may be open at once"
            return BrowserCrashed(why, hint="raise the limit: ulimit -n 1024")
        return None

    def _close_pidfd(self) -> None:
        if self._pidfd >= 0:
            asyncio.get_running_loop().remove_reader(self._pidfd)
            os.close(self._pidfd)
            self._pidfd = -1
            self._exited.set()

    @property
    def is_alive(self) -> bool:
        """Whether the process runs and its connection is open."""
        return not self._exited.is_set() and not self.connection.is_lost

    @property
    def age(self) -> float:
        """Seconds since launch."""
        return asyncio.get_running_loop().time() - self.started

    def log_tail(self) -> str:
        """The last lines of Chromium's log."""
        return _tail(self.profile)

    def processes(self) -> list[int]:
        """Ids of all running processes of the group."""
        return _running_members(self.pid)

    async def _starved(self) -> float:
        """The share of the time that its renderers lack a processor; 0 where the kernel does not tell."""
        renderers = [pid for pid in self.processes() if _computes(pid)]
        before = _scheduled(renderers)
        await asyncio.sleep(_SAMPLE_SECONDS if renderers else 0.0)
        ran, lacked = (now - then for now, then in zip(_scheduled(renderers), before, strict=True))
        return max(0.0, lacked / max(ran + lacked, _SAMPLE_SECONDS * 1e9))

    def freeze(self) -> None:
        """Stop the whole group: it uses no CPU until :meth:`thaw`. It can still be killed."""
        self.is_frozen = True
        self._stopped = asyncio.get_running_loop().time()
        if self._again is not None:
            self._again.cancel()
        self._signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let the group continue.

        A process that is being forked when both signals come gets the first alone: Linux ignores a SIGCONT
        that nobody handles before it notes what a child has to get. So it is sent again until forks have
        ended.
        """
        self.is_frozen = False
        self._continue(_FIRST_PAUSE_SECONDS)

    def _continue(self, pause: float) -> None:
        self._signal(signal.SIGCONT)
        loop = asyncio.get_running_loop()
        if loop.time() - self._stopped < _FORK_SECONDS:
            self._again = loop.call_later(pause, self._continue, 2 * pause)

    def relieve(self, renderer: int | None, why: str) -> None:
        """End this renderer, or the whole browser, because of its memory use."""
        if renderer is None:
            self.connection.abandon(BrowserOutOfMemory(f"the browser was ended: {why}"))
            self._signal(signal.SIGKILL)
            return
        self.relieved = why
        with contextlib.suppress(ProcessLookupError):
            if os.getpgid(renderer) == self.pid:
                os.kill(renderer, signal.SIGKILL)

    def _signal(self, number: signal.Signals) -> None:
        if not (self._ending or self._exited.is_set()):  # later, the id may belong to another group
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.pid, number)

    async def kill(self) -> None:
        """End the whole group and remove its profile. Safe to call twice; not undone by cancellation.

        Raises:
            BrowserError: processes of the group did not end after SIGKILL.
        """
        if self._ending is None:
            self.connection.abandon(BrowserCrashed("the browser was closed"))
            self._ending = asyncio.create_task(self._end())
        await asyncio.shield(self._ending)

    async def _end(self) -> None:
        try:
            await _end_group(self.pid, KILL_SECONDS, self._cgroup)
        finally:
            self._close_pidfd()
            await self._root.remove(self.profile)


def _computes(pid: int) -> bool:
    """Whether it is a renderer that computes, or would if it had a processor."""
    with contextlib.suppress(OSError):  # it has ended
        state = Path("/proc", str(pid), "stat").read_text(errors="replace").rpartition(") ")[2][:1]
        return state == "R" and process_type(pid) == b"renderer"
    return False


def _scheduled(pids: list[int]) -> tuple[int, int]:
    """How long these processes' main threads have run, and were ready to run without a processor, ns."""
    ran = lacked = 0
    for pid in pids:
        with contextlib.suppress(OSError):  # it has ended, or the kernel does not count
            own_ran, own_lacked, _ = map(int, Path("/proc", str(pid), "schedstat").read_text().split())
            ran, lacked = ran + own_ran, lacked + own_lacked
    return ran, lacked


def _running_members(group: int) -> list[int]:
    """Process ids of the group's members, without zombies. Reads all of /proc: a few ms."""
    try:
        return list(_members(group))
    except OSError:  # out of file descriptors: check only the leader, which is our child
        with contextlib.suppress(ChildProcessError):
            if os.waitid(os.P_PID, group, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                return [group]
        return []


def _members(group: int) -> Iterator[int]:
    with os.scandir("/proc") as entries:
        for entry in entries:
            if not entry.name.isdigit():
                continue
            try:
                # "pid (name) state ppid pgrp ...", where the name may contain anything
                fields = Path(entry.path, "stat").read_text(errors="replace").rpartition(")")[2].split()
            except (FileNotFoundError, ProcessLookupError):
                continue  # it ended in the meantime
            if int(fields[2]) == group and fields[0] not in "ZX":
                yield int(entry.name)


def _reap(group: int) -> None:
    """Collect the exit status of our own children in the group, so that none remains a zombie."""
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-group, os.WNOHANG)[0]:
            pass


async def _end_group(group: int, seconds: float, cgroup: Cgroup | None = None) -> None:
    """SIGKILL the group and wait until none of its processes runs.

    Members that are not our children are reaped by the system's init, at some later time: zombies hold no
    resources and count as ended.
    """
    pause, longest = _EXIT_POLL_SECONDS
    loop = asyncio.get_running_loop()
    deadline = loop.time() + seconds
    while True:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)
        if cgroup is not None:
            cgroup.kill()
        running = await asyncio.to_thread(_running_members, group)
        if not running and (cgroup is None or cgroup.is_empty):
            break
        if loop.time() > deadline:
            raise BrowserError(f"processes {running} outlived SIGKILL by {seconds:g} s")
        await asyncio.sleep(pause)
        pause = min(pause * 2, longest)
    _reap(group)
    if cgroup is not None:
        cgroup.remove()


def _tail(profile: Path) -> str:
    """The last lines of the log, or those that say why the browser ended."""
    try:
        text = (profile / "chromium.log").read_bytes()[-_LOG_TAIL_BYTES:].decode(errors="replace")
    except OSError:
        return ""
    lines = [line.strip() for line in text.splitlines()]
    reasons = [line for line in lines if any(word in line for word in _REASON_MARKERS)]
    return " | ".join(reasons[-_LOG_LINES:] or lines[-_LOG_LINES:])


def _flags(executable: Path, headed: bool) -> list[str]:
    """The flags of an executable. Full browsers have a back-forward cache, which would use a new renderer for
    every website; in headless shells pages do not support it."""
    if "headless" in executable.name:
        return list(_FLAGS)
    flags = [
        flag.replace("BackForwardCache,", "") for flag in _FLAGS if not (headed and flag == "--headless")
    ]
    return [*flags, "--renderer-process-limit=1"]


def _arguments(
    executable: Path, profile: Path, sandbox: SandboxState, listener: ProxyListener, told: Told, headed: bool
) -> list[str]:
    folder = f"--user-data-dir={profile}{os.sep}profile"
    arguments = [str(executable), *_flags(executable, headed), *told.flags, *listener.browser_flags, folder]
    if not sandbox.on:
        arguments.append("--no-sandbox")
    return arguments


@contextlib.contextmanager
def _high_descriptor(descriptor: int) -> Iterator[int]:
    """A copy of a descriptor, above the numbers that the child process assigns."""
    copy = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, _FIRST_FREE_FD)
    try:
        yield copy
    finally:
        os.close(copy)


def _environment(profile: Path, headed: bool) -> dict[str, str]:
    """The environment of Chromium, without secrets, so that a page that escapes its renderer finds none; but
    with what lets it open windows, if it is to."""
    harmless = {
        name: value
        for name, value in os.environ.items()
        if not (_SECRET_NAME.search(name) or name.startswith("XDG_"))
    }
    # Crash reports, caches and certificates are written below the home folder, whatever the profile is.
    screen = {name: os.environ[name] for name in _SCREEN if name in os.environ} if headed else {}
    if headed and (given := Path.home() / ".Xauthority").exists():
        screen.setdefault("XAUTHORITY", str(given))
    return {**harmless, **screen, "TMPDIR": str(profile), "HOME": str(profile)}


def _spawn(arguments: list[str], child_end: socket.socket, profile: Path, headed: bool) -> int:
    """Start Chromium as the leader of a new process group, with a socket as its descriptors 3 and 4.

    Raises:
        OSError: it cannot be started.
    """
    log_file = os.open(profile / "chromium.log", os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        with _high_descriptor(child_end.fileno()) as pipe, _high_descriptor(log_file) as errors:
            return os.posix_spawn(
                arguments[0],
                arguments,
                _environment(profile, headed),
                file_actions=[
                    (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                    (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
                    (os.POSIX_SPAWN_DUP2, errors, 2),
                    (os.POSIX_SPAWN_DUP2, pipe, 3),
                    (os.POSIX_SPAWN_DUP2, pipe, 4),
                ],
                setpgroup=0,
            )
    finally:
        os.close(log_file)


async def _new_profile(root: ProfileRoot) -> Path:
    making = asyncio.create_task(asyncio.to_thread(root.new))
    try:
        return await asyncio.shield(making)
    except asyncio.CancelledError:
        with contextlib.suppress(OSError):
            await root.remove(await making)  # cancellation does not stop the thread that creates it
        raise
    except OSError as error:
        raise BrowserLaunchFailed(
            f"no profile can be made in {root.path.parent}: {error.strerror}",
            hint="make room there, or set browser.temporary_root",
        ) from error


async def _start(
    config: BrowserConfig, executable: Path, root: ProfileRoot, sandbox: SandboxState, listener: ProxyListener
) -> tuple[BrowserProcess, socket.socket]:
    """Start a browser. Returns it with our end of its pipe; leaves nothing behind if it fails."""
    told = Told(config.identity, await asyncio.to_thread(version_of, executable))
    profile = await _new_profile(root)
    pid = cgroup = None
    with contextlib.ExitStack() as undo:
        try:
            cgroup = new_cgroup(config)
            own_end, child_end = socket.socketpair()
            undo.callback(own_end.close)
            own_end.setblocking(False)
            with child_end:
                arguments = _arguments(executable, profile, sandbox, listener, told, config.headed)
                pid = _spawn(
                    cgroup.command(arguments) if cgroup else arguments, child_end, profile, config.headed
                )
            process = BrowserProcess(pid, Connection(), profile, root, told, cgroup)
        except OSError as error:
            if pid is not None:
                await _end_group(pid, KILL_SECONDS, cgroup)
            if cgroup is not None:
                cgroup.remove()
            await root.remove(profile)
            raise BrowserLaunchFailed(
                f"{executable} cannot be started: {error.strerror}", hint="see `webgym doctor`"
            ) from error
        except ConfigError:
            await root.remove(profile)
            raise
        undo.pop_all()
    return process, own_end


async def launch(
    config: BrowserConfig, executable: Path, root: ProfileRoot, sandbox: SandboxState, listener: ProxyListener
) -> BrowserProcess:
    """Start a browser that can connect only through ``listener``, and wait for its first answer.

    Raises:
        BrowserLaunchFailed: it cannot be started, ended at once, or did not answer in time.
    """
    process, own_end = await _start(config, executable, root, sandbox, listener)
    connection = process.connection
    try:
        await asyncio.get_running_loop().create_unix_connection(lambda: connection, sock=own_end)
        version = await connection.call("Browser.getVersion", reply=Version, seconds=config.launch_seconds)
        bound(await asyncio.to_thread(_running_members, process.pid), config)
    except (BrowserCrashed, BrowserTimeout) as error:
        log_tail = process.log_tail()
        await process.kill()
        raise BrowserLaunchFailed(
            f"{executable} did not start: {log_tail or error.message}", hint="see `webgym doctor`"
        ) from error
    except BaseException:
        await process.kill()
        raise
    process.version = version.product
    return process


async def launch_sandboxed(
    config: BrowserConfig,
    executable: Path,
    root: ProfileRoot,
    sandbox: SandboxState | None,
    listener: ProxyListener,
) -> tuple[BrowserProcess, SandboxState]:
    """Start a browser with its sandbox if possible; log a warning if not.

    Args:
        config: the slot's limits and its sandbox setting.
        executable: the Chromium to run.
        root: where to create its profile.
        sandbox: the result of an earlier launch; ``None`` at the first.
        listener: the proxy's listener for this browser.

    Raises:
        BrowserLaunchFailed: it does not start, or not with the sandbox that the setting requires.
        ConfigError: at the first launch: ``browser.cgroup`` is not a cgroup that can be divided.
    """
    state = sandbox or planned_sandbox(config)
    if sandbox is not None:
        try:
            return await launch(config, executable, root, sandbox, listener), sandbox
        except ConfigError as error:  # the settings were right at the first launch
            raise BrowserLaunchFailed(error.message, hint=error.hint) from error
    if not state.on:
        process = await launch(config, executable, root, state, listener)
    else:
        process, state = await _launch_first(config, executable, root, listener)
    if not state.on:
        fix = "" if config.sandbox == "off" else f"; to fix it: {remedy()}"
        log.warning("Chromium runs WITHOUT its sandbox: %s%s", state.reason, fix)
    return process, state


async def _launch_first(
    config: BrowserConfig, executable: Path, root: ProfileRoot, listener: ProxyListener
) -> tuple[BrowserProcess, SandboxState]:
    """Start a browser with its sandbox, or without it if it fails otherwise and the setting allows it."""
    try:
        return await _launch_examined(config, executable, root, SandboxState(True), listener)
    except BrowserLaunchFailed as error:
        if not is_sandbox_failure(error.message):
            raise
        if config.sandbox == "on":
            raise BrowserLaunchFailed(
                f"the sandbox is required but not available: {error.message}", hint=remedy()
            ) from error
        log.info("%s", error.message)
    state = SandboxState(False, "this machine does not let Chromium build it")
    process, _ = await _launch_examined(config, executable, root, state, listener)
    return process, state


async def _launch_examined(
    config: BrowserConfig, executable: Path, root: ProfileRoot, planned: SandboxState, listener: ProxyListener
) -> tuple[BrowserProcess, SandboxState]:
    """Start a browser, and check that it renders a page and whether its renderer is sandboxed."""
    process = await launch(config, executable, root, planned, listener)
    try:
        observed = await examine_sandbox(process.connection, process.processes, config.open_seconds)
        if config.sandbox == "on" and not observed.on:
            raise BrowserLaunchFailed(f"the sandbox is required but not active: {observed.reason}")
    except (BrowserCrashed, BrowserTimeout, CommandFailed) as error:
        await process.kill()
        raise BrowserLaunchFailed(
            f"{executable} renders no page: {error.message}", hint="see `webgym doctor`"
        ) from error
    except BaseException:
        await process.kill()
        raise
    return process, observed
