"""An agent's actions as text for a judge model: a line per step, without the answer's text."""

from __future__ import annotations

from webgym.core.action import Target
from webgym.core.observation import Observation
from webgym.core.trajectory import Episode, Step


def action_history(episode: Episode, *, line_chars: int, limit: int) -> str:
    """The steps of an episode as lines, oldest first; the oldest are left out beyond ``limit`` characters.

    Args:
        episode: the recorded steps.
        line_chars: longest line, characters.
        limit: most characters of all lines together.
    """
    lines = [_line(step, line_chars) for step in episode.steps]
    recent: list[str] = []
    for line in reversed(lines):
        if recent and sum(map(len, recent)) + len(recent) + len(line) > limit:
            break
        recent.append(line)
    left_out = [f"[{len(lines) - len(recent)} earlier steps left out]"] if len(recent) < len(lines) else []
    return "\n".join([*left_out, *reversed(recent)]) or "no step was taken"


_UNREADABLE = "nothing (unreadable reply)"


def _line(step: Step, chars: int) -> str:
    seen = step.observation
    place = f"step {step.index + 1}, on {seen.url}: "
    action = step.action.told(lambda target: _target(target, seen)) if step.action else _UNREADABLE
    effect = " (the page did not change)" if step.changed is False else ""
    line = " ".join((place + action + effect).split())
    return line if len(line) <= chars else line[: chars - 1] + "…"


def _target(target: Target, seen: Observation) -> str:
    if target.coordinate is not None:
        x, y = target.coordinate
        return f"the point ({x:g}, {y:g}) of 1000"
    element = next(
        (candidate for candidate in seen.elements or () if candidate.number == target.element), None
    )
    return f'"{element.name}" ({element.role})' if element else f"element {target.element}"
