"""The contract for answers of the offline web: the values alone, in the order asked for."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.text import fold
from webgym.core.truth import AnswerTruth
from webgym.judge.offline import compare, items
from webgym.offline.config import CollectionName
from webgym.offline.web import OfflineWeb

ONE = AnswerTruth((("$1,250", "1,250", "1250"),), ("$900",))
TWO = AnswerTruth((("Blue Mug",), ("14:30", "2:30 pm")), ("Red Mug",))
COMMAS = AnswerTruth((("blue star",), ("7",)), ("12",), by_comma=True)


def reading(truth: AnswerTruth, answer: str) -> str:
    """``right``, ``wrong`` (the form is right) or ``form``."""
    form, value = compare(truth, answer)
    return "form" if not form.passed else "right" if value and value.passed else "wrong"


@pytest.mark.parametrize(
    ("truth", "answer"),
    [
        *(
            (ONE, text)
            for text in ("$1,250", " 1250. ", "**$1,250**", "Answer: 1,250", "1. `1250`", "“1250”")
        ),
        *(
            (ONE, text)
            for text in ("Final answer:\n\n$1,250", "**Answer:** 1250", "\uff11\uff12\uff15\uff10", "- 1,250")
        ),
        *((TWO, text) for text in ("Blue Mug\n14:30", "blue  mug; 2:30 PM", "1. Blue Mug\n2. 2:30 pm")),
        *((TWO, text) for text in ("Answer:\r\n* **Blue Mug**\r\n* 14:30.", "BLUE MUG\n\n\n14:30\n")),
        *((COMMAS, text) for text in ("blue star, 7", "blue star\n7", "Blue star; 7.")),
        *((AnswerTruth(), text) for text in ("done", "Done.", "**DONE**", "Answer: done")),
    ],
)
def test_the_values_alone_are_right_in_any_layout(truth: AnswerTruth, answer: str) -> None:
    assert reading(truth, answer) == "right"


@pytest.mark.parametrize(
    ("truth", "answer", "what"),
    [
        (ONE, "$900", "wrong"),
        (ONE, "1,251", "wrong"),
        (ONE, "", "form"),
        (ONE, " \n", "form"),
        (ONE, "1250\n1250", "form"),
        (ONE, "The price is $1,250.", "form"),
        (ONE, "The price is most probably $900 I think", "form"),
        (ONE, "not 1250", "form"),
        (ONE, "1250 or 900", "form"),
        (ONE, "at least 1250", "form"),
        (ONE, "I could not find it. The page mentions $1,250.", "form"),
        (ONE, "0 apples; 1250 oranges; 3 limes", "form"),
        (ONE, "12.50", "wrong"),
        (TWO, "14:30\nBlue Mug", "wrong"),
        (TWO, "Red Mug\n14:30", "wrong"),
        (TWO, "Blue Mug, 14:30", "form"),
        (TWO, "Blue Mug\n14:30\nRed Mug", "form"),
        (TWO, "Blue Mug", "form"),
        (COMMAS, "7, blue star", "wrong"),
        (COMMAS, "blue star, 7, 7", "form"),
        (AnswerTruth(), "I have done it", "form"),
        (AnswerTruth(), "Blue Mug", "wrong"),
    ],
)
def test_nothing_else_is(truth: AnswerTruth, answer: str, what: str) -> None:
    assert reading(truth, answer) == what


@given(st.text(max_size=200))
def test_any_text_is_read(answer: str) -> None:
    assert all(item and "\n" not in item for item in items(answer))
    for truth in (ONE, TWO, COMMAS, AnswerTruth()):
        right = items(answer, by_comma=truth.by_comma)
        known = [{fold(spelling) for spelling in spellings} for spellings in truth.values]
        expected = len(right) == len(known) and all(a in b for a, b in zip(right, known, strict=True))
        assert (reading(truth, answer) == "right") == expected


def right_answers(truth: AnswerTruth, rng: random.Random) -> list[str]:
    join = (", " if truth.by_comma else "\n").join
    values = [spellings[0] for spellings in truth.values]
    lists = [join(values), "Answer: " + join(values), join(f"- **{value}**" for value in values)]
    return [*lists, *(join(rng.choice(spellings) for spellings in truth.values) for _ in range(3))]


def wrong_answers(truth: AnswerTruth) -> list[str]:
    join = (", " if truth.by_comma else "\n").join
    *others, last = values = [spellings[0] for spellings in truth.values]
    wrong = truth.others[0] if truth.others else "something else"
    made = [
        join([*values, wrong]),
        join([wrong, *values]),
        join([*others, f"{last} or {wrong}"]),
        join([*others, wrong]),
        join([*others, f"not {last}"]),
        join([*others, f"at least {last}"]),
        f"It is {join(values)}",
        f"I could not find it. The page mentions {join(values)}.",
        join(others),
    ]
    if fold(last) != fold(values[0]) and len(values) > 1:
        made.append(join([last, *values[1:-1], values[0]]))
    return made


@pytest.mark.parametrize(("collection", "per_family"), [("large", 1), ("small", 4), ("cross", 2)])
def test_every_task_asks_for_its_answer_in_a_form_that_its_truth_has(
    collection: CollectionName, per_family: int
) -> None:
    rng, separators = random.Random(1), set()
    for task in OfflineWeb(collection=collection, per_family=per_family).tasks():
        assert task.truth is not None
        truth = task.truth.answer
        separators.add(truth.by_comma)
        for spelling in (spelling for spellings in truth.values for spelling in spellings):
            assert len(items(spelling, by_comma=truth.by_comma)) == 1, (task.id, spelling)
        assert {reading(truth, answer) for answer in right_answers(truth, rng)} == {"right"}, task.id
        assert "right" not in {reading(truth, answer) for answer in wrong_answers(truth)}, task.id
        asked = task.instruction.casefold()
        assert truth.required or "done" in asked, task.id
        assert len(truth.required) < 2 or "order" in asked, task.id
    assert separators == {collection == "small"}


def arrangements(candidates: Sequence[str]) -> list[str]:
    arranged = [sep.join(candidates) for sep in (", ", "\n", "; ", " or ", " / ", " ", "\n- ", ". ")]
    labelled = [sep.join(f"{text} for {nth}" for nth, text in enumerate(candidates)) for sep in ("\n", "; ")]
    return [*arranged, *labelled]


@pytest.mark.parametrize(("collection", "per_family"), [("large", 1), ("small", 4)])
def test_candidates_earn_no_more_than_one_guess(collection: CollectionName, per_family: int) -> None:
    """Two candidates in an answer are none, or one in a list whose number is the other."""
    for task in OfflineWeb(collection=collection, per_family=per_family).tasks():
        assert task.truth is not None
        truth = task.truth.answer
        if not truth.required:
            continue
        *first, last = [spellings[0] for spellings in truth.required]
        for wrong in truth.others[:2] or ("something else",):
            for candidates in ([*first, last, wrong], [*first, wrong, last]):
                for answer in arrangements(candidates):
                    right = [
                        value
                        for value in (last, wrong)
                        if reading(AnswerTruth((*truth.required[:-1], (value,)), (), truth.by_comma), answer)
                        == "right"
                    ]
                    assert right == [] or (len(right) == 1 and answer.startswith("1. ")), (task.id, answer)
