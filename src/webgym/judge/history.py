"""An agent's actions as text for a judge model: a line per step, without the answer's text."""

from __future__ import annotations

from webgym.core.action import (
    Action,
    Answer,
    DoubleClick,
    Drag,
    GoBack,
    Hover,
    LeftClick,
    Navigate,
    Press,
    RightClick,
    Scroll,
    Target,
    Type,
    Upload,
    Wait,
)
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


def _line(step: Step, chars: int) -> str:
    place = f"step {step.index + 1}, on {step.observation.url}: "
    action = _describe(step.action, step.observation) if step.action else "nothing (unreadable reply)"
    effect = " (the page did not change)" if step.changed is False else ""
    line = " ".join((place + action + effect).split())
    return line if len(line) <= chars else line[: chars - 1] + "…"


def _describe(action: Action, seen: Observation) -> str:
    match action:
        case LeftClick(target, modifiers):
            modifiers_text = f" with {'+'.join(modifiers)} held" if modifiers else ""
            return f"clicked {_target(target, seen)}{modifiers_text}"
        case DoubleClick(target):
            return f"double-clicked {_target(target, seen)}"
        case RightClick(target):
            return f"right-clicked {_target(target, seen)}"
        case Hover(target):
            return f"moved the mouse to {_target(target, seen)}"
        case Drag(start, target, path):
            through = f" through {len(path)} points" if path else ""
            return f"dragged {_target(start, seen)}{through} to {_target(target, seen)}"
        case Type(target, text, enter):
            return f'typed "{text}" into {_target(target, seen)}{"" if enter else " without Enter"}'
        case Press(keys):
            return f"pressed {'+'.join(keys)}"
        case Upload(target, files):
            return f"chose the files {', '.join(files)} at {_target(target, seen)}"
        case Scroll(direction, target):
            return f"scrolled {direction}" + ("" if target is None else f" at {_target(target, seen)}")
        case Wait(seconds):
            return f"waited {seconds:g} s"
        case GoBack():
            return "went back"
        case Navigate(url):
            return f"opened {url}"
        case Answer():
            return "gave its answer"


def _target(target: Target, seen: Observation) -> str:
    if target.coordinate is not None:
        x, y = target.coordinate
        return f"the point ({x:g}, {y:g}) of 1000"
    element = next(
        (candidate for candidate in seen.elements or () if candidate.number == target.element), None
    )
    return f'"{element.name}" ({element.role})' if element else f"element {target.element}"
