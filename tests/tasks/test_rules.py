"""The rules of the rubric: each has what it finds, what it must let pass, and how often it is wrong."""

from __future__ import annotations

import json
import re
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.tasks.cut_rubrics import CUT_RIGHTLY, CUT_WRONGLY, OTHER_NUMBER, SAME_NUMBER
from tests.tasks.good_rubrics import GOOD
from tests.tasks.sources.native import REAL

from webgym.core.task import FactGroup, Rubric
from webgym.offline.web import OfflineWeb
from webgym.tasks.rules import RULES, Asked, Draft, DraftGroup, Finding, check_rubric
from webgym.tasks.rules.wording import with_capital_or

REPLIES = REAL / "judge-labels" / "webjudge_replies_o4_mini.jsonl"
DEEPSHOP = REAL / "deepshop" / "deepshop_test.jsonl"
Groups = list[list[str]]


def draft(groups: Groups, difficulty: int | None = None) -> Draft:
    found = tuple(DraftGroup(number, "a group", tuple(facts)) for number, facts in enumerate(groups, start=1))
    return Draft(found, sum(map(len, groups)) if difficulty is None else difficulty)


def broken(task: str, *facts: str, **asked: object) -> set[str]:
    return {finding.rule for finding in look(task, [list(facts)], **asked)}


def look(task: str, groups: Groups, **asked: object) -> list[Finding]:
    return check_rubric(draft(groups), Asked(task, **asked))  # type: ignore[arg-type]


@pytest.mark.parametrize("number", ["9" * 320, "9" * 5_000, "8" * 305 + " thousand", "hundred " * 160])
@pytest.mark.parametrize("unit", ["km", "adults", "%", "million", "and a half"])
def test_a_number_beyond_all_bounds_is_no_crash(number: str, unit: str) -> None:
    said = f"The tower for {number} {unit} is found"
    broken("Find the tower", said)
    broken(said, "The tower of 3 km is found")


@pytest.mark.timeout(10)  # the time of most patterns grows with the square of a text's length
@pytest.mark.parametrize("part", ["1.", '"', "red or ", "such as ", "a", "1", "\n"])
def test_texts_without_end_take_no_time(part: str) -> None:
    assert broken("Find the tower", part * 100_000, "The tower is found") == {"endless"}
    described = DraftGroup(1, part * 100_000, ("The tower is found",))
    assert {each.rule for each in check_rubric(Draft((described,), 1), Asked("Find it"))} == {"endless"}
    assert not broken(f"Find the tower {part * 3_000}", "The tower is found") & {"endless"}


SHOES = "Find running shoes in red or blue under $80 that are rated at least 4 stars"

HITS = [
    ("empty-fact", SHOES, ["The shoes are red OR blue", "None"]),
    ("empty-fact", SHOES, ["The shoes are red OR blue", " - "]),
    ("empty-fact", SHOES, ["The shoes are red OR blue", "N/A."]),
    ("or-in-capitals", SHOES, ["The shoes are red or blue"]),
    ("or-in-capitals", SHOES, ["The shoes are either red or blue"]),
    ("or-in-capitals", SHOES, ["The shoes are red and/or blue"]),
    ("or-in-capitals", "Fly to Boston or New York", ["The flight goes to Boston or New York"]),
    ("split-alternatives", SHOES, ["The shoes are red", "The shoes are blue"]),
    (
        "split-alternatives",
        "Pay by card, voucher or cash",
        ["The payment is by card", "The payment is by voucher"],
    ),
    ("several-things", "Give its name and its address", ["The name and address of the hotel are found"]),
    ("several-things", "Give the price and rating", ["The price and the average rating are reported"]),
    ("several-things", "Title, author, year?", ["The title, author, and year are reported"]),
    ("step", SHOES, ["The user clicks the price filter"]),
    ("step", SHOES, ["Step 2: the shoes are red OR blue"]),
    ("step", SHOES, ["1. The shoes are red OR blue"]),
    ("step", SHOES, ["Navigate to the shoes section"]),
    ("step", SHOES, ["The filter for red shoes is set by scrolling down"]),
    ("step", SHOES, ["Red shoes are typed into the field"]),
    ("examples", SHOES, ["Running shoes, such as trail shoes, are found"]),
    ("examples", SHOES, ["Running shoes (e.g. for trails) are found"]),
    (
        "example-as-fact",
        "Find sights such as museums or parks in Riga",
        ["Sights are found", "Museums are found"],
    ),
    (
        "example-as-fact",
        "Find a speaker, for example by Jola, Anda, or Mirk, now",
        ["The speaker is by Mirk"],
    ),
    (
        "example-as-fact",
        "Find a speaker such as the Jola One with Bluetooth",
        ["The speaker is the Jola One"],
    ),
    ("example-as-fact", "Tell me about pets (e.g., cats, dogs)", ["Information about cats is found"]),
    ("duplicate", SHOES, ["The shoes cost under $80", "The shoes cost under $80 is reported"]),
    ("duplicate", SHOES, ["The shoes are red OR blue", "the shoes are  red OR blue."]),
    ("restated-task", SHOES, [f"{SHOES.replace(' or ', ' OR ')} is done", "The shoes cost under $80"]),
    ("unstated-number", SHOES, ["The shoes cost under $75"]),
    ("unstated-number", SHOES, ["The shoes have 120 reviews"]),
    ("unstated-number", "Find two hotels in Bonn", ["Hotel 3 in Bonn is found"]),
    (
        "how-to",
        "How do I reset my Lumo lamp?",
        ["Hold the button for a while", "Wait until the light blinks"],
    ),
    (
        "computation",
        "How much more do two pens cost than one?",
        ["The prices are subtracted", "A result is given"],
    ),
    ("computation", "What is the total of both fees?", ["The fees are found", "Both are added up"]),
    (
        "enumerated",
        "Give the contact details of the club",
        ["The phone number is given", "The e-mail is given"],
    ),
    ("enumerated", "Give the contact details of the club", ["The contact details (phone, fax) are given"]),
    (
        "enumerated",
        "Report the specs of the Zed phone",
        ["The Zed's battery is reported", "The Zed's memory"],
    ),
    (
        "enumerated",
        "When is the Zed museum open? Give its hours",
        ["The hours on Monday", "The hours on Tuesday"],
    ),
    ("hollow", SHOES, ["The task is completed"]),
    ("hollow", SHOES, ["All requirements are met"]),
    ("no-subject", SHOES, ["It is found and reported"]),
    ("markup", SHOES, ["**The shoes** are red OR blue"]),
    ("markup", SHOES, ["The shoes\nare red OR blue"]),
    ("markup", SHOES, ['{"fact": "red shoes"}']),
    ("endless", SHOES, ["The shoes are red OR blue " * 20]),
    ("several-clauses", SHOES, ["The shoes are red OR blue and cost under $80"]),
    ("several-clauses", "Find red and blue paint", ["The red paint and the blue paint are found"]),
    ("several-conditions", SHOES, ["Running shoes, priced under $80, and rated at least 4 stars"]),
    ("several-sentences", SHOES, ["The shoes are running shoes. They cost under $80"]),
    ("unstated-name", SHOES, ["The shoes are made by Fleetfoot"]),
    ("unstated-quotation", SHOES, ['The shoes carry the label "Best seller"']),
    ("off-task", SHOES, ["Payment details are entered correctly today"]),
    ("agent", SHOES, ["The agent finds running shoes"]),
    ("question", SHOES, ["Are the shoes red OR blue?"]),
    ("long", SHOES, ["The shoes are red OR blue " * 8]),
    ("purchase", "Buy a Vega tent", ["The Vega tent is in the cart", "The payment is made"]),
    (
        "operands",
        "How much more is the Vega tent than the Lyra tent?",
        ["The price of Vega", "The price of Lyra", "The difference"],
    ),
]

NEAR_MISSES = [
    (
        "operands",
        "On Ivorywood Retro Computing, find out which option leads the poll, and with how many votes",
        ["the option with the most votes is found", "its number of votes is found"],
    ),
    (
        "operands",
        "Open the topic “How old is your fern?” and find out on which board it stands and its label",
        [
            "the board of the topic “How old is your fern?” is found",
            "the tag of the topic “How old is your fern?” is found",
        ],
    ),
    ("empty-fact", SHOES, ["None of the shoes costs more than $80"]),
    ("or-in-capitals", SHOES, ["The shoes are rated 4 stars or more", "The shoes are red OR blue"]),
    ("or-in-capitals", SHOES, ["The shoes cost $80 or less", "The price is at or below $80"]),
    ("or-in-capitals", "Find 'Truth or Dare' cards", ["The cards are for 'Truth or Dare'"]),
    ("split-alternatives", SHOES, ["The shoes are red OR blue", "The shoes are under $80"]),
    (
        "split-alternatives",
        "Get red shoes and blue socks or a hat",
        ["The shoes are red", "The shoes are blue"],
    ),
    ("several-things", "Between price and rating?", ["The difference between price and rating is found"]),
    ("several-things", SHOES, ["The shoes are sorted by price and rating"]),
    ("several-things", "Give date and time", ["The date and time of the talk are found"]),
    ("several-things", "Find a bed and breakfast", ["A bed and breakfast in Ayr is found"]),
    ("step", "Click the newsletter box", ["The newsletter box is clicked"]),
    ("step", "Find click fraud statistics", ["Statistics of click fraud are found"]),
    ("step", SHOES, ["The type of the shoes is given", "The search results hold red shoes"]),
    ("step", "Give 1.5 litre bottles", ["1.5 litre bottles are found"]),
    ("examples", SHOES, ["The shoes are as such not expensive"]),
    ("example-as-fact", "Find sights such as museums in Riga", ["Sights in Riga are found"]),
    (
        "example-as-fact",
        "Find a speaker from brands such as Jola or Anda, ensuring it is new and ships for free",
        ["The speaker ships for free", "The speaker is new"],
    ),
    ("example-as-fact", "Find museums and sights such as museums", ["Museums are found"]),
    ("duplicate", "Prices of A1 and A2", ["The price of A1 is found", "The price of A2 is found"]),
    ("restated-task", SHOES, [SHOES.replace(" or ", " OR ")]),
    (
        "restated-task",
        "Give the address and the phone number of the vegan restaurant Soil near the old harbour of Bergen",
        [
            "The address of the vegan restaurant Soil near the old harbour of Bergen with its number",
            "The phone of the vegan restaurant Soil near the old harbour of Bergen",
        ],
    ),
    (
        "unstated-number",
        "Find ten flats with two rooms, under $1,400",
        ["10 flats", "2 rooms", "under $1400"],
    ),
    (
        "unstated-number",
        "A run on March 5th at 7:30",
        ["The run is on 2024-03-05".replace("2024-", ""), "7:30"],
    ),
    ("unstated-number", "Find two hotels in Bonn", ["Hotel 2: the name is found", "Hotel 1 is found"]),
    ("unstated-number", "A 10k run", ["A run over 10,000 metres"]),
    ("leaked-answer", "Who wrote Emma?", ["The author of Emma is found"]),
    (
        "how-to",
        "How to get a visa and what does it cost in Peru?",
        ["How to get a visa is found", "Its cost in Peru"],
    ),
    ("how-to", "How many steps has the tower?", ["The number of steps of the tower is found"]),
    (
        "computation",
        "Give the total of both fees",
        ["The fees are found", "The total of both fees is calculated"],
    ),
    (
        "computation",
        "Calculate the fees and their sum",
        ["The fees are calculated", "Their sum is calculated"],
    ),
    (
        "enumerated",
        "Give the phone number and e-mail in the contact details",
        ["The phone number", "The e-mail"],
    ),
    ("enumerated", "Give the contact details of the club", ["The contact details of the club are given"]),
    ("hollow", "Is the task list complete?", ["Whether the task list is complete is found"]),
    ("several-clauses", "Find terms and conditions", ["The terms and conditions are found"]),
    ("several-conditions", "The total, with tax", ["The total, with tax, is found"]),
    ("several-sentences", "Fly to St. Louis", ["The flight goes to St. Louis"]),
    ("unstated-name", "Shoes from the EU", ["The shoes come from the European Union"]),
    ("unstated-name", "Shoes from New York City", ["The shoes come from NYC", "Shoes OR boots in May"]),
    ("unstated-quotation", "Open 'About us'", ['The page "About us" is open']),
    ("off-task", "List the recipes", ["The recipe is listed"]),
    (
        "operands",
        "Give the prices of A and B and the difference",
        ["The price of A", "The price of B", "The difference"],
    ),
    ("agent", "Find a travel agent", ["The travel agent in Ulm is found"]),
]


@pytest.mark.parametrize(("rule", "task", "facts"), HITS)
def test_what_breaks_a_rule_is_found(rule: str, task: str, facts: list[str]) -> None:
    findings = [finding for finding in look(task, [facts]) if finding.rule == rule]
    assert findings
    assert all("\n" not in str(finding) and "group 1" in finding.message for finding in findings)


@pytest.mark.parametrize(("rule", "task", "facts"), NEAR_MISSES)
def test_what_only_looks_like_it_passes(rule: str, task: str, facts: list[str]) -> None:
    assert rule not in broken(task, *facts)


def refused(task: str, facts: list[str]) -> set[str]:
    return {finding.rule for finding in look(task, [facts]) if finding.severity == "error"}


@pytest.mark.parametrize(("task", "facts"), CUT_WRONGLY)
def test_what_is_one_fact_may_not_be_cut(task: str, facts: list[str]) -> None:
    rules = {"purchase", "how-to", "step", "computation", "operands", "split-alternatives"}
    assert refused(task, facts) & rules


@pytest.mark.parametrize(("task", "facts"), CUT_RIGHTLY)
def test_what_is_asked_for_may_be_facts_of_their_own(task: str, facts: list[str]) -> None:
    assert refused(task, facts) == set()


@pytest.mark.parametrize(("task", "facts"), SAME_NUMBER)
def test_a_number_of_the_task_may_come_in_another_form(task: str, facts: list[str]) -> None:
    assert "unstated-number" not in refused(task, facts)


@pytest.mark.parametrize(("task", "facts"), OTHER_NUMBER)
def test_another_number_is_found(task: str, facts: list[str]) -> None:
    assert "unstated-number" in refused(task, facts)


THINGS = [("Vega", "Lyra"), ("Oslo", "Bergen"), ("hostel", "hotel"), ("blue line", "red line")]
WRONG_CUTS = [
    ("Find the {0} or the {1} at Zed.", ["The {0} is found at Zed", "Zed has the {1}"]),
    (
        "How much more does the {0} cost than the {1}?",
        ["The price of the {0} is found", "The {1}'s price is found"],
    ),
    (
        "Add up the fees of the {0} and the {1}.",
        ["The fee of the {0} is found", "The fee of the {1} is found"],
    ),
    ("Buy a ticket for the {0}.", ["The {0} is selected", "Billing is filled in", "The order is confirmed"]),
    ("How do I cancel the {0}?", ["Log in", "Open the settings", "Press the red switch"]),
]
RIGHT_CUTS = [
    (
        "Which is cheaper, the {0} or the {1}?",
        ["The price of the {0} is found", "The price of the {1} is found"],
    ),
    ("Is the {0} or the {1} older?", ["The age of the {0} is found", "The age of the {1} is found"]),
    (
        "Give the price of the {0} and of the {1}.",
        ["The price of the {0} is given", "The price of the {1} is given"],
    ),
    ("Find the {0} or the {1} at Zed.", ["The {0} OR the {1} is found at Zed"]),
    ("Buy a ticket for the {0}.", ["The ticket is for the {0}", "A ticket is bought"]),
]


@pytest.mark.parametrize("things", THINGS, ids=str)
def test_families_of_cuts_are_told_apart(things: tuple[str, str]) -> None:
    """Whatever they are about."""

    def told(cuts: list[tuple[str, list[str]]]) -> list[bool]:
        return [
            bool(refused(task.format(*things), [fact.format(*things) for fact in facts]))
            for task, facts in cuts
        ]

    assert told(WRONG_CUTS) == [True] * len(WRONG_CUTS)
    assert told(RIGHT_CUTS) == [False] * len(RIGHT_CUTS)


def test_style_is_remarked_on_and_refuses_nothing() -> None:
    for fact in (
        "The shoes are red or blue",
        "The shoes are red and/or blue",
        "Shoes, such as red OR blue ones",
    ):
        findings = look(SHOES, [[fact]])
        assert findings
        assert {finding.severity for finding in findings} == {"warning"}
    assert (
        with_capital_or("red or blue, 4 or more, 'Truth or Dare'")
        == "red OR blue, 4 or more, 'Truth or Dare'"
    )
    assert with_capital_or("red and/or blue") == "red OR blue"


@pytest.mark.skipif(not REPLIES.exists(), reason=f"{REPLIES} is not there")
def test_what_a_model_lists_for_real_tasks_is_seldom_refused() -> None:
    """The key points of a judge for 306 tasks, each read as a rubric: 19 were refused once."""
    points: dict[str, tuple[str, list[str]]] = {}
    for record in map(json.loads, REPLIES.read_text("utf-8").splitlines()):
        listed = [re.sub(r"^\d+[.)]\s*", "", line).strip() for line in record["key_points"].splitlines()]
        points.setdefault(record["task_id"], (record["goal"].strip(), [line for line in listed if line]))
    found = [refused(task, facts) for task, facts in points.values() if facts]
    assert len(found) > 250
    assert sum(map(bool, found)) <= 0.03 * len(found), found


def test_the_shape_of_the_whole() -> None:
    def found(rubric: Draft, **asked: bool) -> set[str]:
        return {finding.rule for finding in check_rubric(rubric, Asked(SHOES, **asked))}  # type: ignore[arg-type]

    fact = "The shoes are red OR blue"
    assert found(draft([])) == {"empty-group"}
    assert found(draft([[fact], []])) == {"empty-group"}
    assert found(draft([[fact]], difficulty=2)) == {"difficulty"}
    assert found(Draft((DraftGroup(1, "  ", (fact,)),), 1)) == {"no-description"}
    assert found(Draft((DraftGroup(2, "a", (fact,)),), 1)) == {"group-ids"}
    assert found(Draft((DraftGroup(2, "a", (fact,)),), 1), derived=True) == set()
    assert "too-many-facts" in found(draft([[f"The shoes are red {number}" for number in range(61)]]))
    assert "many-groups" in found(draft([[fact]] * 11))
    assert found(draft([[fact], [fact]])) == {"repetition"}


def test_answers_and_hints_must_not_leak() -> None:
    task = "Find a cozy coffee shop in Westchester and give its full address."
    hints = ("Identify 'Bean & Leaf' as cozy.", "State the address as 12 Main Street, Rye, NY 10580.")
    shop = "The coffee shop is cozy"
    for fact, leaks in [
        ("The shop is 'Bean & Leaf'", True),
        ("The full address is 12 Main Street, Rye", True),
        ("The address has the code 10580", True),
        ("The full address of the coffee shop is given", False),
    ]:
        assert ("leaked-answer" in broken(task, shop, fact, hints=hints)) is leaks
    answers = ("Altair Press; 1987",)
    assert "leaked-answer" in broken("Who published it?", "The publisher is Altair Press", answers=answers)
    assert "leaked-answer" not in broken(
        "Did Altair Press publish it?", "It is by Altair Press", answers=answers
    )
    assert "leaked-answer" not in broken("How many?", "The number is found", answers=("3", "Yes"))


def test_every_rule_is_tested_and_named_once() -> None:
    ids = [rule.id for rule in RULES]
    assert len(set(ids)) == len(ids)
    tested = {rule for rule, _, _ in HITS} | {"leaked-answer"}
    of_the_whole = {
        "empty-group",
        "no-description",
        "difficulty",
        "group-ids",
        "too-many-facts",
        "many-groups",
    }
    assert tested | of_the_whole | {"repetition"} == set(ids)
    severities = [rule.severity for rule in RULES]
    assert severities == sorted(severities), "errors come first"


@pytest.mark.parametrize("good", GOOD, ids=lambda good: good[0][:40])
def test_good_rubrics_are_not_refused(good: tuple[str, list[tuple[str, list[str]]]]) -> None:
    task, groups = good
    rubric = Rubric(
        tuple(FactGroup(number, about, tuple(facts)) for number, (about, facts) in enumerate(groups, start=1))
    )
    assert check_rubric(Draft.of(rubric), Asked(task)) == []


def test_no_rubric_of_the_offline_web_is_refused_and_few_are_remarked_on() -> None:
    tasks = [task for task in OfflineWeb(seed=7, per_family=6).tasks() if task.truth is not None]
    refused, remarked = [], 0
    for task in tasks:
        answers = () if task.reference_answer is None else (task.reference_answer,)
        asked = Asked(task.instruction, task.website, answers=answers, derived=task.parent_id is not None)
        findings = check_rubric(Draft.of(task.rubric), asked)
        refused += [finding for finding in findings if finding.severity == "error"]
        remarked += bool(findings)
    assert refused == []
    assert remarked < 0.06 * len(tasks)


@pytest.mark.skipif(not DEEPSHOP.exists(), reason=f"{DEEPSHOP} is not there")
def test_deepshops_own_columns_break_only_rules_that_they_do_break() -> None:
    """What a model made of 150 real tasks, and nobody checked.

    The findings of one rule were all read, those of the others in samples.
    """
    found: Counter[str] = Counter()
    for record in map(json.loads, DEEPSHOP.read_text("utf-8").splitlines()):
        columns = [record[name] for name in ("attribute", "filter", "sort")]
        facts = [[text] for text in columns if text not in ("", "None") and "**" not in text]
        findings = look(record["ques"], facts, website=record["web"]) if facts else []
        found.update(finding.rule for finding in findings if finding.severity == "error")
    assert found == {"example-as-fact": 14, "several-things": 8}


@given(
    st.text(max_size=60),
    st.lists(st.lists(st.text(max_size=60), max_size=4), max_size=4),
    st.lists(st.text(max_size=30), max_size=3),
)
def test_any_text_is_looked_at_without_an_error(task: str, groups: Groups, hints: list[str]) -> None:
    findings = look(task, groups, hints=tuple(hints), answers=tuple(hints), website="http://x.test/")
    assert all("\n" not in finding.message for finding in findings)
