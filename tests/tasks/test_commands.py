"""``webgym tasks split``, ``validate``, ``sample`` and ``stats``."""

from __future__ import annotations

import asyncio
import hashlib
import json
import random
from pathlib import Path

import msgspec
import pytest
from tests.conftest import Calls
from tests.tasks.making import task

from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Reply, Step, Trajectory
from webgym.store.runs import RunWriter
from webgym.tasks.formats import read_tasks, write_tasks
from webgym.tasks.taxonomy import DOMAIN_OF


def many(count: int = 200, websites: int = 60) -> list[Task]:
    rng = random.Random(5)
    return [
        task(
            f"s/{number}",
            f"https://www.site{rng.randrange(websites)}.example/{number}",
            rng.choice((1, 1, 1, 4, 7)),
            subdomain=rng.choice(sorted(DOMAIN_OF)),
        )
        for number in range(count)
    ]


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    path = tmp_path / "whole.jsonl"
    write_tasks(path, many())
    return path


def test_split_then_validate(calls: Calls, tmp_path: Path, whole: Path) -> None:
    out, left = tmp_path / "set", tmp_path / "left.jsonl"
    output = calls.printed("tasks", "split", whole, "--out", out, "--test", 12, "--left-out", left)
    train, test = (read_tasks(out / f"{name}.jsonl").tasks for name in ("train", "test"))
    assert len(test) == 12
    gone = [json.loads(line) for line in left.read_text().splitlines()]
    assert len(train) + 12 + len(gone) == 200
    assert f"{len(gone)} left out: test website" in output
    assert "188" not in output or len(train) == 188
    output = calls.printed("tasks", "validate", out)
    assert "ok  no training task is on a test website" in output
    code, again = calls.run("tasks", "validate", out / "train.jsonl", out / "test.jsonl")
    assert (code, again) == (0, output)


def test_validate_names_offenders_in_any_files(calls: Calls, tmp_path: Path) -> None:
    # The files' names say what they are for; the tasks do not.
    write_tasks(
        tmp_path / "test.jsonl", [task("t/1", "https://m.leaky.example/"), task("t/2", "other.example")]
    )
    write_tasks(
        tmp_path / "train.parquet", [task("a/1", "WWW.LEAKY.example:80"), task("t/2", "fine.example")]
    )
    report = tmp_path / "report.json"
    files = (tmp_path / "test.jsonl", tmp_path / "train.parquet")
    output = calls.printed("tasks", "validate", *files, "--json", report, code=1)
    assert "BAD no training task is on a test website: 1 exceptions" in output
    assert "leak: a/1 (leaky.example): the test task t/1 is on it" in output
    assert "id: t/2 (fine.example): a second task with this id" in output
    held = json.loads(report.read_bytes())["report"]
    assert [(each["rule"], each["id"]) for each in held["offenders"]] == [
        ("id", "t/2"),
        ("leak", "a/1"),
        ("family", "t/2"),
    ]


@pytest.mark.parametrize("collection", ["large", "small"])
def test_our_own_set_is_valid(calls: Calls, tmp_path: Path, collection: str) -> None:
    path = tmp_path / "offline.jsonl"
    few = ("--collection", collection, "--per-family", 6)
    code, _, shown = calls.apart("tasks", "offline", "--out", path, *few, FORCE_COLOR="1")
    assert code == 0
    assert "websites" in shown  # as in a terminal, while they are made
    assert " 0 for testing" not in calls.printed("tasks", "validate", path)


def test_validate_fails_over_a_broken_record_and_over_tasks_without_a_split(
    calls: Calls, tmp_path: Path
) -> None:
    path = tmp_path / "tasks.jsonl"
    path.write_bytes(msgspec.json.encode(task("a/1")) + b"\nnonsense\n")
    output = calls.printed("tasks", "validate", path, "--unsplit", code=2)
    assert "every record can be read: 1 cannot" in output
    path.write_bytes(msgspec.json.encode(task("a/1")) + b"\n")
    output = calls.printed("tasks", "validate", path, "--unsplit")
    assert "ok  no training task is on a test website" not in output
    assert "--  not checked, as the tasks are not split yet: no training task is on a test website" in output
    assert "it is for neither training nor testing" in calls.printed("tasks", "validate", path, code=1)


def test_split_says_how_many_websites_there_are(calls: Calls, tmp_path: Path, whole: Path) -> None:
    output = calls.printed("tasks", "split", whole, "--out", tmp_path / "set", code=2)
    assert "1,167 test tasks need as many websites, and there are 5" in output
    assert not (tmp_path / "set").exists()
    output = calls.printed("tasks", "split", whole, whole, "--out", tmp_path / "set", "--test", 1, code=2)
    assert "two tasks have the id" in output


def test_sample_goes_on_where_it_left_off(calls: Calls, tmp_path: Path, whole: Path) -> None:
    state, out = tmp_path / "state.json", tmp_path / "drawn.jsonl"
    options = ("--count", 80, "--seed", 3, "--state", state)
    drawn = []
    for _ in range(2):
        calls.printed("tasks", "sample", whole, *options, "--out", out)
        drawn += [each.id for each in read_tasks(out).tasks]
    assert len(set(drawn)) == 160
    assert calls.printed("tasks", "sample", whole, "--count", 80, "--seed", 3).split() == drawn[:80]
    other = ("--count", 80, "--seed", 4, "--state", state)
    assert "belongs to other tasks or settings" in calls.printed("tasks", "sample", whole, *other, code=2)


def test_a_file_of_drawn_tasks_holds_each_once(calls: Calls, tmp_path: Path, whole: Path) -> None:
    out = tmp_path / "drawn.jsonl"
    output = calls.printed("tasks", "sample", whole, "--count", 450, "--out", out)
    assert "200 tasks written" in output
    assert "250 repeated draws are left out" in output
    held = read_tasks(out)
    assert len(held.tasks) == 200
    assert not held.broken
    output = calls.printed("tasks", "sample", whole, "--count", 450)
    assert "250 repeated draws are printed: all tasks had been drawn" in output


def test_a_read_only_file_system_is_one_line(
    calls: Calls, tmp_path: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "unlink", refuse)
    (tmp_path / "taken").touch()
    out = tmp_path / "taken" / "drawn.jsonl"
    output = calls.printed("tasks", "sample", whole, "--count", 3, "--out", out, code=2)
    assert f"webgym: cannot write {out}: " in output


def test_sample_draws_nothing_that_leaks_a_broken_test_task_of_another_file(
    calls: Calls, tmp_path: Path
) -> None:
    train, test = tmp_path / "train.jsonl", tmp_path / "test.jsonl"
    rows = [task(f"s/{name}", f"https://{name}.example/", 1) for name in "abc"]
    write_tasks(train, rows[:2])
    write_tasks(test, rows[2:])
    held = {"id": "s/d", "website": "https://www.a.example/x", "split": "test"}
    test.write_bytes(test.read_bytes() + msgspec.json.encode(held) + b"\n")
    code, out, told = calls.apart("tasks", "sample", train, test, "--count", 2)
    assert (code, set(out.split())) == (0, {"s/b"}), told
    assert "left out: s/a on a.example shares the website of the test task s/d" in told


def test_sample_chooses(calls: Calls, tmp_path: Path, whole: Path) -> None:
    out = tmp_path / "drawn.jsonl"
    options = ("--ratio", "1:1:2", "--without", "Entertainment", "--block", "https://site3.example/x")
    calls.printed("tasks", "sample", whole, "--count", 8, *options, "--shard", "1/2", "--out", out)
    drawn = read_tasks(out).tasks
    assert sorted(each.level for each in drawn) == ["easy"] * 2 + ["hard"] * 4 + ["medium"] * 2
    assert not [each for each in drawn if each.domain == "Entertainment" or "//www.site3." in each.website]
    for wrong, said in (
        (("--ratio", "2:1"), "is not a ratio"),
        (("--shard", "2"), "is not a shard"),
        (("--shard", "2/2"), "there is no shard 2 of 2"),
        (("--domain", "Cooking"), "unknown domain 'Cooking'"),
        (("--block", "no website"), "does not name a website"),
        (("--split", "all", "--count", "1", "--domain", "News", "--without", "News"), "no task to draw"),
    ):
        assert said in calls.printed("tasks", "sample", whole, *wrong, code=2)


def test_stats_in_every_form(calls: Calls, tmp_path: Path, whole: Path) -> None:
    figures = tmp_path / "figures"
    assert "6 files written to" in calls.printed("tasks", "stats", whole, "--figures", figures)
    assert {path.name for path in figures.iterdir()} == {
        f"{name}.{suffix}" for name in ("websites", "difficulty", "domains") for suffix in ("png", "svg")
    }
    stats = ("tasks", "stats", whole)
    assert f"webgym: cannot write to {whole}: " in calls.printed(*stats, "--figures", whole, code=2)
    assert json.loads(calls.printed(*stats, "--form", "json"))["tasks"] == 200
    head = "| source | websites | tasks | derived | train | test |"
    assert head in calls.printed(*stats, "--form", "markdown")
    begin = "Tasks by source\nsource,websites,tasks,derived,train,test\ninsta-v3,"
    assert calls.printed(*stats, "--form", "csv").startswith(begin)
    calls.printed(*stats, "--form", "pie", code=2)


PICTURE = b"the store does not look inside"
NAME = hashlib.sha256(PICTURE).hexdigest()


def attempt(task: Task, sample: int, steps: int, outcome: Outcome) -> Trajectory:
    seen = Observation(NAME, "https://a.example/", "", (1, 1))
    turns = tuple(Step(index, seen, (), Reply("", "scripted")) for index in range(steps))
    name = f"{task.id}#{sample}.0"
    episode = Episode(name, task.id, sample, 0, 0, "scripted", 0.0, 1.0, turns, Ending.ANSWERED)
    return Trajectory(episode, outcome)


def run_of(path: Path, attempts: list[tuple[Task, int, Outcome]]) -> Path:
    """A run folder with attempts of so many steps."""

    async def write() -> None:
        tasks = list({task.id: task for task, _, _ in attempts}.values())
        async with await RunWriter.create(path, {"seed": 0}, tasks) as writer:
            await writer.put_image(NAME, PICTURE)
            for sample, (task, steps, outcome) in enumerate(attempts):
                await writer.append(attempt(task, sample, steps, outcome))

    asyncio.run(write())
    return path


def test_stats_take_lengths_from_runs(calls: Calls, tmp_path: Path, whole: Path) -> None:
    easy, hard = (next(each for each in many() if each.level == level) for level in ("easy", "hard"))
    run = run_of(
        tmp_path / "run",
        [
            (easy, 2, Outcome.SUCCESS),
            (easy, 6, Outcome.FAILURE),
            (hard, 8, Outcome.FAILURE),
            (hard, 9, Outcome.TRUNCATED),  # not answered: its length is the budget's
            (hard, 40, Outcome.ENVIRONMENT_ERROR),  # carries no reward, so it says nothing
        ],
    )
    output = calls.printed("tasks", "stats", whole, "--run", run, "--form", "json")
    lengths = json.loads(output)["lengths"]
    assert {level: found["counts"] for level, found in lengths.items()} == {
        "easy": {"2": 1, "6": 1},
        "hard": {"8": 1},
    }
    calls.printed("tasks", "stats", whole, "--run", tmp_path, code=2)


def test_sample_prefers_what_succeeded_half_the_time(calls: Calls, tmp_path: Path, whole: Path) -> None:
    tasks = many()
    attempts = [
        (task, 1, Outcome.SUCCESS if place < 100 or sample % 2 else Outcome.FAILURE)
        for place, task in enumerate(tasks)
        for sample in range(4)
    ]
    run = run_of(tmp_path / "run", attempts)
    output = calls.printed("tasks", "sample", whole, "--count", 10, "--curriculum", run)
    assert len(set(output.split()) & {task.id for task in tasks[100:]}) >= 7
    options = ("--curriculum", run, "--spread-websites")
    assert "exclude each other" in calls.printed("tasks", "sample", whole, *options, code=2)


@pytest.mark.parametrize("command", ["sample", "validate", "check", "stats", "split", "show", "convert"])
def test_a_terminal_obeys_nothing_that_a_task_file_says(calls: Calls, tmp_path: Path, command: str) -> None:
    """Neither markup nor escape codes: not from a task that can be read, and not from one that cannot."""
    evil = "[/x][red]\x1b[2J\x9b2J\u202e"
    held = [
        msgspec.structs.replace(task(f"{evil}{number}"), domain=evil, subdomain=evil, instruction=evil)
        for number in range(2)
    ]
    path = tmp_path / "evil.jsonl"
    write_tasks(path, [*held, msgspec.structs.replace(held[0], website=evil, id="third", parent_id=evil)])
    path.write_bytes(path.read_bytes() * 2)  # the second time round, their ids are taken
    more = {"split": ("--out", tmp_path / "out"), "convert": (tmp_path / "out.jsonl",)}.get(command, ())
    few = {"sample": ("--split", "unsplit"), "split": ("--test", 1)}.get(command, ())
    code = 2 if command in ("validate", "check", "convert") else 0
    output = calls.printed("tasks", command, path, *more, *few, code=code)
    assert "Error" not in output
    assert not any(character in output for character in "\x1b\x9b\u202e")
    assert "[/x][red]" in output
