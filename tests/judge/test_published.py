"""The judges of published benchmarks: what they ask, what counts as a reply, and that no fault is a 0."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from tests.judge.judge_model import Asked, serve_judge
from tests.judge.scenes import TASK, episode, look, pictures, reads

from webgym.core.errors import JudgeError
from webgym.core.task import WHOLE_TASK, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Verdict
from webgym.judge.config import JudgeChoice
from webgym.judge.factory import name_of, open_judge
from webgym.judge.published import read_outcome, read_points, read_score, read_success
from webgym.judge.verdicts import NoVerdict

REAL = Path(__file__).resolve().parents[3] / "shared/data/judge-labels/webjudge_replies_o4_mini.jsonl"
SHOP = replace(TASK, rubric=WHOLE_TASK)


def webjudge(
    outcome: str = "success", score: Callable[[str], int] = lambda name: 4
) -> Callable[[Asked], str]:
    """A model that lists a point, scores pictures and decides."""

    def answers(asked: Asked) -> str:
        if "actions" in asked.quotes:
            return f'Thoughts: looked at all of step 2.\nStatus: "{outcome}"'
        if asked.shots:
            return f"**Reasoning**: saw it\n**Score**: {score(asked.shots[0][1])}"
        return "**Key Points**:\n1. Blue Mug\n2. its price"

    return answers


async def judged(
    name: str, answers: Callable[[Asked], str], made: Episode, task: Task = SHOP, **choice: Any
) -> tuple[Verdict, list[Asked]]:
    async with serve_judge(answers) as model:
        chosen = JudgeChoice(name=name, rubric=model.config(), **choice)
        async with open_judge(chosen) as judge:
            verdict = await judge.judge(task, made, pictures)
            assert verdict.judge == judge.name == name_of(chosen)
        return verdict, model.asked


async def test_webjudge_lists_points_scores_screenshots_and_decides() -> None:
    made = episode(["front", "mug $12.50", "front", "cart"])
    low = look("front").screenshot
    verdict, asked = await judged("webjudge", webjudge(score=lambda name: 2 if name == low else 3), made)
    points, *scores, outcome = asked
    assert points.quotes == {"task": TASK.instruction}
    assert len(scores) == 3  # the front page was seen twice
    assert {tuple(each.quotes) for each in scores} == {("task", "points")}
    assert scores[0].quotes["points"] == "1. Blue Mug\n2. its price"
    assert [label for label, _ in outcome.shots] == ["step 2", "step 4"]
    assert outcome.quotes["notes"] == "step 2: saw it\nstep 4: saw it"
    assert "12.50" not in outcome.quotes["actions"]  # the answer is not shown, which may claim anything
    assert "answer" not in outcome.quotes
    assert (verdict.reward, verdict.keypoints) == (1, (1, 3))
    assert verdict.response is not None
    assert verdict.response.reason == "Thoughts: looked at all of step 2."
    assert verdict.response.steps == (1,)
    assert verdict.cost is not None
    assert verdict.cost.calls == 5
    assert verdict.judge.startswith("webjudge/1 judge-1@")
    assert len(verdict.prompts) == 64


async def test_webjudge_shows_the_first_fifty_and_decides_without_any() -> None:
    long = episode([f"page {number}" for number in range(53)])
    verdict, asked = await judged("webjudge", webjudge("failure"), long)
    assert [label for label, _ in asked[-1].shots] == [f"step {number}" for number in range(1, 51)]
    assert verdict.reward == 0
    verdict, asked = await judged("webjudge", webjudge(score=lambda name: 1), episode(["a", "b"]))
    assert not asked[-1].shots
    assert "notes" not in asked[-1].quotes
    assert (verdict.reward, verdict.keypoints) == (1, ())


@pytest.mark.parametrize(
    ("of", "bad"),
    [
        ("points", ""),
        ("score", "**Reasoning**: nice\n**Score**: 7"),
        ("score", "**Reasoning**: nice"),
        ("outcome", "Thoughts: fine.\nStatus: done"),
        ("outcome", "Status: success\nStatus: failure"),
    ],
)
async def test_a_reply_without_a_verdict_is_asked_for_again_and_never_a_0(of: str, bad: str) -> None:
    good, bads = webjudge(), 0

    def answers(asked: Asked) -> str:
        nonlocal bads
        kind = "outcome" if "actions" in asked.quotes else "score" if asked.shots else "points"
        if kind != of or bads >= most:
            return good(asked)
        bads += 1
        return bad

    most = 1
    verdict, asked = await judged("webjudge", answers, episode(["a"]))
    assert verdict.reward == 1
    assert len(asked) == 4
    bads, most = 0, 99
    with pytest.raises(JudgeError, match="no clear verdict in 3 replies"):
        await judged("webjudge", answers, episode(["a"]))


async def test_webvoyagers_judge_sees_the_answer_and_the_last_fifteen_screenshots() -> None:
    made = episode([f"page {number}" for number in range(20)])
    verdict, (asked,) = await judged("webvoyager", lambda asked: "It is on step 20.\nSUCCESS", made)
    assert asked.quotes == {"task": TASK.instruction, "answer": "The Blue Mug costs $12.50."}
    assert [label for label, _ in asked.shots] == [f"step {number}" for number in range(6, 21)]
    assert asked.body["temperature"] == 0
    assert (verdict.reward, verdict.response and verdict.response.steps) == (1, (19,))
    verdict, _ = await judged("webvoyager", lambda asked: "The price is wrong.\n\nVerdict: NOT SUCCESS", made)
    assert verdict.reward == 0
    with pytest.raises(JudgeError, match="no clear verdict"):
        await judged("webvoyager", lambda asked: "I cannot say.", made)
    wrong = replace(SHOP, reference_answer="$99")  # of the benchmark's file: this judge does not use it
    verdict, _ = await judged("webvoyager", lambda asked: "SUCCESS", made, wrong)
    assert verdict.reward == 1


async def test_deepshops_judge_asks_of_every_requirement() -> None:
    def answers(asked: Asked) -> str:
        return "NOT SUCCESS" if asked.quotes["task"] == "Its price is found" else "SUCCESS"

    verdict, asked = await judged("deepshop", answers, episode(), TASK)
    assert sorted(each.quotes["task"] for each in asked) == sorted(text for *_, text in TASK.rubric.facts())
    assert [fact.judgement.passed for fact in verdict.facts] == [True, False, True]
    assert verdict.reward == 0
    assert verdict.score == pytest.approx(2 / 3)
    verdict, _ = await judged("deepshop", lambda asked: "SUCCESS", episode(), TASK)
    assert verdict.reward == 1
    verdict, (asked_once,) = await judged("deepshop", lambda asked: "SUCCESS", episode(), SHOP)
    assert asked_once.quotes["task"] == TASK.instruction


@pytest.mark.parametrize("name", ["webjudge", "webvoyager", "deepshop"])
async def test_without_an_answer_nothing_is_asked_and_a_refusing_website_is_blocked(name: str) -> None:
    verdict, asked = await judged(name, webjudge(), episode(answer=None), TASK)
    assert (verdict.reward, asked) == (0, [])
    refusals = [look(f"refused {number}", status=403, title="403") for number in range(2)]
    made = episode(refusals, answer=None)
    first = replace(made.steps[0], action=None)
    verdict, _ = await judged(name, webjudge(), replace(made, steps=(first, *made.steps[1:])), TASK)
    assert verdict.blocked.passed == (verdict.reward is None)


async def test_a_panel_of_webjudges() -> None:
    verdict, asked = await judged("webjudge", webjudge(), episode(["a"]), panel={"samples": 3})
    assert (verdict.reward, verdict.confidence) == (1, 1.0)
    assert len(asked) == 9
    assert verdict.judge.startswith("panel of 3 at 0.7: webjudge/1")
    assert len(verdict.prompts) == 64


@pytest.mark.parametrize(
    ("reply", "passed"),
    [
        ("SUCCESS", True),
        ("NOT SUCCESS", False),
        ("It was done.\nOverall Verdict: SUCCESS", True),
        ("It was done.\n\n**Verdict:** **NOT SUCCESS**.", False),
        ("All is there. SUCCESS", True),
        ("Either SUCCESS or NOT SUCCESS", None),
        ("This cannot be called a\nSUCCESS", None),
        ("It is no SUCCESS", None),
        ("The page says:\n> SUCCESS", None),
        ("SUCCESS\nNOT SUCCESS", None),
        ("", None),
    ],
)
def test_verdicts_of_webvoyagers_judge(reply: str, passed: bool | None) -> None:
    found = reads(read_success, reply)
    assert (None if isinstance(found, NoVerdict) else found.passed) is passed


@pytest.mark.parametrize("ending", [{"finish_reason": "length"}, {"refusal": "I will not."}])
def test_replies_that_the_model_did_not_end(ending: dict[str, str]) -> None:
    replies: dict[Callable[..., object], str] = {
        read_success: "SUCCESS",
        read_outcome: "Status: success",
        read_score: "Score: 4",
        read_points: "1. a mug",
    }
    for read, reply in replies.items():
        assert not isinstance(reads(read, reply), NoVerdict)
        assert isinstance(reads(read, reply, **ending), NoVerdict)


@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL} is not there")
def test_the_scores_of_the_real_replies() -> None:
    records = [json.loads(line) for line in REAL.read_text().splitlines()]
    looks = [look for record in records for look in record["image_judge_record"]]
    assert len(looks) == 8099
    unread = 0
    for each in looks:
        found = reads(read_score, each["Response"] or "")
        unread += isinstance(found, NoVerdict)
        # The study's reader gave a 0 to what it could not read, of which this one reads some.
        assert each["Score"] == 0 or (not isinstance(found, NoVerdict) and found.digit == each["Score"])
    assert unread == 40
