"""The eight pitfalls of SOURCES.md, for the sources that they concern."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from tests.tasks.sources import native

from webgym.tasks.sources import SOURCES, Read, read_source
from webgym.tasks.sources.base import BAD_WEBSITE, DATED, OUTDATED_ANSWER, PLACEHOLDER_WEBSITE
from webgym.tasks.sources.dates import contains_past_date

TODAY = date(2026, 1, 15)


def read(name: str, path: Path, records: list[dict[str, Any]]) -> Read:
    path.write_text(native.as_lines(records), "utf-8")
    found = read_source(name, path, today=TODAY)
    assert found.records == len(found.tasks) + len(found.skipped) == len(records)
    return found


# --- 1: website missing or a placeholder ----------------------------------------------------------------

WEBSITE_FROM = {
    "insta-v3": {"given"},
    "pae-webvoyager": {"given"},
    "agentsynth-web": {"given"},
    "browsecomp": {"inferred"},
    "travelplanner": {"inferred"},
    "mind2web-live": {"derived", "inferred"},
    "online-mind2web": {"given"},
    "deepshop": {"given"},
    "mind2web-2": {"inferred"},
    "gaia-web": {"inferred"},
    "webgym": {"given"},
}


@pytest.mark.parametrize("source", native.RECORDS)
def test_given_derived_and_to_be_inferred_are_kept_apart(tmp_path: Path, source: str) -> None:
    found = read(source, tmp_path / "a.jsonl", native.RECORDS[source])
    assert set(found.websites_from()) == WEBSITE_FROM[source]
    assert all((task.website is None) == (task.website_from == "inferred") for task in found.tasks)


@pytest.mark.parametrize("website", [None, "", "None", "N/A", "null", " "])
@pytest.mark.parametrize("source", ["insta-v3", "agentsynth-web", "online-mind2web", "pae-webvoyager"])
def test_a_website_that_is_missing_is_to_be_inferred(
    tmp_path: Path, source: str, website: str | None
) -> None:
    name = "web" if source == "pae-webvoyager" else "website"
    [task] = read(source, tmp_path / "a.jsonl", [native.RECORDS[source][0] | {name: website}]).tasks
    assert (task.website, task.website_from, task.flags) == (None, "inferred", ())


@pytest.mark.parametrize(
    ("web", "website", "flags"),
    [
        ("https://www.google.com/", None, {PLACEHOLDER_WEBSITE}),
        ("google.com", None, {PLACEHOLDER_WEBSITE}),
        (None, None, set()),
        ("https://en.wikipedia.org/", "https://en.wikipedia.org/", set()),
    ],
)
def test_gaias_placeholder(tmp_path: Path, web: str | None, website: str | None, flags: set[str]) -> None:
    [task] = read("gaia-web", tmp_path / "a.jsonl", [native.GAIA[1] | {"web": web}]).tasks
    assert (task.website, set(task.flags)) == (website, flags)


def test_a_later_key_node_gives_the_host_if_the_first_has_none(tmp_path: Path) -> None:
    record = json.loads(json.dumps(native.MIND2WEB_LIVE[0]))
    del record["evaluation"][0]["content"]["url"]
    [task] = read("mind2web-live", tmp_path / "a.jsonl", [record]).tasks
    assert (task.website, task.website_from) == ("https://maps.example.org/", "derived")


# --- 2: forms of websites -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "website", "website_from"),
    [
        ("shop.example.com", "https://shop.example.com/", "given"),
        ("WWW.Example.COM", "https://WWW.Example.COM/", "given"),
        ("http://a.b.c.example.com:8080", "http://a.b.c.example.com:8080/", "given"),
        ("https://example.com/de/?q=1#top", "https://example.com/de/?q=1#top", "given"),
        ("//example.com/x", "https://example.com/x", "given"),
        ("bücher.example", "https://bücher.example/", "given"),
        ("one.example.com, two.example.org", "https://one.example.com/", "derived"),
        (["one.example.com", "two.example.org"], "https://one.example.com/", "derived"),
        ("the museum's website", None, "inferred"),
        ("ftp://example.com/", None, "inferred"),
        ("https://", None, "inferred"),
        ("https://exa mple.com/", None, "inferred"),
        ("http://[::1", None, "inferred"),
        ("mailto:someone@example.com", None, "inferred"),
    ],
)
def test_forms_of_websites(tmp_path: Path, given: object, website: str | None, website_from: str) -> None:
    [task] = read("insta-v3", tmp_path / "a.jsonl", [native.INSTA[0] | {"website": given}]).tasks
    assert (task.website, task.website_from) == (website, website_from)
    assert (BAD_WEBSITE in task.flags) == (website is None)


def test_websites_are_counted_as_the_split_counts_them(tmp_path: Path) -> None:
    forms = ["example.com", "https://www.example.com/a", "m.example.com", "other.example.net"]
    records = [native.INSTA[0] | {"website": form} for form in forms]
    assert read("insta-v3", tmp_path / "a.jsonl", records).websites() == 2


# --- 3: ends, marks, other scripts: test_formats.py has every form of file -----------------------------


@pytest.mark.parametrize("source", native.RECORDS)
def test_every_script_passes_unchanged(tmp_path: Path, source: str) -> None:
    said = "Наконец 東京 — naïve café 🚂 \u2028 e\u0301"
    record = dict(native.RECORDS[source][0])
    if source == "browsecomp":
        record = native.browsecomp(said, said)
    else:
        name = next(name for name in SOURCES[source].instruction if name in record)
        record[name] = f"  {said}\r\n"
    [task] = read(source, tmp_path / "a.jsonl", [record]).tasks
    assert task.instruction == said


# --- 4: packed values, ids, words for "absent": the sources' own tests and test_formats.py --------------


@pytest.mark.parametrize(
    ("native_id", "expected"),
    [
        (7, "7"),
        ("7", "7"),
        (7.0, "7"),
        (" a  b\n", "a b"),
        ("ünï", "ünï"),
        ("x" * 300, None),
        (None, None),
        ("", None),
        ("None", None),
        (True, None),
        ([7], None),
        ({}, None),
    ],
)
@pytest.mark.parametrize(
    ("source", "name"), [("mind2web-live", "index"), ("travelplanner", "idx"), ("deepshop", "id")]
)
def test_ids_are_numbers_or_texts(
    tmp_path: Path, source: str, name: str, native_id: object, expected: str | None
) -> None:
    record = native.RECORDS[source][0] | {name: native_id}
    first = read(source, tmp_path / "a.jsonl", [record]).tasks[0].id
    assert first.startswith(f"{source}/")
    if expected is None:  # then what it says makes the id, wherever it stands
        assert len(first) == len(source) + 1 + 12
        other = record | {next(iter(SOURCES[source].instruction)): "Something else."}
        assert read(source, tmp_path / "b.jsonl", [other, record]).tasks[1].id == first
    else:
        assert first == f"{source}/{expected}"


# --- 5: clashes -----------------------------------------------------------------------------------------


def test_no_two_sources_share_an_id(tmp_path: Path) -> None:
    ids = [
        task.id
        for name, records in native.RECORDS.items()
        for task in read(name, tmp_path / f"{name}.jsonl", records).tasks
    ]
    assert len(set(ids)) == len(ids)
    assert all(task_id.partition("/")[0] in SOURCES for task_id in ids)


def test_an_id_that_comes_again_with_another_task_is_told_apart(tmp_path: Path) -> None:
    """Every file of a set may begin to count at 0."""
    (tmp_path / "test.json").write_text(json.dumps(native.MIND2WEB_LIVE[:1]))
    other = native.MIND2WEB_LIVE[0] | {"task": "Something else"}
    (tmp_path / "train.json").write_text(json.dumps([other, other]))
    found = read_source("mind2web-live", tmp_path, today=TODAY)
    first, second = found.tasks
    assert first.id == "mind2web-live/0"
    assert second.id.startswith("mind2web-live/0~")
    [repeated] = found.skipped
    assert repeated.reason == f"the same record as {tmp_path / 'train.json'}, line 1 (record 1)"
    assert found.records == 3


def test_a_copy_of_a_file_is_counted(tmp_path: Path) -> None:
    for name in ("a.jsonl", "b.jsonl"):
        (tmp_path / name).write_text(native.as_lines(native.INSTA))
    found = read_source("insta-v3", tmp_path, today=TODAY)
    assert (found.records, len(found.tasks), len(found.skipped)) == (4, 2, 2)
    assert {skipped.reason.partition(" as ")[0] for skipped in found.skipped} == {"the same record"}


# --- 6: dates -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "Book a room from Jan 1 to Jan 4, 2024.",
        "Find the best film of 2023",
        "the 2023-24 season",
        "Standings 2023/24.",
        "hits of the 1980s",
        "from 2020–2021",
        "(2019)",
        "Who led in 2025?",
        "on 2026-01-14",
        "on 14/01/2026",
        "on 01/14/2026",
        "on January 14th, 2026",
        "on the 14th of January 2026",
        "from January 3 to January 20, 2026",
        "between 13 and 2015",
    ],
)
def test_a_date_that_has_passed_is_seen(text: str) -> None:
    assert contains_past_date(text, TODAY)


LATER = date(2026, 11, 29)


@pytest.mark.parametrize(
    "text",
    [
        *("2025年7月9日の宿", "2025년 7월 9일 숙소", "我想看2023年的销量", "2023년 매출", "２０２４年５月"),
        *("2024. 3. 3. 출발", "٢٠٢٤/٣/٣", "२०२४ में", "ปี2023"),
    ],
)
def test_a_date_that_has_passed_is_seen_in_any_script(text: str) -> None:
    assert contains_past_date(text, LATER)


@pytest.mark.parametrize(
    "text",
    [
        *("2026年12月3日の便", "2026年12月の便", "2027年の売上", "我想看2026年的销量", "2026. 12. 3. 출발"),
        *("2000円", "1990人が", "2000元 laptop", "GTX1999", "$2000"),
        *("version 3.10.12", "release 1.2.19", "call 555-20-10-15", "UNS A92024"),
    ],
)
def test_what_is_to_come_or_no_date_is_not(text: str) -> None:
    assert not contains_past_date(text, LATER)


@pytest.mark.parametrize("source", native.RECORDS)
def test_a_dated_task_is_flagged_and_not_rewritten(tmp_path: Path, source: str) -> None:
    said = "Find a room from March 3 to March 5, 2024."
    record = dict(native.RECORDS[source][0])
    if source == "browsecomp":
        record = native.browsecomp(said, "x")
    else:
        record[next(name for name in SOURCES[source].instruction if name in record)] = said
    [task] = read(source, tmp_path / "a.jsonl", [record]).tasks
    assert task.instruction == said
    assert (DATED in task.flags) is not SOURCES[source].timeless, (
        "what is asked about the past stays as it is"
    )
    [early] = read_source(source, tmp_path / "a.jsonl", today=date(2022, 1, 1)).tasks
    assert DATED not in early.flags, "the caller says what day it is"


# --- 7: counts ------------------------------------------------------------------------------------------


# --- 8: broken records: test_formats.py has every kind -------------------------------------------------


# --- several benchmarks in one folder, and copies of one ------------------------------------------------


def test_a_folder_of_all_benchmarks_gives_each_source_its_own_records(tmp_path: Path) -> None:
    """Many call their instruction alike; what is another's is passed over by name."""
    for source, records in native.RECORDS.items():
        (tmp_path / f"{source}.jsonl").write_text(native.as_lines(records), "utf-8")
    (tmp_path / "v1.jsonl").write_text(native.as_lines(native.INSTA_V1), "utf-8")
    for source, records in native.RECORDS.items():
        own = len(records) + (len(native.INSTA_V1) if source == "insta-v3" else 0)
        found = read_source(source, tmp_path, today=TODAY)
        assert (len(found.tasks), found.skipped) == (own, [])
        others = {str(each.reason) for each in found.passed_over}
        assert len(found.passed_over) == len(native.RECORDS) + (source != "insta-v3") - 1, others
    assert any("a record of gaia-web, not of webgym" in reason for reason in others)


@pytest.mark.parametrize(
    ("question", "entry", "answer"),
    [
        ("How far is it from Bonn to Köln?", {}, "28 km"),
        ("How far is it from Bonn to Köln on May 3, 2024?", {}, "28 km"),
        ("How far is it from Bonn to Köln on May 3, 2026?", {}, None),
        ("How far is it from Bonn to Köln on 2025-05-03?", {}, None),
        ("How many days are there from 2024 to August 9, 2050?", {}, "28 km"),
        ("How far is it from Bonn to Köln?", {"ques": "how far is it from Bonn to  Köln?"}, "28 km"),
        ("How far is it from Bonn to Aachen?", {"ques": "How far is it from Bonn to Köln?"}, None),
    ],
)
def test_an_answer_sticks_to_the_text_that_it_was_given_to(
    tmp_path: Path, question: str, entry: dict[str, str], answer: str | None
) -> None:
    """Copies of WebVoyager move the dates on and keep the ids."""
    answers = {"Map": {"answers": [{"id": 1, "type": "golden", "ans": "28 km", **entry}]}}
    (tmp_path / "reference_answer.json").write_text(json.dumps(answers), "utf-8")
    record = {"web_name": "Map", "id": "Map--1", "ques": question, "web": "https://map.example/"}
    [task] = read("pae-webvoyager", tmp_path / "a.jsonl", [record]).tasks
    assert (task.reference_answer, task.example_answer) == (answer, None)
    assert (OUTDATED_ANSWER in task.flags) is (answer is None)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize(
    "content",
    [
        "Plan a trip from Ulm to Bonn.",
        "You plan trips. Query: Plan a trip from Ulm to Bonn.\nTravel Plan:",
        [{"type": "text", "text": "Plan a trip from Ulm to Bonn."}],
    ],
)
def test_travelplanners_chat_form_is_read(tmp_path: Path, content: object, count: int) -> None:
    turns = [
        {"role": "system", "content": "You plan trips."},
        {"role": "user", "content": content},
        {"role": "assistant", "content": "Day 1: ..."},
    ]
    records = [{"idx": place, "messages": turns} for place in range(count)]
    tasks = read("travelplanner", tmp_path / "a.jsonl", records).tasks
    assert [task.instruction for task in tasks] == ["Plan a trip from Ulm to Bonn."] * count


def test_questions_about_the_past_are_not_dated(tmp_path: Path) -> None:
    record = native.browsecomp("Which author of a novel of 1994 was born between 1950 and 1960?", "x")
    [task] = read("browsecomp", tmp_path / "a.jsonl", [record]).tasks
    assert DATED not in task.flags
