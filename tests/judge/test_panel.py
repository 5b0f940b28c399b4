"""Several judges at once, and judges that are any function."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest
from tests.judge.judge_model import Asked, serve_judge
from tests.judge.scenes import TASK, episode, look, opened_twice, pictures

from webgym.core.errors import ConfigError, JudgeError
from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Cost, FactJudgement, Judgement, Verdict
from webgym.judge.base import Pictures, score_of
from webgym.judge.config import JudgeChoice, PanelConfig
from webgym.judge.factory import FunctionJudge, load_judge, name_of, open_judge
from webgym.judge.offline import OfflineJudge
from webgym.judge.panel import Panel

NOT_BLOCKED = Judgement(False, "no")


def says(*passed: bool, reward: int | None = None, answer: bool = True) -> Verdict:
    """A verdict with these facts."""
    facts = tuple(
        FactJudgement(group.id, index, text, Judgement(fact, f"{fact}", (1,)))
        for (group, index, text), fact in zip(TASK.rubric.facts(), passed, strict=False)
    )
    reward = int(all(passed) and answer) if reward is None else reward
    return Verdict(
        "m", reward, facts, NOT_BLOCKED, Judgement(answer, "as said"), cost=Cost(calls=2, prompt_tokens=5)
    )


class Fixed:
    def __init__(self, found: Verdict | JudgeError, name: str = "fixed") -> None:
        self.found = found
        self.name = name

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        await asyncio.sleep(0)
        if isinstance(self.found, JudgeError):
            raise self.found
        return self.found


async def ask(*found: Verdict | JudgeError) -> Verdict:
    return await Panel([Fixed(each) for each in found]).judge(TASK, episode(), pictures)


async def test_the_majority_decides_and_says_how_large_it_is() -> None:
    verdict = await ask(says(True, True, True), says(True, False, True), says(True, True, True))
    assert verdict.reward == 1
    assert verdict.confidence == pytest.approx(2 / 3)
    assert verdict.score == 1
    assert verdict.facts[1].judgement.reason == "True (2 of 3)"
    assert verdict.cost == Cost(calls=6, prompt_tokens=15)
    verdict = await ask(says(False, True, True), says(True, False, True), says(True, True, True))
    assert verdict.reward == 0
    assert verdict.confidence == pytest.approx(2 / 3)
    assert verdict.score == 1  # each fact has a majority of its own


async def test_without_a_majority_of_all_there_is_no_verdict() -> None:
    yes, no = says(True, True, True), says(False, True, True)
    for found in ((yes, no), (yes, JudgeError("x")), (yes, yes, JudgeError("x"), JudgeError("y"))):
        with pytest.raises(JudgeError, match="no majority"):
            await ask(*found)
    with pytest.raises(JudgeError, match="3 had no verdict: x"):
        await ask(JudgeError("x"), JudgeError("y"), JudgeError("z"))
    assert (await ask(yes, yes, JudgeError("x"))).confidence == pytest.approx(2 / 3)
    assert (await ask(no)).confidence == 1
    with pytest.raises(ValueError, match="member"):
        Panel([])


async def test_a_blocked_attempt_needs_a_majority_too() -> None:
    blocked = Verdict("m", None, (), Judgement(True, "a challenge"))
    verdict = await ask(blocked, blocked, says(True, True, True))
    assert verdict.reward is None
    assert verdict.blocked.passed


async def test_samples_of_the_rubric_judge_draw_replies_of_their_own() -> None:
    def answers(asked: Asked) -> str:
        if asked.stage == "keypoint":
            return asked.each(lambda name: True)
        lenient = asked.body["seed"] != 1 or asked.stage != "fact"
        return asked.verdict(lenient if asked.stage != "blocking" else False)

    async with serve_judge(answers) as model:
        choice = JudgeChoice(
            name="rubric", rubric=model.config(), panel=PanelConfig(samples=3, temperature=0.9)
        )
        async with open_judge(choice) as judge:
            assert judge.name == name_of(choice)
            verdict = await judge.judge(TASK, episode(), pictures)
    assert judge.name.startswith("panel of 3 at 0.9: rubric/4 judge-1@")
    assert verdict.judge == judge.name
    assert verdict.reward == 1
    assert verdict.confidence == pytest.approx(2 / 3)
    assert {asked.body["seed"] for asked in model.asked} == {0, 1, 2}
    assert {asked.body["temperature"] for asked in model.asked} == {0.9}


def test_the_score_is_the_share_of_facts() -> None:
    assert score_of(TASK.rubric, says(True, False, True).facts) == pytest.approx(2 / 3)
    assert score_of(TASK.rubric, says(True, False).facts) is None
    assert score_of(TASK.rubric, ()) is None


# --- any function -------------------------------------------------------------------------------------


def is_short(task: Task, made: Episode) -> tuple[bool, str]:
    return len(made.steps) <= 3, "three steps at most"


async def has_pictures(task: Task, made: Episode, shots: Pictures) -> bool:
    return (await shots(made.observations[0].screenshot)).startswith(b"\x89PNG")


def explodes(task: Task, made: Episode) -> bool:
    raise ZeroDivisionError("no")


class Odd:
    name = "odd/1"

    async def judge(self, task: Task, made: Episode, shots: Pictures) -> Verdict:
        return says(True, True, True)


def makes_one() -> Odd:
    return Odd()


async def run(function: Any, made: Episode | None = None) -> Verdict:
    return await FunctionJudge(function, "mine").judge(TASK, made or episode(), pictures)


async def test_a_function_is_a_judge() -> None:
    verdict = await run(is_short)
    assert (verdict.judge, verdict.reward) == ("mine", 1)
    assert verdict.response == Judgement(True, "three steps at most")
    assert (await run(is_short, episode(["a", "b", "c", "d"]))).reward == 0
    assert (await run(has_pictures)).reward == 1
    assert (await run(lambda task, made: says(True, False, True))).facts[1].judgement.passed is False
    assert (await run(lambda task, made: has_pictures(task, made, pictures))).reward == 1
    assert (await run(lambda *given: len(given) == 3)).reward == 1
    assert (await run(is_short, episode(answer=None))).reward == 0


async def test_a_function_that_fails_or_says_something_else_gives_no_verdict() -> None:
    with pytest.raises(JudgeError, match="mine failed: ZeroDivisionError: no"):
        await run(explodes)
    with pytest.raises(JudgeError, match=r"mine failed: .*StopIteration"):
        await asyncio.wait_for(run(lambda task, made: next(iter(()))), 5)
    everything: tuple[Any, ...] = (None, 0.5, 2, "yes", (True, 1), float("nan"), [])
    for said in everything:
        with pytest.raises(JudgeError, match="returned"):
            await run(lambda task, made, found=said: found)
    for reward in (float("nan"), 0.5, 2, 1.0):
        with pytest.raises(JudgeError, match="reward is the integer 0 or 1"):
            await run(lambda task, made, found=reward: Verdict("mine", found, (), Judgement(False, "no")))


async def test_a_function_sees_blocking_as_others_do() -> None:
    challenge = look("Verify you are human", status=403)
    assert (await run(lambda task, made: False, opened_twice(challenge, challenge))).reward is None
    assert (await run(lambda task, made: False, episode(["front", challenge]))).reward == 0


def test_judges_are_loaded_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert load_judge(f"{__name__}:is_short").name == f"{__name__}:is_short"
    assert load_judge(f"{__name__}:Odd").name == "odd/1"
    assert load_judge(f"{__name__}:makes_one").name == "odd/1"
    (tmp_path / "my_own_judges.py").write_text(
        "def yes(task, episode): return True\nbroken = 3\n"
        "class Needs:\n    def __init__(self, model): pass\n"
        "def fails(): raise OSError('no model')\n"
    )
    (tmp_path / "my_broken_judges.py").write_text("1 / 0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert load_judge("my_own_judges:yes").name == "my_own_judges:yes"
    for where in (
        "my_own_judges:broken",
        "my_own_judges:none",
        "my_own_judges:Needs",
        "my_own_judges:fails",
        "nowhere_at_all:f",
        "x",
        ":",
        "my_broken_judges:f",
    ):
        with pytest.raises(ConfigError):
            load_judge(where)


async def test_judges_are_chosen_by_name() -> None:
    async with open_judge(JudgeChoice()) as judge:
        assert judge.name == OfflineJudge.name
    async with open_judge(JudgeChoice(name=f"{__name__}:is_short")) as judge:
        assert (await judge.judge(TASK, episode(), pictures)).reward == 1
    for name in ("nobody", "rubric"):
        with pytest.raises(ConfigError):
            async with open_judge(JudgeChoice(name=name)):
                pass
