"""Imperfect demonstrators, whose attempts the tiny policy imitates before it learns from outcomes.

Like a pretrained model, a policy that imitates them acts correctly only sometimes. Each demonstrator has its
own
weakness: one answers before it has seen everything, one forgets to write down what it saw, one picks the
wrong tile, one clicks where nothing happens. The mistakes cannot be predicted from the page, so the policy
learns to make each of them with some probability, and learning from outcomes can then select the better
behaviour.

No demonstrator answers what it could not know: an answer holds what is in its written memory or visible on
the current page, and a guess for anything else.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from webgym.agent.elements import target_of, usable
from webgym.agent.formats import format_of, render_reply
from webgym.agent.policy import BasePolicy, PolicyInput
from webgym.agent.solver import Solver
from webgym.core.action import GRID, Action, Answer, GoBack, LeftClick, Target
from webgym.core.errors import ConfigError, PolicyError
from webgym.core.observation import Element, Observation
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.core.truth import Done, Give, Move, Remember
from webgym.study.model import CELL, cell_centres


class Habits(msgspec.Struct, frozen=True):
    """Probabilities of a demonstrator's mistakes.

    Attributes:
        share: of all attempts, relative to other demonstrators.
        hasty: per turn: answers immediately.
        forgets: per entry: does not write it into the memory.
        misreads: per entry: writes another value.
        picks_wrong: per turn: clicks a random element; half the time it does not notice.
        clicks_dead: per turn: clicks where there is no element.
    """

    share: float = 1.0
    hasty: float = 0.0
    forgets: float = 0.0
    misreads: float = 0.0
    picks_wrong: float = 0.0
    clicks_dead: float = 0.0


DEMONSTRATORS: Final[Mapping[str, Habits]] = {
    "careful": Habits(share=2.0),
    "hasty": Habits(share=3.5, hasty=0.35),
    "forgetful": Habits(share=2.0, forgets=0.5, misreads=0.1),
    "clumsy": Habits(share=2.0, picks_wrong=0.25),
    "stuck": Habits(share=1.5, clicks_dead=0.4, hasty=0.2),
}
"""The default mixture. It succeeds in 44 % of the attempts at training tasks."""


class Demonstrators(BasePolicy):
    """A policy that plays known solutions with the mistakes of its demonstrators.

    Args:
        habits: the demonstrators by name. The attempt's seed determines which of them makes an attempt; its
            name is in every reply's ``sampling["demonstrator"]``.

    Raises:
        ConfigError: there are no demonstrators.
    """

    name = "demonstrators"
    wants_elements = True

    def __init__(self, habits: Mapping[str, Habits] = DEMONSTRATORS) -> None:
        if not habits:
            raise ConfigError("there is no demonstrator", hint="name at least one")
        self._habits = dict(habits)

    def begin(self, task: Task, seed: int) -> _Demonstrator:
        """Start an attempt by a demonstrator.

        Raises:
            PolicyError: the task comes without a solution.
        """
        if task.truth is None or not task.truth.moves:
            raise PolicyError(f"the task {task.id} comes without a solution")
        rng = random.Random(f"{task.id}\n{seed}\ndemonstrator")
        names = list(self._habits)
        name = rng.choices(names, [self._habits[each].share for each in names])[0]
        return _Demonstrator(name, self._habits[name], task, task.truth.moves, rng)


class _Demonstrator:
    """An attempt by a demonstrator."""

    def __init__(
        self, name: str, habits: Habits, task: Task, moves: Sequence[Move], rng: random.Random
    ) -> None:
        self._name = name
        self._habits = habits
        self._rng = rng
        self._solver = Solver(task.website, moves)
        self._parts = _entries_by_part(moves)
        self._correct_values = {move.key: move.value for move in moves if isinstance(move, Remember)}
        last = moves[-1]
        self._final = last.text if isinstance(last, Give) else ""
        self._others = task.truth.answer.others if task.truth is not None else ()
        self._noted: set[str] = set()
        self._memory: dict[str, str] = {}
        self._picked_wrong = False

    async def reply(self, turn: PolicyInput) -> Reply:
        """The next reply.

        Raises:
            PolicyError: the observation lacks elements or text.
        """
        observation = turn.observation
        if observation.elements is None or observation.text is None:
            raise PolicyError("a demonstrator needs the page's elements and text")
        with_memory = format_of(turn.prompt_format).has_memory
        action = self._mistake(turn)
        new: dict[str, str] = {}
        if action is None:
            action = _in_cell(self._solver.next(observation, turn.mode).action, observation)
            new = self._take_note(with_memory=with_memory)
        if isinstance(action, Answer):
            action = Answer(self._answer(new, observation, with_memory=with_memory))
        text = render_reply(
            action,
            turn.prompt_format,
            screen=turn.screen,
            description="",
            memory={key: value for key, value in new.items() if key in self._memory},
            progress=self._solver.progress(),
            intention=self._intention(action, observation, with_memory=with_memory),
        )
        return Reply(text, policy=Demonstrators.name, sampling={"demonstrator": self._name})

    def _intention(self, action: Action, observation: Observation, *, with_memory: bool) -> str:
        """The current part of the task, if the prompt has progress, and the name of the action's target."""
        if isinstance(action, Answer):
            aim = "say"
        elif isinstance(action, LeftClick):
            aim = _name_at(action, observation) or "nothing"
        else:
            aim = "back"
        return f"{self._solver.intention()} {aim}" if with_memory else aim

    # --- mistakes -------------------------------------------------------------------------------------

    def _mistake(self, turn: PolicyInput) -> Action | None:
        """A mistake in place of the next move, or the reaction to one; ``None`` for none."""
        observation, habits, draw = turn.observation, self._habits, self._rng.random
        if self._picked_wrong:
            self._picked_wrong = False
            if draw() < 0.5 and turn.steps and turn.steps[-1].changed is not False:
                return GoBack()
            return Answer("?")
        if draw() < habits.hasty:
            return Answer("?")
        if draw() < habits.picks_wrong and (elements := usable(observation)):
            self._picked_wrong = True
            return _in_cell(
                LeftClick(target_of(self._rng.choice(elements), observation, turn.mode)), observation
            )
        if draw() < habits.clicks_dead and (free := _free_cells(observation)):
            return LeftClick(Target(coordinate=self._rng.choice(free)))
        return None

    def _take_note(self, *, with_memory: bool) -> dict[str, str]:
        """The new entries on this page, as read; those that are not forgotten are stored in the memory."""
        new: dict[str, str] = {}
        for key, value in self._solver.memory.items():
            if key in self._noted:
                continue
            self._noted.add(key)
            new[key] = value
            known = (self._memory if with_memory else {}) | new
            is_guessed = any(each not in known for each in self._parts.get(key, ()))
            if self._rng.random() < (0.5 if is_guessed else self._habits.misreads):
                new[key] = self._guess(value)
            if with_memory and self._rng.random() >= self._habits.forgets:
                self._memory[key] = new[key]
        return new

    # --- answers --------------------------------------------------------------------------------------

    def _answer(self, new: dict[str, str], observation: Observation, *, with_memory: bool) -> str:
        """The answer from known entries, with guesses for the others."""
        known = (self._memory if with_memory else {}) | new
        if not self._parts:
            return self._final or "done"
        return ", ".join(known.get(key) or self._seen_or_guessed(key, observation) for key in self._parts)

    def _seen_or_guessed(self, key: str, observation: Observation) -> str:
        right = self._correct_values[key]
        numbers = [word for word in (observation.text or "").split() if word.isdecimal()]
        if right.isdecimal() and numbers and self._rng.random() < 0.5:
            return self._rng.choice(numbers)
        return self._guess(right)

    def _guess(self, value: str) -> str:
        """Another value of the same kind."""
        others = [each for each in self._others if each.isdecimal() == value.isdecimal() and each != value]
        return self._rng.choice(others) if others else value


def _entries_by_part(moves: Sequence[Move]) -> dict[str, tuple[str, ...]]:
    """The entries on which the answer of each part depends, its own last."""
    entries_by_part: dict[str, tuple[str, ...]] = {}
    entries: list[str] = []
    for move in moves:
        if isinstance(move, Remember):
            entries.append(move.key)
        elif isinstance(move, Done):
            if move.part in entries:
                entries_by_part[move.part] = tuple(entries)
            entries = []
    return entries_by_part


def _in_cell(action: Action, observation: Observation) -> Action:
    """The action with its point moved to the nearest cell's centre, where the tiny policy can point."""
    if not isinstance(action, LeftClick) or action.target.coordinate is None:
        return action
    point = tuple(
        min(cell_centres(side), key=lambda middle: (abs(middle - value), middle))
        for value, side in zip(action.target.coordinate, observation.viewport, strict=True)
    )
    return LeftClick(Target(coordinate=(float(point[0]), float(point[1]))))


def _name_at(action: LeftClick, observation: Observation) -> str:
    """The name of the element at a click's point; empty if there is none."""
    if action.target.element is not None:
        return (observation.elements or ())[action.target.element - 1].name
    assert action.target.coordinate is not None
    point = [
        share / GRID * size
        for share, size in zip(action.target.coordinate, observation.viewport, strict=True)
    ]
    return next((each.name for each in observation.elements or () if _contains(each, point)), "")


def _contains(element: Element, point: Sequence[float]) -> bool:
    left, top, width, height = element.box
    return left <= point[0] < left + width and top <= point[1] < top + height


def _free_cells(observation: Observation) -> list[tuple[float, float]]:
    """The centres of the cells without an element."""
    width, height = observation.viewport
    occupied = {
        (column, row)
        for element in observation.elements or ()
        for column in _cells(element, 0)
        for row in _cells(element, 1)
    }
    return [
        (float(x), float(y))
        for column, x in enumerate(cell_centres(width))
        for row, y in enumerate(cell_centres(height))
        if (column, row) not in occupied
    ]


def _cells(element: Element, axis: int) -> range:
    start, length = element.box[axis], element.box[axis + 2]
    return range(int(start // CELL), int((start + max(length, 1) - 1) // CELL) + 1)
