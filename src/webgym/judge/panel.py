"""Several judges, or several samples of one: the majority decides."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from webgym.core.errors import JudgeError
from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Cost, FactJudgement, Judgement, Verdict
from webgym.judge.base import Judge, Pictures
from webgym.judge.soft import score_of


class Panel:
    """Judges by majority.

    A member without a verdict counts for nobody. The reward is what more than half of *all* members found;
    where none did, there is no verdict.

    Args:
        members: at least one.
        name: stands in every verdict; made from the members' where none is given.
    """

    def __init__(self, members: Sequence[Judge], name: str = "") -> None:
        if not members:
            raise ValueError("a panel needs a member")
        self._members = tuple(members)
        names = dict.fromkeys(member.name for member in members)
        self._name = name or f"panel of {len(members)}: {', '.join(names)}"

    @property
    def name(self) -> str:
        """As given, or the members' names."""
        return self._name

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`.

        Raises:
            JudgeError: no finding has more than half of the members behind it.
        """
        found = await asyncio.gather(*(_judged(member, task, episode, pictures) for member in self._members))
        verdicts = [verdict for verdict in found if isinstance(verdict, Verdict)]
        rewards = [verdict.reward for verdict in verdicts]
        reward = max(dict.fromkeys(rewards), key=rewards.count, default=None)
        votes = rewards.count(reward) if verdicts else 0
        if 2 * votes <= len(self._members):
            failed = [str(error) for error in found if isinstance(error, JudgeError)]
            told = f"; {len(failed)} had no verdict: {failed[0]}" if failed else ""
            raise JudgeError(
                f"{votes} of {len(self._members)} members agree, which is no majority{told}",
                hint="an odd number of samples has no ties",
            )
        behind = [verdict for verdict in verdicts if verdict.reward == reward]
        facts = tuple(_facts(task, verdicts))
        costs = [verdict.cost for verdict in verdicts if verdict.cost is not None]
        return Verdict(
            judge=self._name,
            reward=reward,
            facts=facts,
            blocked=behind[0].blocked,
            response=_majority(verdicts, lambda verdict: verdict.response),
            reference=_majority(verdicts, lambda verdict: verdict.reference),
            score=score_of(task.rubric, facts),
            confidence=votes / len(self._members),
            keypoints=behind[0].keypoints,
            cost=sum(costs, Cost()) if costs else None,
        )


async def _judged(member: Judge, task: Task, episode: Episode, pictures: Pictures) -> Verdict | JudgeError:
    try:
        return await member.judge(task, episode, pictures)
    except JudgeError as error:
        return error


def _facts(task: Task, verdicts: Sequence[Verdict]) -> list[FactJudgement]:
    """Each fact by the majority of those who judged it."""
    by_place = [{(fact.group, fact.index): fact.judgement for fact in each.facts} for each in verdicts]
    found = []
    for group, index, text in task.rubric.facts():
        judgements = [facts[group.id, index] for facts in by_place if (group.id, index) in facts]
        if judgement := _decided(judgements):
            found.append(FactJudgement(group.id, index, text, judgement))
    return found


def _majority(verdicts: Sequence[Verdict], part: Callable[[Verdict], Judgement | None]) -> Judgement | None:
    return _decided([judgement for verdict in verdicts if (judgement := part(verdict)) is not None])


def _decided(judgements: Sequence[Judgement]) -> Judgement | None:
    """What most of the read judgements say, in the words of the first that says so. A tie does not pass."""
    read = [judgement for judgement in judgements if judgement.passed is not None]
    if not read:
        return judgements[0] if judgements else None
    passed = 2 * sum(judgement.passed is True for judgement in read) > len(read)
    behind = [judgement for judgement in read if judgement.passed == passed]
    share = f" ({len(behind)} of {len(read)})" if len(judgements) > 1 else ""
    return Judgement(passed, f"{behind[0].reason}{share}", behind[0].steps)
