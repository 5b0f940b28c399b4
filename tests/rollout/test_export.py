"""What a run looks like to other programs: read back with their libraries, and nothing made up."""

from __future__ import annotations

import asyncio
import io
import json
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import msgspec
import pyarrow.parquet as pq
import pytest
import yaml
from PIL import Image
from tests.conftest import Calls
from tests.report.conftest import build_run

from webgym.core.errors import RunFolderError, StoreLocked, UsageError
from webgym.core.outcome import Outcome
from webgym.core.trajectory import ImageRef, Message, TextPart
from webgym.results.export import Format, export
from webgym.store.runs import RunReader, RunWriter


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dozen attempts at test tasks, with all eight outcomes."""
    return asyncio.run(build_run(tmp_path_factory.mktemp("runs") / "run", 12))


def test_parquet_holds_every_step_with_its_pictures(run: Path, tmp_path: Path) -> None:
    done = export(run, tmp_path / "out", "parquet", split="test")
    reader = RunReader(run)
    steps = [(each, step) for each in reader.trajectories() for step in each.episode.steps]
    rows = pq.read_table(tmp_path / "out/steps.parquet").to_pylist()
    assert done.steps == len(rows) == len(steps)
    for row, (trajectory, step) in zip(rows, steps, strict=True):
        assert (row["attempt_id"], row["step"]) == (trajectory.episode.attempt_id, step.index)
        assert msgspec.json.decode(row["messages"], type=tuple[Message, ...]) == step.messages
        assert row["reply"] == step.reply.text
        is_rewarded = trajectory.outcome.is_rewarded
        assert row["reward"] == (float(trajectory.outcome is Outcome.SUCCESS) if is_rewarded else None)
        refs = [part for each in step.messages for part in each.content if isinstance(part, ImageRef)]
        sizes = [Image.open(io.BytesIO(image["bytes"])).size for image in row["images"]]
        assert sizes == [(ref.width, ref.height) for ref in refs]
    assert {row["outcome"] for row in rows if row["reward"] is None} >= {"blocked", "environment_error"}


def test_pandas_and_duckdb_read_it_back(run: Path, tmp_path: Path) -> None:
    import duckdb
    import pandas

    done = export(run, tmp_path / "out", "jsonl", split="all")
    file = tmp_path / "out/steps.jsonl"
    frame = pandas.read_json(file, lines=True)
    assert len(frame) == done.steps > 0
    assert all((tmp_path / "out" / path).is_file() for paths in frame["images"] for path in paths)
    [found] = duckdb.execute(f"select avg(reward), count(*) - count(reward) from '{file}'").fetchall()
    assert 0 < found[0] < 1
    assert found[1] > 0, "what has no reward counts for nothing"


def test_what_is_exported_for_imitation_is_success_in_training_alone(run: Path, tmp_path: Path) -> None:
    assert export(run, tmp_path / "none", "sharegpt").attempts == 0, "all its tasks are for testing"
    done = export(run, tmp_path / "out", "sharegpt", split="test")
    successes = [each for each in RunReader(run).trajectories() if each.outcome is Outcome.SUCCESS]
    assert done.attempts == len(successes)
    told = json.loads((tmp_path / "out/sharegpt.json").read_bytes())
    steps = [step for each in successes for step in each.episode.steps if step.action is not None]
    assert [each["messages"][-1] for each in told] == [
        {"role": "assistant", "content": step.reply.text} for step in steps
    ]
    for each in told:
        marks = sum(message["content"].count("<image>") for message in each["messages"])
        assert marks == len(each["images"])
    with pytest.raises(UsageError, match="cannot be imitated"):
        export(run, tmp_path / "no", "sharegpt", outcomes=frozenset({Outcome.BLOCKED}))


@pytest.mark.parametrize("placeholder", ["<image>", "<video>", "<audio>"])
async def test_a_page_that_writes_a_placeholder_shifts_no_picture_and_reasoning_is_kept(
    run: Path, tmp_path: Path, placeholder: str
) -> None:
    success = next(each for each in RunReader(run).trajectories() if each.outcome is Outcome.SUCCESS)
    said = Message("user", (TextPart(f"see {placeholder} here"),))
    steps = [msgspec.structs.replace(step, messages=(*step.messages, said)) for step in success.episode.steps]
    thought = msgspec.structs.replace(success.episode.steps[-1].reply, reasoning="So many signs.")
    last = msgspec.structs.replace(success.episode.steps[-1], reply=thought)
    steps = [*steps[:1], *success.episode.steps[1:-1], last]
    episode = msgspec.structs.replace(success.episode, steps=tuple(steps))
    tasks = list(RunReader(run).tasks.values())
    async with await RunWriter.create(tmp_path / "run", {}, tasks) as writer:
        for name in {part.screenshot for step in episode.steps for part in _refs(step.messages)}:
            await writer.put_image(name, RunReader(run).image(name))
        for seen in episode.observations:
            await writer.put_image(seen.screenshot, RunReader(run).image(seen.screenshot))
        await writer.append(msgspec.structs.replace(success, episode=episode))
    done = export(tmp_path / "run", tmp_path / "out", "sharegpt", split="test")
    assert (done.unusable, done.steps) == (1, len(steps) - 1)
    told = json.loads((tmp_path / "out/sharegpt.json").read_bytes())
    assert told[-1]["messages"][-1]["content"] == f"<think>\nSo many signs.\n</think>\n\n{thought.text}"


def shrunk(size: tuple[int, int], most: int) -> tuple[int, int]:
    """The size at which LLaMA-Factory's processor gives a picture to the model's."""
    width, height = size
    scale = min(1.0, (most / (width * height)) ** 0.5)
    return (width, height) if scale == 1.0 else (int(width * scale), int(height * scale))


@pytest.mark.parametrize(
    ("profile", "size", "template", "notes"),
    [
        ("qwen3-vl", (1280, 768), "qwen3_vl_nothink", 1),
        ("qwen3-vl-thinking", (1280, 768), "qwen3_vl", 1),
        ("qwen2.5-vl", (1288, 756), "qwen2_vl", 2),
        ("generic", (4096, 2160), None, 2),
    ],
)
async def test_the_settings_beside_it_train_on_what_the_model_saw(
    run: Path, tmp_path: Path, profile: str, size: tuple[int, int], template: str | None, notes: int
) -> None:
    assert shrunk((1280, 768), 768 * 768) == (991, 594), "as its defaults would have it"
    success = next(each for each in RunReader(run).trajectories() if each.outcome is Outcome.SUCCESS)

    def sent(message: Message) -> Message:
        parts = (ImageRef(p.screenshot, *size) if isinstance(p, ImageRef) else p for p in message.content)
        return Message(message.role, tuple(parts))

    steps = [
        msgspec.structs.replace(step, messages=tuple(map(sent, step.messages)))
        for step in success.episode.steps
    ]
    episode = msgspec.structs.replace(success.episode, steps=tuple(steps))
    config = {"agent": {"profile": profile}}
    tasks = list(RunReader(run).tasks.values())
    async with await RunWriter.create(tmp_path / "run", config, tasks) as writer:
        for name in {seen.screenshot for seen in episode.observations}:
            await writer.put_image(name, RunReader(run).image(name))
        await writer.append(msgspec.structs.replace(success, episode=episode))
    export(tmp_path / "run", tmp_path / "out", "sharegpt", split="test")
    text = (tmp_path / "out" / "train.yaml").read_text()
    settings = yaml.safe_load(text)
    for sample in json.loads((tmp_path / "out/sharegpt.json").read_bytes()):
        for name in sample["images"]:
            with Image.open(tmp_path / "out" / name) as picture:
                assert shrunk(picture.size, settings["image_max_pixels"]) == picture.size == size
    assert settings.get("template") == template
    assert (settings["cutoff_len"], settings["mask_history"]) == (16384, True)
    assert settings["model_name_or_path"] == success.episode.policy
    assert settings["dataset"] in json.loads((tmp_path / "out" / "dataset_info.json").read_text())
    assert text.count("# ") == notes
    assert ("points wrong" in text) == (profile == "qwen2.5-vl")


def _refs(messages: tuple[Message, ...]) -> list[ImageRef]:
    return [part for each in messages for part in each.content if isinstance(part, ImageRef)]


async def test_tasks_of_no_known_split_are_not_for_training(run: Path, tmp_path: Path) -> None:
    trajectory = next(RunReader(run).trajectories())
    tasks = [msgspec.structs.replace(task, split=None) for task in RunReader(run).tasks.values()]
    for taken_as, wanted in (("train", 1), ("test", 0), ("all", 0)):
        place = tmp_path / taken_as
        async with await RunWriter.create(place / "run", {"tasks": {"split": taken_as}}, tasks) as writer:
            for seen in trajectory.episode.observations:
                await writer.put_image(seen.screenshot, RunReader(run).image(seen.screenshot))
            await writer.append(trajectory)
        assert export(place / "run", place / "out", "parquet").attempts == wanted


async def test_a_training_task_on_the_website_of_a_test_task_is_not_for_training(
    run: Path, tmp_path: Path
) -> None:
    trajectory = next(RunReader(run).trajectories())
    task = RunReader(run).tasks[trajectory.episode.task_id]
    train = msgspec.structs.replace(task, split="train")
    test = msgspec.structs.replace(task, id="copy", split="test")
    for tasks, wanted in (([train], 1), ([train, test], 0)):
        place = tmp_path / str(len(tasks))
        async with await RunWriter.create(place / "run", {"tasks": {"split": "all"}}, tasks) as writer:
            for seen in trajectory.episode.observations:
                await writer.put_image(seen.screenshot, RunReader(run).image(seen.screenshot))
            await writer.append(trajectory)
        done = export(place / "run", place / "out", "parquet")
        assert (done.attempts, done.other_split) == (wanted, 1 - wanted)
        assert export(place / "run", place / "all", "parquet", split="all").attempts == 1


def test_the_command_says_what_it_left_out(run: Path, tmp_path: Path, calls: Calls) -> None:
    said = calls.printed("export", run, "--out", tmp_path / "out", "--format", "jsonl")
    assert "0 steps of 0 attempts" in said
    assert "attempts at tasks of another split" in said
    assert "oracle" not in said
    every = ("--out", tmp_path / "all", "--format", "jsonl", "--split", "all")
    assert "the scripted policy is an oracle" in calls.printed("export", run, *every)
    assert "is not empty" in calls.printed("export", run, "--out", tmp_path / "out", code=2)


def test_a_damaged_record_is_told_with_what_helps_before_anything_is_written(
    run: Path, tmp_path: Path, calls: Calls
) -> None:
    shutil.copytree(run, tmp_path / "run")
    with next((tmp_path / "run/trajectories").iterdir()).open("ab") as records:
        records.write(b"noise\n")
    said = calls.printed("export", tmp_path / "run", "--out", tmp_path / "out", code=1)
    assert "webgym verify --set-aside" in said
    assert not (tmp_path / "out").exists()


def test_a_folder_in_use_is_refused(run: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("keep me")
    with pytest.raises(RunFolderError, match="is not empty"):
        export(run, tmp_path, "jsonl")


@pytest.mark.parametrize("kind", ["jsonl", "parquet", "sharegpt"])
def test_an_export_that_was_killed_can_be_made_again(
    run: Path, tmp_path: Path, calls: Calls, kind: Format
) -> None:
    killed = tmp_path / "killed"
    export_slowly = (
        "import os, sys; from pathlib import Path; from webgym.results.export import export; export("
    )
    export_slowly += "Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], split='all', "
    export_slowly += "progress=lambda done: done < 3 or os.kill(os.getpid(), 9))"
    ended = subprocess.run([sys.executable, "-c", export_slowly, run, killed, kind], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert [path.name for path in killed.iterdir()] == [".unfinished.tmp"]
    calls.printed("export", run, "--out", killed, "--format", kind, "--split", "all")
    export(run, tmp_path / "whole", kind, split="all")
    names = [
        sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
        for folder in (killed, tmp_path / "whole")
    ]
    assert names[0] == names[1]


def test_two_exports_do_not_share_a_folder(run: Path, tmp_path: Path) -> None:
    def again(_: int) -> None:
        with pytest.raises(StoreLocked, match="another process is writing to"):
            export(run, tmp_path / "out", "jsonl", split="all")

    export(run, tmp_path / "out", "parquet", split="all", progress=again)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["steps.parquet"]


@pytest.mark.parametrize("exists", [False, True])
def test_an_export_that_fails_leaves_nothing(run: Path, tmp_path: Path, exists: bool) -> None:
    out = tmp_path / "out"
    if exists:
        out.mkdir()

    def fail(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(run, out, "jsonl", split="all", progress=fail)
    assert list(tmp_path.rglob("*")) == ([out] if exists else [])


@pytest.mark.parametrize("kind", ["jsonl", "parquet"])
def test_a_damaged_picture_is_named_and_not_exported(
    run: Path, tmp_path: Path, calls: Calls, kind: str
) -> None:
    """Also one whose header is whole."""
    broken = shutil.copytree(run, tmp_path / "run")
    for picture in broken.glob("screenshots/*/*.png"):
        picture.write_bytes(picture.read_bytes()[:-20])
    options = ("--out", tmp_path / "out", "--split", "test", "--format", kind)
    said = calls.printed("export", broken, *options, code=1)
    assert re.search(r"webgym: \S+/run/screenshots/\w\w/\w{64}\.png is damaged \(webgym verify RUN", said)
    assert not list((tmp_path / "out").glob("steps.*"))
