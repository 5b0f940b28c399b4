"""The published format: every shape loads, and is written again byte for byte."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.tasks.strategies import json_values, published_files, spoken

from webgym.core.errors import TaskFileError
from webgym.core.task import FactGroup, Rubric, Task
from webgym.tasks.files import NEEDS_PICTURES, NO_FACTS, NONE_FACT
from webgym.tasks.formats import read_tasks, write_tasks
from webgym.tasks.published import DIFFICULTY_DIFFERS, OLD_RUBRIC, ORIGINAL_LINE, line_of, task_of

DATA = Path(__file__).parents[2].resolve().parent / "shared" / "data" / "webgym-format"

ROW: dict[str, Any] = {
    "benchmark_name": "deepshop",
    "task_name": "Find a green controller that the users of the shop rate above four stars.",
    "domain": "Electronics",
    "subdomain": "E-commerce Shopping",
    "website": "https://shop.example/?language=en",
    "definite_answer": "",
    "task_id": "Shop--1",
    "difficulty": 3,
    "evaluator_reference": [
        {"id": 1, "description": "the product", "facts": ["Controller", "Controller is green"]},
        {"id": 2, "description": "the rating", "facts": ["Rated above 4 stars"]},
    ],
    "task_id_decomposed_from": None,
}


def row(**changes: Any) -> dict[str, Any]:
    return ROW | changes


def lines(*rows: dict[str, Any]) -> bytes:
    return b"".join(json.dumps(each).encode() + b"\n" for each in rows)


def round_trip(folder: Path, content: bytes, name: str = "train.jsonl") -> bytes:
    """Read as published, written as published."""
    (folder / name).write_bytes(content)
    (folder / "out").mkdir(exist_ok=True)
    write_tasks(folder / "out" / name, read_tasks(folder / name).tasks, format="published")
    return (folder / "out" / name).read_bytes()


def test_a_row_is_a_task() -> None:
    assert task_of(ROW, "test") == Task(
        id="deepshop/Shop--1",
        instruction=ROW["task_name"],
        website=ROW["website"],
        domain="Electronics",  # outside the taxonomy: kept as it is
        subdomain="E-commerce Shopping",
        rubric=Rubric(
            (
                FactGroup(1, "the product", ("Controller", "Controller is green")),
                FactGroup(2, "the rating", ("Rated above 4 stars",)),
            )
        ),
        source="deepshop",
        split="test",
    )


SHAPES: list[tuple[Any, tuple[tuple[str, ...], ...], tuple[str, ...]]] = [
    ("Controller is green", (("Controller is green",),), (OLD_RUBRIC,)),
    (["One", "Two", "Three"], (("One", "Two", "Three"),), (OLD_RUBRIC,)),
    (
        [{"description": "One", "difficulty": 1}, {"description": "Two", "difficulty": 2}],
        (("One",), ("Two",)),
        (OLD_RUBRIC,),
    ),
    ([{"id": "a", "description": "x", "facts": ["One"]}], (("One",),), ()),
    ([{"id": 4, "description": "x", "facts": "One"}], (("One",),), ()),
    ([{"id": 1, "facts": ["One"]}, {"id": 1, "facts": ["Two"]}], (("One",), ("Two",)), ()),
    ([{"id": 1, "facts": ["One", ""]}, {"id": 2, "facts": []}], (("One",),), ()),
    ([{"id": 1, "facts": ["One"]}, {"id": 2, "facts": ["None"]}], (("One",),), (NONE_FACT,)),
    ([{"id": 1, "facts": ["One", None, "N/A."]}], (("One",),), (NONE_FACT,)),
    ([{"id": 1, "facts": ["One"]}, {"id": 2, "description": "x", "facts": None}], (("One",),), (NONE_FACT,)),
    ("[{'id': 1, 'description': None, 'facts': ['One']}]", (("One",),), ()),
    ('[{"id": 1, "description": "x", "facts": ["One"]}]', (("One",),), ()),
    ({"fact_groups": [{"id": 1, "description": "x", "facts": ["One"]}], "difficulty": 1}, (("One",),), ()),
    ('{"fact_groups": [{"id": 1, "facts": ["One", "Two"]}], "difficulty": 2}', (("One", "Two"),), ()),
    ({"groups": [{"id": 1, "description": "x", "facts": ["One"]}]}, (("One",),), ()),
    ([{"id": None, "description": "One", "difficulty": 1, "facts": None}], (("One",),), (OLD_RUBRIC,)),
    ("[draft] One", (("[draft] One",),), (OLD_RUBRIC,)),
]

NOTHING: list[Any] = [
    *("", " \t", *"""None none null N/A nan - [] {} ['None'] ["None"] [None] **""".split()),
    *("**", None, [], {}, [[]], [None], ["None"], ["", "N/A"], float("nan")),
    [{"id": 1, "description": "x", "facts": ["None"]}, {"id": 2, "description": "y", "facts": [""]}],
    [{"id": 1, "description": "x", "facts": None}, {"id": 2, "description": "y", "facts": "None"}],
    [{"id": 1, "description": "x", "facts": [" None. ", "Not applicable", "None specified", "null"]}],
    [{"description": "None", "difficulty": 0}, {"description": "", "difficulty": 0}],
    '[{"id": 1, "description": "x", "facts": ["None"]}]',
    "[{'id': 1, 'description': 'filters', 'facts': ['None']}]",
]


@pytest.mark.parametrize(("reference", "facts", "flags"), SHAPES)
def test_every_shape_of_the_facts_loads_and_is_written_again(
    tmp_path: Path, reference: Any, facts: tuple[tuple[str, ...], ...], flags: tuple[str, ...]
) -> None:
    told = row(evaluator_reference=reference)
    del told["difficulty"]
    task = task_of(told)
    assert tuple(group.facts for group in task.rubric.groups) == facts
    assert len({group.id for group in task.rubric.groups}) == len(facts)
    assert task.flags == flags
    assert round_trip(tmp_path, lines(told)) == lines(told)


def test_rows_without_a_fact_to_judge_are_set_aside_and_counted(tmp_path: Path) -> None:
    """Judged, they would reward nothing: whatever the row says of its difficulty and its answer."""
    aside = [row(task_id=place, evaluator_reference=said) for place, said in enumerate(NOTHING)]
    aside += [row(task_id="level", difficulty="medium", evaluator_reference=[], definite_answer="Paris")]
    aside += [row(task_id="zero", difficulty=0, evaluator_reference="None")]
    (tmp_path / "test.jsonl").write_bytes(lines(*aside, ROW))
    found = read_tasks(tmp_path / "test.jsonl")
    assert [task.id for task in found.tasks] == ["deepshop/Shop--1"]
    assert found.broken == []
    assert [record.line for record in found.set_aside] == list(range(1, len(aside) + 1))
    assert found.set_aside[0].reason == "deepshop/0 has no fact to judge"
    (tmp_path / "none.jsonl").write_bytes(lines(*aside))
    with pytest.raises(
        TaskFileError, match=rf"no task that can be judged: {len(aside)} have no fact to judge"
    ):
        read_tasks(tmp_path / "none.jsonl")


def test_what_was_read_before_such_rows_were_known_is_set_aside_too(tmp_path: Path) -> None:
    """WebGym's own files may hold what an older release made of such rows."""
    task = task_of(ROW)
    nothing = Rubric((FactGroup(1, "x", ("None",)),))
    partly = Rubric((FactGroup(1, "x", ("One", "None")), FactGroup(2, "y", ("N/A",))))
    tasks = [
        replace(task, id="flagged", flags=(NO_FACTS,)),
        replace(task, id="none", rubric=nothing),
        replace(task, id="partly", rubric=partly, reference_answer="None"),
    ]
    for name in ("own.jsonl", "own.parquet"):
        write_tasks(tmp_path / name, tasks)
        found = read_tasks(tmp_path / name)
        assert [record.line for record in found.set_aside] == [1, 2]
        [left] = found.tasks
        assert left.rubric == Rubric((FactGroup(1, "x", ("One",)),))
        assert (left.reference_answer, left.flags) == (None, (NONE_FACT,))


@pytest.mark.parametrize(
    ("column", "value", "field", "read"),
    [
        ("definite_answer", "", "reference_answer", None),
        ("definite_answer", None, "reference_answer", None),
        ("definite_answer", " ", "reference_answer", None),
        ("definite_answer", "None", "reference_answer", None),
        ("definite_answer", " null ", "reference_answer", None),
        ("definite_answer", "N/A", "reference_answer", None),
        ("definite_answer", "nan", "reference_answer", None),
        ("definite_answer", [], "reference_answer", None),
        ("definite_answer", ["None"], "reference_answer", None),
        ("definite_answer", "['None']", "reference_answer", None),
        ("definite_answer", "Nothing", "reference_answer", "Nothing"),
        ("definite_answer", 0, "reference_answer", "0"),
        ("definite_answer", "Paris", "reference_answer", "Paris"),
        ("definite_answer", 42, "reference_answer", "42"),
        ("definite_answer", 42.0, "reference_answer", "42"),
        ("task_id", 17, "id", "deepshop/17"),
        ("task_id", "deepshop/17", "id", "deepshop/17"),
        ("benchmark_name", None, "source", "webgym"),
        ("benchmark_name", "", "id", "webgym/Shop--1"),
        ("task_id_decomposed_from", None, "parent_id", None),
        ("task_id_decomposed_from", "", "parent_id", None),
        ("task_id_decomposed_from", "None", "parent_id", None),
        ("domain", "nan", "domain", ""),
        ("task_id_decomposed_from", "Shop--0", "parent_id", "deepshop/Shop--0"),
        ("task_id_decomposed_from", 0, "parent_id", "deepshop/0"),
        ("domain", None, "domain", ""),
        ("difficulty", 3, "flags", ()),
        ("difficulty", "3", "flags", ()),
        ("difficulty", 3.0, "flags", ()),
        ("difficulty", 1, "flags", (DIFFICULTY_DIFFERS,)),
        ("difficulty", None, "flags", ()),
        ("difficulty", True, "flags", (DIFFICULTY_DIFFERS,)),
        ("difficulty", "hard", "flags", (DIFFICULTY_DIFFERS,)),
        ("attempt_level", 2, "extra", {"attempt_level": 2}),
        ("attempt_level", None, "extra", {}),
        ("image", "https://shop.example/picture?id=3", "flags", (NEEDS_PICTURES,)),
        ("image", None, "flags", ()),
        ("image", "", "flags", ()),
        ("shown", ["a.txt", "look/kettle.webp"], "flags", (NEEDS_PICTURES,)),
        ("image", {"bytes": None, "path": "kettle.png"}, "flags", (NEEDS_PICTURES,)),
        ("images", [], "flags", ()),
        ("distribution", "train", "extra", {"distribution": "train"}),
        ("seen", {"by": [1.5, None]}, "extra", {"seen": {"by": [1.5, None]}}),
        ("webgym", "a column of somebody else's", "extra", {"webgym": "a column of somebody else's"}),
        ("webgym", {"flags": 3}, "extra", {"webgym": {"flags": 3}}),
        ("webgym", {"id": "mine"}, "id", "mine"),
        ("published", 1, "extra", {}),
    ],
)
def test_every_form_of_a_column(tmp_path: Path, column: str, value: Any, field: str, read: Any) -> None:
    told = row(**{column: value})
    assert getattr(task_of(told), field) == read
    assert round_trip(tmp_path, lines(told)) == lines(told)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"not json", "malformed"),
        (b"[1]", "not a JSON object"),
        (b'"x\xff"', "utf-8"),
        (lines(row(task_id="")).strip(), "task_id is empty"),
        (lines(row(task_name="  ")).strip(), "task_name is empty"),
        (lines(row(website=None)).strip(), "website is empty"),
        (lines(row(website="None")).strip(), "website is empty"),
        (lines({k: v for k, v in ROW.items() if k != "website"}).strip(), "has no website"),
        (
            lines({k: v for k, v in ROW.items() if k != "evaluator_reference"}).strip(),
            "no evaluator_reference",
        ),
        (lines(row(evaluator_reference=[{"facts": [{"a": 1}]}])).strip(), "is not text"),
        (
            lines(row(evaluator_reference={"checks": ["One"], "total": 1})).strip(),
            "form, with the keys checks, total",
        ),
        (lines(ROW).strip(), "second task with the id 'deepshop/Shop--1'"),
        (lines(row(task_name="\ud800")).strip(), "surrogate"),
        (b'{"task_name": ' + b"[" * 100_000, "recursion"),
    ],
)
def test_a_broken_row_is_named_and_the_rest_loads_and_is_written(
    tmp_path: Path, line: bytes, reason: str
) -> None:
    first, last = lines(ROW), lines(row(task_id="Shop--2"))
    (tmp_path / "test.jsonl").write_bytes(first + line + b"\n" + last)
    found = read_tasks(tmp_path / "test.jsonl")
    (broken,) = found.broken
    assert broken.line == 2
    assert reason in broken.reason
    assert {task.split for task in found.tasks} == {"test"}
    write_tasks(tmp_path / "out.jsonl", found.tasks, format="published")
    assert (tmp_path / "out.jsonl").read_bytes() == first + last


@given(told=st.dictionaries(st.sampled_from([*ROW, "webgym", "published"]), json_values, min_size=4))
def test_any_values_are_a_task_or_a_reason(told: dict[str, Any]) -> None:
    try:
        task = task_of({"task_id": 1, "task_name": "x", "website": "y", "evaluator_reference": "z"} | told)
    except ValueError:
        return
    assert msgspec.convert(msgspec.to_builtins(task), Task) == task
    written = json.loads(line_of(task, None))
    assert task_of(written) == task


# --- byte for byte ------------------------------------------------------------------------------------


@given(content=published_files())
@settings(max_examples=30, deadline=None)
def test_any_file_is_written_again_byte_for_byte_by_way_of_every_format(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    folder = tmp_path_factory.mktemp("published")
    assert round_trip(folder, content) == content
    tasks = read_tasks(folder / "train.jsonl").tasks
    for name in ("own.jsonl", "own.parquet"):
        write_tasks(folder / name, tasks)
        again = read_tasks(folder / name).tasks
        assert again == tasks
        write_tasks(folder / "train.jsonl", again, format="published")
        assert (folder / "train.jsonl").read_bytes() == content


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf" + lines(ROW),
        lines(ROW).rstrip(b"\n"),
        lines(ROW).replace(b"\n", b"\r\n"),
        b"\n \n" + lines(ROW) + b"\n\n" + lines(row(task_id=2)) + b"\n \n",
        lines(ROW).replace(b"{", b"{  ", 1),
        lines(ROW).replace(b"green", b"gr\\u00fcn"),
        lines(ROW).replace(b"green", b"gr\\u00FCN \\/ "),
        lines(ROW).replace(b"green", "grün".encode()),
        lines(ROW).replace(b'"difficulty": 3', b'"difficulty": 3e0'),
        lines(ROW).replace(b'"difficulty": 3', b'"difficulty": 1, "difficulty": 3'),
        lines(row(definite_answer=float("nan"), score=float("-inf"))),
        lines(ROW).replace(b'"difficulty": 3', b'"score": 0.10, "big": 123456789012345678901234567890'),
    ],
)
def test_what_writers_of_json_do_differently_is_kept(tmp_path: Path, content: bytes) -> None:
    assert round_trip(tmp_path, content) == content


def test_the_real_rows(tmp_path: Path) -> None:
    if not DATA.is_dir():
        pytest.skip(f"{DATA} is not there")
    for file in DATA.glob("*.jsonl"):
        content = file.read_bytes()
        found = read_tasks(file)
        assert found.broken == []
        assert len(found.tasks) == len(content.splitlines())
        flags = [set(task.flags) for task in found.tasks]
        assert flags == [{DIFFICULTY_DIFFERS}, {NONE_FACT}]
        assert round_trip(tmp_path, content) == content


def test_of_many_files_one_is_made_without_joining_lines(tmp_path: Path) -> None:
    content = b"\xef\xbb\xbf" + lines(ROW).rstrip(b"\n")
    (tmp_path / "train.jsonl").write_bytes(content)
    (tmp_path / "test.jsonl").write_bytes(content.replace(b"Shop--1", b"Shop--2"))
    write_tasks(tmp_path / "all.jsonl", read_tasks(tmp_path).tasks, format="published")
    both = lines(ROW) + lines(row(task_id="Shop--2")).rstrip(b"\n")
    assert (tmp_path / "all.jsonl").read_bytes() == b"\xef\xbb\xbf" + both


# --- changes ------------------------------------------------------------------------------------------


def changed(told: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """The row that is written of a task that was changed since it was read."""
    task = task_of(told)
    task.extra[ORIGINAL_LINE] = json.dumps(told)
    written: dict[str, Any] = json.loads(line_of(replace(task, **changes), None))
    return written


def test_what_was_changed_since_is_written_anew_and_nothing_else() -> None:
    told = row(task_id=5, difficulty=1, attempt_level=2, evaluator_reference=["One", "Two"])
    answered = changed(told, reference_answer="42")
    assert answered == told | {"definite_answer": "42"}
    assert list(answered) == list(told)
    rubric = Rubric((FactGroup(1, "x", ("One",)), FactGroup(2, "y", ("Two",))))
    groups = [
        {"id": 1, "description": "x", "facts": ["One"]},
        {"id": 2, "description": "y", "facts": ["Two"]},
    ]
    assert changed(told, rubric=rubric, flags=()) == told | {"evaluator_reference": groups, "difficulty": 2}
    assert changed(told, id="deepshop/6") == told | {"task_id": "deepshop/6"}
    assert changed(told, flags=("dated",)) == told | {"webgym": {"flags": ["dated"]}}
    without = {name: value for name, value in told.items() if name != "attempt_level"}
    assert changed(told, extra={ORIGINAL_LINE: json.dumps(told), "attempt_level": 3}) == told | {
        "attempt_level": 3
    }
    assert changed(told, extra={ORIGINAL_LINE: json.dumps(told)}) == without


@given(content=published_files(), flag=st.text(max_size=3), answer=spoken)
@settings(max_examples=30, deadline=None)
def test_a_changed_task_is_read_back_as_it_was_changed(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, flag: str, answer: str
) -> None:
    path = tmp_path_factory.mktemp("changed") / "train.jsonl"
    path.write_bytes(content)
    tasks = [replace(task, flags=(flag,), reference_answer=answer) for task in read_tasks(path).tasks]
    write_tasks(path, tasks, format="published")

    def bare(some: list[Task]) -> list[Task]:
        return [
            replace(task, extra={k: v for k, v in task.extra.items() if k != ORIGINAL_LINE}) for task in some
        ]

    assert bare(read_tasks(path).tasks) == bare(tasks)


def test_our_own_rows_have_the_columns_of_the_published_set(tmp_path: Path) -> None:
    task = task_of(ROW)
    path = tmp_path / "tasks.jsonl"
    write_tasks(path, [replace(task, split="test", website_from="inferred")], format="published")
    assert json.loads(path.read_bytes()) == ROW | {
        "task_id": "deepshop/Shop--1",
        "webgym": {"split": "test", "website_from": "inferred"},
    }
    write_tasks(tmp_path / "test.jsonl", [replace(task, split="test")], format="published")
    assert json.loads((tmp_path / "test.jsonl").read_bytes()) == ROW | {"task_id": "deepshop/Shop--1"}


def test_a_task_that_no_row_can_tell_is_said(tmp_path: Path) -> None:
    with pytest.raises(
        TaskFileError, match=r"'deepshop/Shop--1' cannot be written as a published row: website is empty"
    ):
        write_tasks(tmp_path / "out.jsonl", [replace(task_of(ROW), website=" ")], format="published")


def test_the_published_set_loads_as_the_hub_converts_it_to_parquet(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.Table.from_pylist([row(task_id="1"), row(task_id="")]), tmp_path / "test-0.parquet")
    found = read_tasks(tmp_path)
    assert found.tasks == [task_of(row(task_id="1"), "test")]
    assert [(broken.line, broken.reason) for broken in found.broken] == [(2, "task_id is empty")]


@pytest.mark.parametrize("suffix", ["jsonl", "parquet"])
@pytest.mark.parametrize(
    "left_out",
    [
        row(task_id="9"),
        row(task_id="9", task_name=""),
        row(task_id="", task_name="too"),
        row(task_id="9", website="other.test", task_id_decomposed_from="1"),
        row(task_id="1", website="", task_name=""),
    ],
)
def test_a_test_row_that_is_left_out_is_kept_from_training(
    tmp_path: Path, left_out: dict[str, Any], suffix: str
) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    for name, rows in {
        "train": [row(task_id="1"), row(task_id="2", website="good.test")],
        "test": [row(task_id="8", website="8.test"), left_out | {"evaluator_reference": "None"}],
    }.items():
        if suffix == "jsonl":
            (tmp_path / f"{name}.jsonl").write_bytes(lines(*rows))
        else:
            texts = [each | {"evaluator_reference": str(each["evaluator_reference"])} for each in rows]
            pq.write_table(pa.Table.from_pylist(texts), tmp_path / f"{name}.parquet")
    assert [each.id for each in read_tasks(tmp_path).tasks] == ["deepshop/2", "deepshop/8"]
