"""A policy of random actions: a baseline for every other policy, and a stress test."""

from __future__ import annotations

import random
from typing import Final

from webgym.agent.context import describe
from webgym.agent.elements import TEXT_ROLES, target_of, usable
from webgym.agent.policy import BasePolicy, PolicyInput
from webgym.agent.prompts import render_reply
from webgym.core.action import (
    GRID,
    Action,
    Answer,
    DoubleClick,
    Drag,
    GoBack,
    Hover,
    LeftClick,
    Press,
    RightClick,
    Scroll,
    Side,
    Target,
    Type,
    Wait,
)
from webgym.core.observation import Observation
from webgym.core.task import Task
from webgym.core.trajectory import Reply

_ANSWER_CHANCE: Final = 0.05
"""Probability of an answer at any turn but the last one, which always answers."""

_WEIGHTS: Final = {"element": 12, "point": 1, "scroll": 4, "back": 1, "wait": 1}
_EXTENDED_WEIGHTS: Final = {"mouse": 4, "drag": 1, "keys": 2}
"""Additional actions of the extended space."""
_KEYS: Final = ("Enter", "Escape", "Tab", "ArrowDown", "Control+a", "Backspace")


class RandomPolicy(BasePolicy):
    """Clicks and types at random, on visible elements if the observation has them, and answers at some
    point."""

    name = "random"
    wants_elements = True

    def begin(self, task: Task, seed: int) -> RandomSession:
        """A session whose choices are determined by the task's id and the seed."""
        return RandomSession(random.Random(f"{task.id}\n{seed}"))


class RandomSession:
    """One attempt of the random policy."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng

    async def reply(self, turn: PolicyInput) -> Reply:
        """Any action that the mode allows."""
        action = self._action(turn)
        text = render_reply(
            action, turn.prompt_format, screen=turn.screen, description=describe(action, turn.screen)
        )
        return Reply(text, policy=RandomPolicy.name)

    def _action(self, turn: PolicyInput) -> Action:
        seen, rng = turn.observation, self._rng
        if turn.index >= turn.budget - 1 or rng.random() < _ANSWER_CHANCE:
            return Answer(self._words(seen, 3))
        is_extended = turn.space == "extended"
        weights = _WEIGHTS | (_EXTENDED_WEIGHTS if is_extended else {})
        match rng.choices(list(weights), weights=list(weights.values()))[0]:
            case "mouse" if elements := usable(seen):
                act = rng.choice((DoubleClick, RightClick, Hover))
                return act(target_of(rng.choice(elements), seen, turn.mode))
            case "drag" if elements := usable(seen):
                start, end = rng.choices(elements, k=2)
                return Drag(target_of(start, seen, turn.mode), target_of(end, seen, turn.mode))
            case "keys" if is_extended:
                return Press((rng.choice(_KEYS),))
            case "element" if elements := usable(seen):
                element = rng.choice(elements)
                target = target_of(element, seen, turn.mode)
                typed = element.role in TEXT_ROLES
                return Type(target, self._words(seen, 1)) if typed else LeftClick(target)
            case "point" if turn.mode == "coordinates":
                return LeftClick(Target(coordinate=(float(rng.randrange(GRID)), float(rng.randrange(GRID)))))
            case "back":
                return GoBack()
            case "wait":
                return Wait(1.0)
            case _:
                sides: tuple[Side, ...] = ("left", "right") if is_extended else ()
                return Scroll(rng.choice(("up", "down", "down", *sides)))

    def _words(self, seen: Observation, most: int) -> str:
        """At most ``most`` consecutive words from the page, at a random position."""
        words = (seen.text or seen.title).split() or ["nothing"]
        start = self._rng.randrange(len(words))
        return " ".join(words[start : start + most])
