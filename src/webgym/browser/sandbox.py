"""Chromium's sandbox: whether it is requested, whether it is active, and how to enable it.

The sandbox has two layers: a renderer runs in user, process and network namespaces of its own, and a filter
(seccomp) blocks most system calls. The command line does not prove that it is active, since wrapper scripts
add flags of their own. So the first browser's renderer is examined from outside.
"""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from webgym.browser.cdp import Connection
from webgym.browser.cdp_messages import Attached, BrowserContext, CreatedTarget, EmptyReply
from webgym.browser.config import BrowserConfig
from webgym.core.errors import BrowserCrashed, BrowserLaunchFailed

_NO_SANDBOX = re.compile(
    r"no usable sandbox"
    r"|SUID sandbox helper"
    r"|FATAL:[^|]*(?:sandbox|zygote|namespace)"
    r"|Check failed:[^|]*(?:chroot|namespace|credentials)",
    re.IGNORECASE,
)
"""Chromium's messages when it ends because it has no sandbox. Its warnings mention the sandbox as well."""

_SECCOMP_FILTER = "2"
_SETTINGS = Path("/proc/sys")


class SandboxState(msgspec.Struct, frozen=True):
    """Whether Chromium's sandbox is on, and the reason if it is off or incomplete."""

    on: bool
    reason: str = ""


def planned_sandbox(config: BrowserConfig) -> SandboxState:
    """Whether to start with the sandbox, by the setting and the current user.

    Raises:
        BrowserLaunchFailed: the sandbox is required, but the user is root.
    """
    if config.sandbox == "off":
        return SandboxState(False, "switched off by the setting browser.sandbox")
    if os.geteuid() != 0:
        return SandboxState(True)
    if config.sandbox == "on":
        raise BrowserLaunchFailed("Chromium does not run with its sandbox as root", hint=remedy())
    return SandboxState(False, "running as root, where Chromium's sandbox does not work")


def is_sandbox_failure(output: str) -> bool:
    """Whether a browser that ended at its start did so because it had no sandbox, by its output."""
    return _NO_SANDBOX.search(output) is not None


# --- examining a renderer from outside ----------------------------------------------------------------


async def examine_sandbox(
    connection: Connection, processes: Callable[[], list[int]], seconds: float
) -> SandboxState:
    """Let a browser render a page, and check whether the renderer is sandboxed.

    Args:
        connection: the browser's connection.
        processes: returns the ids of the browser's processes.
        seconds: deadline of each command.

    Raises:
        BrowserCrashed: its pages crash, or it is gone.
        BrowserTimeout: no page opened in time.
    """

    def on_crash(_: EmptyReply) -> None:
        connection.abandon(BrowserCrashed("its pages crash"))

    unsubscribe = connection.on("Target.targetCrashed", EmptyReply, on_crash)
    connection.send("Target.setDiscoverTargets", {"discover": True})
    context = await connection.call(
        "Target.createBrowserContext", {"disposeOnDetach": True}, reply=BrowserContext, seconds=seconds
    )
    where = {"browserContextId": context.browser_context_id}
    blank = {"url": "about:blank", **where}
    target = await connection.call("Target.createTarget", blank, reply=CreatedTarget, seconds=seconds)
    flat = {"targetId": target.target_id, "flatten": True}
    page = await connection.call("Target.attachToTarget", flat, reply=Attached, seconds=seconds)
    # A renderer enters its sandbox before it runs a script.
    script = {"expression": "0"}
    await connection.call(
        "Runtime.evaluate", script, reply=EmptyReply, seconds=seconds, session_id=page.session_id
    )
    state = await asyncio.to_thread(_containment, processes)
    unsubscribe()
    connection.send("Target.setDiscoverTargets", {"discover": False})
    await connection.call("Target.disposeBrowserContext", where, reply=EmptyReply, seconds=seconds)
    return state


def _status(process: int | str) -> dict[str, str]:
    lines = Path(f"/proc/{process}/status").read_text(errors="replace").splitlines()
    return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}


def _containment(processes: Callable[[], list[int]]) -> SandboxState:
    own = _status("self")
    renderers = []
    for pid in processes():
        try:
            if b"--type=renderer" in Path(f"/proc/{pid}/cmdline").read_bytes():
                renderers.append(_status(pid))
        except (FileNotFoundError, ProcessLookupError):
            continue  # it ended in the meantime
    if not renderers:
        return SandboxState(False, "none of its renderers is visible in /proc")
    # A process has one id in every namespace in which it is visible.
    if any(len(renderer["NSpid"].split()) <= len(own["NSpid"].split()) for renderer in renderers):
        return SandboxState(
            False,
            "the browser runs without it although it was requested: does a wrapper script add --no-sandbox?",
        )
    if any(_filters(renderer) <= _filters(own) for renderer in renderers):
        return SandboxState(True, "in namespaces only: this kernel filters no system calls")
    return SandboxState(True)


def _filters(status: dict[str, str]) -> int:
    """Number of seccomp filters on a process's system calls. A container's own filter is one of them."""
    return int(status.get("Seccomp_filters", status.get("Seccomp") == _SECCOMP_FILTER))


# --- how to fix it ------------------------------------------------------------------------------------


def remedy() -> str:
    """How to enable Chromium's sandbox on this machine: one line, a command if there is one."""
    if os.geteuid() == 0:
        return "run it as another user, e.g. `runuser -u USER -- webgym serve`"
    settings = [f"sudo sysctl -w {setting}" for setting in _settings()]
    if settings:
        return " && ".join(settings)
    if _filters(_status("self")):
        return "start the container with `--security-opt seccomp=deploy/seccomp.json`"
    return "allow unprivileged user namespaces, or `sudo apt-get install chromium-sandbox`"


def _settings() -> Iterator[str]:
    """The kernel settings of this machine that prevent the sandbox, with the values that allow it."""
    for name, blocking, required in (
        ("kernel.apparmor_restrict_unprivileged_userns", "1", "0"),
        ("kernel.unprivileged_userns_clone", "0", "1"),
        ("user.max_user_namespaces", "0", "10000"),
    ):
        try:
            value = _SETTINGS.joinpath(*name.split(".")).read_text().strip()
        except OSError:  # this kernel has no such setting, or hides it
            continue
        if value == blocking:
            yield f"{name}={required}"
