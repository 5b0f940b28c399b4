"""The offline judge: what passes, what does not, and what has no verdict."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from webgym.core.action import Navigate
from webgym.core.errors import JudgeError
from webgym.core.observation import Observation
from webgym.core.outcome import Ending
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode, Reply, Step
from webgym.core.truth import AnswerTruth, Evidence, FactTruth, Give, StateCheck, Truth
from webgym.core.verdict import Verdict
from webgym.judge.offline import OfflineJudge

HOST = "fernhill-mugs.webgym.test"

TASK = Task(
    id="offline/fernhill-mugs/price",
    instruction="Find the price of the Blue Mug and put one into the cart.",
    website=f"http://{HOST}/",
    domain="Lifestyle & Leisure",
    subdomain="Shopping",
    rubric=Rubric((FactGroup(1, "The Blue Mug", ("the price is found", "one is in the cart")),)),
    source="offline",
    reference_answer="$12.50",
    truth=Truth(
        host=HOST,
        facts=(
            FactTruth(1, 0, evidence=(Evidence(("Blue Mug", "$12.50"), r"/p/"),)),
            FactTruth(1, 1, state=(StateCheck(("cart", "Blue Mug"), 1),)),
        ),
        answer=AnswerTruth(required=(("$12.50", "12.50 dollars"),), others=("$9.00",)),
        moves=(Give("$12.50"),),
    ),
)

FRONT = Observation(
    "a" * 64, f"http://{HOST}/", "Mugs", (1280, 768), status=200, text="Welcome. Red Mug $9.00"
)
PRODUCT = Observation(
    "b" * 64,
    f"http://{HOST}/p/1",
    "Blue Mug",
    (1280, 768),
    status=200,
    text="Blue Mug\nPrice $12.50\nRated 4.7",
)
CHALLENGE = Observation(
    "c" * 64, f"http://{HOST}/", "Just a moment", (1280, 768), status=403, text="Verify you are human"
)
RIGHT = "$12.50"
CART = {"cart": {"Blue Mug": 1}}
OTHER_STATES: list[dict[str, Any]] = [{}, {"cart": {}}, {"cart": {"Blue Mug": 2}}, {"cart": "Blue Mug"}]


def episode(*seen: Observation, answer: str | None = RIGHT, state: dict[str, Any] | None = CART) -> Episode:
    steps = tuple(Step(i, observation, (), Reply("…", "test")) for i, observation in enumerate(seen))
    ending = Ending.BUDGET_SPENT if answer is None else Ending.ANSWERED
    return Episode(
        "x#0.0", TASK.id, 0, 0, 1, "test", 0.0, 1.0, steps, ending, answer=answer, final_state=state
    )


async def judged(of: Episode, task: Task = TASK) -> Verdict:
    async def pictures(name: str) -> bytes:
        raise AssertionError(f"the offline judge asked for {name}")

    return await OfflineJudge().judge(task, of, pictures)


async def test_everything_shown_done_and_said_is_a_success() -> None:
    verdict = await judged(episode(FRONT, PRODUCT))
    assert verdict.reward == 1
    assert [fact.judgement.passed for fact in verdict.facts] == [True, True]
    assert verdict.facts[0].judgement.steps == (1,)


async def test_a_failure_says_what_was_wrong() -> None:
    """The answer's fault comes first: a model that answers in sentences is seen to do so."""
    made = {
        None: episode(FRONT, PRODUCT),
        "form": episode(FRONT, PRODUCT, answer="The Blue Mug costs $12.50."),
        "wrong value": episode(FRONT, PRODUCT, answer="$9.00"),
        "no evidence": episode(FRONT),
        "state": episode(FRONT, PRODUCT, state={}),
    }
    assert {fault: (await judged(each)).fault for fault, each in made.items()} == {
        each: each for each in made
    }
    assert (await judged(episode(FRONT, answer="I could not find it.", state={}))).fault == "form"
    assert (await judged(episode(FRONT, answer=None, state={}))).fault is None


async def test_evidence_of_another_website_counts_there_alone() -> None:
    assert TASK.truth is not None
    other = f"other.{HOST}"
    change = msgspec.structs.replace
    facts = tuple(
        change(fact, evidence=tuple(change(view, host=other) for view in fact.evidence))
        for fact in TASK.truth.facts
    )
    task = change(TASK, truth=change(TASK.truth, facts=facts))
    there = change(PRODUCT, url=PRODUCT.url.replace(HOST, other))
    assert (await judged(episode(FRONT, PRODUCT), task)).reward == 0
    assert (await judged(episode(FRONT, there), task)).reward == 1
    assert (await judged(episode(FRONT, there))).reward == 0


async def test_a_right_answer_without_the_evidence_fails() -> None:
    verdict = await judged(episode(FRONT))
    assert verdict.reward == 0
    assert verdict.reference is not None
    assert verdict.reference.passed
    assert not verdict.facts[0].judgement.passed


def product(**changes: Any) -> Observation:
    return msgspec.structs.replace(PRODUCT, **changes)


@pytest.mark.parametrize(
    "made",
    [
        episode(answer=None, state={}),
        episode(state=CART),
        # On another website or path, in fields, in several screenshots, on a page that is not there.
        episode(product(url="http://other.webgym.test/p/1"), product(url=f"http://{HOST}/list")),
        episode(FRONT, product(text="Blue Mug", fields=("Blue Mug", "$12.50 and 381 pieces"))),
        episode(product(text="Blue Mug"), product(text="Price $12.50")),
        episode(FRONT, product(status=404)),
        # The server holds something else.
        *(episode(FRONT, PRODUCT, state=state) for state in OTHER_STATES),
        episode(FRONT, PRODUCT, answer=None),  # after the budget
    ],
)
async def test_what_proves_nothing(made: Episode) -> None:
    assert (await judged(made)).reward == 0


@pytest.mark.parametrize(
    ("others", "reward"), [({}, 1), ({"saved": {}}, 1), ({"saved": {"Red Mug": True}}, 0)]
)
async def test_what_must_be_empty_may_be_absent(others: dict[str, Any], reward: int) -> None:
    assert TASK.truth is not None
    shown, done = TASK.truth.facts
    alone = msgspec.structs.replace(done, state=(*done.state, StateCheck(("saved",), None)))
    task = msgspec.structs.replace(TASK, truth=msgspec.structs.replace(TASK.truth, facts=(shown, alone)))
    assert (await judged(episode(FRONT, PRODUCT, state=CART | others), task)).reward == reward


def asked_twice(seen: Observation, **more: Any) -> Episode:
    """An attempt that opened the front page again."""
    made = episode(seen, seen, **more)
    again = msgspec.structs.replace(made.steps[0], action=Navigate(TASK.website))
    return msgspec.structs.replace(made, steps=(again, *made.steps[1:]))


async def test_a_challenge_that_stays_is_blocking_and_one_met_on_the_way_is_not() -> None:
    verdict = await judged(asked_twice(CHALLENGE, answer="I was blocked."))
    assert verdict.blocked.passed
    assert verdict.reward is None
    for made in (episode(FRONT, CHALLENGE), episode(CHALLENGE, FRONT), episode(CHALLENGE, CHALLENGE)):
        assert (await judged(made)).reward == 0


@pytest.mark.parametrize(
    ("status", "text"), [(404, "Page not found"), (200, "No results"), (500, "Oops"), (200, "About captchas")]
)
async def test_other_trouble_is_not_blocking(status: int, text: str) -> None:
    seen = msgspec.structs.replace(FRONT, status=status, text=text)
    verdict = await judged(asked_twice(seen, answer="nothing"))
    assert not verdict.blocked.passed
    assert verdict.reward == 0


async def test_a_refusal_that_persists_is_blocking() -> None:
    seen = msgspec.structs.replace(FRONT, status=403, text="Forbidden")
    assert (await judged(asked_twice(seen, answer="nothing"))).blocked.passed
    assert not (await judged(episode(seen, answer="nothing"))).blocked.passed


async def test_no_verdict_without_what_it_needs() -> None:
    with pytest.raises(JudgeError, match="state"):
        await judged(episode(FRONT, PRODUCT, state=None))
    with pytest.raises(JudgeError, match="visible text"):
        await judged(episode(msgspec.structs.replace(FRONT, text=None)))
    with pytest.raises(JudgeError, match="no hidden truth"):
        await judged(episode(FRONT), msgspec.structs.replace(TASK, truth=None))
    assert TASK.truth is not None
    gap = msgspec.structs.replace(TASK.truth, facts=TASK.truth.facts[:1])
    with pytest.raises(JudgeError, match=r"fact 1\.1"):
        await judged(episode(FRONT, PRODUCT), msgspec.structs.replace(TASK, truth=gap))


@pytest.mark.parametrize(
    ("answer", "seen"), [(None, (FRONT,)), ("Done.", (FRONT,)), (RIGHT, (FRONT, PRODUCT))]
)
async def test_a_state_that_the_server_lost_is_no_failure_whatever_else_is(
    answer: str | None, seen: tuple[Observation, ...]
) -> None:
    """Pages that come after a restart lack what was done before it, and the agent goes astray."""
    with pytest.raises(JudgeError, match="state"):
        await judged(episode(*seen, answer=answer, state=None))


@pytest.mark.parametrize("answer", [None, "Done.", RIGHT])
async def test_a_website_that_the_agent_never_opened_has_no_state_to_lose(answer: str | None) -> None:
    """Its task begins on another one: the agent could spare itself the failure."""
    assert TASK.truth is not None
    other = "other.webgym.test"
    shown, done = TASK.truth.facts
    there = msgspec.structs.replace(shown, evidence=(Evidence(("Blue Mug", "$12.50"), host=other),))
    task = msgspec.structs.replace(TASK, truth=msgspec.structs.replace(TASK.truth, facts=(there, done)))
    product = msgspec.structs.replace(PRODUCT, url=f"http://{other}/p/1")
    assert (await judged(episode(product, answer=answer, state=None), task)).reward == 0
