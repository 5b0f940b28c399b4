"""Files of people's labels, and how far people agree."""

from __future__ import annotations

import csv
import io
import json
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.errors import UsageError
from webgym.judge.labels import (
    LABELS,
    HumanLabel,
    annotator_agreement,
    parse_labels,
    read_labels,
    render_labels,
    settled,
)

OM2W = Path(__file__).resolve().parents[3] / "shared/data/online-mind2web/human_label.json"
words = st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=12).map(str.strip)
labels = st.lists(
    st.builds(
        HumanLabel,
        label=st.sampled_from(LABELS),
        attempt_id=words.filter(bool),
        task_id=words,
        annotator=words,
        note=words,
    ),
    unique_by=lambda label: (label.attempt_id, label.annotator),
)


@pytest.mark.parametrize("as_json", [False, True])
@given(labels)
def test_what_is_written_reads_back(as_json: bool, written: list[HumanLabel]) -> None:
    data = render_labels(written, as_json=as_json)
    read = parse_labels(data)
    assert read.labels == written
    assert not read.broken
    assert read.is_ours
    assert render_labels(read.labels, as_json=as_json) == data


def test_a_spreadsheet_carries_nothing_out() -> None:
    said = ['=HYPERLINK("http://a.example")', "+1", "-1", "@SUM(A1)", "'=1", "''@", "'quoted'", "a=1"]
    data = render_labels([HumanLabel("success", each, each, each, each) for each in said])
    cells = {cell for row in csv.reader(io.StringIO(data.decode())) for cell in row}
    assert not any(cell[0] in "=+-@" for cell in cells if cell)
    assert {"'+1", "''=1", "'quoted'"} <= cells
    assert [label.note for label in parse_labels(data).labels] == said


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_any_bytes_are_labels_or_refused(data: bytes) -> None:
    for whole in (b"attempt_id,label\n" + data, data):
        with suppress(ValueError):
            assert all(label.subject for label in parse_labels(whole).labels)


def test_a_table_as_people_write_it() -> None:
    read = parse_labels(
        '\ufeffTask ID;Label;Annotator;Comment\r\nt1;Success;ann;"fine; really"\r\n\r\nt2;0;ann;\r\n'
        "t3;maybe;ann;\r\n;success;ann;\r\nt5;failure\r\nt6;Not executable;bob;gone\r\n"
        "t2;yes;ann;looked again\r\n".encode()
    )
    assert read.labels == [
        HumanLabel("success", task_id="t1", annotator="ann", note="fine; really"),
        HumanLabel("not_executable", task_id="t6", annotator="bob", note="gone"),
        HumanLabel("success", task_id="t2", annotator="ann", note="looked again"),
    ]
    assert list(map(str, read.broken)) == [
        "line 5: the label 'maybe' is not one of success, failure, unsure, not_executable",
        "line 6: it has neither an attempt_id nor a task_id",
        "line 7: 2 columns where the header has 4",
        "line 4: t2 is labelled again further down, at line 9",
    ]


def test_a_quote_that_is_never_closed() -> None:
    read = parse_labels(b'attempt_id,label,note\na,success,ok\nb,failure,"never\nc,success,x\n')
    assert [label.attempt_id for label in read.labels] == ["a"]
    assert str(read.broken[0]).startswith("line 3: a quote is never closed")


def test_json_lists_and_lines() -> None:
    rows = [
        {"attempt_id": "a", "label": "success", "annotator": 7},
        {"attempt_id": "b", "label": True},
        {"attempt_id": "c", "label": None},
        "d",
    ]
    for data in (json.dumps(rows), json.dumps({"labels": rows}), "\n".join(map(json.dumps, rows))):
        read = parse_labels(data.encode())
        assert [(label.attempt_id, label.label, label.annotator) for label in read.labels] == [
            ("a", "success", "7"),
            ("b", "success", ""),
        ]
        assert len(read.broken) == 2
    with pytest.raises(ValueError, match="invalid JSON"):
        parse_labels(b'[{"attempt_id": "a"')
    with pytest.raises(ValueError, match="first line"):
        parse_labels(b"name,verdict\na,success\n")


def test_files_that_are_not_there_or_no_labels(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot read"):
        read_labels(tmp_path / "none.csv")
    (tmp_path / "other.csv").write_text("x,y\n1,2\n")
    with pytest.raises(UsageError, match=r"not a table of labels.*attempt_id"):
        read_labels(tmp_path / "other.csv")


def test_columns_that_are_not_ours_are_noticed() -> None:
    assert not parse_labels(b"attempt_id,label,seconds\na,success,3\n").is_ours


def test_labels_of_online_mind2web() -> None:
    rows = [
        {"task_id": "t", "confirmed_task": "x", "One_human_label": "1", "Two_human_label": "2"},
        {"task_id": "u", "confirmed_task": "y", "One_human_label": "0", "Two_human_label": "3"},
    ]
    read = parse_labels(json.dumps(rows).encode())
    assert read.labels == [
        HumanLabel("success", task_id="t", agent="One"),
        HumanLabel("not_executable", task_id="t", agent="Two"),
        HumanLabel("failure", task_id="u", agent="One"),
    ]
    assert [str(broken) for broken in read.broken] == ["record 2: Two's label '3' is not 0, 1 or 2"]


@pytest.mark.skipif(not OM2W.exists(), reason=f"{OM2W} is not there")
def test_the_real_labels_of_online_mind2web() -> None:
    read = read_labels(OM2W)
    assert not read.broken
    counts = {label: sum(one.label == label for one in read.labels) for label in LABELS}
    assert counts == {"success": 706, "failure": 1074, "unsure": 0, "not_executable": 20}  # SOURCES.md
    assert len({one.agent for one in read.labels}) == 6


@pytest.mark.parametrize(
    ("said", "majority", "first", "unanimous"),
    [
        (["success"], "success", "success", "success"),
        (["success", "failure", "success"], "success", "success", None),
        (["failure", "success"], None, "failure", None),
        (["unsure", "failure"], "failure", "unsure", None),
        (["unsure", "unsure"], "unsure", "unsure", "unsure"),
        (["unsure", "not_executable"], "not_executable", "unsure", None),
        (["unsure", "unsure", "success"], "success", "unsure", None),
        (["not_executable", "not_executable", "success"], "not_executable", "not_executable", None),
        (["not_executable", "success"], None, "not_executable", None),
        (["not_executable", "success", "success"], "success", "not_executable", None),
        (["failure", "not_executable", "success", "not_executable"], "not_executable", "failure", None),
        (["success", "failure", "not_executable"], None, "success", None),
        ([], None, None, None),
    ],
)
def test_one_label_from_several(said: list, majority: object, first: object, unanimous: object) -> None:  # type: ignore[type-arg]
    assert (settled(said), settled(said, "first"), settled(said, "unanimous")) == (
        majority,
        first,
        unanimous,
    )


def said(annotator: str, *words: str) -> list[HumanLabel]:
    """Labels of attempts 0, 1, ...; a dot for none."""
    known = {"s": "success", "f": "failure", "u": "unsure"}
    return [
        HumanLabel(known[word], attempt_id=str(number), annotator=annotator)  # type: ignore[arg-type]
        for number, word in enumerate(words)
        if word != "."
    ]


def test_annotators_against_each_other() -> None:
    # The binary example of Krippendorff's "Computing Krippendorff's alpha-reliability" (2011): 0.095.
    example = annotator_agreement([*said("Meg", *"fsffffffsf"), *said("Owen", *"sssffsffff")])
    assert example.observed == pytest.approx(0.6)
    assert example.alpha == pytest.approx(0.095, abs=5e-4)
    found = annotator_agreement([*said("A", *"fsffffffff"), *said("B", *"ssssffffff")])
    assert found.attempts == 10
    assert found.observed == pytest.approx(0.7)
    (pair,) = found.pairs
    assert (pair.pair, pair.attempts) == (("A", "B"), 10)
    expected = 2 * 5 * 15 / (20 * 19)
    assert found.alpha == pytest.approx(1 - 0.3 / expected)
    assert pair.kappa == pytest.approx((0.7 - (0.1 * 0.4 + 0.9 * 0.6)) / (1 - (0.1 * 0.4 + 0.9 * 0.6)))


def test_annotators_who_share_nothing_or_are_unsure() -> None:
    nothing = annotator_agreement([*said("A", "s", ".", "u"), *said("B", ".", "f", "f")])
    assert (nothing.attempts, nothing.observed, nothing.alpha, nothing.pairs) == (0, None, None, ())
    alike = annotator_agreement([*said("A", "s", "s"), *said("B", "s", "s"), *said("C", "s", ".")])
    assert (alike.observed, alike.alpha) == (1.0, None)
    assert [pair.pair for pair in alike.pairs] == [("A", "B"), ("A", "C"), ("B", "C")]
