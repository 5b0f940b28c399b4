"""Are the offline web's tasks what they claim to be? Solvable, and by nothing less than a solution.

``webgym sites check`` plays every solution in real browsers and asks here what to make of it.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable, Iterator, Mapping

import msgspec

from webgym.core.errors import JudgeError
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Trajectory
from webgym.judge import Judge


def unexpected(tasks: Mapping[str, Task], trajectories: Iterable[Trajectory]) -> Iterator[str]:
    """A line for every task whose solution did not end as its truth expects, and why."""
    seen: set[str] = set()
    for trajectory in trajectories:
        episode = trajectory.episode
        task = tasks[episode.task_id]
        assert task.truth is not None
        seen.add(task.id)
        if trajectory.outcome != task.truth.expects:
            expected = f"expected {task.truth.expects}, came to {trajectory.outcome}"
            yield f"{task.id}: {expected} after {len(episode.steps)} steps: {_why(trajectory)}"
    for task_id in tasks.keys() - seen:
        yield f"{task_id}: was not attempted"


def _why(trajectory: Trajectory) -> str:
    episode, verdict = trajectory.episode, trajectory.verdict
    failure = episode.failure or trajectory.judge_failure
    if failure is not None:
        return failure.message
    if verdict is None:
        return "it was not judged"
    found = [verdict.reference, verdict.response, *(fact.judgement for fact in verdict.facts)]
    reasons = [judgement.reason for judgement in found if judgement is not None and judgement.passed is False]
    return f"{'; '.join(reasons)} (answer: {episode.answer!r})"


def spoilt(task: Task, solved: Episode) -> Iterator[tuple[str, Episode]]:
    """A solved episode, spoilt in every way that must cost it its success.

    Yields:
        What was spoilt, and the episode that is left.
    """
    change = msgspec.structs.replace
    assert task.truth is not None
    if task.truth.answer.required:
        yield "a wrong answer", change(solved, answer="It is the other one, 987654321.")
        yield "an answer that gives up", change(solved, answer="I could not find it.")
        if task.truth.answer.forbidden:
            wrong = f"{solved.answer} Or {task.truth.answer.forbidden[0]}."
            yield "an answer that names another candidate too", change(solved, answer=wrong)
    yield "no answer", change(solved, answer=None, ending=Ending.BUDGET_SPENT)
    yield "a right answer at first sight", change(solved, steps=solved.steps[:1], final=None)
    yield "a right answer without a look", change(solved, steps=(), final=None)
    nothing = change(solved, steps=(), final=None, answer=None, ending=Ending.BUDGET_SPENT, final_state={})
    yield "an empty trajectory", nothing
    if any(fact.state for fact in task.truth.facts):
        yield "nothing done on the server", change(solved, final_state={})


async def pushovers(
    tasks: Mapping[str, Task], trajectories: Iterable[Trajectory], judge: Judge
) -> AsyncIterator[str]:
    """A line for every spoilt solution that the judge lets pass."""
    for trajectory in trajectories:
        if trajectory.outcome is not Outcome.SUCCESS:
            continue
        task = tasks[trajectory.episode.task_id]
        for what, episode in spoilt(task, trajectory.episode):
            try:
                verdict = await judge.judge(task, episode, _no_picture)
            except JudgeError:
                continue
            if verdict.reward == 1:
                yield f"{task.id}: {what} passes"


async def _no_picture(name: str) -> bytes:
    raise JudgeError(f"the picture {name} is not at hand")
