"""Judges made of others: a majority of several, or of several samples of one; and one without its rubric."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from webgym.core.errors import JudgeError
from webgym.core.task import WHOLE_TASK, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Cost, FactJudgement, Judgement, Verdict
from webgym.judge.base import Judge, Pictures, score_of
from webgym.judge.model_client import result_or_error


class Panel:
    """A judge whose verdict is the majority verdict of its members.

    The reward is the one that more than half of *all* members gave; members without a verdict count in that
    total. Without such a majority there is no verdict.

    Args:
        members: at least one judge.
        name: recorded in every verdict; empty makes one from the members' names.
    """

    def __init__(self, members: Sequence[Judge], name: str = "") -> None:
        if not members:
            raise ValueError("a panel needs a member")
        self._members = tuple(members)
        names = dict.fromkeys(member.name for member in members)
        self._name = name or f"panel of {len(members)}: {', '.join(names)}"

    @property
    def name(self) -> str:
        """The name that was given, or one made from the members' names."""
        return self._name

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`.

        Raises:
            JudgeError: no reward was given by more than half of the members.
        """
        results = await asyncio.gather(
            *(result_or_error(member.judge(task, episode, pictures)) for member in self._members)
        )
        verdicts = [verdict for verdict in results if isinstance(verdict, Verdict)]
        rewards = [verdict.reward for verdict in verdicts]
        reward = max(dict.fromkeys(rewards), key=rewards.count, default=None)
        votes = rewards.count(reward) if verdicts else 0
        if 2 * votes <= len(self._members):
            failed = [str(error) for error in results if isinstance(error, JudgeError)]
            errors = f"; {len(failed)} had no verdict: {failed[0]}" if failed else ""
            raise JudgeError(
                f"{votes} of {len(self._members)} members agree, which is no majority{errors}",
                hint="an odd number of samples has no ties",
            )
        agreeing = [verdict for verdict in verdicts if verdict.reward == reward]
        facts = tuple(_facts(task, verdicts))
        costs = [verdict.cost for verdict in verdicts if verdict.cost is not None]
        return Verdict(
            judge=self._name,
            reward=reward,
            facts=facts,
            blocked=agreeing[0].blocked,
            response=_majority_part(verdicts, lambda verdict: verdict.response),
            reference=_majority_part(verdicts, lambda verdict: verdict.reference),
            score=score_of(task.rubric, facts),
            confidence=votes / len(self._members),
            keypoints=agreeing[0].keypoints,
            cost=sum(costs, Cost()) if costs else None,
            prompts=agreeing[0].prompts,
        )


def _facts(task: Task, verdicts: Sequence[Verdict]) -> list[FactJudgement]:
    """The judgement of each fact: the majority of the members that judged it."""
    judgements_by_fact = [
        {(fact.group, fact.index): fact.judgement for fact in verdict.facts} for verdict in verdicts
    ]
    majorities = []
    for group, index, text in task.rubric.facts():
        judgements = [facts[group.id, index] for facts in judgements_by_fact if (group.id, index) in facts]
        if judgement := _majority_judgement(judgements):
            majorities.append(FactJudgement(group.id, index, text, judgement))
    return majorities


def _majority_part(
    verdicts: Sequence[Verdict], part: Callable[[Verdict], Judgement | None]
) -> Judgement | None:
    return _majority_judgement(
        [judgement for verdict in verdicts if (judgement := part(verdict)) is not None]
    )


def _majority_judgement(judgements: Sequence[Judgement]) -> Judgement | None:
    """The majority judgement, with the reason of the first that agrees with it. A tie does not pass."""
    decided = [judgement for judgement in judgements if judgement.passed is not None]
    if not decided:
        return judgements[0] if judgements else None
    passed = 2 * sum(judgement.passed is True for judgement in decided) > len(decided)
    agreeing = [judgement for judgement in decided if judgement.passed == passed]
    share = f" ({len(agreeing)} of {len(decided)})" if len(judgements) > 1 else ""
    return Judgement(passed, f"{agreeing[0].reason}{share}", agreeing[0].steps)


PREFIX: Final = "without rubric: "
"""Prefix of the names of such judges; the name of the same judge with rubric follows."""


class WithoutRubric:
    """Replaces every task's rubric by a single fact: that the task was done.

    Everything else is the wrapped judge's (screenshots, criterion B, reference answers, models), so a
    difference from its own verdicts is due to the rubric.

    Args:
        judge: any judge that does not need the task's hidden truth.
    """

    def __init__(self, judge: Judge) -> None:
        self._judge = judge

    @property
    def name(self) -> str:
        """The wrapped judge's name, with :data:`PREFIX`."""
        return f"{PREFIX}{self._judge.name}"

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`."""
        verdict = await self._judge.judge(
            msgspec.structs.replace(task, rubric=WHOLE_TASK, truth=None), episode, pictures
        )
        return msgspec.structs.replace(verdict, judge=self.name)
