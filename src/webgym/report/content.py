"""Trajectories as data for the pages: the content of each trajectory's own page.

Untrusted text (page titles, replies, answers) is passed on unchanged. It is made safe where it enters a page:
as inert JSON in the file, as text nodes in the document.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from webgym.core.action import (
    GRID,
    Action,
    Drag,
    Target,
    name_of,
)
from webgym.core.observation import Element, Observation
from webgym.core.task import Task
from webgym.core.trajectory import Failure, Revision, Step, Trajectory
from webgym.core.verdict import Cost, Judgement, Verdict
from webgym.core.websites import host_or_text
from webgym.results.summary import environment_milliseconds
from webgym.store.verdicts import Judged


def page(trajectory: Trajectory, task: Task | None, others: Sequence[Judged] = ()) -> dict[str, Any]:
    """The content of a trajectory's page. Boxes and points are percentages of the screenshot's size.

    Args:
        trajectory: the trajectory.
        task: its task; ``None`` if the run does not contain it.
        others: later verdicts of other judges.
    """
    episode, verdict = trajectory.episode, trajectory.verdict
    waited = [*environment_milliseconds(episode.steps), None]
    return {
        "id": episode.attempt_id,
        "outcome": trajectory.outcome.value,
        "ending": episode.ending.value,
        "policy": episode.policy,
        "seed": str(episode.seed),  # beyond what a double holds
        "started": episode.started_at,
        "seconds": episode.seconds,
        "judgeSeconds": trajectory.judge_seconds,
        "task": _task(task, episode.task_id),
        "groups": _groups(task, verdict),
        "verdict": _verdict(verdict),
        "failure": _failure(episode.failure),
        "judgeFailure": _failure(trajectory.judge_failure),
        "others": [_other(judged, task) for judged in others],
        "answer": episode.answer,
        "steps": [_step(step, wait) for step, wait in zip(episode.steps, waited, strict=False)],
        "final": _observation(episode.final) if episode.final else None,
    }


def blind(content: dict[str, Any]) -> dict[str, Any]:
    """The content of a page without verdicts and everything that reveals them, for unbiased labelling."""
    groups = [
        {**group, "facts": [{"text": fact["text"], "passed": None} for fact in group["facts"]]}
        for group in content["groups"]
    ]
    hidden: dict[str, Any] = {"outcome": None, "verdict": None, "judgeFailure": None, "judgeSeconds": 0}
    return {**content, **hidden, "groups": groups, "others": [], "blind": True}


def _task(task: Task | None, task_id: str) -> dict[str, Any]:
    if task is None:
        return {"id": task_id, "instruction": task_id}
    return {
        "id": task.id,
        "instruction": task.instruction,
        "site": host_or_text(task.website),
        "domain": task.domain,
        "subdomain": task.subdomain,
        "level": task.level,
        "difficulty": task.difficulty,
        "split": task.split,
        "reference": task.reference_answer,
    }


def _groups(task: Task | None, verdict: Verdict | None) -> list[dict[str, Any]]:
    by_fact = {(fact.group, fact.index): fact for fact in verdict.facts} if verdict else {}
    if task is None:
        facts = [{"text": fact.fact, **_judgement(fact.judgement)} for fact in by_fact.values()]
        return [{"description": "", "facts": facts}] if facts else []
    groups: dict[int, dict[str, Any]] = {}
    for group, index, text in task.rubric.facts():
        content = groups.setdefault(group.id, {"description": group.description, "facts": []})
        fact = by_fact.get((group.id, index))
        content["facts"].append({"text": text, **(_judgement(fact.judgement) if fact else {"passed": None})})
    return list(groups.values())


def _judgement(judgement: Judgement) -> dict[str, Any]:
    return {"passed": judgement.passed, "reason": judgement.reason, "steps": judgement.steps}


def _verdict(verdict: Verdict | None) -> dict[str, Any] | None:
    if verdict is None:
        return None
    findings = {"response": verdict.response, "reference": verdict.reference, "blocked": verdict.blocked}
    return {
        "judge": verdict.judge,
        "reward": verdict.reward,
        "score": verdict.score,
        "fault": verdict.fault,
        "confidence": verdict.confidence,
        "cost": _cost(verdict.cost),
        **{name: _judgement(finding) if finding else None for name, finding in findings.items()},
    }


def _cost(cost: Cost | None) -> dict[str, float] | None:
    if cost is None:
        return None
    tokens = cost.prompt_tokens + cost.completion_tokens
    return {"replies": cost.calls, "cached": cost.cached, "tokens": tokens, "dollars": cost.dollars}


def _other(judged: Judged, task: Task | None) -> dict[str, Any]:
    """The verdict of another judge, with the same keys as that of the run's own."""
    return {
        "judge": judged.judge,
        "outcome": judged.outcome.value,
        "judgeSeconds": judged.seconds,
        "groups": _groups(task, judged.verdict),
        "verdict": _verdict(judged.verdict),
        "judgeFailure": _failure(judged.failure),
    }


def _failure(failure: Failure | None) -> dict[str, str] | None:
    return {"code": failure.code, "message": failure.message} if failure else None


def _observation(observation: Observation) -> dict[str, Any]:
    width, height = observation.viewport
    return {
        "shot": observation.screenshot,
        "url": observation.url,
        "title": observation.title,
        "status": observation.status,
        "size": [width, height],
        "scroll": observation.scroll,
        "notices": [[notice.kind, notice.text] for notice in observation.notices],
        "ms": {name: round(value, 1) for name, value in observation.milliseconds.items()},
    }


def _step(step: Step, waited: float | None) -> dict[str, Any]:
    """One step. ``waited`` is the time from the reply to the next observation, milliseconds; ``None`` if
    unknown."""
    reply = step.reply
    return {
        **_observation(step.observation),
        "at": round(step.at, 2),
        "reply": reply.text,
        "finish": reply.finish_reason,
        "replyMs": round(reply.seconds * 1000, 1),
        "tokens": [reply.prompt_tokens, reply.completion_tokens],
        "waited": None if waited is None else round(waited, 1),
        "changed": step.changed,
        "error": step.parse_error,
        "memory": _memory_corrections(step.revision),
        "action": _action(step.action, step.observation) if step.action else None,
    }


def _memory_corrections(revision: Revision | None) -> str:
    """The changes of a reply to the memory that were not applied as written, as text."""
    if revision is None:
        return ""
    parts = {
        "omitted, kept": revision.dropped,
        "changed, both values kept": revision.rewritten,
        "no room, not added": revision.refused,
    }
    return "; ".join(f"{correction}: {', '.join(keys)}" for correction, keys in parts.items() if keys)


def _action(action: Action, observation: Observation) -> dict[str, Any]:
    """An action for the pages: its words, and what is drawn on the screenshot of it."""
    words = action.told(lambda target: _named(target, observation))
    return {
        "name": name_of(action).replace("_", " "),
        "words": words[0].upper() + words[1:],
        "entered": action.entered,
        "places": [_place(target, observation) for target in action.targets],
        "way": [_point(point) for point in action.path] if isinstance(action, Drag) else [],
    }


def _named(target: Target, observation: Observation) -> str:
    place = _place(target, observation)
    if place.get("on"):
        return f"“{place['on']}”"
    return "the page" if "mark" not in place else f"element {place['mark']}"


def _point(coordinate: tuple[float, float]) -> list[float]:
    return [round(value * 100 / GRID, 3) for value in coordinate]


def _place(target: Target, observation: Observation) -> dict[str, Any]:
    """The target of an action on the screenshot: point, box or mark, and the element's name and role."""
    place: dict[str, Any] = {}
    if target.coordinate is not None:
        place["point"] = _point(target.coordinate)
        element = _element_at(target.coordinate, observation)
    else:
        place["mark"] = target.element
        element = next(
            (known for known in observation.elements or () if known.number == target.element), None
        )
        if element is not None:
            place["box"] = _percent(element, observation)
    if element is not None:
        place["on"] = element.name
        place["role"] = element.role
    return place


def _percent(element: Element, observation: Observation) -> list[float]:
    width, height = observation.viewport
    x, y, w, h = element.box
    return [
        round(value, 3) for value in (x * 100 / width, y * 100 / height, w * 100 / width, h * 100 / height)
    ]


def _element_at(coordinate: tuple[float, float], observation: Observation) -> Element | None:
    """The smallest element at a point of the action grid; ``None`` if there is none or none were recorded."""
    x, y = (value * size / GRID for value, size in zip(coordinate, observation.viewport, strict=True))

    def is_hit(element: Element) -> bool:
        left, top, width, height = element.box
        return left <= x <= left + width and top <= y <= top + height

    hit = [element for element in observation.elements or () if is_hit(element)]
    return min(hit, key=lambda element: element.box[2] * element.box[3], default=None)
