"""The run store: what counts is on disk, whole, once; what is not whole is said, never used."""

from __future__ import annotations

import asyncio
import hashlib
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.rollout.test_summary import task

from webgym.core.action import Action, Answer, LeftClick, Navigate, Scroll, Target, Type, Wait
from webgym.core.errors import RunFolderError, StoreCorrupt, StoreError, StoreFull, StoreLocked
from webgym.core.observation import Element, Notice, Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.trajectory import Episode, Failure, ImageRef, Message, Reply, Step, TextPart, Trajectory
from webgym.core.verdict import FactJudgement, Judgement, Verdict
from webgym.results.evaluation import evaluate
from webgym.rollout.merging import merge_runs
from webgym.store.records import decode, seal
from webgym.store.runs import RunReader, RunWriter

WRITES = Path(__file__).with_name("writes_until_killed.py")
TASK = task("t/1", 1)
PICTURES = [f"picture {number}".encode() * 100 for number in range(4)]
NAMES = [hashlib.sha256(picture).hexdigest() for picture in PICTURES]


def made(number: int, *, outcome: Outcome = Outcome.FAILURE, text: str = "a reply") -> Trajectory:
    """A trajectory of two steps that shows two of the pictures and sends a third."""
    steps = tuple(
        Step(
            index=index,
            observation=Observation(NAMES[index], "http://a.test/", "A", (1280, 768)),
            messages=(Message("user", (TextPart("look"), ImageRef(NAMES[2], 1280, 768))),),
            reply=Reply(text, "p"),
            action=Answer("4"),
        )
        for index in range(2)
    )
    episode = Episode(f"t/1#{number}.0", "t/1", number, 0, 7, "p", 100.0, 2.5, steps, Ending.ANSWERED)
    return Trajectory(episode, outcome)


async def begun(path: Path, *numbers: int) -> RunWriter:
    writer = await RunWriter.create(path, {"seed": 7}, [TASK])
    for name, picture in zip(NAMES, PICTURES, strict=True):
        await writer.put_image(name, picture)
    for number in numbers:
        await writer.append(made(number))
    return writer


async def test_a_task_that_was_drawn_twice_is_drawn_twice_when_the_run_is_resumed(tmp_path: Path) -> None:
    async with await RunWriter.create(tmp_path / "run", {}, [TASK, TASK]):
        pass
    reader = RunReader(tmp_path / "run")
    assert reader.drawn == [TASK, TASK]
    assert reader.tasks == {TASK.id: TASK}


async def test_what_was_appended_reads_back_in_order(tmp_path: Path) -> None:
    async with await begun(tmp_path / "run", 0, 1, 2) as writer:
        await writer.metric({"steps": 3})
        await writer.write_summary({"attempts": 3})
    reader = RunReader(tmp_path / "run")
    assert list(reader.trajectories()) == [made(0), made(1), made(2)]
    assert reader.config == {"seed": 7}
    assert reader.tasks == {"t/1": TASK}
    assert reader.summary == {"attempts": 3}
    assert reader.image(NAMES[3]) == PICTURES[3]
    assert (tmp_path / "run/metrics.jsonl").read_text() == '{"steps":3}\n'
    entry = reader.attempts["t/1#1.0"]
    assert (entry.task_id, entry.sample, entry.retry, entry.outcome) == ("t/1", 1, 0, Outcome.FAILURE)


async def test_each_line_is_plain_json_with_its_checksum(tmp_path: Path) -> None:
    await (await begun(tmp_path, 0)).aclose()
    line = (tmp_path / "trajectories/00000.jsonl").read_bytes()
    record = msgspec.json.decode(line)
    assert set(record) == {"sha256", "trajectory"}
    assert record["sha256"] == hashlib.sha256(line.split(b'"trajectory":', 1)[1][:-2]).hexdigest()
    assert record["trajectory"]["episode"]["attempt_id"] == "t/1#0.0"


async def test_folders_of_pictures_are_synced_with_the_first_record_that_needs_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[str] = []
    monkeypatch.setattr("webgym.store.runs.sync_folder", lambda path: synced.append(path.name))
    needed = {"screenshots", *(name[:2] for name in NAMES[:3])}
    async with await begun(tmp_path) as writer:
        assert {path.name for path in (tmp_path / "screenshots").iterdir()} == {name[:2] for name in NAMES}
        for number in range(2):
            synced.clear()
            await writer.append(made(number))
            assert sorted(synced) == ([] if number else sorted(needed))
    async with await RunWriter.reopen(tmp_path) as writer:
        synced.clear()  # the earlier writer may have died before it synced
        await writer.append(made(2))
        assert sorted(synced) == sorted(needed)


async def test_many_tasks_write_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.store.runs.SHARD_BYTES", 4_000)
    async with await begun(tmp_path) as writer, asyncio.TaskGroup() as group:
        for number in range(60):
            group.create_task(writer.put_image(NAMES[0], PICTURES[0]))
            group.create_task(writer.append(made(number)))
    found = {trajectory.episode.sample for trajectory in RunReader(tmp_path).trajectories()}
    assert found == set(range(60))
    shards = sorted((tmp_path / "trajectories").iterdir())
    assert len(shards) > 3
    assert all(shard.stat().st_size < 8_000 for shard in shards)
    assert len(list((tmp_path / "screenshots").glob("*/*"))) == len(NAMES)


async def test_a_run_goes_on_where_it_stopped(tmp_path: Path) -> None:
    await (await begun(tmp_path, 0, 1)).aclose()
    async with await RunWriter.reopen(tmp_path) as writer:
        assert list(writer.attempts) == ["t/1#0.0", "t/1#1.0"]
        await writer.append(made(2))  # its pictures are known from before
    assert [t.episode.sample for t in RunReader(tmp_path).trajectories()] == [0, 1, 2]


async def test_the_same_attempt_is_on_disk_once(tmp_path: Path) -> None:
    async with await begun(tmp_path, 0) as writer:
        await writer.append(made(0))
        with pytest.raises(StoreError, match="already recorded"):
            await writer.append(made(0, outcome=Outcome.SUCCESS))
    assert list(RunReader(tmp_path).trajectories()) == [made(0)]


async def test_a_reader_follows_a_run_that_is_written(tmp_path: Path) -> None:
    async with await begun(tmp_path, 0) as writer:
        reader = RunReader(tmp_path)
        assert len(reader.attempts) == 1
        shard = tmp_path / "trajectories/00000.jsonl"
        whole = shard.read_bytes()
        await writer.append(made(1))
        second = shard.read_bytes()[len(whole) :]
        shard.write_bytes(whole + second[: len(second) // 2])  # as if caught in the middle of the write
        assert len(reader.attempts) == 1
        shard.write_bytes(whole + second)
        assert len(reader.attempts) == 2
        assert reader.trajectory("t/1#1.0") == made(1)


async def test_a_cancelled_append_is_carried_through(tmp_path: Path) -> None:
    writer = await begun(tmp_path)
    task = asyncio.create_task(writer.append(made(0)))
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await writer.append(made(1))
    await writer.aclose()
    written = [t.episode.sample for t in RunReader(tmp_path).trajectories()]
    assert written in ([0, 1], [1])  # whole or not begun
    assert sorted(entry.sample for entry in writer.attempts.values()) == written


# --- what is refused ---------------------------------------------------------------------------------


async def test_two_collectors_never_write_one_run(tmp_path: Path) -> None:
    async with await begun(tmp_path):
        with pytest.raises(StoreLocked, match=str(os.getpid())):
            await RunWriter.reopen(tmp_path)
    await (await RunWriter.reopen(tmp_path)).aclose()


async def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(RunFolderError, match=r"thesis\.tex"):
        await RunWriter.create(tmp_path, {}, [])
    assert os.listdir(tmp_path) == ["thesis.tex"]  # noqa: PTH208
    await (await begun(tmp_path / "run")).aclose()
    with pytest.raises(RunFolderError, match="holds a run already") as refused:
        await RunWriter.create(tmp_path / "run", {}, [])
    assert f"webgym rollout --resume {tmp_path}/run continues it" in (refused.value.hint or "")
    (tmp_path / "run" / "iterations").mkdir()
    with pytest.raises(RunFolderError, match="holds a training already"):
        await RunWriter.create(tmp_path / "run", {}, [])


async def test_records_of_a_run_without_its_config_are_no_new_runs(tmp_path: Path) -> None:
    """As a copy leaves them that was cut short: they would be read as the new run's results."""
    await (await begun(tmp_path, 0)).aclose()
    for left in ("config.yaml", "metrics.jsonl"):
        (tmp_path / left).unlink()
        with pytest.raises(RunFolderError, match=r"is not empty \(.*trajectories/00000\.jsonl\)"):
            await RunWriter.create(tmp_path, {}, [TASK])
    (tmp_path / "trajectories/00000.jsonl").unlink()  # as a start that was killed leaves it
    await (await begun(tmp_path, 0)).aclose()
    assert len(RunReader(tmp_path).attempts) == 1


async def test_a_folder_that_is_no_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="is not a run"):
        RunReader(tmp_path)
    with pytest.raises(RunFolderError, match="is not a run"):
        await RunWriter.reopen(tmp_path / "none")
    (tmp_path / "file").touch()
    with pytest.raises(RunFolderError, match="cannot create"):
        await RunWriter.create(tmp_path / "file", {}, [])


async def test_a_config_of_another_program_is_read_and_a_broken_one_is_named(tmp_path: Path) -> None:
    await (await begun(tmp_path / "run", 0)).aclose()  # all that it records is a seed
    assert (await merge_runs([tmp_path / "run"], tmp_path / "all")).attempts == 1
    (tmp_path / "run/config.yaml").write_text("samples: lots\n")
    with pytest.raises(StoreCorrupt, match="samples is not a number from 1 on: 'lots'"):
        evaluate(tmp_path / "run")


async def test_a_picture_has_the_name_of_its_content(tmp_path: Path) -> None:
    async with await begun(tmp_path) as writer:
        for name in ("0" * 64, "../../etc/passwd"):
            with pytest.raises(StoreCorrupt):
                await writer.put_image(name, b"other")
    reader = RunReader(tmp_path)
    with pytest.raises(StoreCorrupt, match="does not hold"):
        reader.image("0" * 64)
    with pytest.raises(StoreError, match="does not name"):
        reader.image("../" * 5 + "etc/passwd")


async def test_a_trajectory_needs_its_pictures(tmp_path: Path) -> None:
    async with await RunWriter.create(tmp_path, {}, [TASK]) as writer:
        await writer.put_image(NAMES[0], PICTURES[0])
        with pytest.raises(StoreError, match="2 pictures"):
            await writer.append(made(0))
    assert not RunReader(tmp_path).attempts


async def test_what_would_not_read_back_is_refused(tmp_path: Path) -> None:
    broken = msgspec.structs.replace(made(0), judge_seconds=float("nan"))
    async with await begun(tmp_path) as writer:
        with pytest.raises(StoreError, match="cannot be stored"):
            await writer.append(broken)


def test_halves_of_a_character_do_not_lose_a_trajectory() -> None:
    read = decode(seal(made(0, text="caf\ud83d \U0001f600 ok")))
    assert read.episode.steps[0].reply.text == "caf� \U0001f600 ok"
    assert read.episode.steps[0].action == Answer("4")


# --- what a crash leaves -----------------------------------------------------------------------------


async def test_a_torn_line_is_cut_wherever_it_tore(tmp_path: Path) -> None:
    await (await begun(tmp_path / "whole", 0, 1)).aclose()
    data = (tmp_path / "whole/trajectories/00000.jsonl").read_bytes()
    first = data.index(b"\n") + 1
    rng = random.Random(1)
    for cut in [first, first + 1, *rng.sample(range(first, len(data)), 12), len(data) - 1]:
        run = tmp_path / f"cut-{cut}"
        shutil.copytree(tmp_path / "whole", run)
        (run / "trajectories/00000.jsonl").write_bytes(data[:cut])
        async with await RunWriter.reopen(run) as writer:
            assert list(writer.attempts) == ["t/1#0.0"]
            assert writer.torn_bytes == cut - first
            await writer.append(made(1))
        assert list(RunReader(run).trajectories()) == [made(0), made(1)]


async def test_leftovers_of_a_dead_writer_are_swept(tmp_path: Path) -> None:
    await (await begun(tmp_path, 0)).aclose()
    torn = [tmp_path / ".summary.json.abc.tmp", tmp_path / "screenshots/ab/.abcd.png.123.tmp"]
    for file in torn:
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(b"half")
    (tmp_path / "metrics.jsonl").write_bytes(b'{"a":1}\n{"b":')
    await (await RunWriter.reopen(tmp_path)).aclose()
    assert not any(file.exists() for file in torn)
    assert (tmp_path / "metrics.jsonl").read_bytes() == b'{"a":1}\n'


async def test_leftovers_of_one_who_died_making_the_run_are_swept(tmp_path: Path) -> None:
    torn = tmp_path / ".tasks.jsonl.abc.tmp"
    torn.write_bytes(b"half")
    await (await begun(tmp_path, 0)).aclose()
    assert not torn.exists()


def _flip(data: bytes) -> bytes:
    return data.replace(b"a reply", b"b reply", 1)


def _swap(data: bytes) -> bytes:
    return b"hello\n" + data.split(b"\n", 1)[1]


def _double(data: bytes) -> bytes:
    first = data.split(b"\n", 1)[0] + b"\n"
    return first + data


@pytest.mark.parametrize(
    ("damage", "line", "reason", "whole"),
    [
        (_flip, 1, "checksum", [1, 2]),
        (_swap, 1, "not a record", [1, 2]),
        (_double, 2, "second time", [0, 1, 2]),
    ],
)
async def test_a_corrupt_line_is_reported_and_can_be_skipped(
    tmp_path: Path, damage: object, line: int, reason: str, whole: list[int]
) -> None:
    await (await begun(tmp_path, 0, 1, 2)).aclose()
    shard = tmp_path / "trajectories/00000.jsonl"
    assert callable(damage)
    shard.write_bytes(damage(shard.read_bytes()))
    where = rf"trajectories/00000\.jsonl line {line}: .*{reason}"
    with pytest.raises(StoreCorrupt, match=where):
        await RunWriter.reopen(tmp_path)
    with pytest.raises(StoreCorrupt, match=where):
        list(RunReader(tmp_path).trajectories())
    async with await RunWriter.reopen(tmp_path, skip_corrupt=True) as writer:
        assert [(skipped.file, skipped.line) for skipped in writer.skipped] == [
            ("trajectories/00000.jsonl", line)
        ]
        await writer.append(made(3))
    reader = RunReader(tmp_path, skip_corrupt=True)
    assert [t.episode.sample for t in reader.trajectories()] == [*whole, 3]
    assert len(reader.skipped) == 1


async def test_a_broken_task_names_its_line(tmp_path: Path) -> None:
    await (await begun(tmp_path)).aclose()
    with (tmp_path / "tasks.jsonl").open("ab") as file:
        file.write(b'{"id":"t/2"}\n')
    with pytest.raises(StoreCorrupt, match=r"tasks\.jsonl line 2: .*instruction"):
        assert RunReader(tmp_path).tasks


def test_kill_9_loses_nothing_that_counted_and_doubles_nothing(tmp_path: Path) -> None:
    rng = random.Random(20260)
    run = tmp_path / "run"
    counted: set[str] = set()
    for round_ in range(7):
        child = subprocess.Popen([sys.executable, str(WRITES), str(run), str(round_)], stdout=subprocess.PIPE)
        assert child.stdout is not None
        lines = [child.stdout.readline() for _ in range(rng.randrange(0, 12))]
        try:  # somewhere within the writes that follow
            child.wait(rng.uniform(0, 0.03))
        except subprocess.TimeoutExpired:
            child.kill()
        lines += child.stdout.readlines()
        child.wait()
        child.stdout.close()
        counted |= {line.decode().strip() for line in lines if line.endswith(b"\n")}
        if not (run / "config.yaml").exists():
            continue

        async def open_again() -> set[str]:
            async with await RunWriter.reopen(run) as writer:
                return set(writer.attempts)

        on_disk = asyncio.run(open_again())
        assert counted <= on_disk
        assert len(on_disk - counted) <= (round_ + 1) * 3  # what was in flight at each kill
    reader = RunReader(run)
    seen = [t.episode for t in reader.trajectories()]
    assert len({episode.attempt_id for episode in seen}) == len(seen) == len(reader.attempts)
    for episode in seen:
        for observation in episode.observations:
            assert hashlib.sha256(reader.image(observation.screenshot)).hexdigest() == observation.screenshot
    assert len(counted) > 20
    assert not list(run.glob("**/*.tmp"))


# --- a full disk -------------------------------------------------------------------------------------


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of two megabytes. Only where we may mount one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here; the limit on file size is tested instead")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


async def test_a_full_disk_stops_the_run_and_loses_nothing(tiny_disk: Path) -> None:
    run = tiny_disk / "run"
    writer = await begun(run, 0)
    text = "x" * 300_000

    async def fill() -> None:
        for number in range(1, 20):
            await writer.append(made(number, text=text))

    with pytest.raises(StoreFull, match="free some space"):
        await fill()
    filler = os.urandom(900_000)
    with pytest.raises(StoreFull):
        await writer.put_image(hashlib.sha256(filler).hexdigest(), filler)
    assert not list(run.glob("**/*.tmp"))
    before = [t.episode.sample for t in RunReader(run).trajectories()]
    assert before == list(range(len(before)))
    assert len(before) >= 2
    for picture in (run / "screenshots").glob("*/*.png"):
        assert hashlib.sha256(picture.read_bytes()).hexdigest() == picture.stem
    grow = await asyncio.create_subprocess_exec("mount", "-o", "remount,size=8m", str(tiny_disk))
    assert await grow.wait() == 0
    await writer.append(made(len(before), text=text))  # space was made: the same writer goes on
    await writer.aclose()
    assert [t.episode.sample for t in RunReader(run).trajectories()] == [*before, len(before)]


async def test_a_run_that_finds_no_space_to_begin_in_leaves_no_half_of_one(tiny_disk: Path) -> None:
    run = tiny_disk / "run"
    with pytest.raises(StoreFull, match="free some space, then start the run again"):
        await RunWriter.create(run, {"too": "x" * 3_000_000}, [])
    assert not [entry for entry in run.iterdir() if entry.is_dir()]
    await (await RunWriter.create(run, {}, [])).aclose()


# --- files that go away ------------------------------------------------------------------------------


@pytest.mark.parametrize("what", ["trajectories", "trajectories/00000.jsonl"])
@pytest.mark.parametrize("is_replaced", [False, True])
async def test_records_that_were_moved_away_stop_the_run(
    tmp_path: Path, what: str, is_replaced: bool
) -> None:
    run, away = tmp_path / "run", tmp_path / "away"
    async with await begun(run, 0, 1) as writer:
        (run / what).rename(away)
        if is_replaced:
            shutil.copytree(away, run / what) if away.is_dir() else shutil.copy(away, run / what)
        with pytest.raises(StoreError, match="cannot continue writing a trajectory"):
            await writer.append(made(2))
        if is_replaced and away.is_dir():
            shutil.rmtree(run / what)
        away.rename(run / what)
        await writer.append(made(2))
    assert [t.episode.sample for t in RunReader(run).trajectories()] == [0, 1, 2]


LIMITED = """
import asyncio, resource, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from writes_until_killed import record
from webgym.core.errors import StoreFull
from webgym.store.runs import RunWriter
import random

async def main():
    rng = random.Random(3)
    async with await RunWriter.create(Path(sys.argv[1]), {}, []) as writer:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, -1))
        for number in range(50):
            trajectory, pictures = record(number, rng)
            for name, data in pictures.items():
                await writer.put_image(name, data)
            try:
                await writer.append(trajectory)
            except StoreFull:
                print(number)
                return

asyncio.run(main())
"""


def test_a_file_that_may_not_grow_stays_valid(tmp_path: Path) -> None:
    run = tmp_path / "run"
    command = [sys.executable, "-c", LIMITED, str(run), str(WRITES.parent)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    counted = int(done.stdout)
    assert counted > 1
    assert (run / "trajectories/00000.jsonl").read_bytes().endswith(b"}\n")
    assert len(list(RunReader(run).trajectories())) == counted


# --- any trajectory ----------------------------------------------------------------------------------

texts = st.text(st.characters(codec="utf-8"), max_size=40)
numbers = st.floats(allow_nan=False, allow_infinity=False, min_value=0, max_value=1e9)
names = st.binary(max_size=8).map(lambda data: hashlib.sha256(data).hexdigest())
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=6,
)
grid = st.floats(0, 1000)
targets = st.builds(Target, coordinate=st.tuples(grid, grid)) | st.builds(Target, element=st.integers(0, 99))
actions: st.SearchStrategy[Action] = st.one_of(
    st.builds(LeftClick, targets),
    st.builds(Type, targets, texts),
    st.builds(Scroll, st.sampled_from(("up", "down"))),
    st.builds(Wait, numbers),
    st.builds(Navigate, texts),
    st.builds(Answer, texts),
)
observations = st.builds(
    Observation,
    screenshot=names,
    url=texts,
    title=texts,
    viewport=st.just((1280, 768)),
    status=st.none() | st.integers(100, 599),
    notices=st.lists(st.builds(Notice, st.just("dialog"), texts), max_size=2).map(tuple),
    text=st.none() | texts,
    elements=st.none()
    | st.lists(
        st.builds(Element, st.integers(0, 99), texts, texts, st.just((1.0, 2.0, 3.5, 4.0)), value=texts),
        max_size=2,
    ).map(tuple),
    milliseconds=st.dictionaries(texts, numbers, max_size=3),
)
messages = st.builds(
    Message,
    st.sampled_from(("system", "user")),
    st.lists(st.builds(TextPart, texts) | st.builds(ImageRef, names, st.just(9), st.just(9)), max_size=3).map(
        tuple
    ),
)
steps = st.builds(
    Step,
    index=st.integers(0, 50),
    observation=observations,
    messages=st.lists(messages, max_size=2).map(tuple),
    reply=st.builds(Reply, texts, texts, sampling=st.dictionaries(texts, plain, max_size=2)),
    action=st.none() | actions,
    parse_error=texts,
    changed=st.none() | st.booleans(),
    at=numbers,
)
judgements = st.builds(Judgement, st.booleans(), texts, st.lists(st.integers(0, 9), max_size=2).map(tuple))
trajectories = st.builds(
    Trajectory,
    episode=st.builds(
        Episode,
        attempt_id=texts,
        task_id=texts,
        sample=st.integers(0, 9),
        retry=st.integers(0, 9),
        seed=st.integers(0, 2**63),
        policy=texts,
        started_at=numbers,
        seconds=numbers,
        steps=st.lists(steps, max_size=3).map(tuple),
        ending=st.sampled_from(Ending),
        final=st.none() | observations,
        answer=st.none() | texts,
        final_state=st.none() | st.dictionaries(texts, plain, max_size=3),
        failure=st.none() | st.builds(Failure, texts, texts),
    ),
    outcome=st.sampled_from(Outcome),
    verdict=st.none()
    | st.builds(
        Verdict,
        texts,
        st.sampled_from((None, 0, 1)),
        st.lists(
            st.builds(FactJudgement, st.integers(0, 9), st.integers(0, 9), texts, judgements), max_size=2
        ).map(tuple),
        judgements,
        response=st.none() | judgements,
        reference=st.none() | judgements,
    ),
    judge_failure=st.none() | st.builds(Failure, texts, texts),
    judge_seconds=numbers,
)


@settings(max_examples=60, deadline=None)
@given(trajectories)
def test_any_trajectory_survives_the_line(trajectory: Trajectory) -> None:
    line = seal(trajectory)
    assert line.count(b"\n") == 1
    assert decode(line) == trajectory


@settings(max_examples=60, deadline=None)
@given(trajectories, st.data())
def test_no_changed_byte_goes_unnoticed(trajectory: Trajectory, data: st.DataObject) -> None:
    line = seal(trajectory)
    at = data.draw(st.integers(0, len(line) - 1))
    changed = line[:at] + bytes([line[at] ^ (1 << data.draw(st.integers(0, 7)))]) + line[at + 1 :]
    with pytest.raises(ValueError, match=r"record|checksum"):
        decode(changed)
