"""The offline judge's comparison of answers: what is claimed, and what is only mentioned."""

from __future__ import annotations

import time
from datetime import date

import pytest

from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.truth import AnswerTruth, Evidence, FactTruth, Give, Truth
from webgym.judge.claims import spelled, swapped
from webgym.judge.offline import _labels, _reference
from webgym.offline.engine.spelling import count, days, minutes, quantity, times

DAY = (("Thursday",),)
DATED = (times(10 * 60 + 45), ("Monday",), ("Hall",))
LENGTH = (quantity("36", "km", "kilometres"), quantity("370", "m", "metres"))
HOURS = (times(10 * 60 + 45), times(19 * 60 + 30))
COST = (("£30", "30"),)
NO_REVIEWS = (count(0, "reviews", "review"),)
ONE = (count(1),)
TEN = (count(10),)
SIZE = (("S",),)
HIRED = (("Ann",), days(date(2026, 4, 22)))
SMALL_COST = (("€2",), ("€1,450", "1,450", "1450"))
KIND = (("Pots & Planters",), ("One",))
ZERO = (count(0, "reviews", "review"),)
FULL_HOURS = (times(8 * 60), times(17 * 60), times(13 * 60 + 30))
STARS = (("4 of 5 stars",), ("6 days", "6days"))
WALK = (times(9 * 60 + 45), ("€1,650", "1,650", "1650"), ("1.25%",))
DOCTOR = (("Dr Ann Lee",),)
FEW = (("6 sessions", "6sessions"), minutes(8))
GATE = (("Gate 4",),)
FAR = (quantity("530", "thousand km²"),)
YEAR = (quantity("1", "years"),)
CODE = (("KM-4512",),)
HOUSE = (("87 Claydale Road",),)
THREE = (("93 min",), ("160 °C",), ("Room 7",))

WRONG = [
    (DAY, "It is not Thursday."),
    (DAY, "It isn't on Thursday."),
    (DAY, "Any day except Thursday."),
    (DAY, "Thursday is wrong."),
    (LENGTH, "It is less than 36 km long, with a climb of over 370 m."),
    (LENGTH, "It is 36 miles long, with a climb of 370 feet."),
    (HOURS, "It opens at 10:45 pm and closes at 7:30 pm."),
    (COST, "It comes to $30."),
    (COST, "The total is 30 pence."),
    (NO_REVIEWS, "None of the pages that I visited shows the reviews."),
    (NO_REVIEWS, "There are two excellent reviews; none of the others is."),
    (ONE, "No one gave that rating."),
    (ONE, "Two of the reviews have that rating; the first one is by Jo."),
    (TEN, "There are ten or twelve."),
    (TEN, "I saw it at step 10."),
    (TEN, "I saw it at step 1 of 10."),
    (TEN, "\n".join(f"Step {number}: done." for number in range(1, 12))),
    (TEN, "I saw ten on the first page; altogether there are fourteen."),
    (SMALL_COST, "2 and €1,450"),
    (SMALL_COST, "2 dollars and 1,450 euros"),
    (SMALL_COST, "$2 € and 1450 €"),
    (SMALL_COST, "2 euros or 3 euros, and €1,450"),
    (KIND, "Pots and Planters, 2"),
    (KIND, "Pots and Planters, 1 or 2"),
    (KIND, "Pots and Kettles, 1"),
    (ZERO, "zero or 3"),
    (ZERO, "zero or one"),
    (ZERO, "None. Perhaps there is one."),
    (TEN, "zero, 10"),
    (HIRED, "Ann, on Tuesday, April 22, 2026."),
    (HIRED, "Ann, on 23/04/2026."),
    (HIRED, "Ann, on 22 Apr 2026：23 Apr 2026."),
    (HIRED, "Ann, on 22/05/2026."),
    (FULL_HOURS, "8 pm, 5 pm and 1.30 pm"),
    (FULL_HOURS, "08:00, 17:00 and 13:30 or １３：４５"),
    (FULL_HOURS, "8 am, 5 pm and 1.30 am"),
    (FULL_HOURS, "8 am, 4 pm or 5 pm and 1.30 pm"),
    (ONE, "1. Some have two.\n2. Others have three."),
    (TEN, "1. 9\n2. 10\n3. 11"),
    (THREE, "1. 93 min\n2. 160 °C\n4. Room 7"),
    (TEN, "I searched 10 websites, but could not find the number."),
    (TEN, "It took step 10."),
    (TEN, "10+"),
    (TEN, "≥ 10"),
    (TEN, "at least ten"),
    (TEN, "ten thousand"),
    (TEN, "a hundred and ten"),
    (COST, "£30 million"),
    (COST, "CHF 30"),
    (DAY, "Thurs\u200bday is wrong."),
    (DAY, "Thursday, if not Friday"),
    (SIZE, "It's sure, but I could not find the size."),
    (TEN, "Answer 1: 9. Answer 2: 10."),
    (TEN, "(1 of 2) 9 (2 of 2) 10"),
    (TEN, "| 1 | 9 |\n| 2 | 10 |"),
    (TEN, "10，9"),
    (TEN, "10 \\u007c 9"),
    (TEN, "<p>10</p><p>9</p>"),
    (FEW, "Session 6 took 8 h."),
    (FEW, "6, 8 min"),
    (GATE, "Platform: 4"),
    (GATE, "gate: 5"),
    (GATE, "Gate 5. Number: 4"),
    (DAY, "Thursday. \x00Friday."),
    (DAY, "Thursday or F\u00adr\u00adi\u00adday"),
    (LENGTH, "370 km and 36 m"),
    (FAR, "530 km²"),
]
RIGHT = [
    (STARS, "four out of five stars, six days"),
    (STARS, "4 of 5 stars and 6 days, respectively"),
    *(
        (WALK, answer)
        for answer in (
            "9.45, 1650 € and 1.25 percent",
            "9h45, €1'650 and 1.25 pct",
            "At 9:45 for €\u00a01\u202f650, with 1.25 %.",
            "9:45; 1650,00 EUR; 1.25 per cent",
        )
    ),
    (DOCTOR, "It is Dr. Ann Lee."),
    (TEN, "１０"),
    (TEN, "10 of the pages that were listed are such pages."),
    (DAY, "It is not Wednesday but Thursday."),
    (DAY, "Not on Thursday, I thought at first. Then I saw that it is Thursday."),
    (LENGTH, "36 kilometres and 370 metres"),
    (LENGTH, "It is 36 km long and climbs 370."),
    (HOURS, "It opens at 10:45 a.m. and closes at 07:30 PM."),
    (HOURS, "10:45 to 19:30"),
    (HOURS, "10:45 h to 19:30 h"),
    (COST, "£30.00"),
    (COST, "The total is 30 pounds."),
    (NO_REVIEWS, "There are no excellent reviews."),
    (NO_REVIEWS, "None."),
    (ONE, "Only one review has it."),
    (TEN, "There are ten reviews."),
    *(
        (SMALL_COST, answer)
        for answer in (
            "2 euros and 1450 euros",
            "EUR 2 and EUR 1,450",
            "2 € and 1,450 €",
            "€2 EUR; €1,450",
            "€2 €1,450",
        )
    ),
    (KIND, "Pots and Planters, 1"),
    (KIND, "Pots & Planters, one"),
    (ZERO, "It is zero."),
    (ZERO, "0 reviews"),
    (ZERO, "None of them: I looked at each one."),
    *(
        (HIRED, f"It is Ann, since {day}.")
        for day in (
            "the 22nd of April 2026",
            "22 of Apr",
            "Wednesday, April 22, 2026",
            "Wed., 22 Apr",
            "22 April 2026 (Wednesday)",
            "22/04/2026",
            "4/22/2026",
            "22.04.2026",
            "Apr. 22, 2026",
            "22-Apr-2026",
            "2026/04/22",
            "2026/4/22",
            "22. April 2026",
        )
    ),
    ((days(date(2026, 8, 8)),), "08/08/2026"),
    ((days(date(2026, 8, 8)),), "08 Aug 2026"),
    ((days(date(2026, 8, 8)),), "Aug 08, 2026"),
    (FULL_HOURS, "8 am, 5 pm and 1.30 pm"),
    (FULL_HOURS, "8 a.m. to 5pm, 1.30pm"),
    (ONE, "1. That is all."),
    (TEN, "1. Number: **ten**"),
    *(
        (THREE, answer)
        for answer in (
            "1. 93 min\n2. 160 °C\n3. Room 7",
            "(1) 93 min, (2) 160 °C, (3) Room 7",
            "They are: 1) 93 min, 2) 160 °C and 3) Room 7.",
            "  - **1.** Time: **93 min**\n  - **2.** Heat: **160 °C**\n  - **3.** Place: **Room 7**",
            "1: 93 min\n2: 160 °C\n3: Room 7",
        )
    ),
    (SIZE, "I'm done: the size is S."),
    ((("Henrik Jansen",),), "Name: Henrik Jansen"),
    ((("Apr 2026",),), "It is April 2026."),
    ((minutes(552),), "9h 12m"),
    ((minutes(552),), "9 hrs and 12 mins"),
    ((("4 of 5",),), "4 out of 5"),
    ((("SL-980",),), "It is SL\u2011980."),
    ((("KM4512",),), "It was booked as KM4512 days ago."),
    ((("Wait until spring.",),), "The text is: Wait until spring"),
    *(
        (TEN, answer)
        for answer in (
            "Answer 1: 10",
            "**Answer 1:** 10",
            "Q1: 10",
            "(1 of 1) 10",
            "[1/1] 10",
            "1. **Number**: 10",
            "| # | Question | Answer |\n|--:|:--|:--|\n| 1 | Number | **10** |",
            "There are 10.[1]",
            "There are 10. 【3†source】",
            "Number -> 10",
            "Number => 10",
            "<answer>10</answer>",
            "<ul><li>Number: <b>10</b></li></ul>",
            "I looked at pages 1 to 3. There are $10$.",
        )
    ),
    (THREE, "Answer 1: 93 min\nAnswer 2: 160 °C\nAnswer 3: Room 7"),
    (THREE, "Question 1 – 93 min\nQuestion 2 – 160 °C\nQuestion 3 – Room 7"),
    (THREE, "(1 of 3) 93 min\n(2 of 3) 160 °C\n(3 of 3) Room 7"),
    (THREE, "| 1 | 93 min |\n| 2 | 160 °C |\n| 3 | Room 7 |"),
    (THREE, "**93** minutes，**160** °C，Room 7。"),
    (THREE, "ninety-three min; 160 °C; Room 7"),
    (THREE, "93min, 160°C, Room 7"),
    (COST, '{"total": "\\u00a330"}'),
    (COST, "£30 (GBP)"),
    (COST, "It comes to about £30."),
    (COST, "It comes to £30 or so."),
    (COST, "~£30"),
    (LENGTH, "It is 36 km long, with a climb of roughly 370 metres."),
    (LENGTH, "It is 36 km long, with a climb of 370 metres or so."),
    (FEW, "Sessions: 6\nLength: 8"),
    (GATE, "The gate of the flight is 4."),
    (GATE, '{"gate_of_the_flight": "4"}'),
    (GATE, "| Gate | 4 |"),
    (FEW, '{"sessions": "6", "length": "8"}'),
    (FEW, "1. The number of sessions is 6 and the length is 8."),
    (FAR, "530,000 km²"),
    (FAR, "530 thousand km²"),
    (YEAR, "a difference of 1 year"),
    (YEAR, "one year"),
    (HOUSE, "I found this about 87 Claydale Road"),
    (CODE, "Booking number: KM-4512"),
    (CODE, "**Booking number:** KM-4512"),
    (DATED, "Start: 10:45\nDay: Monday\nPlace: Hall"),
    (DATED, "1. Start: 10:45\n2. Day: Monday\n3. Place: Hall"),
]


TWO = "Paper River has 43 calls and Scarlet Clock has 45 calls, a difference of 2 calls."
CALLS = (("43 calls", "43"), ("45 calls", "45"), ("2 calls",))


@pytest.mark.parametrize(
    ("answer", "is_right"),
    [
        (TWO, True),
        ("Scarlet Clock: 45 calls. Paper River: 43 calls. Difference: 2 calls.", True),
        ("43 calls (Paper River), 45 calls (Scarlet Clock): 2 calls", True),
        ("Those of Paper River and Scarlet Clock are 43 (Paper River) and 45 (Scarlet Clock): 2 calls", True),
        ("Paper River and Scarlet Clock have 43 and 45 calls, a difference of 2 calls.", True),
        ("Paper River has 45 calls and Scarlet Clock has 43 calls, a difference of 2 calls.", False),
        ("45 calls (Paper River), 43 calls (Scarlet Clock): 2 calls", False),
        ("Paper River has 43 calls and Scarlet Clock has 2 calls, a difference of 45 calls.", False),
    ],
)
def test_numbers_that_are_given_for_each_other_are_wrong(answer: str, is_right: bool) -> None:
    assert (swapped(spelled(answer), CALLS, spelled(TWO)) == "") is is_right


@pytest.mark.parametrize(
    ("answer", "is_right"),
    [
        ("For Pine Path, the colour is red. It is Salt Hall: the colour of the sign is blue.", True),
        ("Colour of the sign: blue (Salt Hall). Pine Path: red.", True),
        ("red, Salt Hall, blue", True),
        ("For Pine Path, the colour is blue. It is Salt Hall: the colour of the sign is red.", False),
    ],
)
def test_names_that_are_given_for_each_other_are_wrong(answer: str, is_right: bool) -> None:
    solution = "For Pine Path, the colour is red. It is Salt Hall: the colour of the sign is blue."
    assert (
        swapped(spelled(answer), (("red",), ("Salt Hall",), ("blue",)), spelled(solution)) == ""
    ) is is_right


ROUTE = "For Old Hall, the length is 160 min, the walk is 14 min and the day of the hall is Monday."
ROUTE_VALUES = (("160 min", "160"), ("14 min", "14"), ("Monday",))
GAME_VALUES = (("114",), ("62",), ("52",))
GAMES = "Finished at last: the puzzle game has 114 and Looking for a puzzle game has 62, a difference of 52."


@pytest.mark.parametrize(
    ("solution", "values", "answer", "is_right"),
    [
        (ROUTE, ROUTE_VALUES, "160 min, 14 min, Monday", True),
        (ROUTE, ROUTE_VALUES, "14 min, 160 min, Monday", False),
        (ROUTE, ROUTE_VALUES, "It is 14 min. It is 160 min. It is Monday.", False),
        (ROUTE, ROUTE_VALUES, "14 min on foot, and it takes 160", True),
        (ROUTE, ROUTE_VALUES, "The walk and the length are 14 min and 160 min respectively; Monday.", True),
        (ROUTE, ROUTE_VALUES, "The walk and the length are 160 min and 14 min respectively; Monday.", False),
        (ROUTE, ROUTE_VALUES, "160 min and 14 min: the walk and the length. Monday.", False),
        (
            ROUTE,
            ROUTE_VALUES,
            "The length of Old Hall is 160 min, the walk of Old Hall is 14 min. Monday is Old Hall's day.",
            True,
        ),
        (GAMES, GAME_VALUES, "Looking for …: 62; Finished at last: 114; 52", True),
        (GAMES, GAME_VALUES, "Looking for …: 114; Finished at last: 62; 52", False),
        (GAMES, GAME_VALUES, "52 (= 114 - 62)", True),
        (GAMES, GAME_VALUES, "114, 52, 62", False),
    ],
)
def test_lists_are_in_the_order_of_their_labels(
    solution: str, values: tuple[tuple[str, ...], ...], answer: str, is_right: bool
) -> None:
    assert (swapped(spelled(answer), values, spelled(solution)) == "") is is_right


def judged(required: tuple[tuple[str, ...], ...], answer: str) -> bool:
    instruction = "What do the reviews, the pages and the shop say? Give the size, the rating and the total."
    task = Task("t", instruction, "http://a.test/", "d", "s", Rubric((FactGroup(1, "g", ("f",)),)), "offline")
    truth = Truth("a.test", (), AnswerTruth(required), (Give(", ".join(one[0] for one in required)),))
    judgement = _reference(task, truth, answer)
    assert judgement is not None
    return judgement.passed is True


@pytest.mark.parametrize(("required", "answer"), WRONG)
def test_what_is_denied_or_of_another_unit_is_not_claimed(
    required: tuple[tuple[str, ...], ...], answer: str
) -> None:
    assert not judged(required, answer)


@pytest.mark.parametrize(("required", "answer"), RIGHT)
def test_what_is_claimed_in_common_spellings_is_right(
    required: tuple[tuple[str, ...], ...], answer: str
) -> None:
    assert judged(required, answer)


def judged_page(task: str, solution: str, values: dict[str, str], answer: str) -> bool:
    """As :func:`judged`, with the label of each value on its page."""
    facts = tuple(
        FactTruth(1, nth, (Evidence((label, value)),)) for nth, (value, label) in enumerate(values.items())
    )
    rubric = Rubric((FactGroup(1, "g", tuple(f"fact {nth}" for nth in range(len(facts)))),))
    truth = Truth("a.test", facts, AnswerTruth(tuple((value,) for value in values)), (Give(solution),))
    judgement = _reference(Task("t", task, "http://a.test/", "d", "s", rubric, "offline"), truth, answer)
    assert judgement is not None
    return judgement.passed is True


COOK = "look up the years at the stove, the favourite ingredient and the number of recipes of Ann"
COOKS = "For Ann, the years at the stove is 6, the favourite ingredient is miso, the number of recipes is 79."
OF_COOK = {"6": "Cooking for", "miso": "Cannot cook without", "79": "Has written"}
PAY = ("look up the yearly pay and the bonus", "The yearly pay is $67,900 and the bonus is $85.")
OF_PAY = {"$67,900": "Half earn more than", "$85": "Extra"}
STAFF = ("look up the adviser and the manager", "The adviser is Ann Lee and the manager is Bo Ray.")
OF_STAFF = {"Ann Lee": "Asks for you", "Bo Ray": "Run by"}
SENT = ("look up the number of the form and the mouth and the number of bridges",)
SENT_SOLUTION = "The number is BR-411. For Ox, the mouth is Fjord and the number of bridges is 45."
OF_SENT = {"BR-411": "Ticket", "Fjord": "Ends in", "45": "Bridges"}


@pytest.mark.parametrize(
    ("task", "solution", "values", "answer", "is_right"),
    [
        (COOK, COOKS, OF_COOK, "Cooking for: 6\nCannot cook without: miso\nHas written: 79", True),
        (COOK, COOKS, OF_COOK, "Cooking for 79, cannot cook without miso, has written 6", False),
        (*PAY, OF_PAY, "Half earn more than\n$67,900\nExtra\n$85", True),
        (*PAY, OF_PAY, "$67,900 a year, and $85", True),
        (*PAY, OF_PAY, "$67,900 per month, and $85", False),
        (*STAFF, OF_STAFF, "Asks for you: Ann Lee. Run by: Bo Ray.", True),
        (*STAFF, OF_STAFF, "Asks for you: Bo Ray. Run by: Ann Lee.", False),
        (*STAFF, OF_STAFF, '{"the_adviser": "Ann Lee", "the_manager": "Bo Ray"}', True),
        (*STAFF, OF_STAFF, '{"the_adviser": "Bo Ray", "the_manager": "Ann Lee"}', False),
        (*SENT, SENT_SOLUTION, OF_SENT, "Ref: BR-411\nMouth: Fjord\nNumber of bridges: 45", True),
        (*STAFF, OF_STAFF, "| Field | Value |\n|---|---|\n| Adviser | Ann Lee |\n| Manager | Bo Ray |", True),
        (*STAFF, OF_STAFF, "Adviser: Ann Lee, manager: Bo Ray. High confidence.", True),
    ],
)
def test_labels_of_the_page_and_of_the_solution_tell_values_apart(
    task: str, solution: str, values: dict[str, str], answer: str, is_right: bool
) -> None:
    assert judged_page(task, solution, values, answer) is is_right


def test_long_lists_of_values_and_labels_are_read_once() -> None:
    """Each word was compared with each value, and each value's label looked for from the start."""
    solution = spelled("The walk is 7 min and the ride is 9 min.")
    required = (("7 min", "7"), ("9 min", "9"))
    seconds = []
    for times_longer in (1, 4):
        answer = spelled("walk 7 ride 9 or " * 600 * times_longer)
        begun = time.process_time()
        swapped(answer, required, solution)
        seconds.append(time.process_time() - begun)
    assert seconds[1] < 10 * seconds[0] + 0.1


def test_another_candidate_is_no_label() -> None:
    """The rows of a table are evidence together: that of one is no label of the other."""
    facts = (FactTruth(1, 0, (Evidence(("Bo Ray", "Ann Lee")),)), FactTruth(1, 1, (Evidence(("Size", "7")),)))
    assert _labels(Truth("a.test", facts, AnswerTruth((("Ann Lee",),), ("Bo Ray",)), ())) == {"7": "Size"}
