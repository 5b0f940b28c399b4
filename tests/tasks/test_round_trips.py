"""Task files that other programs have read and written again hold the same tasks."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from webgym.core.task import Attachment, FactGroup, Rubric, Task
from webgym.core.truth import (
    AnswerTruth,
    Click,
    Evidence,
    FactTruth,
    Fill,
    Give,
    Home,
    See,
    StateCheck,
    Truth,
)
from webgym.tasks.files import NEEDS_PICTURES
from webgym.tasks.formats import read_tasks, write_tasks

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases" / "training"


def task(number: int, **changes: Any) -> Task:
    rubric = Rubric((FactGroup(1, "halls", (f"Names hall {number}", "Says how large it is")),))
    made = Task(
        f"mine/{number}", "Which hall is largest?", "https://halls.example/", "Misc.", "News", rubric, "mine"
    )
    return replace(made, **changes)


TRUTH = Truth(
    "halls.webgym.test",
    (
        FactTruth(1, 0, (Evidence(("Great Hall", "[1]"), "/halls"),)),
        FactTruth(1, 1, (Evidence(("400 seats",)),)),
    ),
    AnswerTruth(required=(("Great Hall",),)),
    (Home(), Fill("Search", "hall"), Click("Go", "button"), See(("Great Hall",)), Give("Great Hall")),
)
STATES = Truth(
    "halls.webgym.test",
    (
        FactTruth(1, 0, (), (StateCheck(("cart", "Lamp"), 2), StateCheck(("cart", "Mug"), None))),
        FactTruth(1, 1),
    ),
    AnswerTruth(required=(("done",), ("2", "two")), others=("3",), by_comma=True),
    (Click(path="/cart"), Give("done")),
)
SETS: dict[str, list[Task]] = {
    "plain": [
        task(1),
        task(2, rubric=Rubric((FactGroup(1, "", ("One",)), FactGroup(2, "b", ("Two", "Three"))))),
    ],
    "answers": [task(1, reference_answer="25"), task(2, reference_answer="Paris"), task(3)],
    "numbers": [task(1, reference_answer="25"), task(2, reference_answer="-3"), task(3)],
    "mixed": [
        task(1, split="train", parent_id="mine/2", flags=("dated",)),
        task(2, example_answer="perhaps", website_from="derived"),
        task(3, extra={"attempt_level": 2, "by": ["a", "b"]}),
        task(4, extra={"seen": "yes"}, split="test", website="https://other.example/"),
    ],
    "files": [task(1, files=(Attachment("a.txt", "hello"), Attachment("b.bin", data=b"\x00\xff"))), task(2)],
    "truths": [task(1, truth=TRUTH), task(2, truth=STATES)],
    "days": [task(1, reference_answer="2024-03-03"), task(2, reference_answer="2025-12-31")],
}


def by_pandas(source: Path, target: Path) -> None:
    import pandas as pd

    frame = pd.read_json(source, lines=True) if source.suffix == ".jsonl" else pd.read_parquet(source)
    if target.suffix == ".jsonl":
        frame.to_json(target, orient="records", lines=True)
    else:
        frame.to_parquet(target)


def by_datasets(source: Path, target: Path) -> None:
    import datasets

    kind = "json" if source.suffix == ".jsonl" else "parquet"
    cache = str(target.parent / "cache")
    table = datasets.load_dataset(kind, data_files=str(source), split="train", cache_dir=cache)
    if target.suffix == ".jsonl":
        table.to_json(target)
    else:
        table.to_parquet(target)


def by_duckdb(source: Path, target: Path) -> None:
    import duckdb

    reads = "read_json" if source.suffix == ".jsonl" else "read_parquet"
    kind = "json" if target.suffix == ".jsonl" else "parquet"
    with duckdb.connect() as database:
        database.sql(f"copy (select * from {reads}('{source}')) to '{target}' (format {kind})")


def by_arrow(source: Path, target: Path) -> None:
    import pyarrow.json
    import pyarrow.parquet as pq

    table = pyarrow.json.read_json(source) if source.suffix == ".jsonl" else pq.read_table(source)
    if target.suffix == ".jsonl":
        target.write_text("".join(json.dumps(row) + "\n" for row in table.to_pylist()))
    else:
        pq.write_table(table, target)


PROGRAMS: dict[str, tuple[str, Callable[[Path, Path], None]]] = {
    "pandas": ("pandas", by_pandas),
    "datasets": ("datasets", by_datasets),
    "duckdb": ("duckdb", by_duckdb),
    "arrow": ("pyarrow", by_arrow),
}


_LISTS = "has no type for lists of different things"
_DAYS = "writes a day as a number of milliseconds, or not at all"
CANNOT = {
    ("truths", "pandas", "parquet"): _LISTS,
    ("truths", "arrow", "parquet"): _LISTS,
    ("truths", "arrow", "jsonl"): _LISTS,
    ("days", "datasets", "jsonl"): _DAYS,
    ("days", "arrow", "jsonl"): _DAYS,
}


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("source", ["tasks.jsonl", "tasks.parquet"])
@pytest.mark.parametrize("target", ["jsonl", "parquet"])
@pytest.mark.parametrize("name", SETS)
def test_tasks_come_back_from(tmp_path: Path, program: str, source: str, target: str, name: str) -> None:
    module, convert = PROGRAMS[program]
    pytest.importorskip(module)
    write_tasks(tmp_path / source, SETS[name])
    path = tmp_path / f"again.{target}"
    if why := CANNOT.get((name, program, target)) if source.endswith("jsonl") else None:
        pytest.skip(f"{program} {why}")
    convert(tmp_path / source, path)
    found = read_tasks(path)
    assert not found.broken
    assert found.tasks == SETS[name]


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("target", ["jsonl", "parquet"])
def test_published_rows_come_back_from(tmp_path: Path, program: str, target: str) -> None:
    module, convert = PROGRAMS[program]
    pytest.importorskip(module)
    told: list[dict[str, Any]] = [
        {"task_id": "a", "task_name": "Name it", "website": "https://a.example", "definite_answer": "Paris"},
        {"task_id": "b", "task_name": "Name two", "website": "https://b.example", "attempt_level": 2},
    ]
    told[0]["evaluator_reference"] = [{"id": 1, "description": "x", "facts": ["One"]}]
    told[1]["evaluator_reference"] = [{"description": "Two", "difficulty": 1}]
    source = tmp_path / "train.jsonl"
    source.write_text("".join(json.dumps(row) + "\n" for row in told))
    convert(source, tmp_path / f"again.{target}")
    before, after = read_tasks(source).tasks, read_tasks(tmp_path / f"again.{target}").tasks
    assert [each.rubric for each in after] == [each.rubric for each in before]
    assert [each.reference_answer for each in after] == ["Paris", None]
    assert [each.extra.get("attempt_level") for each in after] == [None, 2]
    assert "attempt_level" not in after[0].extra


def test_null_is_a_missing_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.jsonl"
    told = {"instruction": "Look.", "website": "https://halls.example/"}
    names = "id domain subdomain rubric source split flags extra files truth notes".split()
    missing = dict.fromkeys(names)
    path.write_text(json.dumps(told | missing) + "\n" + json.dumps(told) + "\n")
    first, second = read_tasks(path).tasks
    assert replace(second, id=first.id) == first
    assert (first.id, second.id) == ("mine/1", "mine/2")


def test_a_needed_key_that_is_null_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "mine.jsonl"
    path.write_text(
        '{"instruction": null, "website": "a.example"}\n{"instruction": "a", "website": "a.example"}\n'
    )
    [broken] = read_tasks(path).broken
    assert broken.reason == "instruction: it is missing"


def test_a_number_that_may_have_lost_digits_is_no_answer(tmp_path: Path) -> None:
    """As pandas makes of a column with 3.10 in it."""
    path = tmp_path / "mine.jsonl"
    told = {"instruction": "Look.", "website": "https://halls.example/"}
    rows = [told | {"reference_answer": value} for value in (3.1, 25.0, True)]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    found = read_tasks(path)
    assert [each.reference_answer for each in found.tasks] == ["25"]
    assert "dtype=False" in found.broken[0].reason


@pytest.mark.parametrize("packed", [False, True])
def test_a_rubric_as_its_writer_replies_it(tmp_path: Path, *, packed: bool) -> None:
    groups = [{"id": 1, "description": "Halls", "facts": ["Names the Great Hall", "Says how large it is"]}]
    reply: Any = {"fact_groups": groups, "difficulty": 2}
    told = {"instruction": "Look.", "website": "https://halls.example/"}
    path = tmp_path / "mine.jsonl"
    forms = [reply, {"groups": groups}, groups]
    rows = [told | {"rubric": json.dumps(form) if packed else form} for form in forms]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert [each.difficulty for each in read_tasks(path).tasks] == [2, 2, 2]


def test_a_task_with_a_picture_is_flagged(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    told = {"instruction": "Find this.", "website": "https://halls.example/"}
    rows = [
        told | {"image": "https://halls.example/see?7"},
        told | {"image": None},
        told | {"given": ["a.jpeg"]},
    ]
    path = tmp_path / "mine.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert [each.flags for each in read_tasks(path).tasks] == [(NEEDS_PICTURES,), (), (NEEDS_PICTURES,)]
    table = pa.Table.from_pylist([told | {"photo": {"bytes": b"\x89PNG", "path": None}}])
    pq.write_table(table, tmp_path / "mine.parquet")
    assert read_tasks(tmp_path / "mine.parquet").tasks[0].flags == (NEEDS_PICTURES,)


@pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is not here")
def test_files_that_others_made() -> None:
    hub = CASES / "09-hub-round-trip-json-to-parquet"
    assert read_tasks(hub / "tasks.parquet").tasks == read_tasks(hub / "tasks.jsonl").tasks
    assert len(read_tasks(CASES / "10-null-for-a-missing-key" / "tasks.jsonl").tasks) == 2
    written = read_tasks(CASES / "12-rubric-in-the-rubric-writers-own-form" / "train.jsonl")
    assert [each.difficulty for each in written.tasks] == [1, 3, 1]
