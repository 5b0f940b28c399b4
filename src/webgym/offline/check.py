"""Do the offline web's tasks end as they should when their solutions are played?"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from webgym.core.task import Task
from webgym.core.trajectory import Trajectory


def unexpected(tasks: Mapping[str, Task], trajectories: Iterable[Trajectory]) -> Iterator[str]:
    """A line for every task that did not end as its truth expects, and why."""
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
    reasons = [judgement.reason for judgement in found if judgement is not None and not judgement.passed]
    return f"{'; '.join(reasons)} (answer: {episode.answer!r})"
