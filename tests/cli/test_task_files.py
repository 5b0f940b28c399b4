"""`webgym tasks convert` and `show`: into a pipe, and in a real terminal."""

from __future__ import annotations

import os
import pty
import re
import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

import pytest
from msgspec.structs import replace
from tests.conftest import webgym

from webgym.cli import main
from webgym.core.task import FactGroup, Rubric, Task
from webgym.tasks.formats import read_tasks, write_tasks

RUBRIC = Rubric(
    (FactGroup(1, "the book", ("it is green", "it is thin", "it is new")), FactGroup(2, "", ("it is cheap",)))
)


def made(count: int = 30) -> list[Task]:
    parent = Task(
        "deepshop/0", "Find the book.", "https://shop.example/", "Misc.", "News", RUBRIC, "deepshop"
    )
    child = replace(
        parent, id="deepshop/0+1", parent_id="deepshop/0", rubric=Rubric(RUBRIC.groups[:1]), split="train"
    )
    others = [
        replace(parent, id=f"deepshop/{number}", instruction=f"Find book {number}.", flags=("dated",))
        for number in range(1, count - 1)
    ]
    return [replace(parent, reference_answer="Hamlet", flags=("garbled",)), child, *others]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "tasks.parquet"
    write_tasks(path, made())
    return path


KEPT = ("--format", "csv", "parquet")
Run: TypeAlias = Callable[..., tuple[int, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """A command in this process: (exit code, what it printed)."""

    def call(*arguments: object) -> tuple[int, str]:
        with pytest.raises(SystemExit) as ended:
            main([str(each) for each in arguments])
        told = capsys.readouterr()
        return int(ended.value.code or 0), told.out + told.err

    return call


def lines(said: str) -> list[list[str]]:
    return [line.split("\t") for line in said.splitlines()]


# --- convert ------------------------------------------------------------------------------------------


def test_a_set_goes_through_all_formats_and_comes_back(file: Path, run: Run) -> None:
    folder = file.parent
    steps = [
        (file, folder / "own.jsonl.gz", ()),
        (folder / "own.jsonl.gz", folder / "published.jsonl", ("--format", "published")),
        (folder / "published.jsonl", folder / "again.parquet", ()),
    ]
    for source, out, options in steps:
        code, said = run("tasks", "convert", source, out, *options)
        assert code == 0, said
        assert said == f"30 tasks written to {out}\n"
    assert (folder / "again.parquet").read_bytes() == file.read_bytes()


def test_what_could_not_be_read_is_said_and_fails(tmp_path: Path, run: Run) -> None:
    source, out = tmp_path / "tasks.jsonl", tmp_path / "out.parquet"
    write_tasks(source, made(3))
    source.write_bytes(source.read_bytes() + b"{\n")
    code, said = run("tasks", "convert", source, out)
    assert code == 2
    assert f"left out {source}:4: " in said
    assert len(read_tasks(out).tasks) == 3


@pytest.fixture
def published(tmp_path: Path) -> Path:
    """Three published rows, of which the second says nothing that could be judged."""
    path = tmp_path / "test.jsonl"
    tasks = [replace(task, split="test", flags=()) for task in made(4)[2:]]
    tasks.insert(1, replace(tasks[0], id="deepshop/none", rubric=Rubric((FactGroup(1, "", ("None",)),))))
    write_tasks(path, tasks, format="published")
    return path


@pytest.mark.parametrize(
    "command",
    [("convert", "{}", "{}.parquet"), ("check", "{}"), ("validate", "{}"), ("show", "{}"), ("stats", "{}")],
    ids=lambda command: command[0],
)
def test_tasks_without_a_fact_to_judge_are_set_aside_and_counted(
    published: Path, run: Run, command: tuple[str, ...]
) -> None:
    _, said = run("tasks", *(part.format(published) for part in command))
    assert "set aside 1 tasks without a fact to judge; the first: " in said.replace("\n", " ")
    assert f"{published}:2: deepshop/none has no fact to judge" in said
    assert "deepshop/none" not in said.replace(f"{published}:2: deepshop/none", "")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("none.jsonl", "out.parquet"), "cannot read the task file"),
        (("tasks.parquet", "out.txt"), "has no known suffix"),
        (("tasks.parquet", "out.jsonl", "--format", "csv"), "'jsonl', 'parquet', 'published'"),
        (
            ("tasks.parquet", "out.jsonl", "--format", "parquet"),
            "not a valid file name for the format parquet",
        ),
        (("tasks.parquet", "folder"), "split the tasks first"),
    ],
)
def test_what_cannot_be_converted_is_one_line(
    file: Path, run: Run, arguments: tuple[str, ...], expected: str
) -> None:
    given = [each if each in KEPT else file.parent / each for each in arguments]
    code, said = run("tasks", "convert", *given)
    assert code == 2
    (line,) = said.splitlines()
    assert expected in line
    assert [each.name for each in file.parent.iterdir()] == ["tasks.parquet"]


# --- show, into a pipe --------------------------------------------------------------------------------


def test_a_pipe_gets_a_line_per_task(file: Path, run: Run) -> None:
    code, said = run("tasks", "show", file)
    assert code == 0
    assert lines(said)[0] == ["deepshop/0", "4", "medium", "shop.example", "Misc. / News", "Find the book."]
    assert len(lines(said)) == 30


@pytest.mark.parametrize(
    ("options", "ids"),
    [
        (("--level", "medium", "--text", "the book"), ["0"]),
        (("--split", "train"), ["0+1"]),
        (("--flag", "dated", "--limit", "2"), ["1", "2"]),
        (
            ("--flag", "dated", "--limit", "10", "--page", "3"),
            ["21", "22", "23", "24", "25", "26", "27", "28"],
        ),
        (("--website", "http://www.shop.example/x", "--text", "find book 7"), ["7", "17", "27"]),
        (("--domain", "misc.", "--subdomain", "news", "--source", "deepshop", "--limit", "1"), ["0"]),
    ],
)
def test_filters_and_pages(file: Path, run: Run, options: tuple[str, ...], ids: list[str]) -> None:
    code, said = run("tasks", "show", file, *options)
    assert code == 0, said
    assert [line[0].removeprefix("deepshop/") for line in lines(said)] == ids


def test_a_task_is_shown_whole_with_its_family(file: Path, run: Run) -> None:
    code, said = run("tasks", "show", file, "deepshop/0")
    assert code == 0
    for part in ("medium, 4 facts", "Find the book.", "1. the book", "- it is thin", "Hamlet", "garbled"):
        assert part in said
    assert re.search(r"1 tasks derived from it\n +deepshop/0\+1 +groups 1 ", said)
    code, said = run("tasks", "show", file, "deepshop/0+1")
    assert re.search(r"derived from\n +deepshop/0 +groups 1, 2 ", said)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("shop/28",), "similar ids: deepshop/28"),
        (("nothing",), "webgym tasks show"),
        (("--level", "hardest"), "--level is one of medium, easy"),
        (("--domain", "Sports"), "--domain is one of Misc."),
        (("--text", "no such words"), "give fewer conditions"),
        (("--limit", "20", "--page", "3"), "there are 2"),
    ],
)
def test_what_is_not_there_is_said_with_what_is(
    file: Path, run: Run, arguments: tuple[str, ...], expected: str
) -> None:
    code, said = run("tasks", "show", file, *arguments)
    assert code == 2
    (line,) = said.splitlines()
    assert expected in line


def test_characters_that_a_terminal_obeys_are_not_printed(tmp_path: Path, run: Run) -> None:
    hostile = "\x1b]0;owned\x07\x1b[2Jline one\nline\ttwo\u202e"
    write_tasks(
        tmp_path / "t.jsonl", [replace(made(2)[0], instruction=hostile, extra={"\x1b[1m": "\x1b[2m"})]
    )
    for arguments in ((), ("deepshop/0",)):
        code, said = run("tasks", "show", tmp_path / "t.jsonl", *arguments)
        assert code == 0
        assert "line one line two" in said
        assert not set(said) & {"\x1b", "\x07", "\u202e"}


def test_a_reader_that_has_seen_enough_is_no_error(tmp_path: Path) -> None:
    write_tasks(tmp_path / "t.jsonl", made(5_000))
    shell = (
        f"set -o pipefail; {' '.join(map(_quoted, webgym('tasks', 'show', tmp_path / 't.jsonl')))} | head -1"
    )
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("deepshop/0\t")


def _quoted(argument: str) -> str:
    return "'" + argument.replace("'", "'\\''") + "'"


# --- show, in a terminal ------------------------------------------------------------------------------


def test_in_a_terminal_the_list_opens_in_the_pager(file: Path) -> None:
    ours, theirs = pty.openpty()
    command = webgym("tasks", "show", file, "--flag", "garbled")
    environment = os.environ | {"PAGER": "cat -n"}
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, env=environment) as process:
        os.close(theirs)
        said = b""
        with suppress(OSError):  # the other end is gone
            while got := os.read(ours, 65536):
                said += got
    os.close(ours)
    assert process.returncode == 0
    assert [line.split()[:3] for line in said.decode().splitlines()] == [["1", "deepshop/0", "4"]]


def test_check_and_validate_count_websites_alike(tmp_path: Path, run: Run) -> None:
    """By registrable domain: addresses of one website are one."""
    tasks = [
        replace(task, website=f"https://www.shop.example/{place}") for place, task in enumerate(made(4)[2:])
    ]
    write_tasks(tmp_path / "tasks.jsonl", [*tasks, replace(made(3)[2], id="x/1", website="m.shop.example")])
    said = [run("tasks", verb, tmp_path / "tasks.jsonl")[1] for verb in ("check", "validate")]
    assert all("tasks on 1 websites" in each for each in said), said
