"""Policies by name. Without a model: one knows the solutions of the offline web's tasks, one acts at random.

The first makes mistakes at a configurable rate and replaces a model in the demo, in tests and measurements;
the second is a baseline for every other policy, and a stress test. Every reply is in the prompt format and
mode that a model would use, so that parser, records and reports are exercised as with a model. They act only
on what the page shows, never on page state that a person could not see.
"""

from __future__ import annotations

import copy
import random
import re
from collections.abc import Sequence
from typing import Any, Final, Literal, TypeAlias, get_args

from webgym.agent.context import describe
from webgym.agent.elements import TEXT_ROLES, target_of, usable
from webgym.agent.formats import render_reply
from webgym.agent.openai_policy import OpenAIPolicy
from webgym.agent.policy import BasePolicy, Policy, PolicyInput
from webgym.agent.profile import Profile
from webgym.agent.solver import Act, Solver
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
from webgym.core.errors import ConfigError, PolicyError
from webgym.core.observation import Observation
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.core.truth import Choose, Click, Fill, Give, Move, See, Truth
from webgym.llm.config import ChatConfig

POLICY_NAMES: Final = ("scripted", "random", "openai")

Mistake: TypeAlias = Literal[
    "wrong_answer",  # names another candidate, or another number
    "unseen_answer",  # the right answer at once, without having looked
    "skipped_move",  # leaves one move out and carries on
    "misclick",  # clicks elsewhere once, then finds its way back
    "unreadable",  # one or two replies without an action, then goes on
    "dawdle",  # scrolls up and down until the budget is spent
    "gives_up",  # says early that nothing was found
    "raises",  # fails as an endpoint would
]
MISTAKES: Final[tuple[Mistake, ...]] = get_args(Mistake)

_AFTER_TURNS: Final = 3
"""A mistake while acting is made within this many turns, or just before the answer if that comes first."""


class ScriptedPolicy(BasePolicy):
    """Carries out ``task.truth.moves``.

    Args:
        mistake_rate: share of attempts with exactly one mistake, from 0 to 1. Which attempts, and which
            mistake, is determined by the task's id and the attempt's seed; every reply names it in
            ``sampling["mistake"]``.
        mistakes: the kinds of mistakes to sample from.

    Raises:
        ConfigError: the rate is not between 0 and 1, or ``mistakes`` is empty.
    """

    name = "scripted"
    wants_elements = True

    def __init__(self, mistake_rate: float = 0.0, *, mistakes: Sequence[Mistake] = MISTAKES) -> None:
        if not 0 <= mistake_rate <= 1:
            raise ConfigError(f"the mistake rate is {mistake_rate}", hint="give a share from 0 to 1")
        if not mistakes:
            raise ConfigError("there is no mistake to draw from", hint="name at least one kind")
        self._mistake_rate = mistake_rate
        self._mistakes = tuple(mistakes)

    def begin(self, task: Task, seed: int) -> ScriptedSession:
        """A session that carries out this task's solution. Without a solution, its first reply raises."""
        rng = random.Random(f"{task.id}\n{seed}")
        mistake = None
        if rng.random() < self._mistake_rate:
            mistake = rng.choice(self._mistakes)
        return ScriptedSession(task, mistake, rng)


class ScriptedSession:
    """One attempt of the scripted policy.

    Attributes:
        mistake: the mistake that this attempt makes; ``None`` for none. If the sampled kind does not apply to
            the task (no answer that could be wrong, no move that could be left out), it is ``gives_up``.
    """

    def __init__(self, task: Task, mistake: Mistake | None, rng: random.Random) -> None:
        self._task = task
        self._rng = rng
        self._moves: tuple[Move, ...] = task.truth.moves if task.truth is not None else ()
        self.mistake = mistake
        if task.truth is not None and self._moves:
            self._apply_mistake_to_plan(task.truth)
        self._solver = Solver(task.website, self._moves)
        self._due_turn = rng.randrange(_AFTER_TURNS)
        self._mistakes_left = {"unreadable": rng.randint(1, 2), "misclick": 1, "raises": 1}.get(
            self.mistake or "", 0
        )
        self._strayed_from: str | None = None
        self._dawdled = 0

    async def reply(self, turn: PolicyInput) -> Reply:
        """The next reply.

        Raises:
            PolicyError: the task has no solution, the observation lacks elements or text, or the attempt's
                mistake is ``raises``.
        """
        if not self._moves:
            hint = "the scripted policy plays tasks of the offline web only"
            raise PolicyError(f"the task {self._task.id} comes without a solution", hint=hint)
        seen = turn.observation
        if seen.elements is None or seen.text is None:
            hint = "ask the server for elements and text"
            raise PolicyError("the scripted policy cannot see what is on the page", hint=hint)
        act = self._mistake_now(turn) or self._solver.next(seen, turn.mode)
        if isinstance(act, str):
            return self._reply(act)
        text = render_reply(
            act.action,
            turn.prompt_format,
            screen=turn.screen,
            description=act.description,
            memory=_memory_of(self._solver),
            progress=self._solver.progress(),
            intention=self._solver.intention(),
        )
        return self._reply(text)

    def _reply(self, text: str) -> Reply:
        return Reply(text, policy=ScriptedPolicy.name, sampling={"mistake": self.mistake})

    # --- mistakes in the plan ---------------------------------------------------------------------

    def _apply_mistake_to_plan(self, truth: Truth) -> None:
        """Change the moves if the mistake is one of the plan."""
        *moves, last = self._moves
        if self.mistake == "wrong_answer" and (wrong := wrong_answer(truth, self._rng)) is not None:
            self._moves = (*moves, Give(wrong))
        elif self.mistake == "unseen_answer":
            self._moves = (last,)
        elif self.mistake == "skipped_move" and (skippable := _skippable_moves(moves)):
            del moves[self._rng.choice(skippable)]
            self._moves = (*moves, last)
        elif self.mistake in ("gives_up", "wrong_answer", "skipped_move"):
            self.mistake = "gives_up"
            kept = moves[: self._rng.randint(0, len(moves) // 2)]
            self._moves = (*kept, Give("I could not find what was asked for."))

    # --- mistakes while acting --------------------------------------------------------------------

    def _mistake_now(self, turn: PolicyInput) -> Act | str | None:
        """What the mistake does at this turn; ``None`` for nothing."""
        if self._strayed_from is not None:
            strayed_from, self._strayed_from = self._strayed_from, None
            if turn.observation.url != strayed_from:
                return Act(GoBack(), "Go back: that was the wrong link")
        if self.mistake == "dawdle" and (self._dawdled or self._is_due(turn)):
            self._dawdled += 1
            direction: Literal["up", "down"] = "down" if self._dawdled % 2 else "up"
            return Act(Scroll(direction), f"Scroll {direction} and look around")
        if not self._mistakes_left or not self._is_due(turn):
            return None
        self._mistakes_left -= 1
        if self.mistake == "raises":
            raise PolicyError("the scripted policy failed on purpose", hint="this is a seeded mistake")
        if self.mistake == "unreadable":
            return self._rng.choice(_UNREADABLE)
        self._strayed_from = turn.observation.url
        return self._misclick(turn)

    def _is_due(self, turn: PolicyInput) -> bool:
        if turn.index >= self._due_turn:
            return True
        upcoming = copy.deepcopy(self._solver).next(turn.observation, turn.mode)
        return isinstance(upcoming.action, Answer)

    def _misclick(self, turn: PolicyInput) -> Act:
        seen = turn.observation
        links = [element for element in usable(seen) if element.role == "link"]
        if links:
            wrong = self._rng.choice(links)
            return Act(LeftClick(target_of(wrong, seen, turn.mode)), f'Click "{wrong.name}"')
        if turn.mode == "marks":
            return Act(Scroll("down"), "Scroll down to look around")
        point = (float(self._rng.randrange(GRID)), float(self._rng.randrange(GRID)))
        return Act(LeftClick(Target(coordinate=point)), "Click into the page")


_UNREADABLE: Final = (
    "I should look at the page more closely before I do anything.",
    'Action: Click the link.\n<tool_call>\n{"name": "computer_use", "arguments": {"action": "left_cl',
    'Action: Click the link.\n<tool_call>\n{"name": "computer_use", "arguments": {"action": "press"}}\n'
    "</tool_call>",
)


def _memory_of(solver: Solver) -> dict[str, Any]:
    """The memory entries of the solution; if it has none, the texts seen so far."""
    if solver.writes_memory:
        return dict(solver.memory)
    return {f"seen {number}": list(texts) for number, texts in enumerate(solver.seen, 1)}


def wrong_answer(truth: Truth, rng: random.Random) -> str | None:
    """An answer in the form asked for, with another value; ``None`` if the task asks for no value."""
    if not truth.answer.required:
        return None
    right = [spellings[0] for spellings in truth.answer.required]
    at = rng.randrange(len(right))
    right[at] = rng.choice(truth.answer.others) if truth.answer.others else _altered(right[at], rng)
    return (", " if truth.answer.by_comma else "\n").join(right)


def _altered(text: str, rng: random.Random) -> str:
    """Another text of the same kind: with other digits, or with its letters reversed."""
    shift = rng.randint(1, 9)
    other = re.sub(r"[0-9](?![0-9])", lambda digit: str((int(digit[0]) + shift) % 10), text)
    return other if other != text else text[::-1]


def _skippable_moves(moves: Sequence[Move]) -> list[int]:
    """Indices of the moves that matter most: those that act; if there are none, those that look for text."""
    acts = [index for index, move in enumerate(moves) if isinstance(move, Click | Fill | Choose)]
    return acts or [index for index, move in enumerate(moves) if isinstance(move, See)]


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


def create_policy(
    name: str, *, mistake_rate: float = 0.0, chat: ChatConfig | None = None, profile: Profile | None = None
) -> Policy:
    """The policy of this name.

    Args:
        name: one of :data:`POLICY_NAMES`.
        mistake_rate: for ``scripted``: share of attempts with a mistake.
        chat: for ``openai``: endpoint and model.
        profile: for ``openai``: profile of the model family; by default chosen by the model's name.

    Raises:
        ConfigError: the policy is unknown, or ``openai`` is given no endpoint.
    """
    match name:
        case "scripted":
            return ScriptedPolicy(mistake_rate)
        case "random":
            return RandomPolicy()
        case "openai":
            if chat is None:
                hint = "give a base URL and the model's name"
                raise ConfigError("the openai policy does not know its endpoint", hint=hint)
            return OpenAIPolicy(chat, profile)
        case _:
            raise ConfigError(f"unknown policy {name!r}", hint=f"choose one of {', '.join(POLICY_NAMES)}")
