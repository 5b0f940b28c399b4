"""A run that is not whole: what is broken is named, and set aside so that the rest is whole again."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.report.conftest import build_run
from tests.rollout.running import Run, a_world, books

from webgym.cli import main
from webgym.core.errors import RunFolderError, StoreCorrupt, StoreLocked
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Trajectory
from webgym.core.verdict import Judgement, Verdict
from webgym.judge.base import Pictures
from webgym.results.export import export
from webgym.rollout.rejudge import judge_run
from webgym.store.records import attempt_ids_in, pictures
from webgym.store.runs import RunReader, RunWriter, verdicts_of
from webgym.store.verify import Findings, verify


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return asyncio.run(build_run(tmp_path_factory.mktemp("verify") / "run", distinct=2))


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    return shutil.copytree(whole, tmp_path / "run")


def _shard(run: Path) -> Path:
    return run / "trajectories/00000.jsonl"


def _shown_by(run: Path, name: str) -> list[str]:
    return [t.episode.attempt_id for t in RunReader(run).trajectories() if name in pictures(t)]


def _first_picture(run: Path) -> Path:
    first: Trajectory = next(RunReader(run).trajectories())
    return RunReader(run).image_path(sorted(pictures(first))[0])


def test_a_whole_run_is_whole(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted((path, path.stat().st_mtime_ns) for path in run.rglob("*"))
    held = len(list((run / "screenshots").glob("*/*.png")))
    assert verify(run) == Findings(12, held, [])
    assert sorted((path, path.stat().st_mtime_ns) for path in run.rglob("*")) == before, "it only reads"
    with pytest.raises(SystemExit) as ended:
        main(["verify", str(run)])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"12 trajectories and {held} pictures are intact\n"


def _change(path: Path, old: bytes, new: bytes) -> None:
    path.write_bytes(path.read_bytes().replace(old, new, 1))


def _add(path: Path, data: bytes) -> None:
    with path.open("ab") as file:
        file.write(data)


BREAKS: dict[str, tuple[Callable[[Path], object], str]] = {
    "changed": (
        lambda run: _change(_shard(run), b"Memory", b"memory"),
        "trajectories/00000.jsonl line 1: the checksum does not match",
    ),
    "torn": (
        lambda run: _add(_shard(run), b'{"sha256":"ab'),
        "trajectories/00000.jsonl line 13: half-written, 13 bytes",
    ),
    "doubled": (
        lambda run: _add(_shard(run), _shard(run).read_bytes().splitlines(keepends=True)[0]),
        "recorded a second time",
    ),
    "temporary": (
        lambda run: (run / "screenshots/ab/.x.png.1.tmp").write_bytes(b"x"),
        "screenshots/ab/.x.png.1.tmp: half-written",
    ),
    "foreign": (
        lambda run: (run / "screenshots/ab/photo.png").write_bytes(b"x"),
        "screenshots/ab/photo.png: not a picture of the store",
    ),
    "summary": (lambda run: (run / "summary.json").write_text("{"), "summary.json"),
    "metrics": (lambda run: _add(run / "metrics.jsonl", b"[]\n"), "metrics.jsonl line 1: Expected `object`"),
}


@pytest.mark.parametrize("kind", BREAKS)
def test_what_is_broken_is_named_and_set_aside(run: Path, kind: str) -> None:
    damage, told = BREAKS[kind]
    damage(run)
    found = verify(run)
    assert len(found.problems) == 1
    assert told in str(found.problems[0])
    assert not found.is_whole
    found = verify(run, set_aside=True)
    assert [problem.is_set_aside for problem in found.problems] == [True]
    assert verify(run).problems == []
    log = [json.loads(line) for line in (run / "set-aside/log.jsonl").read_text().splitlines()]
    assert [(one["file"], one["line"]) for one in log] == [(found.problems[0].file, found.problems[0].line)]
    assert (run / "set-aside" / found.problems[0].file).stat().st_size > 0


def test_attempts_that_lack_their_task_are_told(run: Path) -> None:
    tasks = (run / "tasks.jsonl").read_bytes().splitlines(keepends=True)
    (run / "tasks.jsonl").write_bytes(b"".join(tasks[1:]))
    (problem,) = verify(run, set_aside=True).problems
    assert str(problem).startswith("tasks.jsonl: 1 attempt lacks its task, as ")
    assert not problem.is_set_aside
    with pytest.raises(StoreCorrupt, match="does not hold its task"):
        export(run, run / "out", "jsonl", split="all")
    assert not (run / "out").exists()


@pytest.mark.parametrize("is_gone", [True, False])
async def test_attempts_that_show_a_broken_picture_go_with_it_and_can_be_made_again(
    run: Path, is_gone: bool
) -> None:
    picture = _first_picture(run)
    lost = _shown_by(run, picture.stem)
    assert 0 < len(lost) < 12
    picture.unlink() if is_gone else picture.write_bytes(b"no picture")
    found = verify(run, set_aside=True)
    assert sum("missing or broken" in problem.reason for problem in found.problems) == len(lost)
    assert found.trajectories == 12 - len(lost)
    moved = (run / "set-aside" / _shard(run).relative_to(run)).read_bytes().splitlines()
    assert len(moved) == len(lost)
    async with await RunWriter.reopen(run) as writer:
        assert not set(lost) & set(writer.attempts)
        assert len(writer.attempts) == 12 - len(lost)


class Judge:
    """Passes everything, and notes whom it was asked about."""

    name = "passing/1"

    def __init__(self) -> None:
        self.asked: list[str] = []

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        self.asked.append(episode.attempt_id)
        return Verdict(self.name, 1, (), Judgement(False, "no"))


@pytest.mark.parametrize("change", [(b'"outcome":"success"', b'"outcome":"failure"'), (b'"t0#', b'"t1#')])
async def test_what_is_made_again_has_a_name_of_its_own_so_that_no_verdict_on_the_lost_one_counts(
    tmp_path: Path, change: tuple[bytes, bytes]
) -> None:
    """Also where the record that was lost does not tell its name any more."""
    run, judge = tmp_path / "run", Judge()
    async with a_world() as world:
        await Run().start(world.config(tmp_path, 3), run).end()
        await judge_run(run, judge)
        for line in _shard(run).read_bytes().splitlines():
            if b'"t0#' in line:
                _change(_shard(run), line, line.replace(*change))
        assert verify(run, set_aside=True).problems
        await Run().start(None, run).end()
    assert {each.episode.attempt_id for each in books(run)} == {"t0#0.1", "t1#0.0", "t2#0.0"}
    assert "t0#0.0" not in verdicts_of(run, judge.name)[1]
    judge.asked.clear()
    assert (await judge_run(run, judge)).earlier == 2
    assert judge.asked == ["t0#0.1"]


def test_half_written_lines_that_are_set_aside_stay_lines_and_keep_their_names(run: Path) -> None:
    torn = [f'{{"sha256":"ab","trajectory":{{"episode":{{"attempt_id":"t{each}#9.0",' for each in range(2)]
    for line in torn:
        _add(_shard(run), line.encode())
        assert verify(run, set_aside=True).is_whole
    moved = run / "set-aside/trajectories/00000.jsonl"
    assert moved.read_text().splitlines() == torn
    moved.write_text("".join(torn))  # as earlier versions wrote it
    assert sorted(attempt_ids_in(moved.parent)) == ["t0#9.0", "t1#9.0"]


def test_settings_and_tasks_stay(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _add(run / "tasks.jsonl", b"no task\n")
    with pytest.raises(SystemExit) as ended:
        main(["verify", str(run), "--set-aside"])
    assert ended.value.code == 1
    assert capsys.readouterr().out.startswith("tasks.jsonl line 13: ")
    assert b"no task" in (run / "tasks.jsonl").read_bytes()


async def test_a_run_that_is_written_to_is_verified_and_not_touched(run: Path) -> None:
    async with await RunWriter.reopen(run):
        _add(_shard(run), b'{"sha256":"ab')  # under way
        (run / "screenshots/ab/.x.png.1.tmp").write_bytes(b"x")
        assert (await asyncio.to_thread(verify, run)).problems == []
        with pytest.raises(StoreLocked):
            await asyncio.to_thread(verify, run, set_aside=True)


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match=r"it has no config\.yaml"):
        verify(tmp_path)
    (tmp_path / "config.yaml").write_text("of: another program\n")
    with pytest.raises(RunFolderError, match=r"it has no tasks\.jsonl \(give the folder that webgym"):
        verify(tmp_path)
