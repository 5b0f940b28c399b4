"""Every source in its native shape."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from tests.tasks.sources import native

from webgym.tasks.files import NO_FACTS, NONE_FACT
from webgym.tasks.published import DIFFICULTY_DIFFERS, OLD_RUBRIC
from webgym.tasks.sources import SOURCES, Read, SourceTask, read_source
from webgym.tasks.sources.base import (
    ENCRYPTED_SOURCE,
    GARBLED,
    NEEDS_FILE,
    OUTDATED_ANSWER,
    PLACEHOLDER_WEBSITE,
)

TODAY = date(2026, 1, 15)


def read(name: str, path: Path, content: object) -> Read:
    """What a source makes of a file with this content."""
    if isinstance(content, list) and path.suffix == ".jsonl":
        text = native.as_lines(content)
    else:
        text = content if isinstance(content, str) else json.dumps(content, ensure_ascii=False, indent=2)
    path.write_text(text, "utf-8")
    found = read_source(name, path, today=TODAY)
    assert found.records == len(found.tasks) + len(found.skipped)
    return found


def whole(name: str, path: Path, content: object) -> list[SourceTask]:
    """The tasks, where no record may be skipped."""
    found = read(name, path, content)
    assert found.skipped == []
    return found.tasks


def test_the_sources_are_those_of_the_papers_table() -> None:
    assert [(source.name, source.paper_websites, source.paper_tasks) for source in SOURCES.values()][:10] == [
        ("insta-v3", 146_348, 146_441),
        ("pae-webvoyager", 13, 128_499),
        ("agentsynth-web", 328, 2_086),
        ("browsecomp", 7, 1_266),
        ("travelplanner", 1, 1_225),
        ("mind2web-live", 76, 542),
        ("online-mind2web", 139, 300),
        ("deepshop", 1, 150),
        ("mind2web-2", 44, 130),
        ("gaia-web", 1, 87),
    ]


def test_insta_v3_has_steps_and_criteria_for_hints(tmp_path: Path) -> None:
    first, second = whole("insta-v3", tmp_path / "a.jsonl", native.INSTA)
    assert first.instruction == "Find the opening hours of the café on Sundays."
    assert (first.website, first.website_from) == ("https://museum.example.org/", "given")
    assert first.hints == (
        "step: Open https://museum.example.org.",
        "step: Open 'Visit'.",
        "criterion: The hours are those of the café: 10 to 16.",
    )
    assert second.hints == ()
    assert first.id.startswith("insta-v3/")


def test_insta_v1_has_other_columns(tmp_path: Path) -> None:
    tasks = whole("insta-v3", tmp_path / "a.json", native.INSTA_V1)
    assert [(task.website, task.instruction) for task in tasks] == [
        ("https://library.example.net/", "Look up who may borrow books."),
        ("https://club.example.com/", "Find out when the club meets."),
    ]
    assert {task.domain for task in tasks} == {""}, "its 'domain' is a host, not a category"


def test_an_answer_is_the_answer_only_if_it_is_golden(tmp_path: Path) -> None:
    (tmp_path / "reference_answer.json").write_text(json.dumps(native.WEBVOYAGER_ANSWERS))
    soup, distance, kettle = whole("pae-webvoyager", tmp_path / "a.jsonl", native.WEBVOYAGER)
    assert (soup.reference_answer, soup.example_answer) == (None, "Red Lentil Soup")
    assert (distance.reference_answer, distance.example_answer) == ("28 km", None)
    assert (kettle.reference_answer, kettle.example_answer) == (None, None)
    assert (soup.domain, soup.subdomain) == ("Lifestyle & Leisure", "Food & Cooking")
    assert (distance.domain, distance.subdomain) == ("", ""), "a map is for anything"


@pytest.mark.parametrize(
    ("text", "answer"),
    [("nan", None), ("N/A", None), ("null", None), ("-", None), ("None", None), ("none", "none"), ("0", "0")],
)
def test_words_for_no_reference_answer_are_none_in_any_source(
    tmp_path: Path, text: str, answer: str | None
) -> None:
    (gaia,) = whole("gaia-web", tmp_path / "gaia.jsonl", [native.GAIA[0] | {"Final answer": text}])
    (comp,) = whole("browsecomp", tmp_path / "comp.jsonl", [native.browsecomp("Who?", text)])
    said = {"Google Map": {"answers": [{"id": 1, "type": "golden", "ans": text}]}}
    (tmp_path / "reference_answer.json").write_text(json.dumps(said))
    (distance,) = whole("pae-webvoyager", tmp_path / "map.jsonl", [native.WEBVOYAGER[1]])
    assert [task.reference_answer for task in (gaia, comp, distance)] == [answer] * 3


@pytest.mark.parametrize(("beside", "answered"), [(True, []), (False, ["Find a soup."])])
def test_an_answer_is_to_one_text(tmp_path: Path, beside: bool, answered: list[str]) -> None:
    """PAE's tasks have the ids of WebVoyager's."""
    (tmp_path / "pae").mkdir()
    (tmp_path / "reference_answer.json").write_text(json.dumps(native.WEBVOYAGER_ANSWERS))
    record = native.WEBVOYAGER[1] | {"ques": "Find a soup."}
    pae = tmp_path / "a.jsonl" if beside else tmp_path / "pae" / "a.jsonl"
    pae.write_text(native.as_lines([record | {"ques": "Count the soups."}]))
    (tmp_path / "b.jsonl").write_text(native.as_lines([record, record | {"web": "https://soups.example/"}]))
    tasks = read_source("pae-webvoyager", tmp_path, today=TODAY).tasks
    assert len(tasks) == 3
    assert sorted({task.instruction for task in tasks if task.reference_answer}) == answered
    assert {task.instruction for task in tasks if OUTDATED_ANSWER in task.flags} == (
        {"Find a soup.", "Count the soups."} if beside else set()
    )


def test_pae_has_no_answers_beside_it(tmp_path: Path) -> None:
    tasks = whole("pae-webvoyager", tmp_path / "a.jsonl", native.WEBVOYAGER)
    assert [task.id for task in tasks] == [f"pae-webvoyager/{record['id']}" for record in native.WEBVOYAGER]
    assert {task.reference_answer for task in tasks} == {None}


@pytest.mark.parametrize("content", ["{", "[]", '{"Allrecipes": 3}', '{"Allrecipes": {"answers": [4, {}]}}'])
def test_broken_answers_cost_the_answers_alone(tmp_path: Path, content: str) -> None:
    (tmp_path / "reference_answer.json").write_text(content)
    found = read("pae-webvoyager", tmp_path / "a.jsonl", native.WEBVOYAGER)
    assert len(found.tasks) == 3
    assert [Path(each.file).name for each in found.passed_over] == (
        ["reference_answer.json"] if content in ("{", "[]") else []
    )


def test_agentsynths_actions_are_strings_or_objects(tmp_path: Path) -> None:
    night, songs = whole("agentsynth-web", tmp_path / "a.jsonl", native.AGENTSYNTH)
    assert (night.example_answer, songs.example_answer) == ("Night Owls", "A, B, C")
    assert night.reference_answer is None, "a model's answer is no truth"
    assert night.website == "https://radio.example.com/"


@pytest.mark.parametrize(
    ("actions", "flags"),
    [
        (["stop and confirm"], (GARBLED,)),
        ([json.dumps({"action_key": "click"})], ()),
        ([{"action_key": "stop", "action_kwargs": {"answer": "N/A"}}], ()),
        ([{"action_key": "stop", "action_kwargs": "{'answer': None}"}], ()),
        ([], ()),
        (None, ()),
        ("not a list", (GARBLED,)),
        ([7], (GARBLED,)),
    ],
)
def test_a_last_action_without_an_answer(tmp_path: Path, actions: object, flags: tuple[str, ...]) -> None:
    record = native.AGENTSYNTH[0] | {"action_sequence": actions}
    [task] = whole("agentsynth-web", tmp_path / "a.jsonl", [record])
    assert task.example_answer is None
    assert task.flags == flags


def test_browsecomp_is_decrypted_and_says_so(tmp_path: Path) -> None:
    first, second = whole("browsecomp", tmp_path / "a.csv", native.as_csv(native.BROWSECOMP))
    assert first.instruction.startswith("Which naïve painter")
    assert (first.reference_answer, second.reference_answer) == ("Ada Müller", "nobody")
    assert {first.website, second.website} == {None}
    assert first.flags == second.flags == (ENCRYPTED_SOURCE,)
    assert first.subdomain == "Music"
    assert second.domain == "", "art is no subdomain"


def test_browsecomps_test_vector() -> None:
    from webgym.tasks.sources.benchmarks import decrypt

    cipher = (
        "hkZGQrfhIUXkfQlvcAtpqhjMNOTOrNrpSHdRXHqI9A6wDlda9uE8EbMuT3A8TGmsvhFi9Yau1a//thEO7HFNWqZBB1Tu/DcW"
    )
    plain = "What is 2+2? (naïve café) — a plaintext longer than thirty-two bytes"
    assert decrypt(cipher, "webgym-canary") == plain


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"canary": "the wrong one"}, "does not decrypt"),
        ({"canary": ""}, "no 'canary'"),
        ({"problem": "A plain question?"}, "not base64"),
        ({"problem": ""}, "'problem' is empty"),
        ({"answer": "%%%"}, "not base64"),
    ],
)
def test_what_does_not_decrypt_is_skipped_and_not_quoted(
    tmp_path: Path, change: dict[str, str], reason: str
) -> None:
    rows = [native.BROWSECOMP[0] | change, native.BROWSECOMP[1]]
    found = read("browsecomp", tmp_path / "a.csv", native.as_csv(rows))
    assert [task.reference_answer for task in found.tasks] == ["nobody"]
    [skipped] = found.skipped
    assert (skipped.file, skipped.place) == (str(tmp_path / "a.csv"), "line 2")
    assert reason in skipped.reason
    assert "painter" not in str(skipped)
    assert "plain" not in skipped.reason


def test_travelplanners_columns_are_python_literals(tmp_path: Path) -> None:
    [task] = whole("travelplanner", tmp_path / "a.csv", native.as_csv(native.TRAVELPLANNER))
    assert task.instruction == 'Plan 3 days in Kiel for 2 people from Bonn, "by the sea", with $1,400.'
    assert {"cuisine: Thai", "cuisine: Greek", "room type: private room"} <= set(task.hints)
    assert "budget in dollars: 1400" in task.hints
    assert not any("house rule" in hint for hint in task.hints)
    assert task.subdomain == "Travel & Accommodation"
    assert task.flags == ("dated",), "its dates stand in a column of their own"


def test_travelplanners_lines_may_have_no_plan(tmp_path: Path) -> None:
    tasks = whole("travelplanner", tmp_path / "a.jsonl", native.TRAVELPLANNER_LINES)
    assert [task.id for task in tasks] == ["travelplanner/1", "travelplanner/2"]
    assert {task.example_answer for task in tasks} == {None}, "a model's plan is no example"


def test_travelplanners_own_plan_is_an_example(tmp_path: Path) -> None:
    row = native.TRAVELPLANNER[0] | {"annotated_plan": "[{'days': 1}]", "local_constraint": "{'broken"}
    [task] = whole("travelplanner", tmp_path / "a.csv", native.as_csv([row]))
    assert task.example_answer == "[{'days': 1}]"
    assert GARBLED in task.flags


def test_mind2web_live_starts_at_the_host_of_its_first_key_node(tmp_path: Path) -> None:
    first, second = whole("mind2web-live", tmp_path / "a.json", native.MIND2WEB_LIVE)
    assert (first.website, first.website_from) == ("https://www.shop.example.com/", "derived")
    assert (second.website, second.website_from) == (None, "inferred")
    assert first.hints == ("url included match: shop.", "url exactly match: zip=53111")
    assert (first.id, second.id) == ("mind2web-live/0", "mind2web-live/WXkY6pe")


def test_online_mind2web(tmp_path: Path) -> None:
    first, second = whole("online-mind2web", tmp_path / "a.json", native.ONLINE_MIND2WEB)
    assert first.id == "online-mind2web/b7258ee0"
    assert second.website == "https://phones.example.com/compare?region=de#top", (
        "the address is kept as it is"
    )


def test_deepshops_absent_and_garbled_values(tmp_path: Path) -> None:
    camera, blender = whole("deepshop", tmp_path / "a.jsonl", native.DEEPSHOP)
    assert (camera.hints, camera.flags) == (("attribute: Compact camera",), ())
    assert (blender.hints, blender.flags) == (("attribute: Steel blender",), (GARBLED,))
    assert camera.subdomain == "Shopping"


def test_mind2web_2_has_trees_beside_it(tmp_path: Path) -> None:
    (tmp_path / "find_parks_rubric.json").write_text(json.dumps(native.MIND2WEB_2_TREE))
    parks, monitor = whole("mind2web-2", tmp_path / "a.json", native.MIND2WEB_2)
    assert parks.id == "mind2web-2/find_parks"
    assert parks.hints == ("must hold: It is a state park", "counts: Its address is right")
    assert (monitor.hints, monitor.website) == ((), None)


@pytest.mark.parametrize("path", ["../secret_rubric.json", "/etc/hostname", "a\0b", "x" * 5000, "", 3])
def test_a_rubrics_path_never_leaves_the_folder(tmp_path: Path, path: object) -> None:
    (tmp_path / "secret_rubric.json").write_text(json.dumps(native.MIND2WEB_2_TREE))
    (tmp_path / "inner").mkdir()
    record = {"a": {"task_description": "Find it.", "rubric_path": path}}
    [task] = whole("mind2web-2", tmp_path / "inner" / "a.json", record)
    assert task.hints == ()


def test_gaias_website_is_a_placeholder(tmp_path: Path) -> None:
    first, second = whole("gaia-web", tmp_path / "a.jsonl", native.GAIA)
    assert (first.website, first.website_from) == (None, "inferred")
    assert PLACEHOLDER_WEBSITE in first.flags
    assert (first.reference_answer, second.reference_answer) == ("3", "none"), "'none' is an answer"
    assert first.id == "gaia-web/8e867cd7-0000"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"Final answer": 17}, "17"),
        ({"Final answer": "?"}, None),
        ({"Final answer": None, "final_answer": "x"}, "x"),
        ({"Final answer": ""}, None),
        ({"Final answer": 2.5}, "2.5"),
        ({"Final answer": 3.0}, "3"),
        ({"Final answer": "3.0"}, "3.0"),
    ],
)
def test_gaias_answers(tmp_path: Path, change: dict[str, Any], expected: str | None) -> None:
    record = {name: value for name, value in native.GAIA[0].items() if name != "Final answer"} | change
    [task] = whole("gaia-web", tmp_path / "a.jsonl", [record | {"file_name": "table.xlsx"}])
    assert task.reference_answer == expected
    assert NEEDS_FILE in task.flags


def test_the_published_set_has_rubrics(tmp_path: Path) -> None:
    controller, hours = whole("webgym", tmp_path / "a.jsonl", native.PUBLISHED)
    assert controller.id == "webgym/deepshop/Amazon--100"
    assert controller.rubric is not None
    assert controller.rubric.difficulty == 2
    assert (controller.domain, controller.subdomain) == ("Electronics", "E-commerce Shopping"), (
        "kept as given"
    )
    assert (controller.reference_answer, hours.reference_answer) == (None, "10 to 16")
    assert (controller.parent_id, hours.parent_id) == (None, "webgym/insta-v3/17")
    assert hours.extra == {"distribution": "train", "benchmark_name": "insta-v3"}


def test_the_published_sets_test_tasks_are_known_by_their_file(tmp_path: Path) -> None:
    first, second = native.PUBLISHED
    (tmp_path / "a-copy.jsonl").write_text(native.as_lines([first]))
    (tmp_path / "test.jsonl").write_text(native.as_lines([first]))
    (tmp_path / "train.jsonl").write_text(native.as_lines([first, second]))
    tasks = read_source("webgym", tmp_path, today=TODAY).tasks
    assert [task.split for task in tasks] == ["test", "train"]
    (tmp_path / "test.json").write_text(json.dumps(native.ONLINE_MIND2WEB))
    assert {task.split for task in read_source("online-mind2web", tmp_path, today=TODAY).tasks} == {None}


@pytest.mark.parametrize(
    ("change", "facts", "flags"),
    [
        ({"evaluator_reference": "It is green"}, ["It is green"], {OLD_RUBRIC, DIFFICULTY_DIFFERS}),
        ({"evaluator_reference": ["Green", "Rated"]}, ["Green", "Rated"], {OLD_RUBRIC}),
        (
            {"evaluator_reference": [{"description": "Green", "difficulty": 2}]},
            ["Green"],
            {OLD_RUBRIC, DIFFICULTY_DIFFERS},
        ),
        (
            {"evaluator_reference": [{"id": 1, "description": "x", "facts": ["Green", "None"]}]},
            ["Green"],
            {NONE_FACT, DIFFICULTY_DIFFERS},
        ),
        ({"difficulty": 5}, ["Controller in green", "Rated above 4 stars"], {DIFFICULTY_DIFFERS}),
        ({"difficulty": "2"}, ["Controller in green", "Rated above 4 stars"], set()),
        ({"evaluator_reference": None}, [], {NO_FACTS}),
        ({"evaluator_reference": ["None"]}, [], {NO_FACTS}),
        ({"evaluator_reference": "['None']"}, [], {NO_FACTS}),
    ],
)
def test_the_published_sets_older_rows(
    tmp_path: Path, change: dict[str, object], facts: list[str], flags: set[str]
) -> None:
    [task] = whole("webgym", tmp_path / "a.jsonl", [native.PUBLISHED[0] | change])
    assert [fact for _, _, fact in task.rubric.facts()] == facts if task.rubric else facts == []
    assert set(task.flags) == flags


def test_a_published_row_may_lack_what_a_source_need_not_have(tmp_path: Path) -> None:
    row = native.PUBLISHED[0] | {"website": None, "task_id": None, "benchmark_name": None}
    [task] = whole("webgym", tmp_path / "a.jsonl", [row])
    assert (task.website, task.website_from) == (None, "inferred")
    assert len(task.id) == len("webgym/") + 12
