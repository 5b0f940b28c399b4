"""Which Chromium is taken, on machines made of fake executables."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from webgym.browser.find import FULL, find_browser, run_bounded
from webgym.core.errors import BrowserNotFound


class Machine:
    """A folder of programs that is the whole PATH, an empty home, and a counter of program starts."""

    def __init__(self, root: Path) -> None:
        self.programs = root / "bin"
        self.home = root / "home"
        self.log = root / "started"
        self.playwright = self.home / ".cache" / "ms-playwright"
        self.programs.mkdir()
        self.home.mkdir()

    def write(self, path: Path, script: str) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'#!/bin/sh\necho "$0 $@" >> {self.log}\n{script}\n')
        path.chmod(0o755)
        return path

    def program(self, name: str, says: str = "Chromium 156.0.8078.79 built on Debian") -> Path:
        return self.write(self.programs / name, f"echo '{says}'")

    def playwright_shell(self, revision: int, *, whole: bool = True, name: str = "headless_shell") -> Path:
        folder = self.playwright / f"chromium_headless_shell-{revision}"
        path = self.write(
            folder / "chrome-linux" / name, f"echo 'Google Chrome for Testing 159.0.{revision}.6'"
        )
        if whole:
            (folder / "INSTALLATION_COMPLETE").touch()
        return path

    def starts(self) -> list[str]:
        return self.log.read_text().splitlines() if self.log.exists() else []


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Machine:
    made = Machine(tmp_path)
    monkeypatch.setenv("PATH", str(made.programs))
    monkeypatch.setenv("HOME", str(made.home))
    for name in ("WEBGYM_BROWSER", "PLAYWRIGHT_BROWSERS_PATH", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    return made


def test_a_full_browser_by_one_word(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    shell = machine.program("chromium-headless-shell")
    with pytest.raises(BrowserNotFound):
        find_browser(FULL)
    full = machine.program("chromium")
    assert find_browser().path == shell
    monkeypatch.setenv("WEBGYM_BROWSER", str(shell))
    assert find_browser(FULL).path == full


def test_the_order_of_places(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Adding a better one to the machine each time changes what is found."""
    chrome = machine.program("google-chrome", says="Google Chrome 150.0.1.2 ")
    found = find_browser()
    assert (found.path, found.kind, found.version, found.origin) == (
        chrome,
        "chrome",
        "150.0.1.2",
        "system",
    )
    for name, kind in [
        ("chromium-browser", "chromium"),
        ("chromium", "chromium"),
        ("chromium-headless-shell", "headless-shell"),
    ]:
        better = machine.program(name)
        found = find_browser()
        assert (found.path, found.kind, found.version) == (better, kind, "156.0.8078.79")
    shell = machine.playwright_shell(1200)
    found = find_browser()
    assert (found.path, found.kind, found.version, found.origin) == (
        shell,
        "headless-shell",
        "159.0.1200.6",
        "playwright",
    )
    from_environment = machine.program("mine")
    monkeypatch.setenv("WEBGYM_BROWSER", str(from_environment))
    found = find_browser()
    assert (found.path, found.origin) == (from_environment, "setting")
    argument = machine.program("theirs")
    assert find_browser(argument).path == argument


def test_of_playwrights_shells_the_newest_that_is_whole(machine: Machine) -> None:
    machine.playwright_shell(999)
    newest = machine.playwright_shell(1255, name="chrome-headless-shell")
    machine.playwright_shell(1300, whole=False)
    assert find_browser().path == newest


def test_one_that_does_not_work_is_passed_over(machine: Machine) -> None:
    """Ubuntu's chromium-browser is a stub that asks for a snap."""
    machine.write(
        machine.programs / "chromium",
        "echo 'Command requires the chromium snap to be installed.' >&2; exit 1",
    )
    chrome = machine.program("google-chrome-stable", says="Google Chrome 150.0.1.2")
    assert find_browser().path == chrome


def test_no_browser_is_an_error_that_says_what_to_do(machine: Machine) -> None:
    stub = machine.write(machine.programs / "chromium", "echo 'install the snap' >&2; exit 1")
    with pytest.raises(BrowserNotFound, match="install the snap") as caught:
        find_browser()
    assert str(stub) in caught.value.message
    assert "make setup" in caught.value.hint
    assert "playwright install chromium-headless-shell" in caught.value.hint


@pytest.mark.parametrize("way", ["argument", "environment"])
@pytest.mark.parametrize(
    ("name", "script", "reason"),
    [
        ("missing", None, "there is no browser at"),
        ("mute", "exit 0", "is not a working Chromium, it printed: nothing"),
        ("other", "echo 'GNU bash, version 5.2.15'", "it printed: GNU bash"),
        ("broken", "echo 'libnss3.so: cannot open' >&2; exit 127", "it printed: libnss3.so"),
    ],
)
def test_what_is_asked_for_by_name_is_it_or_an_error(
    machine: Machine,
    monkeypatch: pytest.MonkeyPatch,
    way: str,
    name: str,
    script: str | None,
    reason: str,
) -> None:
    machine.program("chromium")
    path = machine.programs / name
    if script is not None:
        machine.write(path, script)
    if way == "environment":
        monkeypatch.setenv("WEBGYM_BROWSER", str(path))
    with pytest.raises(BrowserNotFound) as caught:
        find_browser(path if way == "argument" else None)
    assert reason in caught.value.message
    assert "WEBGYM_BROWSER" in caught.value.hint


def test_an_explicit_file_must_be_executable(machine: Machine) -> None:
    machine.program("chromium")
    path = machine.program("plain")
    path.chmod(0o644)
    with pytest.raises(BrowserNotFound, match="is not an executable file"):
        find_browser(path)
    with pytest.raises(BrowserNotFound, match="is not an executable file"):
        find_browser(machine.programs)


def test_the_version_is_asked_once_per_file(machine: Machine) -> None:
    path = machine.program("chromium")
    assert find_browser() == find_browser()
    assert len(machine.starts()) == 1
    machine.program("chromium", says="Chromium 157.0.0.1")
    os.utime(path, ns=(1, 1))
    assert find_browser().version == "157.0.0.1", "another file under the same name is asked again"


def test_a_browser_that_hangs_is_ended_with_its_children(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.browser.find.VERSION_SECONDS", 0.3)
    marker = machine.home / "survived"
    path = machine.write(
        machine.programs / "hangs", f"PATH={os.defpath}; (sleep 1; touch {marker}) & sleep 60"
    )
    started = time.monotonic()
    with pytest.raises(BrowserNotFound, match=r"did not print its version within 0\.3 s"):
        find_browser(path)
    assert time.monotonic() - started < 50, "it did not wait for the minute that the child sleeps"
    # The child would have written its file by the time that another such program has ended.
    run_bounded(["/bin/sh", "-c", "sleep 1.2"], seconds=10)
    assert not marker.exists()
