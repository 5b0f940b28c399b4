"""Chromium's sandbox for real: as a user who may have it, and on machines that refuse it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests import seccomp, unprivileged

from webgym.browser import sandbox
from webgym.browser.config import BrowserConfig
from webgym.browser.find import find_browser
from webgym.browser.sandbox import SandboxState, is_sandbox_failure, planned_sandbox
from webgym.core.errors import BrowserLaunchFailed

CONTAINED = Path(__file__).with_name("contained.py")

SET_SECCOMP = {"index": 0, "value": 22, "op": "SCMP_CMP_EQ"}
PNG = "\x89PNG"
NEW_USER_NAMESPACE = {"index": 0, "value": 0x10000000, "valueTwo": 0x10000000, "op": "SCMP_CMP_MASKED_EQ"}


@pytest.fixture
def folder() -> Iterator[Path]:
    if unprivileged.interpreter() is None:
        pytest.skip("run by root with an interpreter that no other user can read")
    with unprivileged.scratch() as folder:
        yield folder


@pytest.fixture
def containing(folder: Path) -> Path:
    """On a machine that allows the sandbox."""
    if not unprivileged.can_make_namespaces(folder):
        pytest.skip("this machine does not let ordinary users make namespaces")
    return folder


def serve(
    folder: Path, setting: str = "auto", executable: Path | None = None, refuse: Any = None
) -> dict[str, Any]:
    """Serve a session as a user without privileges, on a machine that refuses some system calls."""
    arguments = ["-c", CONTAINED.read_text(), setting, str(executable or find_browser().path)]
    if refuse is not None:
        if seccomp.library() is None:
            pytest.skip("no libseccomp to play a machine that refuses the sandbox")
        profile = folder / "profile.json"
        profile.write_text(json.dumps({"defaultAction": "SCMP_ACT_ALLOW", "syscalls": refuse}))
        profile.chmod(0o644)
        own = unprivileged.interpreter()
        arguments = ["-c", Path(seccomp.__file__).read_text(), str(profile), str(own), *arguments]
    answer = unprivileged.python(folder, *arguments)
    assert answer.returncode == 0, answer.stderr
    said: dict[str, Any] = json.loads(answer.stdout)
    said["stderr"] = answer.stderr
    return said


def refusal(*names: str, **more: Any) -> list[dict[str, Any]]:
    return [{"names": list(names), "action": "SCMP_ACT_ERRNO", **more}]


NO_USER_NAMESPACES = [
    *refusal("clone", "unshare", args=[NEW_USER_NAMESPACE]),
    *refusal("clone3", errnoRet=38),
]
REFUSALS = {
    "no user namespaces": NO_USER_NAMESPACES,
    "namespaces without rights": refusal("chroot"),  # what AppArmor and some containers leave of them
}


@pytest.mark.browser
def test_on_a_machine_that_allows_it_pages_are_contained(containing: Path) -> None:
    said = serve(containing)
    assert said["info"] == {"sandboxed": True, "reason": ""}
    assert said["picture"] == PNG
    own, group = said["own"], said["processes"].values()
    renderers = [process for process in group if process["kind"] == "renderer"]
    assert renderers
    for renderer in renderers:
        assert renderer["Seccomp"] == "2", "its system calls are filtered"
        assert renderer["NoNewPrivs"] == "1"
        assert len(renderer["NSpid"].split()) > len(own["NSpid"].split()), "it sees no process of ours"
        assert renderer["user"] != own["user"]
        assert int(renderer["CapEff"], 16) == 0
    assert {process["State"][0] for process in group} == {"T"}, "between calls they are stopped all the same"
    assert said["left"] == [], "processes in namespaces of their own are ended like the rest"
    assert list(containing.glob("webgym-*/*")) == []


SLOW = pytest.mark.slow
WITHOUT, HALF = REFUSALS


@pytest.mark.browser
@pytest.mark.parametrize("name", [WITHOUT, pytest.param(HALF, marks=SLOW)])
def test_where_it_cannot_be_built_the_server_runs_and_says_so(folder: Path, name: str) -> None:
    said = serve(folder, refuse=REFUSALS[name])
    assert said["info"]["sandboxed"] is False
    assert "does not let Chromium build it" in said["info"]["reason"]
    assert "WITHOUT its sandbox" in said["stderr"]
    assert "to fix it: " in said["stderr"]
    assert said["picture"] == PNG


@pytest.mark.browser
@pytest.mark.parametrize("name", [pytest.param(WITHOUT, marks=SLOW), HALF])
def test_where_it_is_demanded_and_not_to_be_had_nothing_is_served(folder: Path, name: str) -> None:
    said = serve(folder, "on", refuse=REFUSALS[name])
    assert said["error"] == "browser_launch_failed"
    assert "required" in said["message"]
    assert "seccomp=deploy/seccomp.json" in said["hint"] or "sysctl" in said["hint"]


@pytest.mark.browser
def test_what_a_kernel_without_filters_leaves_of_it(containing: Path) -> None:
    no_filters = [*refusal("seccomp", errnoRet=38), *refusal("prctl", errnoRet=22, args=[SET_SECCOMP])]
    said = serve(containing, refuse=no_filters)
    assert said["info"]["sandboxed"] is True
    assert said["info"]["reason"].startswith("in namespaces only")


@pytest.mark.browser
def test_pages_that_crash_anyhow_are_not_the_sandboxs_fault(folder: Path) -> None:
    said = serve(folder, refuse=refusal("capset"))
    assert said["error"] == "browser_launch_failed"
    assert "renders no page" in said["message"]


@pytest.mark.browser
def test_a_wrapper_that_switches_it_off_is_found_out(containing: Path) -> None:
    wrapper = containing / "wrapper"
    wrapper.write_text(f'#!/bin/sh\nexec {find_browser().path} "$@" --no-sandbox\n')
    wrapper.chmod(0o755)
    said = serve(containing, executable=wrapper)
    assert said["info"]["sandboxed"] is False
    assert "the browser runs without it" in said["info"]["reason"]
    assert serve(containing, "on", executable=wrapper)["error"] == "browser_launch_failed"


@pytest.mark.browser
def test_serve_and_doctor_as_that_user(containing: Path) -> None:
    command = "from webgym.cli import main; main()"
    answer = unprivileged.python(containing, "-c", command, "doctor", "--json")
    checks = {check["name"]: check for check in json.loads(answer.stdout)["checks"]}
    assert checks["Sandbox"]["status"] == "ok"
    assert checks["Sandbox"]["found"].startswith("on: pages run in namespaces of their own")


@pytest.mark.parametrize(
    ("said", "blamed"),
    [
        ("[1:ERROR:content/zygote.cc:130] No usable sandbox! If this is a Debian system", True),
        ("The SUID sandbox helper binary was found, but is not configured correctly.", True),
        ('Check failed: sys_chroot("/proc/self/fdinfo/") == 0', True),
        ("[1:FATAL:zygote_host_impl_linux.cc:251] Zygote process exited prematurely", True),
        ("[1:WARNING:sandbox_linux.cc:405] InitializeSandbox() called with multiple threads", False),
        ("[1:FATAL:memory.cc:22] Out of memory | [1:ERROR:sandbox_linux.cc:405] warned", False),
        ("error while loading shared libraries: libnss3.so", False),
    ],
)
def test_only_what_the_sandbox_did_is_blamed_on_it(said: str, blamed: bool) -> None:
    assert is_sandbox_failure(said) is blamed


def test_root_has_none_and_may_not_demand_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert "root" in planned_sandbox(BrowserConfig()).reason
    assert planned_sandbox(BrowserConfig(sandbox="off")).on is False
    with pytest.raises(BrowserLaunchFailed) as caught:
        planned_sandbox(BrowserConfig(sandbox="on"))
    assert "runuser" in caught.value.hint
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert planned_sandbox(BrowserConfig()) == SandboxState(True)


def test_the_remedy_is_the_setting_that_is_in_the_way(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(sandbox, "_SETTINGS", tmp_path)
    for name, value in (
        ("kernel/apparmor_restrict_unprivileged_userns", "1"),
        ("user/max_user_namespaces", "9"),
    ):
        path = tmp_path / name
        path.parent.mkdir()
        path.write_text(f"{value}\n")
    assert sandbox.remedy() == "sudo sysctl -w kernel.apparmor_restrict_unprivileged_userns=0"
    (tmp_path / "user/max_user_namespaces").write_text("0\n")
    assert sandbox.remedy().endswith(" && sudo sysctl -w user.max_user_namespaces=10000")
