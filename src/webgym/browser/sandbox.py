"""Chromium's sandbox: whether it is asked for, whether it is really there, and how to fix it.

The sandbox has two layers: a renderer lives in user, process and network namespaces of its own, and a filter
(seccomp) refuses it most system calls. What a browser was told on its command line proves nothing, since
wrapper scripts add flags of their own. So the first browser's renderer is looked at from outside.
"""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from webgym.browser.cdp import Connection
from webgym.browser.cdp_messages import Attached, BrowserContext, CreatedTarget, EmptyReply, TargetCrashed
from webgym.browser.config import BrowserConfig
from webgym.core.errors import BrowserCrashed, BrowserLaunchFailed

_REFUSED = re.compile(
    r"no usable sandbox"
    r"|SUID sandbox helper"
    r"|FATAL:[^|]*(?:sandbox|zygote|namespace)"
    r"|Check failed:[^|]*(?:chroot|namespace|credentials)",
    re.IGNORECASE,
)
"""What Chromium writes when it ends for want of a sandbox. Its mere warnings name the sandbox as well."""

_SECCOMP_FILTER = "2"
_SETTINGS = Path("/proc/sys")


class SandboxState(msgspec.Struct, frozen=True):
    """Whether Chromium's sandbox is on, and why not if it is off."""

    on: bool
    reason: str = ""


def planned_sandbox(config: BrowserConfig) -> SandboxState:
    """What the setting and this user allow, before anything was tried.

    Raises:
        BrowserLaunchFailed: the sandbox is demanded, and we are root.
    """
    if config.sandbox == "off":
        return SandboxState(False, "switched off by the setting browser.sandbox")
    if os.geteuid() != 0:
        return SandboxState(True)
    if config.sandbox == "on":
        raise BrowserLaunchFailed("Chromium does not run with its sandbox as root", hint=remedy())
    return SandboxState(False, "running as root, where Chromium's sandbox does not work")


def is_to_blame(said: str) -> bool:
    """Whether a browser that ended at its start did so for want of a sandbox, by what it wrote."""
    return _REFUSED.search(said) is not None


# --- looking from outside -----------------------------------------------------------------------------


async def examined(
    connection: Connection, processes: Callable[[], list[int]], seconds: float
) -> SandboxState:
    """Let a browser render a page, and see whether that is contained.

    Args:
        processes: tells the ids of the browser's processes.
        seconds: deadline of each of the few commands.

    Raises:
        BrowserCrashed: its pages crash, or it is gone.
        BrowserTimeout: no page came up in time.
    """

    def on_crash(_: TargetCrashed) -> None:
        connection.abandon(BrowserCrashed("its pages crash"))

    unsubscribe = connection.on("Target.targetCrashed", TargetCrashed, on_crash)
    connection.send("Target.setDiscoverTargets", {"discover": True})
    context = await connection.call(
        "Target.createBrowserContext", {"disposeOnDetach": True}, reply=BrowserContext, seconds=seconds
    )
    where = {"browserContextId": context.browser_context_id}
    blank = {"url": "about:blank", **where}
    target = await connection.call("Target.createTarget", blank, reply=CreatedTarget, seconds=seconds)
    flat = {"targetId": target.target_id, "flatten": True}
    page = await connection.call("Target.attachToTarget", flat, reply=Attached, seconds=seconds)
    # A renderer that has run a script has closed its sandbox.
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
    ours = _status("self")
    renderers = []
    for pid in processes():
        try:
            if b"--type=renderer" in Path(f"/proc/{pid}/cmdline").read_bytes():
                renderers.append(_status(pid))
        except (FileNotFoundError, ProcessLookupError):
            continue  # it ended while we looked
    if not renderers:
        return SandboxState(False, "no renderer of it is to be seen in /proc")
    # A process has one number in every namespace that it can be seen from.
    if any(len(each["NSpid"].split()) <= len(ours["NSpid"].split()) for each in renderers):
        return SandboxState(
            False,
            "the browser leaves it off, though told to have it on: does a wrapper of it add --no-sandbox?",
        )
    if any(_filters(each) <= _filters(ours) for each in renderers):
        return SandboxState(True, "in namespaces only: this kernel filters no system calls")
    return SandboxState(True)


def _filters(status: dict[str, str]) -> int:
    """How many filters stand before a process's system calls. A container's own is one of them."""
    return int(status.get("Seccomp_filters", status.get("Seccomp") == _SECCOMP_FILTER))


# --- how to fix it ------------------------------------------------------------------------------------


def remedy() -> str:
    """What gives Chromium its sandbox on this machine: one line, a command where there is one."""
    if os.geteuid() == 0:
        return "run it as another user, e.g. `runuser -u USER -- webgym serve`"
    settings = [f"sudo sysctl -w {setting}" for setting in _settings()]
    if settings:
        return " && ".join(settings)
    if _filters(_status("self")):
        return "start the container with `--security-opt seccomp=deploy/seccomp.json`"
    return "allow unprivileged user namespaces, or `sudo apt-get install chromium-sandbox`"


def _settings() -> Iterator[str]:
    """The kernel settings of this machine that are in the way, as they should be."""
    for name, is_in_the_way, wanted in (
        ("kernel.apparmor_restrict_unprivileged_userns", "1", "0"),
        ("kernel.unprivileged_userns_clone", "0", "1"),
        ("user.max_user_namespaces", "0", "10000"),
    ):
        try:
            value = _SETTINGS.joinpath(*name.split(".")).read_text().strip()
        except OSError:  # this kernel has no such setting, or hides it
            continue
        if value == is_in_the_way:
            yield f"{name}={wanted}"
