"""Whatever a file holds: no error but the typed ones, and every record is counted."""

from __future__ import annotations

import gzip
import json
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.tasks.sources import native

from webgym.core.errors import TaskFileError
from webgym.tasks.sources import SOURCES, Read, read_source
from webgym.tasks.sources.dates import contains_past_date

TODAY = date(2026, 1, 15)
LENIENT = settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

scalars = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text()
    | st.sampled_from(["None", "**", "[", "{'"])
)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)
NAMES = sorted({name for records in native.RECORDS.values() for record in records for name in record})
odd_records = st.dictionaries(st.sampled_from(NAMES) | st.text(), values, max_size=8)


def counted(source: str, path: Path) -> Read | None:
    """What was read, with its books balanced; ``None`` where it is an error of the right type."""
    try:
        found = read_source(source, path, today=TODAY)
    except TaskFileError:
        return None
    assert found.records == len(found.tasks) + len(found.skipped) > 0
    assert len({task.id for task in found.tasks}) == len(found.tasks)
    for task in found.tasks:
        assert task.instruction.strip() == task.instruction != ""
        assert (task.website is None) == (task.website_from == "inferred")
        json.dumps([task.id, task.instruction, task.website, *task.hints], ensure_ascii=False).encode()
    assert all(skipped.place and skipped.reason for skipped in found.skipped)
    return found


@pytest.mark.parametrize("suffix", ["jsonl", "json", "csv", "parquet", "jsonl.gz"])
@LENIENT
@given(data=st.binary(max_size=300) | st.text(alphabet='{}[]",:\\\n\r abq1', max_size=80).map(str.encode))
def test_any_bytes(tmp_path: Path, suffix: str, data: bytes) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(data)
    for source in ("deepshop", "mind2web-2", "browsecomp"):
        counted(source, path)


@pytest.mark.parametrize("source", SOURCES)
@LENIENT
@given(records=st.lists(odd_records, min_size=1, max_size=4))
def test_any_records(tmp_path: Path, source: str, records: list[dict[str, Any]]) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text("".join(json.dumps(record) + "\n" for record in [*records, {}]))
    found = counted(source, path)
    assert found is not None
    assert found.records == len(records) + 1


@pytest.mark.parametrize("source", native.RECORDS)
@LENIENT
@given(data=st.data())
def test_a_good_record_with_anything_in_one_field(tmp_path: Path, source: str, data: st.DataObject) -> None:
    record = dict(data.draw(st.sampled_from(native.RECORDS[source])))
    record[data.draw(st.sampled_from(sorted(record)))] = data.draw(values)
    path = tmp_path / "a.jsonl"
    path.write_text(json.dumps(record) + "\n" + json.dumps({"nothing": 1}) + "\n")
    found = counted(source, path)
    assert found is not None
    assert found.records == 2


@pytest.mark.parametrize("form", ["jsonl", "json", "csv", "gz", "parquet"])
@LENIENT
@given(data=st.data())
def test_a_file_with_damage_anywhere(tmp_path: Path, form: str, data: st.DataObject) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / f"a.{form}"
    records = [record | {"ques": f"{record['ques']} {n}"} for n in range(3) for record in native.DEEPSHOP]
    if form == "parquet":
        pq.write_table(pa.Table.from_pylist(records), path, row_group_size=2)
        whole = path.read_bytes()
    else:
        text = {"csv": native.as_csv(records), "json": json.dumps(records, indent=2)}.get(
            form, native.as_lines(records)
        )
        whole = gzip.compress(text.encode(), mtime=0) if form == "gz" else text.encode()
    at = data.draw(st.integers(0, len(whole)))
    cut = data.draw(st.integers(0, 40))
    path.write_bytes(whole[:at] + data.draw(st.binary(max_size=20)) + whole[at + cut :])
    found = counted("deepshop", path)
    if form in ("jsonl", "json", "csv") and at > len(whole) // 2:
        assert found is not None
        assert len(found.tasks) >= 2, "what stands before the damage is not lost"


@LENIENT
@given(text=st.text(max_size=80) | st.text(alphabet="0123456789-/ .,JanMry", max_size=40))
def test_any_text_has_dates_or_not(text: str) -> None:
    contains_past_date(text, TODAY)


@pytest.mark.parametrize(
    "line",
    [
        "[" * 100_000,
        '{"ques": ' * 100_000,
        '{"ques": ' + "9" * 10_000 + "}",
        '{"ques": NaN}',
        '{"ques": 1e999}',
    ],
)
@pytest.mark.parametrize("suffix", ["jsonl", "json", "csv"])
def test_extremes(tmp_path: Path, suffix: str, line: str) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_text(f"{line}\n{json.dumps(native.DEEPSHOP[0])}\n")
    counted("deepshop", path)


@pytest.mark.parametrize(
    "packed", ["[" * 100_000, "(" * 100_000, "-" * 100_000, "9" * 100_000, "a" * 2_000_000, "b'x'"]
)
def test_extremes_in_packed_values(tmp_path: Path, packed: str) -> None:
    path = tmp_path / "a.jsonl"
    for source, name in [
        ("travelplanner", "local_constraint"),
        ("insta-v3", "steps"),
        ("mind2web-live", "evaluation"),
    ]:
        path.write_text(json.dumps(native.RECORDS[source][0] | {name: packed}))
        found = counted(source, path)
        assert found is not None
        assert len(found.tasks) == 1
