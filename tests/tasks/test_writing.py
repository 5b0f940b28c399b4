"""What models write for a task set: what is taken, what is refused, and how they are asked again."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Sequence
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
from webgym.tasks.sources import SourceTask
from webgym.tasks.taxonomy import DOMAIN_OF, DOMAINS
from webgym.taskset import prompts
from webgym.taskset.writing import infer_website, rewrite, rubric_problem, text_problem, write_rubric

TENT = SourceTask(
    id="insta-v3/1",
    source="insta-v3",
    instruction="Find a tent under $200 for 4 people, and give its weight. Also say how to return it.",
    website="https://tents.example.com/",
    website_from="given",
    hints=("Click 'Shelters'.", "The tent is the Tarn IV at $189.95."),
    example_answer="Tarn Shelter",
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
    reference_answer="Tarn Ltd",
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
    task = msgspec.structs.replace(TENT, instruction=prompts.EXAMPLE_TASK)
    assert rubric_problem(reply, task) is None
    assert msgspec.json.encode(reply).decode() in prompts.for_rubric(TENT)[0]["content"]


REPLY = prompts.EXAMPLE_RUBRIC
WRITER = {"rubric": prompts.for_rubric(TENT), "rewriting": prompts.for_rewriting(TASK, GROUPS[:1])}
CRITIC = {
    "rubric": prompts.for_rubric_critic(TENT, REPLY),
    "rewriting": prompts.for_rewriting_critic(TASK, GROUPS[:1], "Find a tent."),
}


@pytest.mark.parametrize(
    ("of", "rule"),
    [
        ("rubric", "One fact is one piece of information that can be verified by itself"),
        ("rubric", "A fact is as detailed as the task, and no more"),
        ("rubric", "Write nothing that the task does not state"),
        ("rubric", "A computation is one fact, its result"),
        ("rubric", "asks for instructions, and that is one fact"),
        ("rubric", "Never one fact per step"),
        ("rubric", "Alternatives stay together in one fact, joined by OR in capitals"),
        ("rubric", '"contact details" is one fact'),
        ("rubric", 'Examples in the task ("such as", "e.g.") are not asked for'),
        ("rubric", "No fact twice in other words"),
        ("rubric", "nothing may be taken from them that the task itself does not say"),
        ("rewriting", "Keep the website, the setting and the subject of the original"),
        ("rewriting", "Take what is asked for from the given facts alone"),
        ("rewriting", "give no answer away"),
    ],
)
def test_writer_and_critic_have_every_rule_that_takes_understanding(of: str, rule: str) -> None:
    for messages in (WRITER[of], CRITIC[of]):
        assert rule in " ".join(messages[0]["content"].split())


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
    assert "Tarn Ltd" not in told
    assert "Shelters" in CRITIC["rubric"][1]["content"]
    assert "tulips OR roses" in CRITIC["rubric"][1]["content"]
    assert "Instructions for returning" in CRITIC["rewriting"][1]["content"], "what it must not ask for"


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
    assert [group.facts for group in written.groups] == [group.facts for group in GROUPS]
    assert len(model.asked) == 1


REFUSED: list[tuple[str | Completion, str]] = [
    (GOOD[:-10], "not valid JSON"),
    (f"Here you are: {GOOD}", "not valid JSON"),
    ("", "empty"),
    ("[]", "not as asked for"),
    (rubric(), "no fact group"),
    (rubric(["The tent is for 4 people"], []), "group 2 has no facts"),
    (rubric(["The tent is for 4 people", " "]), "fact 2 of group 1 is empty"),
    (rubric(["The tent is for 4 people", "None"]), "fact 2 of group 1 is empty"),
    (rubric(["The tent is for 4 people"], difficulty=2), "difficulty is 2, but there are 1 facts"),
    (rubric(["It is for 4"]).replace("a part", ""), "group 1 has no description"),
    (rubric(["It is for 4"]).replace('"id": 1', '"id": 2'), "the ids 2 instead of 1 to 1"),
    (
        rubric(["It is for 4"], ["It costs $200"]).replace('"id": 2', '"id": 1'),
        "the ids 1, 1 instead of 1 to 2",
    ),
    (rubric(["The tent is for 4 people", "the tent is for 4 people."]), "group 1 has a fact twice"),
    (
        rubric(["It is for 4", "It is light"], ["It is for 4.", "It is light"]),
        "group 2 repeats another group",
    ),
    (rubric(["The tent is light", "OR the tent is cheap"]), "fact 2 of group 1 begins or ends with OR"),
    (rubric(["The tent is light OR", "The tent is cheap"]), "fact 1 of group 1 begins or ends with OR"),
    (rubric(["The tent costs under $150"]), "a number that the task does not state: 150"),
    (rubric(["The tent costs $189.95"]), "a number that the task does not state: 18995"),
    (rubric(["The tent is the Tarn Shelter"]), "has the answer"),
    (rubric([f"The tent is light {n * ' '}{chr(97 + n)}" for n in range(26)] * 3), "there are 78 facts; 60"),
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
    assert (await write_rubric(model, TENT)).difficulty == 4
    assert reason in model.asked[1][-1]["content"]
    assert model.asked[1][-2]["role"] == "assistant"


@pytest.mark.parametrize(("reply", "reason"), REFUSED)
async def test_asking_is_bounded_and_says_what_failed(reply: str | Completion, reason: str) -> None:
    model = Says(reply)
    with pytest.raises(LLMUnusable) as caught:
        await write_rubric(model, TENT, tries=2)
    assert reason in caught.value.reason
    assert len(caught.value.replies) == len(model.asked) == 2


@pytest.mark.parametrize(
    "groups",
    [
        [["It is light OR cheap", "It sleeps 4 or more"], ["Say it and say it again, and click here"]],
        [["Step 1: open the tent in Portland, OR", "Then close it"], ["The tent is for four"]],
        [["Es kostet höchstens 200 $"], ["Il est pour quatre personnes"], ["重さが示されている"]],
        [["The price is given"], ["The price is given", "The maker is given"]],
    ],
)
async def test_no_rubric_is_refused_for_its_wording(groups: list[list[str]]) -> None:
    written = await write_rubric(Says(rubric(*groups)), TENT)
    assert [list(group.facts) for group in written.groups] == groups


OK = json.dumps({"ok": True, "problems": []})
BAD = json.dumps({"ok": False, "problems": ["Fact 1 is a step.", "Fact 2 is an example."]})


async def test_what_the_critic_says_is_the_reason_to_ask_the_writer_again() -> None:
    writer, critic = Says(rubric(["Click here", "A dome tent"]), GOOD), Says(BAD, OK)
    assert (await write_rubric(writer, TENT, critic=critic)).difficulty == 4
    assert "Fact 1 is a step.; Fact 2 is an example." in writer.asked[1][-1]["content"]
    assert ["Click here" in asked[1]["content"] for asked in critic.asked] == [True, False]
    writer, critic = Says(f"Here you are: {FINE}", FINE), Says(BAD, OK)
    assert await rewrite(writer, TASK, GROUPS[:1], critic=critic) == FINE
    assert "Fact 1 is a step." in writer.asked[1][-1]["content"]


async def test_what_is_refused_by_structure_is_not_shown_to_the_critic() -> None:
    critic = Says(OK)
    await write_rubric(Says(rubric(), GOOD), TENT, critic=critic)
    await rewrite(Says("Tent.", FINE), TASK, GROUPS[:1], critic=critic)
    assert len(critic.asked) == 2


@pytest.mark.parametrize(
    "verdict", ["yes", '{"ok": true, "problems": ["x"]}', '{"ok": false, "problems": []}']
)
async def test_a_critic_without_a_clear_verdict_is_asked_again_and_accepts_nothing(verdict: str) -> None:
    critic = Says(verdict, OK)
    assert (await write_rubric(Says(GOOD), TENT, critic=critic)).difficulty == 4
    assert len(critic.asked) == 2
    with pytest.raises(LLMUnusable):
        await write_rubric(Says(GOOD), TENT, critic=Says(verdict))
    with pytest.raises(LLMUnusable, match="Fact 1 is a step"):
        await write_rubric(Says(GOOD), TENT, critic=Says(BAD))


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
        ("Find a tent under $200 for 4 people: Tarn IV, 2.1 kg.", "it states 21"),
        ("Find the tent under $200 for 4 people by Tarn Ltd.", "gives the answer away"),
    ],
)
async def test_a_bad_text_is_refused_and_asked_for_again(reply: str | Completion, reason: str) -> None:
    model = Says(reply, FINE)
    assert await rewrite(model, TASK, GROUPS[:1]) == FINE
    assert reason in model.asked[1][-1]["content"]
    with pytest.raises(LLMUnusable, match=r"gave no usable reply"):
        await rewrite(Says(reply), TASK, GROUPS[:1], tries=2)


def test_what_the_parent_has_is_allowed() -> None:
    parent = msgspec.structs.replace(
        TASK, instruction="Do both:\n- find a tent under $200\n- find its weight"
    )
    groups = (FactGroup(1, "Tent", ("The tent costs under $200",)),)
    assert text_problem("Do this:\n- find a tent that costs less than $200", parent, groups) is None
    quoted = '"Dune" and "Emma": who wrote "Dune"'
    assert text_problem(quoted, TASK, (FactGroup(1, "x", ("The author is found",)),)) is None
    named = msgspec.structs.replace(TASK, instruction="Is the Tarn Ltd tent light, and cheap?")
    assert text_problem("Is the Tarn Ltd tent light?", named, groups) is None


@given(st.text(min_size=1, max_size=300).filter(str.strip))
def test_any_text_is_judged_in_one_line(text: str) -> None:
    reason = text_problem(text.strip(), TASK, GROUPS[:1])
    assert reason is None or "\n" not in reason


FORM = re.compile(r" (?:Answer with|As the answer|The answer is|When that is done)\b")
"""Where an instruction of the offline web goes on to ask for the form of its answer, as no rewriter does."""


def test_rubrics_and_derived_tasks_of_the_offline_web_are_accepted() -> None:
    tasks = [
        msgspec.structs.replace(task, instruction=FORM.split(task.instruction)[0])
        for task in OfflineWeb(seed=7, per_family=1).tasks()
    ]
    parents = {task.id: task for task in tasks if task.parent_id is None}
    for task in tasks:
        if task.parent_id is None:
            groups = tuple(
                prompts.GroupReply(each.id, each.description, each.facts) for each in task.rubric.groups
            )
            asked = SourceTask(task.id, task.source, task.instruction, task.website, "given")
            assert rubric_problem(prompts.RubricReply(groups, task.difficulty), asked) is None
        else:
            assert text_problem(task.instruction, parents[task.parent_id], task.rubric.groups) is None


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
    assert all(each.difficulty for each in written)
    assert {place.domain for place in places} <= set(DOMAINS)
    assert endpoint.kinds["rubric"] > len(tasks) + 10
    assert endpoint.kinds["website"] > len(tasks)


def config(endpoint: Endpoint) -> ChatConfig:
    return ChatConfig(
        base_url=endpoint.url, model="by-rule", retry=Retry(tries=3, first_seconds=0.01, longest_seconds=0.02)
    )
