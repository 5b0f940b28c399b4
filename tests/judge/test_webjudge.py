"""Replies of another judge, with human labels: the real ones, where they are, and their shapes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.errors import UsageError
from webgym.judge.webjudge import Labelled, read_labelled, read_status

REAL = Path(__file__).resolve().parents[3] / "shared/data/judge-labels/webjudge_replies_o4_mini.jsonl"


@pytest.mark.parametrize(
    ("reply", "verdict"),
    [
        ("Thoughts: all done.\nStatus: success", True),
        ("Thoughts: not done.\n\nStatus: failure", False),
        ('Thoughts: x\nStatus: "success"', True),
        ("Thoughts: x\n**Status:** “failure”.", False),
        ("Thoughts: x\n**Status: Success**", True),
        ("Thoughts: nothing was filtered. Status: failure", False),
        ("Thoughts: it says “Filters: Status: Processing”.  \nStatus: success", True),
        ("Status: success\n\nThoughts: everything is there.", True),
        ("Thoughts: x\nStatus: not success", False),
        ("Thoughts: the page says Status: success but", None),
        ("Thoughts: it went through\nStatus: succ", None),
        ("Thoughts: it went through\nStatus:", None),
        ("Thoughts: x\nStatus: success or failure", None),
        ("Thoughts: x\nStatus: partial success", None),
        ("Thoughts: x\nStatus: success\nStatus: failure", None),
        ("Thoughts: x\nStatus: processing", None),
        ("<think>Status: success</think>Thoughts: x\nStatus: failure", False),
        ("Thoughts: the agent", None),
        # Questions.
        ("Thoughts: x\nStatus: success?", None),
        ("Thoughts: x. Status: success?", None),
        ("Thoughts: x. Status: success?!", None),
        ("Status: success？", None),
        ("Thoughts: x\nStatus: success?\nStatus: failure", False),
        # Negations.
        ("Thoughts: it is neither done nor status: success", None),
        ("Thoughts: it is neither done nor\nStatus: success", None),
        ("Thoughts: it can not be called\nStatus: success", None),
        ("Thoughts: hardly a case of status: success.", None),
        ("Thoughts: was it done? No.\nStatus: success", None),
        ("Thoughts: it isn't\n\n**Status: success**", None),
        ("Thoughts: it is anything but ... status: success", None),
        # Quotations.
        ("Thoughts: the page shows “Status: success”", None),
        ("Thoughts: the page shows this. “Status: success”", None),
        ("Thoughts: the page shows:\nStatus: success", None),
        ("Thoughts: the page shows this.\n> Status: success", None),
        ("Thoughts: the page shows this.\n“Status: success”\nStatus: failure", False),
        ("Thoughts: the page shows this.\n**'Status: success'**", None),
        # Conditions.
        ("Thoughts: if status: success", None),
        ("Thoughts: if the page had loaded, it would be status: success", None),
        ("Thoughts: if the page had loaded, it would be\nStatus: success", None),
        ("Thoughts: x. Status: success would be wrong.", None),
        ("Thoughts: x\nStatus: success\nwould be wrong.", None),
        ("Thoughts: x\nStatus: success, if the page had loaded", None),
        ("Thoughts: x\nIf status: success", None),
        # And what is none of these, though it looks like it.
        ("Thoughts: it did not fail, and nothing is wrong.\nStatus: success", True),
        ("Thoughts: would it load? It did, without an error.\nStatus: success", True),
        ("Thoughts: it is “done.” Status: success.", True),
        ("", None),
    ],
)
def test_statuses(reply: str, verdict: bool | None) -> None:
    assert read_status(reply) is verdict


@given(st.text())
def test_any_text_has_a_status_or_none(text: str) -> None:
    assert read_status(text) in (True, False, None)


def test_records(tmp_path: Path) -> None:
    file = tmp_path / "replies.jsonl"
    humans = [{"annotator": "A", "success": "Unsure"}, {"annotator": "B", "success": "Successful"}]
    record = {"judge": "j", "benchmark": "b", "agent": "a", "task_id": 3, "extra": [1]}
    lines = [
        record | {"judge_response": "Status: success", "judge_status": "success", "human": humans},
        record | {"judge_response": None, "judge_status": "processing", "human": []},
    ]
    file.write_text("\n".join(map(json.dumps, lines)) + "\r\n\n")
    first, second = read_labelled(file)
    assert first == Labelled(("j", "b", "a", "3"), True, True, (None, True))
    assert first.human is None
    assert second == Labelled(("j", "b", "a", "3"), None, None, ())
    file.write_text('{"judge_response": 3}\n')
    with pytest.raises(UsageError, match="line 1"):
        list(read_labelled(file))
    with pytest.raises(UsageError, match="cannot read"):
        list(read_labelled(tmp_path / "missing"))


@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL} is not there")
def test_the_figures_of_the_real_replies() -> None:
    records = list(read_labelled(REAL))

    def figures(verdicts: list[bool]) -> tuple[float, float, float]:
        humans = [record.human is True for record in records]
        both = sum(map(bool.__and__, verdicts, humans))
        right = sum(a == b for a, b in zip(verdicts, humans, strict=True))
        return right / len(records), both / sum(verdicts), both / sum(humans)

    # As the study's own reader took them (SOURCES.md).
    assert figures([bool(record.recorded) for record in records]) == pytest.approx(
        (0.833, 0.847, 0.550), abs=5e-4
    )
    # It took the first "Status: ..." for the verdict; one reply quotes a page's "Status: Processing" before
    # its own last line, which says success.
    apart = [record for record in records if record.verdict != record.recorded]
    assert [(record.recorded, record.verdict, record.human) for record in apart] == [(None, True, True)]
    assert figures([bool(record.verdict) for record in records]) == pytest.approx(
        (0.835, 0.848, 0.556), abs=5e-4
    )
