"""The index beside a run: what it finds, and that it is never older than the run."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from webgym.core.outcome import Outcome
from webgym.report.live_run import LiveRun
from webgym.report.write import write_report
from webgym.results.run_index import INDEX, RunIndex, TrajectoryQuery
from webgym.results.summary import summarise
from webgym.run.collect import _index_of
from webgym.store.records import seal
from webgym.store.runs import RunReader, RunWriter
from webgym.store.verify import verify


@pytest.fixture
def run(run_folder: Path, tmp_path: Path) -> Path:
    run = shutil.copytree(run_folder, tmp_path / "run")
    (run / INDEX).unlink(missing_ok=True)
    return run


def _shard(run: Path) -> Path:
    return run / "trajectories/00000.jsonl"


def _opened(run: Path) -> RunIndex:
    index = RunIndex(run, RunReader(run).tasks)
    index.refresh()
    return index


def _ids(index: RunIndex, **wanted: Any) -> list[int]:
    _, rows = index.find(TrajectoryQuery(**wanted), 0, 100)
    return [int(row["id"].split("#")[1].split(".")[0]) for row in rows]


def test_search_filters_and_order(run: Path) -> None:
    index = _opened(run)
    assert _ids(index) == list(range(12))
    assert _ids(index, outcome="failure") == [1, 10]
    assert _ids(index, q="FERNHILL salt") == [8]
    assert _ids(index, q="browser_crashed") == [4]
    assert _ids(index, q="%") == []
    assert _ids(index, outcome="success", level="easy") == [0, 9]
    steps = {each.episode.sample: len(each.episode.steps) for each in RunReader(run).trajectories()}
    for down in (False, True):
        found = [steps[sample] for sample in _ids(index, sort="steps", down=down)]
        assert found == sorted(steps.values(), reverse=down)
    total, rows = index.find(TrajectoryQuery(sort="outcome"), 2, 3)
    assert (total, len(rows)) == (12, 3)
    assert _ids(index, sort="number; DROP TABLE rows") == list(range(12))


def test_it_grows_with_the_run_and_reads_only_what_is_new(run: Path) -> None:
    lines = _shard(run).read_bytes().splitlines(keepends=True)
    _shard(run).write_bytes(b"".join(lines[:5]) + lines[5][:-9])  # one is under way
    index = _opened(run)
    assert len(index) == 5
    _shard(run).write_bytes(b"".join(lines[:8]))
    (run / "trajectories/00001.jsonl").write_bytes(b"".join(lines[8:]))
    version = index.version
    again = _opened(run)  # somebody else, later
    assert _ids(again) == list(range(12))
    assert again.version == version, "what was known stayed"
    assert [digest.sample for digest in again.digests(5)] == list(range(5, 12))


def test_a_reading_that_is_stopped_goes_on_where_it_was(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.results.run_index._BATCH", 5)
    stopped = RunIndex(run, RunReader(run).tasks)
    stopped.refresh(lambda _: stopped.stop())
    assert len(stopped) == 5
    told: list[int] = []
    again = RunIndex(run, RunReader(run).tasks)
    again.refresh(told.append)
    assert (len(again), told, again.version) == (12, [10], stopped.version)


def test_a_verdict_that_came_later_replaces_its_row(run: Path) -> None:
    index = _opened(run)
    unjudged = next(t for t in RunReader(run).trajectories() if t.outcome is Outcome.JUDGE_ERROR)
    version = index.version
    with _shard(run).open("ab") as file:
        file.write(seal(replace(unjudged, outcome=Outcome.BLOCKED, judge_failure=None)))
    index.refresh()
    assert _ids(index, outcome="judge_error") == []
    assert _ids(index, outcome="blocked") == [3, 6]
    assert index.version != version


@pytest.mark.parametrize("kind", ["set aside", "shrunk", "other tasks", "no index", "other version"])
def test_it_is_made_anew_where_the_run_is_another(run: Path, kind: str) -> None:
    index = _opened(run)
    index.close()
    lines = _shard(run).read_bytes().splitlines(keepends=True)
    left = list(range(12))
    if kind == "set aside":
        _shard(run).write_bytes(_shard(run).read_bytes().replace(b"Memory", b"memory", 1))
        assert verify(run, set_aside=True).is_whole
        left = left[1:]
    elif kind == "shrunk":
        _shard(run).write_bytes(b"".join(lines[:4]))
        left = left[:4]
    elif kind == "other tasks":
        tasks = (run / "tasks.jsonl").read_bytes().replace(b"Find the", b"Look for the")
        (run / "tasks.jsonl").write_bytes(tasks)
    elif kind == "no index":
        (run / INDEX).write_bytes(b"no database" * 1000)
    else:
        index = RunIndex(run, {})
        index._connection.execute("UPDATE meta SET value = '[0]' WHERE name = 'made_for'")
        index.close()
    found = _opened(run)
    assert _ids(found) == left
    if kind == "other tasks":
        assert len(_ids(found, q="look for")) == 11


def test_an_index_that_cannot_be_written_lives_in_memory(run: Path) -> None:
    (run / INDEX).mkdir()
    assert _ids(_opened(run)) == list(range(12))


def test_corrupt_lines_are_named(run: Path) -> None:
    _shard(run).write_bytes(_shard(run).read_bytes().replace(b"Memory", b"memory", 1))
    assert [str(line) for line in _opened(run).corrupt] == [
        "trajectories/00000.jsonl line 1: the checksum does not match"
    ]


async def test_a_damaged_attempt_that_was_made_again_is_what_the_run_counts(run: Path) -> None:
    _opened(run).close()
    again = next(iter(RunReader(run).trajectories()))
    _shard(run).write_bytes(_shard(run).read_bytes().replace(b'"', b"'", 1))
    async with await RunWriter.reopen(run, skip_corrupt=True) as store:
        await store.append(again)
        with _index_of(store, list(RunReader(run).tasks.values())) as index:
            assert index.entry(again.episode.attempt_id) == store.attempts[again.episode.attempt_id]
            assert [(line.line, len(index)) for line in index.corrupt] == [(1, 12)]


def test_the_figures_are_those_of_the_summary_and_are_kept(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live = LiveRun(run)
    live.refresh()
    assert live._stored() is not None
    monkeypatch.setattr(LiveRun, "_stored", lambda _: None)
    html = live.overview()
    monkeypatch.undo()
    reader = RunReader(run)
    told = summarise(reader.trajectories(), reader.drawn, seed=7)
    kept = json.loads(
        live.index._connection.execute("SELECT value FROM meta WHERE name = 'overview'").fetchone()[0]
    )
    assert kept["figures"]["summary"] == json.loads(msgspec.json.encode(told))
    monkeypatch.setattr(RunIndex, "digests", lambda *_: pytest.fail("all is known"))
    again = LiveRun(run)
    again.refresh()
    assert again.overview() == html
    (run / INDEX).unlink()  # the run is finished: its figures are in its summary
    anew = LiveRun(run)
    anew.refresh()
    assert anew.overview() == html


@pytest.mark.slow
def test_a_hundred_thousand_trajectories(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Prints what docs/run-folder.md tells. CPU time, which other work on the machine hardly changes."""
    held = list(RunReader(run).trajectories())
    with _shard(run).open("wb") as file:
        for number in range(100_000):
            like = held[number % len(held)].episode
            steps = tuple(replace(step, messages=()) for step in like.steps)
            attempt_id = f"{like.task_id}#{number}.0"
            episode = replace(like, attempt_id=attempt_id, sample=number, steps=steps)
            file.write(seal(replace(held[number % len(held)], episode=episode)))
    told = []
    for what in ("first opening", "second opening"):
        began = time.process_time()
        live = LiveRun(run)
        live.refresh()
        live.overview()
        told.append((what, time.process_time() - began))
    asked = {
        "list": TrajectoryQuery(),
        "filter": TrajectoryQuery(outcome="failure", level="easy"),
        "search": TrajectoryQuery(q="salt fernhill"),
        "search, sorted": TrajectoryQuery(q="cheapest", sort="task", down=True),
    }
    for what, wanted in asked.items():
        began = time.process_time()
        live.index.find(wanted, 0, 200)
        told.append((what, time.process_time() - began))
    began = time.process_time()
    write_report(run)
    report_seconds = time.process_time() - began
    told.append(("report", report_seconds))
    with capsys.disabled():
        print("".join(f"\n{what}: {seconds:.2f} s" for what, seconds in told))
    assert all(seconds < 1 for what, seconds in told[1:-1])
    assert report_seconds < 5
