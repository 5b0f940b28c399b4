"""Task files: what is broken is named and skipped, the rest loads."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from webgym.core.errors import TaskFileError
from webgym.core.task import FactGroup, Rubric, Task
from webgym.tasks import draw, draw_spread, read_tasks, write_tasks


def task(number: int) -> Task:
    rubric = Rubric((FactGroup(1, "group", ("fact",)),))
    return Task(f"t{number}", "fünf Bücher", "http://x.test/", "Misc.", "News", rubric, "offline")


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "tasks.jsonl"
    tasks = [task(number) for number in range(3)]
    assert write_tasks(path, tasks) == 3
    assert read_tasks(path).tasks == tasks
    assert read_tasks(path).broken == []


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b'{"id": "t9", ', "malformed|truncated"),
        (b'{"id": "t9"}', "missing required field"),
        (b"not json", "malformed"),
        (b'{"extra": {"a": ' + b"[" * 100_000, "recursion"),
        (b'{"id": "\xff"}', "utf-8"),
        (msgspec.json.encode(task(0)), "second task"),
        (msgspec.json.encode(task(9)).replace(b'["fact"]', b"[]"), "empty"),
    ],
)
def test_a_broken_line_is_named_and_skipped(tmp_path: Path, line: bytes, reason: str) -> None:
    path = tmp_path / "tasks.jsonl"
    path.write_bytes(msgspec.json.encode(task(0)) + b"\n" + line + b"\n" + msgspec.json.encode(task(1)))
    found = read_tasks(path)
    assert [each.id for each in found.tasks] == ["t0", "t1"]
    (broken,) = found.broken
    assert (broken.file, broken.line) == (path, 2)
    assert re.search(reason, broken.reason.lower())


def test_marks_returns_and_missing_ends_are_survived(tmp_path: Path) -> None:
    path = tmp_path / "tasks.jsonl"
    lines = [msgspec.json.encode(task(number)) for number in range(2)]
    path.write_bytes(b"\xef\xbb\xbf" + lines[0] + b"\r\n\r\n" + lines[1])
    assert [each.id for each in read_tasks(path).tasks] == ["t0", "t1"]


@pytest.mark.parametrize("content", [b"", b"\n\n", b"nonsense\n"])
def test_a_file_without_tasks_is_an_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "tasks.jsonl"
    path.write_bytes(content)
    with pytest.raises(TaskFileError, match="holds no task"):
        read_tasks(path)


def test_an_unknown_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(TaskFileError, match="cannot read the task file"):
        read_tasks(tmp_path / "none.jsonl")
    with pytest.raises(TaskFileError, match="cannot read the task file"):
        read_tasks(tmp_path)


def test_drawing_is_seeded_and_without_replacement() -> None:
    assert draw(range(100), 10, seed=1) == draw(range(100), 10, seed=1) != draw(range(100), 10, seed=2)
    assert sorted(draw(range(100), None, seed=1)) == list(range(100))
    assert len(set(draw(range(100), 10, seed=1))) == 10


def test_a_spread_draw_visits_every_group_before_it_comes_back() -> None:
    items = [f"{group}{number}" for group in "abcd" for number in range(5)]
    drawn = draw_spread(items, 10, seed=3, key=lambda item: item[0])
    assert len(set(drawn)) == 10
    assert {item[0] for item in drawn[:4]} == {item[0] for item in drawn[4:8]} == set("abcd")
    assert drawn == draw_spread(items, 10, seed=3, key=lambda item: item[0])
    assert sorted(draw_spread(items, None, seed=3, key=lambda item: item[0])) == sorted(items)
