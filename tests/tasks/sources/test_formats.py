"""The same records in whatever file they come, whole and broken."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import re
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.tasks.sources import native

from webgym.core.errors import TaskFileError
from webgym.tasks.sources import Read, SourceTask, read_source

TODAY = date(2026, 1, 15)
Records = list[dict[str, Any]]


def read(name: str, path: Path) -> Read:
    found = read_source(name, path, today=TODAY)
    assert found.records == len(found.tasks) + len(found.skipped)
    return found


def shallow(records: Records) -> Records:
    """Nested values as JSON in strings, for formats that cannot nest, or not the same in every row."""
    return [
        {
            name: json.dumps(value, ensure_ascii=False) if isinstance(value, (list, dict)) else value
            for name, value in record.items()
        }
        for record in records
    ]


def parquet(path: Path, records: Records) -> None:
    names = list(dict.fromkeys(name for record in records for name in record))
    columns = {}
    for name in names:
        values = [record.get(name) for record in shallow(records)]
        mixed = len({type(value) for value in values if value is not None}) > 1
        columns[name] = [str(value) for value in values] if mixed else values
    pq.write_table(pa.table(columns), path)


def text(make: Callable[[Records], str], encoding: str = "utf-8") -> Callable[[Path, Records], None]:
    def write(path: Path, records: Records) -> None:
        path.write_bytes(make(records).encode(encoding))

    return write


def packed(pack: Callable[[bytes], bytes]) -> Callable[[Path, Records], None]:
    def write(path: Path, records: Records) -> None:
        path.write_bytes(pack(native.as_lines(records).encode()))

    return write


def array(records: Records) -> str:
    return json.dumps(records, indent=4, ensure_ascii=False)


def backwards(records: Records) -> Records:
    """Other columns, in another order."""
    return [{"Unnamed: 0": 7, **dict(reversed(record.items())), "split": None} for record in records]


FORMS: dict[str, Callable[[Path, Records], None]] = {
    "lines.jsonl": text(native.as_lines),
    "no-suffix": text(native.as_lines),
    "no-end.jsonl": text(lambda records: native.as_lines(records).rstrip("\n")),
    "windows.jsonl": text(lambda records: native.as_lines(records).replace("\n", "\r\n")),
    "old-mac.jsonl": text(lambda records: native.as_lines(records).replace("\n", "\r")),
    "blank-lines.jsonl": text(lambda records: "\n\n" + native.as_lines(records).replace("\n", "\n \n\n")),
    "mark.jsonl": text(lambda records: "\ufeff" + native.as_lines(records)),
    "utf-16.jsonl": text(native.as_lines, "utf-16"),
    "ascii.jsonl": text(lambda records: "".join(json.dumps(record) + "\n" for record in records)),
    "array.json": text(array),
    "one-line.json": text(lambda records: json.dumps(records)),
    "lines.json": text(native.as_lines),
    "blank-start.json": text(lambda records: " \n\t" + array(records)),
    "described.json": text(lambda records: json.dumps({"columns": ["a"], "n": 2, "rows": records})),
    "mark.json": text(lambda records: "\ufeff" + array(records).replace("\n", "\r\n")),
    "data.json": text(lambda records: json.dumps({"version": "1.0", "data": records}, indent=1)),
    "splits.json": text(lambda records: json.dumps({"train": records[:1], "test": records[1:]})),
    "lines.csv": text(native.as_lines),
    "table.csv": text(native.as_csv),
    "windows.csv": text(lambda records: "\ufeff" + native.as_csv(records).replace("\n", "\r\n")),
    "no-end.csv": text(lambda records: native.as_csv(records).rstrip("\n")),
    "json.csv": text(lambda records: native.as_csv(shallow(records))),
    "table.tsv": text(lambda records: native.as_csv(records, "\t")),
    "semicolons.csv": text(lambda records: native.as_csv(records, ";")),
    "backwards.csv": text(lambda records: native.as_csv(backwards(records))),
    "backwards.jsonl": text(lambda records: native.as_lines(backwards(records))),
    "table.parquet": parquet,
    "parquet-without-suffix": parquet,
    "lines.jsonl.gz": packed(gzip.compress),
    "lines.jsonl.bz2": packed(bz2.compress),
    "lines.jsonl.xz": packed(lzma.compress),
    "lines.jsonl.zst": packed(lambda data: pa.compress(data, "zstd", asbytes=True)),
    "table.csv.gz": lambda path, records: (
        path.write_bytes(gzip.compress(native.as_csv(records).encode())),
        None,
    )[1],
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[SourceTask]]:
    """What every source gives from plain JSON lines."""
    folder = tmp_path_factory.mktemp("plain")
    for source, records in native.RECORDS.items():
        (folder / f"{source}.jsonl").write_text(native.as_lines(records), "utf-8")
    return {source: read(source, folder / f"{source}.jsonl").tasks for source in native.RECORDS}


@pytest.mark.parametrize("form", FORMS)
def test_the_form_does_not_matter(tmp_path: Path, plain: dict[str, list[SourceTask]], form: str) -> None:
    """Pitfalls 3 and 4: line ends, marks, encodings, packed values, numbers as texts, orders of columns."""
    for source, records in native.RECORDS.items():
        (tmp_path / source).mkdir()
        path = tmp_path / source / form
        FORMS[form](path, records)
        found = read(source, path)
        for task in found.tasks:
            task.extra.pop("Unnamed: 0", None)  # the published set's other columns are kept
        assert found.tasks == plain[source]
        assert (len(found.tasks), found.skipped) == (len(records), [])


@pytest.mark.parametrize("form", FORMS)
def test_a_record_without_an_instruction_costs_itself(tmp_path: Path, form: str) -> None:
    """Pitfall 8, in every form."""
    records = [native.DEEPSHOP[0], native.DEEPSHOP[1] | {"ques": "", "id": "x"}, native.DEEPSHOP[1]]
    path = tmp_path / form
    FORMS[form](path, records)
    found = read("deepshop", path)
    assert [task.id for task in found.tasks] == ["deepshop/Amazon--31", "deepshop/Amazon--32"]
    [skipped] = found.skipped
    assert skipped.file == str(path)
    assert skipped.reason == "'ques' is empty"
    assert any(letter.isdigit() for letter in skipped.place)


def test_broken_lines_are_told_and_the_rest_loads(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    good = [json.dumps(record | {"id": f"n{n}"}).encode() for n in range(4) for record in native.DEEPSHOP[:1]]
    broken = [
        b'{"ques": "cut o',
        b"[1, 2]",
        b"7",
        b"null",
        b'{"ques": {"a": 1}}',
        b'{"ques": "\xff\xfe"}',
        b"{}",
    ]
    path.write_bytes(
        b"\n".join([good[0], *broken[:3], good[1], *broken[3:], good[2], b"\xff\xfe\x00", good[3]])
    )
    found = read("deepshop", path)
    assert [task.id for task in found.tasks] == [f"deepshop/n{n}" for n in range(4)]
    assert [skipped.place for skipped in found.skipped] == [f"line {n}" for n in (2, 3, 4, 6, 7, 8, 9, 11)]
    assert [skipped.reason.partition(":")[0] for skipped in found.skipped] == [
        "no JSON",
        "a list, not an object",
        "a number, not an object",
        "null, not an object",
        "'ques' is an object, not a text",
        "'ques' is not valid Unicode",
        "no field 'ques' or 'question' or 'task'",
        "no JSON",
    ]


def test_half_a_character_counts_only_where_it_stands(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    line = json.dumps(native.AGENTSYNTH[0])
    path.write_bytes(line.replace("Tonight: Night Owls", "\\ud83d").encode() + b"\n")
    assert len(read("agentsynth-web", path).tasks) == 1
    path.write_bytes(line.replace("find tonight's show", "\\ud83d").encode() + b"\n")
    [skipped] = read("agentsynth-web", path).skipped
    assert "not valid Unicode" in skipped.reason


def test_what_is_whole_before_the_damage_in_an_array_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    content = json.dumps(native.ONLINE_MIND2WEB, indent=2)
    damaged = ('"easy', '"easy",,', "{", "easy")
    for end in (content[: len(content) - 20], *(content.replace('"easy"', each) for each in damaged)):
        path.write_text("\n" + end)
        found = read("online-mind2web", path)
        assert [task.id for task in found.tasks] == ["online-mind2web/b7258ee0"]
        assert [skipped.place for skipped in found.skipped] == ["line 10 (record 2)"]
        assert re.search(r"nothing after it is read: .*line \d\d", found.skipped[0].reason)
    for end, line in ((content[:-2], 15), (content + "\n7", 16)):
        path.write_text(end)
        found = read("online-mind2web", path)
        assert (len(found.tasks), found.skipped[0].place) == (2, f"line {line}")


def test_an_object_of_records_is_whole_or_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    for source, value, damage in (
        ("mind2web-2", native.MIND2WEB_2, '"Find a 34'),
        ("online-mind2web", {"version": "1", "data": native.ONLINE_MIND2WEB}, '"easy"'),
    ):
        path.write_text(json.dumps(value, indent=1).replace(damage, damage[1:]))
        found = read(source, path)
        assert (found.tasks, len(found.skipped)) == ([], 1)
        assert re.search(r"no JSON: .* line \d+", found.skipped[0].reason)


def test_nested_columns_of_a_parquet_file(tmp_path: Path) -> None:
    for source in ("insta-v3", "mind2web-live", "webgym", "agentsynth-web"):
        path = tmp_path / f"{source}.parquet"
        records = native.RECORDS[source][:1]
        pq.write_table(pa.Table.from_pylist(records), path)
        lines = tmp_path / f"{source}.jsonl"
        lines.write_text(native.as_lines(records))
        assert read(source, path).tasks == read(source, lines).tasks


def test_a_broken_entry_of_a_mapping(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps({**native.MIND2WEB_2, "c": "a text", "d": {"task_description": None}}))
    found = read("mind2web-2", path)
    assert [task.id for task in found.tasks] == ["mind2web-2/find_parks", "mind2web-2/buy_monitor"]
    assert [(skipped.place, skipped.reason) for skipped in found.skipped] == [
        ("key 'c'", "a text, not an object"),
        ("key 'd'", "'task_description' is empty"),
    ]


@pytest.mark.parametrize(
    ("row", "place", "reason"),
    [
        ("only,two", "line 3", "2 columns where the header has 9"),
        (",".join("abcdefghijk"), "line 3", "11 columns where the header has 9"),
        ('Amazon,x,"closed" early,d,e,f,g,h,i', "line 3", "no row of a CSV file: ',' expected after"),
        ('Amazon,"x\ny","closed" early,d,e,f,g,h,i', "line 3", "no row of a CSV file: ',' expected after"),
    ],
)
def test_a_broken_row_costs_itself(tmp_path: Path, row: str, place: str, reason: str) -> None:
    lines = native.as_csv(native.DEEPSHOP).splitlines()
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*lines[:2], row, lines[2]]))
    found = read("deepshop", path)
    assert [task.id for task in found.tasks] == ["deepshop/Amazon--31", "deepshop/Amazon--32"]
    [skipped] = found.skipped
    assert skipped.place == place
    assert skipped.reason.startswith(reason)


def test_what_follows_a_quotation_mark_that_is_never_closed_is_part_of_its_row(tmp_path: Path) -> None:
    lines = native.as_csv(native.DEEPSHOP).splitlines()
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*lines[:2], 'Amazon,x,"never closed,d,e,f,g,h,i', lines[2]]))
    found = read("deepshop", path)
    assert [task.id for task in found.tasks] == ["deepshop/Amazon--31"]
    assert [skipped.place for skipped in found.skipped] == ["line 3"]


def test_a_quote_in_the_middle_and_line_ends_inside_do_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(
        b'id,ques,web\r\n1,a 5" screen,amazon.com\r\n2,"two\r\nlines, ""quoted""",amazon.com\r\n'
    )
    assert [task.instruction for task in read("deepshop", path).tasks] == [
        'a 5" screen',
        'two\nlines, "quoted"',
    ]


@pytest.mark.parametrize("suffix", ["jsonl", "json", "csv"])
def test_a_compressed_file_that_is_cut_off(tmp_path: Path, suffix: str) -> None:
    records = [native.DEEPSHOP[0] | {"id": str(n)} for n in range(3000)]
    make = {"jsonl": native.as_lines, "json": array, "csv": native.as_csv}[suffix]
    data = gzip.compress(make(records).encode())
    path = tmp_path / f"a.{suffix}.gz"
    path.write_bytes(data[: len(data) // 2])
    found = read("deepshop", path)
    assert 100 < len(found.tasks) < 3000
    assert 1 <= len(found.skipped) <= 2, "a torn record, and what is missing"
    assert "damaged" in found.skipped[-1].reason
    assert found.skipped[-1].place.startswith("after line ")


def test_a_damaged_parquet_file(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    records = [native.DEEPSHOP[0] | {"id": str(n), "ques": f"Find {n}"} for n in range(3000)]
    pq.write_table(pa.Table.from_pylist(records), path, row_group_size=1000, compression="gzip")
    data = bytearray(path.read_bytes())
    half = len(data) * 6 // 10
    data[half : half + 200] = bytes(200)
    path.write_bytes(data)
    found = read("deepshop", path)
    assert len(found.tasks) in (1000, 2000) or found.tasks
    assert [skipped.reason.partition(":")[0] for skipped in found.skipped] == [
        "the rest of the Parquet file is damaged"
    ]
    path.write_bytes(data[:100])
    [skipped] = read("deepshop", path).skipped
    assert "damaged" in skipped.reason


def test_a_parquet_row_that_is_not_utf_8_costs_itself(tmp_path: Path) -> None:
    names = ["Find it.", "Find \udcff.", "Find more."]
    texts = pa.array([name.encode("utf-8", "surrogateescape") for name in names]).view(pa.string())
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"ques": texts, "id": ["1", "2", "3"]}), path)
    found = read("deepshop", path)
    assert [task.id for task in found.tasks] == ["deepshop/1", "deepshop/3"]
    assert [skipped.place for skipped in found.skipped] == ["row 2"]


def test_a_folder_is_read_whole_and_says_what_it_passed_over(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / ".cache").mkdir()
    (tmp_path / ".cache" / "old.jsonl").write_text(native.as_lines(native.ONLINE_MIND2WEB))
    (tmp_path / "README.md").write_text("about")
    (tmp_path / "data" / "test.json").write_text(array(native.ONLINE_MIND2WEB[1:]))
    (tmp_path / "data" / "train.jsonl").write_text(native.as_lines(native.ONLINE_MIND2WEB[:1]) + "{broken\n")
    (tmp_path / "data" / "other.jsonl").write_text(native.as_lines(native.INSTA[:1]))
    (tmp_path / "data" / "all.zip").write_bytes(b"PK\x03\x04....")
    (tmp_path / "data" / "human_label.json").write_text(array(native.HUMAN_LABELS))
    (tmp_path / "data" / "empty.jsonl").write_text("")
    found = read("online-mind2web", tmp_path)
    assert [task.id for task in found.tasks] == ["online-mind2web/c1", "online-mind2web/b7258ee0"]
    assert [(Path(each.file).name, each.place) for each in found.skipped] == [("train.jsonl", "line 2")]
    assert [(Path(each.file).name, each.reason.partition(":")[0]) for each in found.passed_over] == [
        ("all.zip", f"the format of {tmp_path / 'data' / 'all.zip'} is not supported"),
        ("empty.jsonl", "it is empty"),
        ("human_label.json", "is a companion file of the tasks"),
        ("other.jsonl", "no record of online-mind2web among 1; the first"),
    ]


@pytest.mark.parametrize("content", ["", "\n\n", "[]", "{}", "\ufeff"])
def test_a_file_without_records_is_an_error_that_says_so(tmp_path: Path, content: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(content)
    if content == "{}":
        assert len(read("deepshop", path).skipped) == 1
    else:
        with pytest.raises(TaskFileError, match="contains no record of deepshop"):
            read("deepshop", path)


def test_what_is_not_there_is_an_error_that_says_so(tmp_path: Path) -> None:
    with pytest.raises(TaskFileError, match="No such file"):
        read("deepshop", tmp_path / "nothing.jsonl")
    with pytest.raises(TaskFileError, match="contains no record"):
        read("deepshop", tmp_path)
    (tmp_path / "a.arrow").write_bytes(b"ARROW1")
    with pytest.raises(TaskFileError, match=r"the format of .* is not supported"):
        read("deepshop", tmp_path / "a.arrow")
