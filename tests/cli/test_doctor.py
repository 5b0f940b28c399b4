"""``webgym doctor`` on this machine, and on machines that lack something."""

from __future__ import annotations

import json
import os
import resource
from pathlib import Path

import pytest
from tests.conftest import Calls
from tests.documented import documented
from tests.llm.endpoint import serve

from webgym.agent.formats import render_reply
from webgym.browser.find import find_browser
from webgym.cli import doctor
from webgym.cli.doctor import SAMPLES, SIZE, Check, LaunchCheck, try_browser
from webgym.core.action import Answer, LeftClick, Target
from webgym.core.errors import BrowserError


def program(path: Path, script: str) -> Path:
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


@pytest.mark.browser
def test_this_machine_is_ready(calls: Calls) -> None:
    code, out, err = calls.apart(*documented("webgym doctor"), "--json")
    assert code == 0, out + err
    report = json.loads(out)
    assert report["ready"] is True
    checks = {check["name"]: check for check in report["checks"]}
    assert str(find_browser().path) in checks["Browser"]["found"]
    assert checks["Rendering"]["status"] == "ok"
    assert "pydantic 2." in checks["Packages"]["found"]
    if os.geteuid() == 0:
        assert checks["Sandbox"]["status"] == "note"
        assert "root" in checks["Sandbox"]["found"]


@pytest.mark.browser
async def test_the_trial_draws_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    trial = await try_browser(find_browser().path, 60)
    assert trial.size == SIZE
    assert set(trial.fonts) == set(SAMPLES)
    assert trial.fonts["Latin"]
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


async def test_a_browser_that_does_not_come_up(tmp_path: Path) -> None:
    dies = program(tmp_path / "dies", "echo 'error while loading shared libraries: libnss3.so' >&2; exit 127")
    with pytest.raises(BrowserError, match="libnss3"):
        await try_browser(dies, 20)
    hangs = program(tmp_path / "hangs", "exec sleep 60")
    with pytest.raises(BrowserError, match=r"within 0\.5 s"):
        await try_browser(hangs, 0.5)


def test_a_missing_browser_is_said_with_what_mends_it(tmp_path: Path, calls: Calls) -> None:
    absent = str(tmp_path / "absent")
    code, out, err = calls.apart("doctor", WEBGYM_BROWSER=absent, COLUMNS="160")
    assert code == 1
    assert f"there is no browser at {absent}" in " ".join(out.split())
    assert "→ correct the setting or WEBGYM_BROWSER" in out
    assert "missing: Browser" in out
    assert err == ""


def test_no_browser_anywhere(tmp_path: Path, calls: Calls) -> None:
    nowhere = dict.fromkeys(("PATH", "HOME", "PLAYWRIGHT_BROWSERS_PATH"), str(tmp_path))
    code, out, _ = calls.apart("doctor", "--json", **nowhere)
    assert code == 1
    report = json.loads(out)
    assert report["ready"] is False
    [missing] = [check for check in report["checks"] if check["status"] == "missing"]
    assert missing["name"] == "Browser"
    assert "playwright install chromium-headless-shell" in missing["fix"]


def test_a_browser_that_tells_its_version_and_cannot_start(tmp_path: Path) -> None:
    path = program(
        tmp_path / "half",
        '[ "$1" = --version ] && echo "Chromium 156.0.1.2" && exit\n'
        "echo 'error while loading shared libraries: libnss3.so' >&2; exit 127",
    )
    checks = {check.name: check for check in doctor.check_browser(path)}
    assert checks["Browser"].status == "ok"
    assert checks["Rendering"].status == "missing"
    assert "install-deps" in checks["Rendering"].fix


def trial(**changes: object) -> LaunchCheck:
    whole = {"Latin": True, "CJK": True, "emoji": True}
    values = {"seconds": 1.0, "size": SIZE, "sandbox": True, "sandbox_reason": "", "fonts": whole}
    return LaunchCheck(**(values | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fonts", "status", "packages"),
    [
        ({"Latin": True, "CJK": True, "emoji": True}, "ok", ""),
        ({"Latin": True, "CJK": False, "emoji": False}, "note", "fonts-wqy-zenhei fonts-noto-color-emoji"),
        ({"Latin": False, "CJK": True, "emoji": True}, "missing", "fonts-liberation"),
    ],
)
def test_fonts(fonts: dict[str, bool], status: str, packages: str) -> None:
    check = doctor._fonts(trial(fonts=fonts))
    assert check.status == status
    assert check.fix.endswith(packages)
    assert set(doctor.FONT_PACKAGES) == set(SAMPLES), "every script that is drawn has a package"


def test_running_without_a_sandbox_is_said_aloud(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor._sandbox(trial()).status == "ok"
    monkeypatch.setattr(doctor, "remedy", lambda: "sudo sysctl -w this=that")
    check = doctor._sandbox(trial(sandbox=False, sandbox_reason="this machine does not let it"))
    assert check.status == "note"
    assert "OFF" in check.found
    assert "does not let it" in check.found
    assert check.fix == "sudo sysctl -w this=that"


def test_limits_decide_what_is_worth_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    examinations = [doctor.check_memory, doctor.check_disk, doctor.check_shared_memory]
    if resource.getrlimit(resource.RLIMIT_NOFILE)[0] != resource.RLIM_INFINITY:
        examinations.append(doctor.check_open_files)
    for limit, status in ((1, "ok"), (2**40, "note")):
        for name in ("MEMORY_GIB", "DISK_GIB", "SHARED_MEMORY_MIB", "OPEN_FILES"):
            monkeypatch.setattr(doctor, name, limit if status == "note" else limit / 2**20)
        for examine in examinations:
            assert examine().status == status
            assert bool(examine().fix) == (status == "note")


def test_graphics_cards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert doctor.check_gpu() == Check("GPU", "ok", "none; only needed to serve or train a model")
    program(tmp_path / "nvidia-smi", "echo 'NVIDIA H100, 81559 MiB'; echo 'NVIDIA H100, 81559 MiB'")
    assert doctor.check_gpu().found == "NVIDIA H100, 81559 MiB; NVIDIA H100, 81559 MiB"
    program(tmp_path / "nvidia-smi", "echo 'Driver/library version mismatch'; exit 18")
    check = doctor.check_gpu()
    assert check.status == "note"
    assert "mismatch" in check.found


def test_a_missing_package_is_essential(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.check_packages().status == "ok"
    monkeypatch.setattr(
        "importlib.metadata.requires", lambda _: ["no-such-package>=1", "httpx<1", "x; extra == 'y'"]
    )
    check = doctor.check_packages()
    assert (check.status, check.found, check.fix) == (
        "missing",
        "not installed: no-such-package",
        "make setup",
    )


@pytest.mark.parametrize(
    ("text", "status", "found"),
    [("K7", "ok", "answers as asked"), ("The code is K7.", "note", "'The code is K7.'")],
)
async def test_a_model_that_answers_in_sentences_is_seen(text: str, status: str, found: str) -> None:
    click = render_reply(LeftClick(Target(coordinate=(920.0, 910.0))), "memory", description="Click")
    async with serve() as endpoint:
        endpoint.text = click
        endpoint.texts = {"Which code": render_reply(Answer(text), "memory", description="Answer")}
        check = await doctor.check_model(endpoint.url("fine"), "some-model", None)
    assert (check.name, check.status) == ("Model", status)
    assert found in check.found


async def test_a_model_that_is_not_there_or_points_elsewhere_is_missing() -> None:
    async with serve() as endpoint:
        endpoint.text = "I cannot see anything."
        check = await doctor.check_model(endpoint.url("fine"), "some-model", None)
    assert check.status == "missing"
    assert "never with a valid action" in check.found


def test_a_model_without_its_endpoint_is_refused(calls: Calls) -> None:
    code, said = calls.run("doctor", "--model", "some-model")
    assert (code, "give --base-url and --model" in said) == (2, True)
