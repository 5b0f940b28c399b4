"""``webgym tasks build``, end to end: from the ten sources' shapes to a set that validates.

The build runs as the command does, in a process of its own, against an endpoint that misbehaves.
"""

from __future__ import annotations

import asyncio
import io
import json
import os
import re
import shutil
import signal
import sqlite3
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from rich.console import Console
from tests.conftest import Calls
from tests.documented import documented
from tests.serving import beside
from tests.tasks.endpoint import Endpoint, serve
from tests.tasks.shapes import ask, write_shapes
from tests.tasks.sources import native
from tests.tasks.sources.native import as_lines

from webgym.cli import main
from webgym.core.errors import BudgetSpent, ConfigError, LLMBadReply, TaskFileError, UsageError
from webgym.core.task import Task
from webgym.llm.cache import ReplyCache
from webgym.tasks.formats import read_tasks
from webgym.taskset.batch import import_results
from webgym.taskset.construction.config import BuildConfig, read_config
from webgym.taskset.construction.progress import StageProgress
from webgym.taskset.construction.run import (
    BuildPaths,
    FinishedBuild,
    PendingBatches,
    run_batch,
    run_build,
    run_dry,
)
from webgym.taskset.validate import validate

QUIET = StageProgress(Console(file=io.StringIO()))
STOPPED = "interrupted: all replies are stored; run the same command again to continue\n"
DEADLINE = 90.0
TODAY = "2025-01-01"


class Ran(NamedTuple):
    code: int
    out: str
    err: str


class Command:
    """One ``webgym tasks build`` with everything but the folder."""

    def __init__(self, endpoint: Endpoint, folder: Path, *, plaintext: bool = True, count: int) -> None:
        self.sources = write_shapes(folder / "sources", count=count)
        self.config = folder / "build.yaml"
        self.config.write_text(
            json.dumps(
                {
                    "sources": {name: str(path) for name, path in self.sources.items()},
                    "model": {
                        "base_url": endpoint.url,
                        "model": "by-rule",
                        "concurrency": 8,
                        "retry": {
                            "tries": 2,
                            "refused_tries": 4,
                            "first_seconds": 0.01,
                            "longest_seconds": 0.02,
                        },
                    },
                    "plaintext": ["browsecomp"] if plaintext else [],
                    "today": TODAY,
                    "split": {"test_tasks": count},
                    "figures": False,
                }
            )
        )

    def settings(self, **changes: Any) -> BuildConfig:
        return read_config(self.config, changes)

    async def build(self, out: Path, **changes: Any) -> FinishedBuild:
        """Build in this process."""
        return await run_build(self.settings(**changes), BuildPaths.of(out), QUIET)

    async def start(self, out: Path, *options: str) -> asyncio.subprocess.Process:
        arguments = [
            "-m",
            "webgym",
            "tasks",
            "build",
            "--config",
            str(self.config),
            "--out",
            str(out),
            *options,
        ]
        return await asyncio.create_subprocess_exec(
            sys.executable,
            *arguments,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env=os.environ | {"MPLBACKEND": "agg"},
        )

    async def run(self, out: Path, *options: str) -> Ran:
        process = await self.start(out, *options)
        async with asyncio.timeout(DEADLINE):
            told, wrong = await process.communicate()
        return Ran(process.returncode or 0, told.decode(), wrong.decode())


def files(out: Path) -> dict[str, bytes]:
    """What a build left, but for the account of what was paid."""
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and not path.name.startswith("replies.sqlite") and path.name != "config.yaml"
    }


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_bytes().splitlines()]


def all_tasks(out: Path) -> list[Task]:
    return [*read_tasks(out / "train.jsonl").tasks, *read_tasks(out / "test.jsonl").tasks]


def replies(out: Path) -> int:
    with sqlite3.connect(f"file:{out / 'replies.sqlite'}?mode=ro", uri=True) as connection:
        return int(connection.execute("select count(*) from replies").fetchone()[0])


async def until(condition: Any) -> None:
    async with asyncio.timeout(DEADLINE):
        while not condition():
            await asyncio.sleep(0.02)


async def killed_after(command: Command, endpoint: Endpoint, out: Path, answers: int) -> None:
    """Run the build until the endpoint has answered so often, and kill it while it waits for more."""
    endpoint.hold_after = answers
    endpoint.holding.clear()
    process = await command.start(out)
    async with asyncio.timeout(DEADLINE):
        await endpoint.holding.wait()
    await until(lambda: replies(out) == sum(endpoint.paid.values()))
    process.send_signal(signal.SIGKILL)
    await process.communicate()
    assert process.returncode == -signal.SIGKILL
    await asyncio.sleep(0.1)  # what it had sent is read
    await until(lambda: not endpoint.answering)  # or the dead would still be answered, and pay
    endpoint.hold_after = None
    assert not (out / "manifest.json").exists()


@pytest.mark.timeout(240)  # five builds one after the other
async def test_a_build_from_all_ten_shapes_survives_being_killed_twice(tmp_path: Path) -> None:
    async with serve() as endpoint:
        command = Command(endpoint, tmp_path, count=5)
        whole = tmp_path / "whole"
        await command.build(whole)
        asked = Counter(endpoint.paid)
        by_kind = Counter(endpoint.kinds)
        assert min(by_kind.values()) > 5

        endpoint.paid.clear()
        resumed = tmp_path / "resumed"
        await killed_after(command, endpoint, resumed, by_kind["website"] // 2)
        await killed_after(command, endpoint, resumed, by_kind["website"] + by_kind["rubric"] // 2)
        ran = await command.run(resumed)
        assert (ran.code, ran.err) == (0, "")

        assert max(endpoint.paid.values()) == 1, "no reply is paid for twice"
        assert endpoint.paid == asked
        assert files(resumed) == files(whole)

        endpoint.paid.clear()
        await command.build(resumed)
        assert not endpoint.paid, "nothing is asked again"
        assert files(resumed) == files(whole)
    check(whole, command)


def check(out: Path, command: Command) -> None:
    """The set validates, and the manifest tells the same story as the files."""
    tasks = all_tasks(out)
    assert validate(tasks).ok
    told = json.loads((out / "manifest.json").read_bytes())
    assert set(told["sources"]) == set(command.sources)
    stages = list(told["stages"])
    for before, stage in zip([None, *stages], stages, strict=False):
        for source, row in told["stages"][stage].items():
            assert row["came"] + row["made"] == row["left"] + sum(row["lost"].values())
            if before is not None:
                assert row["came"] == told["stages"][before][source]["left"]
    left = Counter(task.source for task in tasks)
    assert {source: row["left"] for source, row in told["stages"]["split"].items() if row["left"]} == dict(
        left
    )
    failed = Counter(each["stage"] for each in lines(out / "failed.jsonl"))
    dropped = Counter((each["stage"], each["reason"]) for each in lines(out / "dropped.jsonl"))
    for stage in stages:
        lost: Counter[str] = Counter()
        for row in told["stages"][stage].values():
            lost.update(row["lost"])
        assert lost["failed"] == failed[stage]
        noted = {reason: count for (where, reason), count in dropped.items() if where == stage}
        if stage != "import":
            assert {reason: count for reason, count in lost.items() if reason != "failed"} == noted
    assert len(lines(out / "skipped.jsonl")) == sum(
        row["lost"].get("no task", 0) for row in told["stages"]["import"].values()
    )
    assert told["sources"]["gaia-web"]["paper_tasks"] == 87
    assert {split: len(read_tasks(out / f"{split}.parquet").tasks) for split in ("train", "test")} == {
        split: told["tasks"][split]["tasks"] for split in ("train", "test")
    }
    assert told["tasks"]["test"]["tasks"] == 5
    assert any(task.parent_id for task in tasks)
    assert {task.website_from for task in tasks} == {"given", "derived", "inferred"}
    assert failed["rubrics"]
    assert dropped["duplicates", "same"]
    assert (out / "statistics.json").exists()


async def test_ctrl_c_is_one_line_and_loses_nothing(tmp_path: Path) -> None:
    async with serve() as endpoint:
        command = Command(endpoint, tmp_path, count=4)
        out = tmp_path / "out"
        endpoint.hold_after = 10
        process = await command.start(out, "--test-size", "3")
        async with asyncio.timeout(DEADLINE):
            await endpoint.holding.wait()
            await until(lambda: replies(out) == 10)
            process.send_signal(signal.SIGINT)
            _, wrong = await process.communicate()
        assert (process.returncode, wrong.decode()) == (130, STOPPED)
        endpoint.hold_after = None
        await command.build(out, figures=True)
        assert max(endpoint.paid.values()) == 1
        assert list((out / "figures").glob("*.svg"))


PRICES = {"*": {"prompt": 1, "completion": 4}}


async def test_a_dry_run_counts_before_it_asks_and_measures_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with serve() as endpoint:
        command = Command(endpoint, tmp_path, count=6)
        place = BuildPaths.of(tmp_path / "out")
        before = await run_dry(command.settings(prices=PRICES), place, QUIET)
        assert not endpoint.paid
        assert not place.out.exists()
        website, rubric, rewriting = before.lines
        assert (website.there, rubric.there, rewriting.there) == (0, 0, 0)
        assert rubric.things > 40
        assert "assumed" in rubric.basis
        assert "derived from each" in rewriting.basis
        assert before.dollars is not None
        assert before.dollars > 0

        await command.build(place.out)
        paid = sum(endpoint.paid.values())
        assert 0.6 * paid < before.calls < 1.4 * paid
        after = await run_dry(command.settings(prices=PRICES), place, QUIET)
        assert (after.calls, after.dollars) == (0, 0)
        assert [line.there for line in after.lines] == [line.things for line in after.lines]
        assert sum(endpoint.paid.values()) == paid

        half = {name: {"at_most": 3} for name in command.sources}
        other = BuildPaths.of(tmp_path / "other", tmp_path / "half.sqlite")
        await run_build(command.settings(sources=half, split={"test_tasks": 3}), other, QUIET)
        monkeypatch.setattr("webgym.taskset.construction.estimate.MEASURED_FROM", 10)
        trial = await run_dry(command.settings(), BuildPaths.of(tmp_path / "whole", other.cache), QUIET)
        assert "measured" in trial.lines[1].basis, "a trial run's replies tell what the whole will take"
        assert 0 < trial.lines[1].there < trial.lines[1].things
        assert trial.dollars is None


async def test_a_critic_is_priced_before_it_is_asked_about_every_rubric_and_text(tmp_path: Path) -> None:
    async with serve() as endpoint:
        command = Command(endpoint, tmp_path, count=6)
        place = BuildPaths.of(tmp_path / "out")
        settings = command.settings(prices=PRICES, writing={"critic": True})
        before = await run_dry(settings, place, QUIET)
        assert not endpoint.paid
        alone = await run_dry(command.settings(prices=PRICES), place, QUIET)
        assert [line.purpose for line in before.lines[:-1]] == [line.purpose for line in alone.lines]
        critic = before.lines[-1]
        assert critic.purpose == "critic"
        assert critic.things == before.lines[1].things + before.lines[2].things
        assert (before.dollars or 0) > (alone.dollars or 0) + (critic.dollars or 0) * 0.99

        finished = await run_build(settings, place, QUIET)
        assert 0.6 * critic.calls < endpoint.kinds["critic"] < 1.6 * critic.calls
        assert any("no good" in failure.reason for failure in finished.build.failures)
        after = await run_dry(settings, place, QUIET)
        assert (after.calls, after.dollars) == (0, 0)
        assert after.lines[-1].there == after.lines[-1].things > 0


async def test_a_budget_stops_the_build_and_a_larger_one_goes_on(tmp_path: Path) -> None:
    async with serve() as endpoint:
        command = Command(endpoint, tmp_path, count=4)
        out = tmp_path / "out"
        with pytest.raises(BudgetSpent, match="run again"):
            await command.build(out, prices=PRICES, budget={"dollars": 0.15})
        assert not (out / "manifest.json").exists()
        first = sum(endpoint.paid.values())
        assert 0 < first == replies(out)
        finished = await command.build(out, prices=PRICES, budget={"dollars": 100})
        assert max(endpoint.paid.values()) == 1
        assert sum(endpoint.paid.values()) > first
        spent = finished.ledger.totals
        assert spent.all.calls == sum(endpoint.paid.values())
        assert {purpose for purpose, _ in spent.rows} == {"website", "rubric", "rewriting"}


@pytest.mark.parametrize(("critic", "most"), [(False, 6), (True, 16)])
async def test_batch_files_in_place_of_calls(tmp_path: Path, critic: bool, most: int) -> None:
    async with serve() as endpoint:
        command = Command(endpoint, tmp_path, count=3)
        out, folder = tmp_path / "out", tmp_path / "batches"
        settings = command.settings(writing={"critic": critic})
        rounds = 0
        while True:
            done = await run_batch(settings, BuildPaths.of(out), folder, QUIET)
            if isinstance(done, FinishedBuild):
                break
            rounds += 1
            assert sum(file.requests for file in done.files) == done.build.pending
            again = await run_batch(settings, BuildPaths.of(out), folder, QUIET)
            assert isinstance(again, PendingBatches)
            assert again.files == [], "what stands in a file already is not written twice"
            await answer_batches(endpoint, [file.path for file in done.files], out)
        assert not endpoint.paid, "nothing was asked"
        assert 2 <= rounds <= most, "rubrics do not wait for websites; what is refused is asked again"
        await command.build(tmp_path / "asked", writing={"critic": critic})
        assert files(tmp_path / "asked") == files(out)


def test_the_pages_commands(tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the page's order; a batch is answered between them."""
    monkeypatch.chdir(tmp_path)
    with beside(serve()) as endpoint:
        endpoint.misbehaves = False
        Command(endpoint, tmp_path, count=1).config.rename("task-set.yaml")

        def run(words: list[str], *small: str) -> str:
            return calls.printed(*words, *small)

        few = ("--test-size", "2")
        told = run(
            documented("webgym tasks build --config task-set.yaml --out set --price 2.5,10 --dry-run"), *few
        )
        assert "dollars" in told
        assert not endpoint.paid
        trial = documented(
            "webgym tasks build --config task-set.yaml --out trial --cache set/replies.sqlite "
            "--limit 50 --test-size 50"
        )
        Path("set").mkdir()
        run(trial, "--limit", "1", *few)
        paid = endpoint.paid.total()
        run(
            documented("webgym tasks build --config task-set.yaml --out set --price 2.5,10 --budget 900"),
            *few,
        )
        assert endpoint.paid.total() == paid > 0, "what the trial has paid for"
        again = run(documented("webgym tasks build --config task-set.yaml --out set --dry-run"), *few)
        assert re.search(r"^all +0 ", again, re.MULTILINE), again

        made = files(Path("set"))
        shutil.rmtree("set")
        batch = documented("webgym tasks build --config task-set.yaml --out set --batch batches")
        for _ in range(6):
            run(batch, *few)
            if Path("set/manifest.json").exists():
                break
            answered = [answered_batch(endpoint, path) for path in sorted(Path("batches").glob("*.jsonl"))]
            Path("RESULTS.jsonl").write_text("".join(answered))
            run(documented("webgym llm import set/replies.sqlite RESULTS.jsonl"))
        assert endpoint.paid.total() == paid
        without = {"manifest.json": b"", "config.yaml": b""}  # which have the budget
        assert files(Path("set")) | without == made | without


def answered_batch(endpoint: Endpoint, path: Path) -> str:
    """What a batch endpoint makes of a batch file."""
    answered = []
    for line in map(json.loads, path.read_bytes().splitlines()):
        text, reason = endpoint.reply(line["body"]["messages"])
        choice = {"index": 0, "finish_reason": reason, "message": {"role": "assistant", "content": text}}
        response = {"status_code": 200, "body": {"choices": [choice]}}
        answered.append({"custom_id": line["custom_id"], "response": response})
    return "".join(json.dumps(each) + "\n" for each in answered)


async def answer_batches(endpoint: Endpoint, paths: Sequence[Path], out: Path) -> None:
    """Answer batch files as a batch endpoint does, and import the results."""
    results = []
    for path in paths:
        results.append(path.with_suffix(".out"))
        results[-1].write_text(answered_batch(endpoint, path))
    async with ReplyCache(out / "replies.sqlite") as cache:
        assert (await import_results(cache, results)).unanswered == []


async def test_encrypted_sources_stay_out_unless_they_are_named(tmp_path: Path) -> None:
    async with serve() as endpoint:
        endpoint.misbehaves = False
        command = Command(endpoint, tmp_path, plaintext=False, count=2)
        out = tmp_path / "out"
        await command.build(out)
        told = json.loads((out / "manifest.json").read_bytes())
        assert told["stages"]["import"]["browsecomp"]["lost"] == {"plain text not asked for": 2}
        assert not [task for task in all_tasks(out) if task.source == "browsecomp"]
        for path in out.rglob("*"):
            assert path.is_dir() or "naïve painters".encode() not in path.read_bytes(), path
        await command.build(tmp_path / "named", plaintext=["browsecomp"])
        assert [task for task in all_tasks(tmp_path / "named") if task.source == "browsecomp"]


async def test_an_endpoint_that_cannot_be_used_ends_it_and_the_next_run_goes_on(tmp_path: Path) -> None:
    async with serve() as endpoint:
        endpoint.misbehaves = False
        command = Command(endpoint, tmp_path, count=4)
        for status, words in ((401, "WEBGYM_API_KEY"), (500, "500")):
            endpoint.status = status
            with pytest.raises(LLMBadReply, match=words):
                await command.build(tmp_path / "out")
        endpoint.status = None
        assert (await command.build(tmp_path / "out")).written


async def test_the_day_of_the_first_run_stays_and_the_config_is_there_to_read(tmp_path: Path) -> None:
    async with serve() as endpoint:
        endpoint.misbehaves = False
        command = Command(endpoint, tmp_path, count=2)
        out = tmp_path / "out"
        await command.build(out)
        settings = command.settings().model_copy(update={"today": None})
        before = files(out)
        await run_build(settings, BuildPaths.of(out), QUIET)
        assert files(out) == before
        assert json.loads(before["manifest.json"])["today"] == TODAY
        assert read_config(out / "config.yaml", {}) == command.settings()
        (out / "config.yaml").write_text("- nothing")
        (tmp_path / "other").mkdir()
        (tmp_path / "other" / "tasks.jsonl").touch()
        with pytest.raises(TaskFileError, match=r"holds other task files, .*: tasks\.jsonl"):
            await run_build(command.settings(), BuildPaths.of(tmp_path / "other"), QUIET)
        with pytest.raises(ConfigError, match="not the config of a build"):
            await run_build(settings, BuildPaths.of(out), QUIET)


async def test_too_few_websites_for_the_test_set_is_told(tmp_path: Path) -> None:
    async with serve() as endpoint:
        endpoint.misbehaves = False
        with pytest.raises(UsageError, match=r"1,167 test tasks need as many websites.*--test-size"):
            await Command(endpoint, tmp_path, count=2).build(tmp_path / "out", split={"test_tasks": 1167})
        assert set(endpoint.kinds) == {"website"}, "no rubric was paid for"


async def test_a_build_of_which_nothing_is_left_still_tells_what_the_model_said(tmp_path: Path) -> None:
    out = tmp_path / "out"
    async with serve() as endpoint:
        endpoint.reply = lambda messages: ("So be it.", "stop")  # type: ignore[method-assign]
        with pytest.raises(UsageError, match=r"there are 0; \d+ tasks failed, the last: .*failed.jsonl has"):
            await Command(endpoint, tmp_path, count=2).build(out)
    failed = lines(out / "failed.jsonl")
    assert {each["stage"] for each in failed} == {"websites", "rubrics"}
    assert all(each["replies"] == ["So be it."] * 3 for each in failed)
    assert not (out / "manifest.json").exists()


async def test_a_manifest_does_not_outlive_its_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    async with serve() as endpoint:
        command = Command(endpoint, tmp_path, count=2)
        await command.build(out)
        assert (out / "manifest.json").exists()

        def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("webgym.taskset.construction.run.describe", full)
        with pytest.raises(UsageError, match="No space left on device"):
            await command.build(out, seed=1)
    assert not (out / "manifest.json").exists(), "it would tell of a set that is no longer there"


async def test_the_published_sets_families_and_test_tasks_stay_so(tmp_path: Path) -> None:
    def row(id: str, website: str, *sizes: int, parent: str | None = None) -> dict[str, Any]:
        groups = [
            {
                "id": n,
                "description": f"part {n}",
                "facts": [f"Thing {n}.{fact} is found" for fact in range(size)],
            }
            for n, size in enumerate(sizes, start=1)
        ]
        return native.PUBLISHED[1] | {
            "task_id": id,
            "task_name": f"Find all about {id}.",
            "website": website,
            "difficulty": 7,
            "evaluator_reference": groups,
            "definite_answer": "",
            "task_id_decomposed_from": parent,
        }

    names = [f"p{number}" for number in range(6)]
    parents = [row(name, f"https://company-{name}.com/", 3, 1) for name in names]
    children = [row(f"{name}+1", f"https://shop-{name}.net/", 3, parent=name) for name in names]
    strange = row("p5-strange", "https://strange.net/", 1, parent="p5")
    published = tmp_path / "published"
    published.mkdir()
    (published / "test.jsonl").write_text(as_lines(parents[:2]))
    (published / "train.jsonl").write_text(as_lines([*parents[2:], *children, strange]))
    given = {"sources": {"webgym": str(published)}, "split": {"test_tasks": 3}, "figures": False}
    finished = await run_build(read_config(None, given), BuildPaths.of(tmp_path / "out"), QUIET)
    tests = {
        task.id.removeprefix("webgym/insta-v3/") for task in finished.build.tasks if task.split == "test"
    }
    assert tests > {"p0", "p1"}
    assert len(tests) == 3
    trained = [task for task in finished.build.tasks if task.split == "train"]
    left = set(names) - tests
    assert {task.parent_id and task.parent_id.removeprefix("webgym/insta-v3/") for task in trained} == {
        None,
        *left,
    }
    assert len(trained) == 2 * len(left) + ("p5" in left)


async def test_what_asks_for_nothing_needs_no_model(tmp_path: Path) -> None:
    rows = [
        {
            "benchmark_name": "deepshop",
            "task_name": f"{ask(number)}",
            "domain": "Lifestyle & Leisure",
            "subdomain": "Shopping",
            "website": f"https://shop{number}-online.com/",
            "definite_answer": "",
            "task_id": f"Amazon--{number}",
            "difficulty": 1,
            "evaluator_reference": [{"id": 1, "description": "product", "facts": ["The None"]}],
            "task_id_decomposed_from": None,
        }
        for number in range(8)
    ]
    published = tmp_path / "train.jsonl"
    published.write_text(as_lines(rows))
    given = {"sources": {"webgym": str(published)}, "split": {"test_tasks": 3}}
    out = tmp_path / "out"
    finished = await run_build(read_config(None, given), BuildPaths.of(out), QUIET)
    assert len(finished.build.tasks) == 8
    assert validate(all_tasks(out)).ok
    assert {fact for task in all_tasks(out) for _, _, fact in task.rubric.facts()} == {"The None"}, (
        "a source's own rubric is not refused for its wording"
    )
    bare = write_shapes(tmp_path / "sources", count=2)["deepshop"]
    with pytest.raises(ConfigError, match="no model is given for the rubric stage"):
        await run_build(
            read_config(None, given | {"sources": {"deepshop": str(bare)}, "split": {"test_tasks": 1}}),
            BuildPaths.of(out),
            QUIET,
        )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "--source NAME=PATH"),
        (("--source", "deepshop"), "is not NAME=PATH"),
        (("--source", "depshop=x.jsonl"), "unknown source depshop"),
        (
            ("--source", "deepshop=none.jsonl", "--base-url", "http://127.0.0.1:9/v1", "--model", "x"),
            "none.jsonl",
        ),
        (("--source", "deepshop={deepshop}", "--test-size", "1"), "--base-url"),
        (("--source", "deepshop={deepshop}", "--base-url", "nonsense", "--model", "x"), "base URL"),
        (("--source", "deepshop={deepshop}", "--price", "cheap"), "not a price"),
        (("--source", "deepshop={deepshop}", "--dry-run", "--batch", "b"), "exclude each other"),
        (
            ("--source", "deepshop={browsecomp}", "--test-size", "0"),
            "contains no task of deepshop; the first",
        ),
        (("--config", "none.yaml"), "cannot read none.yaml"),
        (("--source", "deepshop={deepshop}", "--test-size", "-1"), "test-size"),
    ],
)
def test_wrong_input_is_one_line(
    options: tuple[str, ...], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    paths = write_shapes(tmp_path / "sources", count=2)
    given = [option.format_map(paths) for option in options]
    with pytest.raises(SystemExit) as ended:
        main(["tasks", "build", "--out", "out", *given])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1
