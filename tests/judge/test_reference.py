"""The rule that compares an answer with a reference answer; where it is not sure, a model is asked."""

from __future__ import annotations

from time import process_time

import pytest
from benchmarks.reference_answers import Families, Known
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.task import reference_of
from webgym.judge.reference import Match, compare

SAME = [
    ("Harbour Bridge", "harbour  bridge."),
    ("Harbour Bridge", "**Harbour Bridge**"),
    ("Harbour Bridge", "“The Harbour Bridge.”"),
    ("Harbour Bridge", "Ｈａｒｂｏｕｒ Bridge!"),
    ("Harbour Bridge", "- Harbour Bridge"),
    ("Harbour Bridge", "Answer: Harbour Bridge"),
    ("Harbour Bridge", "**Final answer:** `Harbour Bridge`"),
    ("Harbour Bridge", "The answer is Harbour Bridge."),
    ("Harbour Bridge", "It crosses the bay, so the tunnel is out.\n\nFINAL ANSWER: Harbour Bridge"),
    ("Harbour Bridge", "I read its page.\n\n**Answer**:\nHarbour Bridge\n"),
    ("Harbour Bridge", "<answer>Harbour Bridge</answer>"),
    ("St. Ives", "St Ives"),
    ("a lighthouse", "Lighthouse"),
    ("O’Neill", "O'Neill"),
    ("7 – 9", "7 - 9"),
    ("Yes", "yes"),
    ("No", "No."),
    # numbers
    ("31,250", "31250"),
    ("31250.5", "31,250.5"),
    ("0.125", "0.125."),
    ("$1,450.50", "$1450.50"),
    ("$80", "$80.00"),
    ("80 €", "€80"),
    ("10%", "10.0 %"),
    # the same text, whatever it means
    ("12.500", "12.500"),
    ("25 000", "25 000"),
    ("3.10", "3.10"),
    ("3500万", "3500万"),
    ("2024-05-03", "2024-05-03"),
    # lists
    ("oak; elm; ash", "oak, elm, ash"),
    ("oak, elm", "- Oak\n- Elm"),
    ("1,200; 7", "1200\n7"),
    ("Ash Road, 31,250", "Ash Road; 31250"),
]

DIFFERENT = [
    ("4", "5"),
    ("4", "Answer: 5"),
    ("1989", "1990"),
    ("31,250", "31260"),
    ("3.7", "3.9"),
    ("15", "1.5"),
    ("Harbour Bridge", " \n"),
    ("Harbour Bridge", "\u200b"),
    ("4", ""),
]

UNSURE_ROWS = """
# words
Harbour Bridge : the bridge over the harbour | Harbour Tunnel | It is Harbour Bridge
São Tomé : Sao Tome
C++ : C
C# : C
A+ : A
AB- : AB
A-1 : A1
CO : Co
A major : major
nowhere : now here
blue-green : blue green
__init__ : init
# denials, hedges, candidates
Harbour Bridge : not Harbour Bridge | ~~Harbour Bridge~~ | Harbour Bridge? | Harbour Bridge …
Harbour Bridge : Harbour Bridge... | ❌ Harbour Bridge | > Harbour Bridge | Harbour Bridge or Tower Bridge
Harbour Bridge : The answer is not Harbour Bridge | **Harbour Bridge** **Tower Bridge**
# numbers with more than one reading
12.500 : 12500 | 12.5
25 000 : 25000 | 25
3.10 : 3.1
3.1 : 3.10
v3.10 : v3.1
4.50 : 4.5
1,234 : 1.234 | 1 234
007 : 7
15 : 1 5
10² : 102
½ : 1/2
5 : -5 | (5) | - 5 | +5 | 5! | # 5 | ٥ | at least 5 | 5+ | ≥ 5 | ~5 | 4–5 | five
# units, scales, currencies
5 m : 5
5 : 5 m | 6 km | 5000000
10% : 10
0.1 : 10
€5 : $5
$5 : 5 | $6
10 MW : 10 mW
3500万 : 3500
3.5亿 : 350000000
1,00,000 : 100000
39.2 : 39.19
39 : 39.2
# identifiers and dates
15551234567 : 5551234567
2024-05-03 : 2024-03-05
May 3, 2024 : 3 May 2024
3 May : 4 May
# lists
oak; elm; ash : oak; elm
oak; elm : elm; oak | oak; elm; ash | oak; ; elm
oak : oak; oak
1, 234 : 1,234
1; 2 : 12
"""
"""A reference answer, and answers of which the rule is not sure."""
UNSURE = [
    *(
        (row.partition(" : ")[0], answer)
        for row in UNSURE_ROWS.splitlines()
        if " : " in row
        for answer in row.partition(" : ")[2].split(" | ")
    ),
    ("Harbour Bridge", "H\u0336arbour Bridge"),
    ("Harbour Bridge", "Harbour Bridge\nTower Bridge"),
    ("Harbour Bridge", "Answer: Tower Bridge\n\nAnswer: Harbour Bridge"),
    ("Harbour Bridge", "The answer is Tower Bridge.\n\nFinal answer: Harbour Bridge"),
    ("Harbour Bridge", "Tower Bridge\nAnswer: Harbour Bridge"),
    ("Harbour Bridge", "Answer: Harbour Bridge\n\nTower Bridge"),
]


@pytest.mark.parametrize(
    ("reference", "answer", "match"),
    [
        *((*pair, Match.SAME) for pair in SAME),
        *((*pair, Match.DIFFERENT) for pair in DIFFERENT),
        *((*pair, Match.UNSURE) for pair in UNSURE),
    ],
)
def test_pairs(reference: str, answer: str, match: Match) -> None:
    assert compare(reference, answer).match is match


KNOWN = [
    Known("own", "Which bridge is the oldest?", "Harbour Bridge"),
    Known("own", "Which tree is the tallest?", "elm"),
    Known("own", "Which tree is the oldest?", "Old Oak"),
    Known("own", "How many steps has the tower?", "412"),
    Known("own", "How many visitors came?", "31,250"),
    Known("own", "How much is a ticket?", "$14.50"),
    Known("own", "How much is a guide?", "$9.00"),
    Known("own", "Is it open today?", "Yes"),
    Known("own", "Is it free?", "No"),
    Known("own", "When was it opened?", "June 4, 1981"),
    Known("own", "Which trees are there?", "oak; elm"),
    Known("own", "Who is the warden, and how many work there?", "Ines Okafor; 7; 2 March"),
]


def test_no_generated_answer_is_decided_falsely() -> None:
    """A sample of what ``benchmarks/reference_answers.py`` counts."""
    families = Families(KNOWN, seed=7)
    wrong = [case for _ in range(5) for one in KNOWN for case in families.wrong(one)]
    assert len({case.family for case in wrong}) >= 11
    assert [case for case in wrong if case.match is Match.SAME] == []
    right = [case for one in KNOWN for case in families.right(one)]
    assert [case for case in right if case.match is Match.DIFFERENT] == []
    assert sum(case.match is Match.SAME for case in right) > len(right) / 3


NUMBERS = st.integers(2, 10**7)


@given(
    NUMBERS,
    NUMBERS,
    st.sampled_from(
        "{r}万 {r}만 {r}\u202flakh {r}k {r}% {r}° {r}² {r}+ ~{r} -{r} −{r} <{r} €{r} v{r} {r}-{o} {o}/{r} "
        "{r}|{o} {r};{o} {r}or{o} not{r} {r}? {r}! ({r}) {r}e3 1/{r} #{r} {r},5 {r}.50".split(" ")
    ),
)
def test_a_number_with_anything_beside_it_is_not_decided(one: int, other: int, form: str) -> None:
    text = form.format(r=one, o=other)
    assert compare(str(one), text).match is Match.UNSURE
    assert compare(text, str(one)).match is Match.UNSURE


@given(st.text(max_size=60), st.text(max_size=60))
def test_any_two_texts_can_be_compared(reference: str, answer: str) -> None:
    assert compare(reference, answer).reason
    assert compare(reference, answer).match is not Match.DIFFERENT or not any(map(str.isalpha, answer))


@given(st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=60))
def test_a_text_is_itself(text: str) -> None:
    assert compare(text, text).match is Match.SAME


@given(st.integers(0, 10**8), st.integers(0, 10**8))
def test_whole_numbers_are_the_same_only_if_they_are_equal(one: int, other: int) -> None:
    for text in (str(other), f"{other:,}", f"Answer: {other:,}."):
        assert compare(f"{one:,}", text).match is not (Match.DIFFERENT if one == other else Match.SAME)


@pytest.mark.parametrize("unit", ["1", "a-", "1 ", "#", "\n\n", "answer:", "**", "Answer: x\n\n", "；", "'"])
def test_an_answer_of_any_length_is_compared_in_time(unit: str) -> None:
    start = process_time()
    compare("oak; elm", unit * (200_000 // len(unit)))
    assert process_time() - start < 3


@pytest.mark.parametrize(
    "text",
    ["", " ", *"nan NaN NULL N/A n/a undefined None <NA> NaT - — [] **".split(), None],
)
def test_what_means_no_reference_answer(text: str | None) -> None:
    assert reference_of(text) is None


@pytest.mark.parametrize("text", ["none", "no", "No", "0", "Na", "Nan Goldin", "unknown", "A-", "?"])
def test_what_may_be_an_answer_is_one(text: str) -> None:
    assert reference_of(text) == text
