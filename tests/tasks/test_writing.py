"""What models write for a task set: what is taken, what is refused, and how they are asked again."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.tasks.endpoint import Endpoint, serve

from webgym.core.errors import LLMUnusable
from webgym.core.task import FactGroup, Rubric, Task
from webgym.llm.client import ChatClient
from webgym.llm.completion import Completion
from webgym.llm.config import ChatConfig, Retry, Sampling
from webgym.offline.web import OfflineWeb
from webgym.tasks import prompts
from webgym.tasks.rewriting import WritingLimits, refused_rewriting
from webgym.tasks.rules import RULES, Asked, Draft, DraftGroup, check_rubric
from webgym.tasks.sources import SourceTask
from webgym.tasks.taxonomy import DOMAIN_OF, DOMAINS
from webgym.tasks.writing import infer_website, rewrite, write_rubric

TENT = SourceTask(
    id="insta-v3/1",
    source="insta-v3",
    instruction="Find a tent under $200 for 4 people, and give its weight. Also say how to return it.",
    website="https://tents.example.com/",
    website_from="given",
    hints=("Click 'Shelters'.", "The tent is the Tarn IV at $189.95."),
)
GROUPS = (
    FactGroup(
        1, "The tent", ("The tent costs under $200", "The tent is for 4 people", "The weight is given")
    ),
    FactGroup(2, "Returns", ("Instructions for returning the tent are found",)),
)
TASK = Task(
    id="insta-v3/1",
    instruction=TENT.instruction,
    website="https://tents.example.com/",
    domain="Lifestyle & Leisure",
    subdomain="Shopping",
    rubric=Rubric(GROUPS),
    source="insta-v3",
    reference_answer="Tarn IV, 2.1 kg",
)


class Says:
    """A model that says these things, one after the other, and then the last one again."""

    def __init__(self, *replies: str | Completion) -> None:
        self._replies = list(replies)
        self.asked: list[list[dict[str, Any]]] = []

    async def complete(self, messages: Sequence[Any], sampling: Sampling | None = None) -> Completion:
        self.asked.append([dict(message) for message in messages])
        reply = self._replies[min(len(self.asked), len(self._replies)) - 1]
        return reply if isinstance(reply, Completion) else completion(reply)


def completion(text: str, *, finish_reason: str = "stop", refusal: str = "") -> Completion:
    return Completion(text, finish_reason, 10, 5, 0.1, "tiny", refusal=refusal)


def rubric(*groups: list[str], difficulty: int | None = None) -> str:
    found = [
        {"id": number, "description": "a part", "facts": facts} for number, facts in enumerate(groups, 1)
    ]
    count = sum(map(len, groups)) if difficulty is None else difficulty
    return json.dumps({"fact_groups": found, "difficulty": count})


GOOD = rubric(list(GROUPS[0].facts), list(GROUPS[1].facts))


# --- prompts ------------------------------------------------------------------------------------------------


def test_the_prompts_own_example_keeps_the_rules() -> None:
    reply = prompts.EXAMPLE_RUBRIC
    groups = tuple(DraftGroup(group.id, group.description, group.facts) for group in reply.fact_groups)
    assert check_rubric(Draft(groups, reply.difficulty), Asked(prompts.EXAMPLE_TASK)) == []
    assert msgspec.json.encode(reply).decode() in prompts.for_rubric(TENT)[0]["content"]


def test_the_prompt_for_rubrics_tells_every_rule_that_a_writer_can_break() -> None:
    told = prompts.for_rubric(TENT)[0]["content"]
    words = {
        "or-in-capitals": "OR in capitals",
        "several-things": "verified by itself",
        "step": "never how to get there",
        "unstated-number": "no numbers",
        "computation": "A computation is one fact",
        "how-to": "Never one fact per step",
        "enumerated": "contact details",
        "examples": "such as",
        "duplicate": "No fact twice",
        "restated-task": "repeats the whole task",
        "hollow": "The answer is correct",
        "leaked-answer": "They may hold the answer",
        "difficulty": "number of facts",
        "split-alternatives": "one fact per alternative",
    }
    assert words.keys() <= {rule.id for rule in RULES}
    for rule, phrase in words.items():
        assert phrase in " ".join(told.split()), rule


def test_the_prompts_hold_what_they_are_about_and_no_answer() -> None:
    system, asked = prompts.for_website(TENT)
    assert all(domain in system["content"] for domain in DOMAINS)
    assert all(subdomain in system["content"] for subdomain in DOMAIN_OF)
    assert "https://tents.example.com/" in asked["content"]
    inferred = msgspec.structs.replace(TENT, website="https://x.example/", website_from="inferred")
    assert "x.example" not in prompts.for_rubric(inferred)[1]["content"]
    assert "Shelters" in prompts.for_rubric(TENT)[1]["content"]
    told = prompts.for_rewriting(TASK, GROUPS[:1])[1]["content"]
    assert "The tent is for 4 people" in told
    assert "Instructions for returning" not in told
    assert "2.1 kg" not in told


def test_endless_notes_are_cut() -> None:
    task = msgspec.structs.replace(TENT, hints=("word " * 5_000,))
    assert len(prompts.for_rubric(task)[1]["content"]) < 6_000


# --- website and domain -------------------------------------------------------------------------------------


async def test_a_website_is_inferred_and_its_domain_follows_from_the_subdomain() -> None:
    bare = msgspec.structs.replace(TENT, website=None, website_from="inferred")
    said = json.dumps({"website": "www.Outdoor.example.org", "subdomain": "Shopping"})
    found = await infer_website(Says(said), bare)
    assert (found.website, found.domain) == ("https://outdoor.example.org/", "Lifestyle & Leisure")
    given = await infer_website(Says(said), TENT)
    assert given.website == TENT.website


@pytest.mark.parametrize(
    ("website", "subdomain", "reason"),
    [
        ("https://a.example/", "Astrology", "none of the subdomains"),
        ("somewhere", "Music", "does not name a website"),
        ("", "Music", "no address"),
        ("http://127.0.0.1/", "Music", "no public website"),
        ("http://printer.local/", "Music", "no public website"),
        ("https://0x0a.1/", "Music", "no public website"),
        ("https://a.example/ (search there)", "Music", "more than the address"),
        ("https://a.example/\x1b[2J", "Music", "more than the address"),
        ("https://metadata.google.internal/", "Music", "metadata service"),
        ("ftp://a.example/", "Music", "not an http or https address"),
        ("https://a.example/" + "x" * 9_000, "Music", "more than 8,192"),
    ],
)
async def test_what_is_no_website_or_subdomain_is_asked_for_again(
    website: str, subdomain: str, reason: str
) -> None:
    bare = msgspec.structs.replace(TENT, website=None, website_from="inferred")
    bad = json.dumps({"website": website, "subdomain": subdomain})
    model = Says(bad, json.dumps({"website": "https://a.example/", "subdomain": "Music"}))
    assert (await infer_website(model, bare)).subdomain == "Music"
    assert len(model.asked) == 2
    assert reason in model.asked[1][-1]["content"]


# --- rubrics ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reply", [GOOD, f"```json\n{GOOD}\n```", f"<think>Hm.</think>\n{GOOD}"])
async def test_a_rubric_is_taken_once(reply: str) -> None:
    model = Says(reply)
    written = await write_rubric(model, TENT)
    assert [group.facts for group in written.rubric.groups] == [group.facts for group in GROUPS]
    assert written.findings == ()
    assert len(model.asked) == 1


REFUSED: list[tuple[str | Completion, str]] = [
    (GOOD[:-10], "not valid JSON"),
    (f"Here you are: {GOOD}", "not valid JSON"),
    ("", "empty"),
    ("[]", "not as asked for"),
    (rubric(), "no fact group"),
    (rubric(["The tent is for 4 people"], []), "group 2 has no facts"),
    (rubric(["The tent is for 4 people", " "]), "empty"),
    (rubric(["The tent is for 4 people"], difficulty=2), "difficulty is 2, but there are 1 facts"),
    (rubric(["The tent is the Tarn IV"]), "only the answer or the hints"),
    (rubric(["The tent costs under $150"]), "150"),
    (rubric(["Click on the tent"]), "step"),
    (rubric(["The tent is light or " * 5_000]), "has 105,000 characters; 1,000 is the limit"),
    (completion(GOOD, finish_reason="length"), "cut off"),
    (completion(GOOD, finish_reason="max_tokens"), "cut off"),
    (completion("", refusal="No."), "refusal"),
    (completion("", finish_reason="content_filter"), "refusal"),
]


@pytest.mark.parametrize(("reply", "reason"), REFUSED)
async def test_a_bad_rubric_is_refused_and_asked_for_again_with_the_reason(
    reply: str | Completion, reason: str
) -> None:
    model = Says(reply, GOOD)
    assert (await write_rubric(model, TENT)).rubric.difficulty == 4
    assert reason in model.asked[1][-1]["content"]
    assert model.asked[1][-2]["role"] == "assistant"


@pytest.mark.parametrize(("reply", "reason"), REFUSED)
async def test_asking_is_bounded_and_says_what_failed(reply: str | Completion, reason: str) -> None:
    model = Says(reply)
    with pytest.raises(LLMUnusable) as caught:
        await write_rubric(model, TENT, limits=WritingLimits(tries=2))
    assert reason in caught.value.reason
    assert len(caught.value.replies) == len(model.asked) == 2


async def test_style_is_set_right_when_it_is_read() -> None:
    written = await write_rubric(Says(rubric(["The tent is light or cheap", "It sleeps 4 or more"])), TENT)
    assert [fact for _, _, fact in written.rubric.facts()] == [
        "The tent is light OR cheap",
        "It sleeps 4 or more",
    ]
    assert written.findings == ()


async def test_remarks_do_not_refuse() -> None:
    written = await write_rubric(Says(rubric(["The tent of Tarn Ltd is for 4 people"])), TENT)
    assert {finding.rule for finding in written.findings} == {"unstated-name"}


async def test_an_inferred_website_changes_nothing_about_the_rubric() -> None:
    """Else a request would be another one once the website is known, and be paid for again."""
    before, after = (
        Says(rubric(["It is on Fieldstore, 4 people"])),
        Says(rubric(["It is on Fieldstore, 4 people"])),
    )
    bare = msgspec.structs.replace(TENT, website=None, website_from="inferred")
    placed = msgspec.structs.replace(bare, website="https://fieldstore.example/")
    first, second = await write_rubric(before, bare), await write_rubric(after, placed)
    assert (before.asked, first) == (after.asked, second)


# --- rewriting ----------------------------------------------------------------------------------------------

FINE = "Find a tent under $200 for 4 people and give its weight."


@pytest.mark.parametrize("thought", ["", "<think>Hm.</think>", "The template opened this.</think>\n"])
async def test_a_rewritten_task_is_taken(thought: str) -> None:
    model = Says(f"{thought}\n{FINE}\n")
    assert await rewrite(model, TASK, GROUPS[:1]) == FINE
    assert len(model.asked) == 1


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        ("", "empty"),
        (" \n", "empty"),
        (completion(FINE, finish_reason="length"), "cut off"),
        (completion(FINE, finish_reason="max_tokens"), "cut off"),
        (completion("", refusal="No."), "refusal"),
        ("I'm sorry, but I can't help with that.", "refusal"),
        (f"Here is the rewritten task: {FINE}", "introduction"),
        (f"Sure! {FINE}", "introduction"),
        (f"Task: {FINE}", "introduction"),
        (f'"{FINE}"', "quotation marks"),
        (f"“{FINE}”", "quotation marks"),
        (json.dumps({"task": FINE}), "JSON"),
        (f"**{FINE}**", "markdown"),
        (f"```\n{FINE}\n```", "markdown"),
        (f"# Task\n{FINE}", "markdown"),
        (f"{FINE} \x00\x1b[2J", "control characters"),
        (f"{FINE} \ud83d", "control characters"),
        (f"{FINE}\n\nNote: weight only.", "several lines"),
        (TASK.instruction, "original task"),
        (TASK.instruction.upper(), "original task"),
        ("Tent.", "too short"),
        (f"{FINE}{chr(10) * 20_000}x", "at most"),
        (FINE + " Look closely at what is there." * 20, "at most"),
        ("Find a tent under $150 for 4 people.", "150"),
        ("Find a tent for 4 people and give its weight.", "leaves out 200"),
        ("Find the tent Tarn IV, 2.1 kg, under $200, for 4 people.", "2.1"),
    ],
)
async def test_a_bad_text_is_refused_and_asked_for_again(reply: str | Completion, reason: str) -> None:
    model = Says(reply, FINE)
    assert await rewrite(model, TASK, GROUPS[:1]) == FINE
    assert reason in model.asked[1][-1]["content"]
    with pytest.raises(LLMUnusable, match=r"wrote no usable text"):
        await rewrite(Says(reply), TASK, GROUPS[:1], limits=WritingLimits(tries=2))


def test_what_only_other_facts_say_and_answers_must_be_gone() -> None:
    text = "Say how to return a tent for 4 people."
    assert "still asks for 4" in (refused_rewriting(text, TASK, GROUPS[1:]) or "")
    assert refused_rewriting("Say how the tent can be returned to the shop.", TASK, GROUPS[1:]) is None
    named = msgspec.structs.replace(TASK, reference_answer="a prepaid label")
    told = refused_rewriting("Say how to return it with a prepaid label.", named, GROUPS[1:])
    assert "answer" in (told or "")


def test_what_the_parent_has_is_allowed() -> None:
    parent = msgspec.structs.replace(
        TASK, instruction="Do both:\n- find a tent under $200\n- find its weight"
    )
    groups = (FactGroup(1, "Tent", ("The tent costs under $200",)),)
    assert refused_rewriting("Do this:\n- find a tent that costs less than $200", parent, groups) is None
    quoted = '"Dune" and "Emma": who wrote "Dune"'
    assert refused_rewriting(quoted, TASK, (FactGroup(1, "x", ("The author is found",)),)) is None


@given(st.text(min_size=1, max_size=300).filter(str.strip))
def test_any_text_is_judged_in_one_line(text: str) -> None:
    reason = refused_rewriting(text.strip(), TASK, GROUPS[:1])
    assert reason is None or "\n" not in reason


PLAN = Task(
    id="insta-v3/2",
    instruction='On Fieldstore, find a waterproof tent by Zed under $200 with the label "Light" for 4 '
    "people, and give its weight. Also find a stove by Kaito that burns gas and is rated best, and "
    "give its colour.",
    website="https://shop.example/",
    domain="Lifestyle & Leisure",
    subdomain="Shopping",
    rubric=Rubric(
        (
            FactGroup(
                1,
                "The tent",
                (
                    "The tent is waterproof",
                    "The tent is by Zed",
                    "The tent costs under $200",
                    'The tent has the label "Light"',
                    "The tent is for 4 people",
                    "The weight of the tent is given",
                ),
            ),
            FactGroup(
                2,
                "The stove",
                (
                    "The stove is by Kaito",
                    "The stove burns gas",
                    "The stove is rated best",
                    "The colour of the stove is given",
                ),
            ),
        )
    ),
    source="insta-v3",
)
TENT_ALONE = (
    'On Fieldstore, find a waterproof tent by Zed under $200 with the label "Light" for four people; '
    "give its weight."
)


@pytest.mark.parametrize(
    ("text", "group", "reason"),
    [
        (TENT_ALONE, 1, None),
        (
            "On Fieldstore, find a gas stove by Kaito that burns well and is rated best; give its colour.",
            2,
            None,
        ),
        (f"{TENT_ALONE} It goes with a stove by Kaito.", 1, "still asks for Kaito"),
        (
            f"{TENT_ALONE} Name a stove that burns gas, too.",
            1,
            "still asks for what was not given: 'The stove burns",
        ),
        (f"{TENT_ALONE} Also give the colour.", 1, "still asks for what was not given: 'The colour"),
        (
            'Find a "Light" stove by Kaito that burns gas and is rated best, with its colour.',
            2,
            "still asks for Light",
        ),
        (
            "Find a waterproof stove by Kaito that burns gas and is rated best, with its colour.",
            2,
            "The tent is water",
        ),
        (TENT_ALONE.replace(" by Zed", ""), 1, "leaves out Zed"),
        (TENT_ALONE.replace("under $200 ", ""), 1, "leaves out 200"),
        (TENT_ALONE.replace('with the label "Light" ', ""), 1, "leaves out Light"),
        (
            TENT_ALONE.replace("waterproof ", ""),
            1,
            "leaves out what this fact asks for: 'The tent is waterproof'",
        ),
        (TENT_ALONE.replace("; give its weight", ""), 1, "leaves out what this fact asks for: 'The weight"),
        ("On Fieldstore, find a stove by Kaito that is rated best.", 2, "leaves out what this fact asks for"),
    ],
)
def test_a_derived_task_asks_for_all_of_its_groups_and_nothing_of_the_others(
    text: str, group: int, reason: str | None
) -> None:
    told = refused_rewriting(text, PLAN, PLAN.rubric.groups[group - 1 : group])
    assert told is None if reason is None else reason in (told or "")


FORM = re.compile(r" (?:Answer with|As the answer|The answer is|When that is done)\b")
"""Where an instruction of the offline web goes on to ask for the form of its answer, as no rewriter does."""


def test_the_offline_webs_derived_tasks_are_taken_for_their_own_groups_and_for_no_others() -> None:
    tasks = [
        msgspec.structs.replace(task, instruction=FORM.split(task.instruction)[0])
        for task in OfflineWeb(seed=7, per_family=1).tasks()
    ]
    parents = {task.id: task for task in tasks if task.parent_id is None}
    derived = [task for task in tasks if task.parent_id is not None]
    own = [
        refused_rewriting(task.instruction, parents[task.parent_id or ""], task.rubric.groups)
        for task in derived
    ]
    assert sum(map(bool, own)) <= 0.03 * len(own)
    siblings = [
        (one, other)
        for one, other in pairwise(derived)
        if one.parent_id == other.parent_id and one.rubric != other.rubric
    ]
    assert len(siblings) > 50
    for one, other in siblings:
        assert refused_rewriting(one.instruction, parents[one.parent_id or ""], other.rubric.groups), one.id


# --- over a real endpoint -----------------------------------------------------------------------------------


async def test_a_misbehaving_endpoint_is_asked_until_it_does_well(tmp_path: Path) -> None:
    tasks = [
        SourceTask(
            id=f"s/{n}",
            source="insta-v3",
            instruction=f"Find red kettle model {n} with steel handle, green lid",
        )
        for n in range(30, 70)
    ]
    async with serve() as endpoint:
        endpoint.stubborn = False
        async with ChatClient(config(endpoint)) as client:
            written = await asyncio.gather(*(write_rubric(client, task) for task in tasks))
            places = await asyncio.gather(*(infer_website(client, task) for task in tasks))
    assert all(check.rubric.difficulty for check in written)
    assert {place.domain for place in places} <= set(DOMAINS)
    assert endpoint.kinds["rubric"] > len(tasks) + 10
    assert endpoint.kinds["website"] > len(tasks)


def config(endpoint: Endpoint) -> ChatConfig:
    return ChatConfig(
        base_url=endpoint.url, model="by-rule", retry=Retry(tries=3, first_seconds=0.01, longest_seconds=0.02)
    )
