"""Task files: what is broken is named and skipped, the rest loads."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from webgym.core.errors import ConfigError, TaskFileError
from webgym.core.task import WHOLE_TASK, FactGroup, Rubric, Task
from webgym.judge.config import JudgeChoice, JudgeConfig
from webgym.judge.factory import refuse_unjudgeable
from webgym.llm.config import ChatConfig
from webgym.tasks.formats import read_tasks, write_tasks
from webgym.tasks.sampling import draw, draw_spread
from webgym.tasks.taxonomy import DOMAIN_OF

RUBRIC = JudgeConfig(chat=ChatConfig(base_url="http://127.0.0.1:9/v1", model="m"))


def task(number: int) -> Task:
    rubric = Rubric((FactGroup(1, "group", ("fact",)),))
    return Task(f"t{number}", "fünf Bücher", "http://x.test/", "Misc.", "News", rubric, "offline")


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "tasks.jsonl"
    tasks = [task(number) for number in range(3)]
    assert write_tasks(path, tasks) == 3
    assert read_tasks(path).tasks == tasks
    assert read_tasks(path).broken == []


def own(**said: object) -> bytes:
    """A record of somebody's own, as short as it may be."""
    return msgspec.json.encode({"instruction": "Look.", "website": "localhost:8000", **said})


def test_an_instruction_and_an_address_make_a_task(tmp_path: Path) -> None:
    path = tmp_path / "mine.jsonl"
    path.write_bytes(own() + b"\n" + own(website="https://a.example/", id="own/7", notes="not read") + b"\n")
    found = read_tasks(path)
    assert not found.broken
    first, second = found.tasks
    assert (first.id, first.rubric, first.source, second.id) == ("mine/1", WHOLE_TASK, "own", "own/7")
    assert DOMAIN_OF[first.subdomain] == first.domain
    write_tasks(tmp_path / "again.jsonl", found.tasks)
    assert read_tasks(tmp_path / "again.jsonl").tasks == found.tasks
    refuse_unjudgeable(JudgeChoice(name="rubric", rubric=RUBRIC, without_rubric=True), found.tasks)
    said = r"2 of 2 tasks: mine/1 has no rubric \(.* with the setting judge\.without_rubric: true\)$"
    with pytest.raises(ConfigError, match=said):
        refuse_unjudgeable(JudgeChoice(name="rubric", rubric=RUBRIC), found.tasks)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b'{"id": "t9", ', "malformed|truncated"),
        (b'{"id": "t9"}', "instruction: it is missing; website: it is missing"),
        (b'{"rubric": [{"id": 1}]}', 'missing required field.*; write {"groups": .*"facts": '),
        (b'{"instructoin": 7, "website": 7}', "did you mean instruction.*instruction: it is missing"),
        (own(website="not a url"), "'not a url' does not name a website"),
        (own(website="file:///etc/passwd"), "not an http or https address"),
        (own(website="javascript:alert(1)"), "not an http or https address"),
        (own(website="https:/www.amazon.com/"), "not an http or https address"),
        (own(website="https:www.amazon.com"), "not an http or https address"),
        (own(website=r"HTTPS:\\www.amazon.com"), "not an http or https address"),
        (own(website="https:3m.com"), "not an http or https address"),
        (own(website="view-source:https://amazon.com/"), "not an http or https address"),
        (own(website="http://169.254.169.254/latest/meta-data"), "metadata service"),
        (own(website="http://[fe80::1]/"), "metadata service"),
        (own(website="2852039166"), "metadata service"),
        (own(website="http://metadata.google.internal./computeMetadata"), "metadata service"),
        (own(instruction="x" * 160_000, website="x" * 9_000), "160,000 characters.*website: it"),
        (own(id="", instruction=" "), "id: it is empty; instruction: it is empty"),
        (own(rubric={"groups": []}), "rubric: a rubric needs"),
        (own(refrence_answer="7"), "'refrence_answer'; did you mean reference_answer"),
        (b"not json", "malformed"),
        (b'{"extra": {"a": ' + b"[" * 100_000, "recursion"),
        (b'{"id": "\xff"}', "utf-8"),
        (msgspec.json.encode(task(0)), "second task"),
        (msgspec.json.encode(task(9)).replace(b'["fact"]', b"[]"), "empty"),
    ],
)
def test_a_broken_line_is_named_and_skipped(tmp_path: Path, line: bytes, reason: str) -> None:
    assert re.search(reason, told_of_broken(tmp_path / "tasks.jsonl", line))


def test_a_line_that_is_too_long_is_named_and_skipped(tmp_path: Path) -> None:
    line = own(instruction="x" * 160_000_000)  # made here, not in every process that collects the tests
    reason = "it has 160,000,0.. bytes, and at most 8,388,608 are taken"
    assert re.search(reason, told_of_broken(tmp_path / "tasks.jsonl", line))


def told_of_broken(path: Path, line: bytes) -> str:
    """What is told of a broken line between two good ones, which are read."""
    path.write_bytes(msgspec.json.encode(task(0)) + b"\n" + line + b"\n" + msgspec.json.encode(task(1)))
    found = read_tasks(path)
    assert [each.id for each in found.tasks] == ["t0", "t1"]
    (broken,) = found.broken
    assert (broken.file, broken.line) == (path, 2)
    return broken.reason.lower()


def test_marks_returns_and_missing_ends_are_survived(tmp_path: Path) -> None:
    path = tmp_path / "tasks.jsonl"
    lines = [msgspec.json.encode(task(number)) for number in range(2)]
    path.write_bytes(b"\xef\xbb\xbf" + lines[0] + b"\r\n\r\n" + lines[1])
    assert [each.id for each in read_tasks(path).tasks] == ["t0", "t1"]


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        *(("tasks.jsonl", content, "contains no task") for content in (b"", b"\n\n", b"nonsense\n")),
        *(
            ("tasks.jsonl", "\N{BYTE ORDER MARK}{}".encode(encoding), "UTF-16 or UTF-32")
            for encoding in ("utf-16", "utf-16-be", "utf-32")
        ),
        # Files of benchmarks are known by another command.
        ("tasks.json", b'[\n{"confirmed_task": "it", "website": "a.example"}\n]', "webgym tasks sources"),
    ],
)
def test_a_file_without_tasks_is_an_error(tmp_path: Path, name: str, content: bytes, why: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(TaskFileError, match=why):
        read_tasks(tmp_path / name)


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


def test_a_record_whose_split_is_misspelt_may_be_a_test_task(tmp_path: Path) -> None:
    """It is skipped, and no training task on its website is left."""
    file = tmp_path / "mine.jsonl"
    line = '{"id": "%s", "instruction": "Name the halls.", "website": "https://%s/", "split": "%s"}\n'
    rows = [("a", "halls.org", "Test"), ("b", "halls.org", "train"), ("c", "other.org", "train")]
    file.write_text("".join(line % row for row in rows))
    assert [task.id for task in read_tasks(file).tasks] == ["c"]
