"""Every format tells the same tasks; what one writes, another gives back byte for byte."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.tasks.strategies import task_lists

from webgym.core.errors import TaskFileError
from webgym.core.task import Attachment, FactGroup, Rubric, Task
from webgym.offline.web import OfflineWeb
from webgym.run.choice import all_tasks, choose_tasks
from webgym.run.config import RunConfig, TaskChoice
from webgym.tasks.formats import Format, read_tasks, write_tasks

NAMES: dict[str, Format] = {
    "tasks.jsonl": "jsonl",
    "tasks.jsonl.gz": "jsonl",
    "tasks.jsonl.zst": "jsonl",
    "tasks.parquet": "parquet",
    "published.jsonl": "published",
    "train.jsonl.gz": "published",
}


def task(number: int, **changes: object) -> Task:
    rubric = Rubric((FactGroup(1, "group", ("fact",)),))
    made = Task(f"offline/{number}", "fünf Bücher", "http://x.test/", "Misc.", "News", rubric, "offline")
    return replace(made, **changes)


def through(folder: Path, name: str, tasks: Iterable[Task]) -> tuple[list[Task], bytes]:
    """What a format gives back, and its bytes."""
    path = folder / name
    write_tasks(path, tasks, format=NAMES[name])
    found = read_tasks(path)
    assert found.broken == []
    return found.tasks, path.read_bytes()


@given(tasks=task_lists)
@settings(max_examples=15, deadline=None)
def test_any_tasks_come_back_equal_in_every_format(
    tmp_path_factory: pytest.TempPathFactory, tasks: list[Task]
) -> None:
    folder = tmp_path_factory.mktemp("formats")
    for name in NAMES:
        assert through(folder, name, tasks)[0] == tasks, name


@given(tasks=task_lists)
@settings(max_examples=15, deadline=None)
def test_lines_and_parquet_give_each_other_back_byte_for_byte(
    tmp_path_factory: pytest.TempPathFactory, tasks: list[Task]
) -> None:
    folder = tmp_path_factory.mktemp("formats")
    from_lines, lines = through(folder, "tasks.jsonl", tasks)
    from_parquet, parquet = through(folder, "tasks.parquet", from_lines)
    assert through(folder, "tasks.jsonl", from_parquet)[1] == lines
    assert through(folder, "tasks.parquet", from_lines)[1] == parquet


def test_the_files_of_a_task_come_back_in_every_format(tmp_path: Path) -> None:
    files = (Attachment("cv.txt", text="Ann"), Attachment("photo.png", data=b"\x89PNG"))
    tasks = [task(1, files=files), task(2)]
    for name in NAMES:
        assert through(tmp_path, name, tasks)[0] == tasks, name


def test_the_offline_web_with_its_truths_comes_back_in_every_format(tmp_path: Path) -> None:
    tasks = list(OfflineWeb(per_family=1).tasks(None))
    for name in NAMES:
        given_back, first = through(tmp_path, name, tasks)
        assert given_back == tasks, name
        assert through(tmp_path, name, given_back)[1] == first, name


# --- what is written ----------------------------------------------------------------------------------


def test_parquet_has_a_typed_column_per_field(tmp_path: Path) -> None:
    path = tmp_path / "tasks.parquet"
    write_tasks(path, [task(1, reference_answer="3", flags=("dated",), extra={"attempt_level": 2})])
    table = pq.read_table(path)
    assert table.schema.metadata[b"webgym.tasks"] == b"1"
    assert {field.name for field in msgspec.structs.fields(Task)} | {"difficulty"} == set(table.column_names)
    assert table.to_pylist() == [
        {
            "id": "offline/1",
            "instruction": "fünf Bücher",
            "website": "http://x.test/",
            "domain": "Misc.",
            "subdomain": "News",
            "rubric": [{"id": 1, "description": "group", "facts": ["fact"]}],
            "difficulty": 1,
            "source": "offline",
            "reference_answer": "3",
            "example_answer": None,
            "parent_id": None,
            "split": None,
            "website_from": "given",
            "flags": ["dated"],
            "extra": '{"attempt_level":2}',
            "truth": None,
            "files": None,
            "identity": None,
            "stated_level": None,
        }
    ]
    meta = pq.ParquetFile(path).metadata.row_group(0).column(0)
    assert meta.compression == "ZSTD"


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    def breaking() -> Iterator[Task]:
        yield task(2)
        raise RuntimeError("stop")

    for name, kind in NAMES.items():
        path = tmp_path / name
        write_tasks(path, [task(1)], format=kind)
        with pytest.raises(RuntimeError, match="stop"):
            write_tasks(path, breaking(), format=kind)
        assert [each.id for each in read_tasks(path).tasks] == ["offline/1"]
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted(NAMES)


def test_a_folder_gets_a_file_per_split(tmp_path: Path) -> None:
    tasks = [task(1, split="train"), task(2, split="test"), task(3, split="train")]
    for kind in ("jsonl", "parquet", "published"):
        folder = tmp_path / kind
        assert write_tasks(folder, tasks, format=kind) == 3
        ending = "parquet" if kind == "parquet" else "jsonl"
        assert sorted(each.name for each in folder.iterdir()) == [f"test.{ending}", f"train.{ending}"]
        assert read_tasks(folder).tasks == [tasks[0], tasks[2], tasks[1]]
        assert [each.id for each in read_tasks(folder / f"test.{ending}").tasks] == ["offline/2"]
    with pytest.raises(TaskFileError, match=r"offline/4.*split the tasks first"):
        write_tasks(tmp_path / "set", [task(4)])


@pytest.mark.parametrize("older", ["train-00000-of-00002.parquet", "test.jsonl.zst", "tasks.jsonl.gz"])
@pytest.mark.parametrize("kind", ["jsonl", "parquet"])
def test_a_folder_has_only_the_tasks_last_written(tmp_path: Path, older: str, kind: Format) -> None:
    write_tasks(tmp_path, [task(2, split="train"), task(3, split="test")], format=kind)
    others = {"trainer.jsonl", "testing.parquet", "manifest.json", "train.txt"}
    for name in others:
        (tmp_path / name).write_text("not ours")
    (tmp_path / "train.d.jsonl").mkdir()
    write_tasks(tmp_path, [task(3, split="train")], format=kind)
    assert read_tasks(tmp_path).tasks == [task(3, split="train")]
    held = {f"train.{kind}", "train.d.jsonl", *others}
    assert {each.name for each in tmp_path.iterdir()} == held

    write_tasks(tmp_path / older, [task(1, split="test")])
    with pytest.raises(TaskFileError, match=rf"other task files, .*: {older} \("):
        write_tasks(tmp_path, [task(4, split="train")], format=kind)
    assert {each.name for each in tmp_path.iterdir()} == held | {older}, "nothing is written or deleted"


def test_names_that_tell_no_format_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TaskFileError, match=r"tasks\.txt.*\.parquet, \.jsonl"):
        write_tasks(tmp_path / "tasks.txt", [task(1)])
    with pytest.raises(TaskFileError, match="not a valid file name for the format"):
        write_tasks(tmp_path / "tasks.jsonl", [task(1)], format="parquet")
    with pytest.raises(TaskFileError, match="not a valid file name for the format"):
        write_tasks(tmp_path / "tasks.parquet", [task(1)], format="published")
    with pytest.raises(TaskFileError, match=r"cannot write .*tasks\.jsonl"):
        write_tasks(Path("/proc/nowhere/tasks.jsonl"), [task(1)])
    assert list(tmp_path.iterdir()) == []


def test_a_number_too_large_for_a_column_is_said(tmp_path: Path) -> None:
    big = task(1, rubric=Rubric((FactGroup(2**63, "", ("fact",)),)))
    with pytest.raises(TaskFileError, match="write JSON lines instead"):
        write_tasks(tmp_path / "tasks.parquet", [big])


# --- what is read -------------------------------------------------------------------------------------


def test_reading_goes_by_content_whatever_the_name(tmp_path: Path) -> None:
    for name, kind in NAMES.items():
        write_tasks(tmp_path / name, [task(1)], format=kind)
        (tmp_path / name).rename(tmp_path / "unnamed")
        assert [each.id for each in read_tasks(tmp_path / "unnamed").tasks] == ["offline/1"]


def test_a_folder_is_read_by_its_names(tmp_path: Path) -> None:
    write_tasks(tmp_path / "test.jsonl", [task(2)])
    write_tasks(tmp_path / "train-00000-of-00002.parquet", [task(3)])
    write_tasks(tmp_path / "train-00001-of-00002.parquet", [task(4)])
    write_tasks(tmp_path / "train-00001-of-00002.jsonl", [task(5)])
    (tmp_path / "trainer.jsonl").write_text("not ours")
    (tmp_path / "figures").mkdir()
    assert [each.id for each in read_tasks(tmp_path).tasks] == ["offline/3", "offline/4", "offline/2"]
    write_tasks(tmp_path / "tasks.jsonl.gz", [task(6)])
    assert [each.id for each in read_tasks(tmp_path).tasks] == ["offline/6"]


def test_an_id_counts_once_over_all_files_of_a_folder(tmp_path: Path) -> None:
    write_tasks(tmp_path / "train.jsonl", [task(1), task(2), task(1)])
    write_tasks(tmp_path / "test.parquet", [task(3), task(2), task(3)])
    told: list[str] = []
    found = all_tasks(RunConfig(tasks=TaskChoice(file=tmp_path)), told.append)
    assert {each.id: each.split for each in found} == {
        "offline/1": "train",
        "offline/2": "test",
        "offline/3": "test",
    }
    train, test = (f"skipped {tmp_path / name}" for name in ("train.jsonl", "test.parquet"))
    assert told == [
        f"{train}:3: a second task with the id 'offline/1'",
        f"{train}:2: the id 'offline/2' is that of a test task, too",
        f"{test}:3: a second task with the id 'offline/3'",
    ]


@pytest.mark.parametrize("splits", [("train", "test"), (None, "test"), ("test", "train"), ("test", None)])
def test_a_test_task_counts_before_one_with_its_id(tmp_path: Path, splits: tuple[object, object]) -> None:
    write_tasks(tmp_path / "tasks.jsonl", [task(1, split=split) for split in splits])
    found = read_tasks(tmp_path / "tasks.jsonl")
    assert [(each.id, each.split) for each in found.tasks] == [("offline/1", "test")]
    assert [broken.line for broken in found.broken] == [2 - splits.index("test")]


NO_FACT = Rubric((FactGroup(1, "", ("None",)),))


@pytest.mark.parametrize(
    ("test", "change"),
    [
        (task(9, rubric=NO_FACT), {}),
        (task(1, website="http://other.test/", rubric=NO_FACT), {}),
        (task(9, website="http://other.test/", parent_id="offline/1", rubric=NO_FACT), {}),
        (task(9), {"rubric": []}),
        (task(9), {"id": None, "split": "tset"}),
        (task(8), {}),
        (task(1, website="ftp://other.test/"), {}),
    ],
)
@pytest.mark.parametrize("suffix", ["jsonl", "parquet"])
def test_a_test_task_that_is_left_out_is_kept_from_training(
    tmp_path: Path, suffix: str, test: Task, change: dict[str, object]
) -> None:
    good = task(2, website="http://good.test/")
    write_tasks(tmp_path / "train.jsonl", [task(1), good])
    assert [each.id for each in read_tasks(tmp_path).tasks] == ["offline/1", "offline/2"]
    tests = [task(8, website="8.test"), test]
    if suffix == "jsonl":
        rows = [msgspec.to_builtins(tests[0]), msgspec.to_builtins(test) | change]
        (tmp_path / "test.jsonl").write_bytes(b"\n".join(map(msgspec.json.encode, rows)))
    else:
        table = table_of(*tests)
        rows = [table.to_pylist()[0], table.to_pylist()[1] | change]
        nullable = pa.schema([field.with_nullable(True) for field in table.schema])
        pq.write_table(pa.Table.from_pylist(rows, nullable), tmp_path / "test.parquet")
    found = read_tasks(tmp_path)
    assert [each.id for each in found.tasks] == ["offline/2", "offline/8"]
    (broken,) = [each for each in found.broken if each.file.name == "train.jsonl"]
    assert broken.line == 1
    assert "test task" in broken.reason
    assert broken.reason.endswith(", which is left out")


def table_of(*tasks: Task) -> pa.Table:
    from webgym.tasks.parquet import _batch

    return pa.Table.from_batches([_batch(list(tasks))])


@pytest.mark.parametrize(
    ("column", "value", "reason"),
    [
        ("website", None, "website: it is missing"),
        ("split", "dev", "Invalid enum value 'dev'"),
        ("website_from", "guessed", "Invalid enum value 'guessed'"),
        ("rubric", [], "at least one fact group"),
        ("rubric", [{"id": 1, "description": "", "facts": []}], "empty"),
        (
            "rubric",
            [{"id": None, "description": "", "facts": ["a"]}],
            r"missing required field `id` - at `\$\.groups\[0\]`",
        ),
        ("rubric", [{"id": 1, "description": None, "facts": ["a"]}], r"field `description`"),
        (
            "rubric",
            [{"id": 1, "description": "", "facts": ["a", None]}],
            r"rubric: Expected.*got `null` - at `.*facts\[1\]`",
        ),
        ("extra", "[1]", "object"),
        ("extra", "{", "truncated"),
        ("truth", "{}", "missing required field"),
    ],
)
def test_a_broken_row_of_parquet_is_named_and_skipped(
    tmp_path: Path, column: str, value: object, reason: str
) -> None:
    rows = table_of(task(0), task(1), task(2)).to_pylist()
    rows[1]["website"] = "https://apart.example/"  # a row with another split holds its website out
    rows[1][column] = value
    nullable = pa.schema([field.with_nullable(True) for field in table_of(task(0)).schema])
    nullable = nullable.set(
        nullable.get_field_index("rubric"),
        pa.field(
            "rubric",
            pa.list_(
                pa.struct(
                    [("id", pa.int64()), ("description", pa.string()), ("facts", pa.list_(pa.string()))]
                )
            ),
        ),
    )
    pq.write_table(pa.Table.from_pylist(rows, nullable), tmp_path / "tasks.parquet")
    found = read_tasks(tmp_path / "tasks.parquet")
    assert [each.id for each in found.tasks] == ["offline/0", "offline/2"]
    (broken,) = found.broken
    assert broken.line == 2
    assert re.search(reason, broken.reason)


def test_parquet_of_other_writers_loads(tmp_path: Path) -> None:
    """Columns in another order, large strings, some missing, some of their own."""
    table = table_of(task(1), task(2)).drop_columns(["truth", "extra", "flags", "website_from", "split"])
    table = table.select(sorted(table.column_names)).append_column("mine", pa.array([1, 2]))
    place = table.schema.get_field_index("instruction")
    table = table.set_column(place, "instruction", table["instruction"].cast(pa.large_string()))
    pq.write_table(table, tmp_path / "tasks.parquet", compression="snappy")
    assert read_tasks(tmp_path / "tasks.parquet").tasks == [task(1), task(2)]


def test_parquet_that_holds_no_tasks_is_said(tmp_path: Path) -> None:
    path = tmp_path / "tasks.parquet"
    pq.write_table(pa.table({"id": ["a"]}), path)
    with pytest.raises(TaskFileError, match="no column 'instruction'"):
        read_tasks(path)
    newer = table_of(task(1)).replace_schema_metadata({"webgym.tasks": "2"})
    pq.write_table(newer, path)
    with pytest.raises(TaskFileError, match="install a newer"):
        read_tasks(path)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(TaskFileError, match="cannot read the task file"):
        read_tasks(path)


def test_a_torn_archive_is_said(tmp_path: Path) -> None:
    for name in ("tasks.jsonl.gz", "tasks.jsonl.zst"):
        path = tmp_path / name
        write_tasks(path, [task(number) for number in range(50)])
        path.write_bytes(path.read_bytes()[:-30])
        with pytest.raises(TaskFileError, match="cannot read the task file"):
            read_tasks(path)


def test_archives_hold_the_lines_and_nothing_else(tmp_path: Path) -> None:
    write_tasks(tmp_path / "tasks.jsonl", [task(1)])
    write_tasks(tmp_path / "tasks.jsonl.gz", [task(1)])
    assert (
        gzip.decompress((tmp_path / "tasks.jsonl.gz").read_bytes()) == (tmp_path / "tasks.jsonl").read_bytes()
    )


@given(content=st.binary(max_size=200) | st.text(max_size=100).map(str.encode))
@settings(max_examples=100, deadline=None)
def test_any_bytes_are_tasks_or_an_error_of_ours(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("any") / "tasks.jsonl"
    for magic in (b"", b"PAR1", b"\x1f\x8b\x08", b"\x28\xb5\x2f\xfd", b'{"task_name": '):
        path.write_bytes(magic + content)
        with pytest.raises(TaskFileError):
            read_tasks(path)


@pytest.mark.parametrize("name", NAMES)
def test_a_run_takes_its_tasks_from_any_format(tmp_path: Path, name: str) -> None:
    tasks = [task(number, split="train") for number in range(3)]
    nothing = Rubric((FactGroup(1, "", ("None",)),))
    aside = replace(tasks[0], id="offline/nothing", rubric=nothing)
    write_tasks(tmp_path / name, [*tasks, aside], format=NAMES[name])
    found = choose_tasks(RunConfig(tasks=TaskChoice(file=tmp_path / name, split="train")))
    assert {each.id for each in found.tasks} == {each.id for each in tasks}
    assert (found.broken, len(found.set_aside)) == ([], 1)


@pytest.mark.parametrize("name", NAMES)
def test_words_for_no_reference_answer_are_none_in_any_format(tmp_path: Path, name: str) -> None:
    words = ["nan", "NaN", "null", "N/A", "undefined", "None", "-", " "]
    answers = ["none", "0", "No", "Na"]
    given = enumerate([*words, *answers])
    tasks = [task(number, split="train", reference_answer=text) for number, text in given]
    write_tasks(tmp_path / name, tasks, format=NAMES[name])
    found = [each.reference_answer for each in read_tasks(tmp_path / name).tasks]
    assert found == [*[None] * len(words), *answers]
