"""What a user sees when a command cannot go on: one line on stderr and the right exit code."""

from __future__ import annotations

import asyncio
import errno
import io
import signal
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import pytest
import typer
from tests.conftest import Calls

from webgym import cli
from webgym.core.errors import ConfigError, ServerUnreachable, StoreFull

Tried: TypeAlias = Callable[..., tuple[int, str]]


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Tried:
    """Runs a function as the verb ``try``: the exit code, and what stands on stderr."""

    def run(command: Callable[..., None], *arguments: str) -> tuple[int, str]:
        module = types.ModuleType("webgym.cli.try")
        module.command = command  # type: ignore[attr-defined]
        module.__spec__ = types.SimpleNamespace()  # type: ignore[assignment]
        monkeypatch.setitem(sys.modules, "webgym.cli.try", module)
        monkeypatch.setattr(cli, "VERBS", (cli.Verb("try", "A verb of the tests."),))
        with pytest.raises(SystemExit) as ended:
            cli.main(["try", *arguments])
        assert isinstance(ended.value.code, int)
        return ended.value.code, capsys.readouterr().err

    return run


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (ConfigError("tasks must be positive", hint="give --tasks 1"), 2, "(give --tasks 1)"),
        (ServerUnreachable("nothing answers", hint="start one"), 1, "nothing answers (start one)"),
        (StoreFull("no space\nleft"), 1, "no space left"),
        (
            ZeroDivisionError("by zero"),
            1,
            "unexpected error ZeroDivisionError: by zero; run again with --debug",
        ),
        (ExceptionGroup("two", [ServerUnreachable("gone", hint="wait")]), 1, "gone (wait)"),
        (ExceptionGroup("two", [ServerUnreachable("gone"), ValueError("a bug")]), 1, "ValueError: a bug"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "a" * 300), 2, "'aaa"),
        (KeyboardInterrupt(), 130, ""),
        (BaseExceptionGroup("stop", [ValueError("late"), KeyboardInterrupt()]), 130, "interrupted"),
    ],
)
def test_an_error_is_one_line(tried: Tried, error: BaseException, code: int, line: str) -> None:
    def command() -> None:
        raise error

    exit_code, said = tried(command)
    assert exit_code == code
    assert line in said
    assert said.count("\n") <= 1
    assert "Traceback" not in said


def test_debug_adds_the_traceback_wherever_it_stands(tried: Tried) -> None:
    def command(number: int = 0) -> None:
        raise ServerUnreachable("nothing answers")

    for arguments in (["--debug"], ["--number", "3", "--debug"]):
        code, said = tried(command, *arguments)
        assert code == 1
        assert "Traceback" in said
        assert said.rstrip().endswith("webgym: nothing answers")


@pytest.mark.parametrize(
    "arguments", [["--numbr", "3"], ["--number", "three"], ["--number"], ["superfluous"]]
)
def test_wrong_arguments_are_one_line(tried: Tried, arguments: list[str]) -> None:
    def command(number: int = 0) -> None:
        raise AssertionError("must not run")

    code, said = tried(command, *arguments)
    assert code == 2
    assert said.count("\n") == 1
    assert "(see `webgym try --help`)" in said


def test_a_verb_sets_the_exit_code(tried: Tried) -> None:
    def command(fail: bool = False) -> None:
        if fail:
            raise typer.Exit(3)

    assert tried(command) == (0, "")
    assert tried(command, "--fail") == (3, "")


def test_ctrl_c_in_a_real_process(tmp_path: Path) -> None:
    """An asynchronous verb that is interrupted leaves no traceback and says 130 to the shell."""
    script = tmp_path / "interrupted.py"
    script.write_text(
        "import asyncio, sys, types\n"
        "from webgym import cli\n"
        "async def work():\n"
        "    async with asyncio.TaskGroup() as group:\n"
        "        group.create_task(asyncio.Event().wait())\n"
        "        print('ready', flush=True)\n"
        "module = types.ModuleType('webgym.cli.try')\n"
        "module.command = lambda: asyncio.run(work())\n"
        "module.__spec__ = types.SimpleNamespace()\n"
        "sys.modules['webgym.cli.try'] = module\n"
        "cli.VERBS = (cli.Verb('try', 'A verb of the tests.'),)\n"
        "cli.main(['try'])\n"
    )
    with subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=100)
    assert process.returncode == 130
    assert "Traceback" not in said


def test_help_lists_the_verbs_and_imports_none() -> None:
    script = (
        "import sys\n"
        "from webgym import cli\n"
        "try:\n    cli.main(['--help'])\n"
        "finally:\n"
        "    heavy = {'pydantic', 'jinja2', 'starlette', 'httpx', 'playwright', 'PIL'} & set(sys.modules)\n"
        "    print('HEAVY', sorted(heavy), [n for n in sys.modules if n.startswith('webgym.cli.')])\n"
    )
    answer = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
    )
    assert answer.returncode == 0
    assert "HEAVY [] []" in answer.stdout
    for verb in cli.VERBS:
        assert not verb.is_installed or f" {verb.name} " in answer.stdout


def test_without_arguments_the_help_is_shown(calls: Calls) -> None:
    code, out, _ = calls.apart(COLUMNS="200")
    assert code == 0
    assert "Usage: webgym" in out


def test_help_in_80_columns_is_whole(calls: Calls) -> None:
    said = calls.printed("rollout", "--help", COLUMNS="80")
    assert "WEBGYM_JUDGE_API_KEY" in said
    assert "…" not in said
    listed = calls.run("bench", "--help", COLUMNS="80")[1]
    assert "one queue for all operations" in " ".join(listed.split())


@pytest.mark.parametrize("columns", ["80", "120"])
def test_a_verb_without_its_sub_verb_shows_its_help_and_an_error_of_one_line(
    calls: Calls, columns: str
) -> None:
    code, out, err = calls.apart("llm", COLUMNS=columns)
    assert code == 2
    assert "Print calls, tokens and cost" in out
    assert err == "webgym: a command is missing (see `webgym llm --help`)\n"


def test_unknown_verbs_and_options(calls: Calls) -> None:
    for argument in ("rolout", "--verbose"):
        code, out, err = calls.apart(argument)
        assert (code, out) == (2, "")
        assert err.count("\n") == 1
        assert "(see `webgym --help`)" in err


def test_a_file_of_settings_without_its_option_names_the_option(calls: Calls) -> None:
    assert "--config" in calls.printed("rollout", "mine.yaml", code=2)
    assert "--config" not in calls.run("verify", "run", "mine.yaml")[1], "it has no such option"


def test_the_version(calls: Calls) -> None:
    assert calls.printed("--version").startswith("webgym 0.")


def test_asyncio_cancellation_is_no_success(tried: Tried) -> None:
    def command() -> None:
        raise asyncio.CancelledError

    code, said = tried(command)
    assert code == 1
    assert said.count("\n") == 1


def test_a_terminal_without_a_character_shows_its_code(tried: Tried, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(terminal, encoding="ascii"))
    assert tried(lambda: print("0 \u2013 1")) == (0, "")
    sys.stdout.flush()
    assert terminal.getvalue() == b"0 \\u2013 1\n"


def test_ctrl_c_leaves_the_cursor_visible(tried: Tried, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # as in a terminal

    def interrupted() -> None:
        raise KeyboardInterrupt

    code, err = tried(interrupted)
    assert code == 130
    assert "\x1b[?25h" in err
