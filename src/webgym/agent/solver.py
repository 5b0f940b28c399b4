"""Carries out a known solution, in a closed loop that observes the page after every action.

A :class:`Solver` follows the moves of a task's truth (:mod:`webgym.core.truth`) by clicking, typing and
scrolling alone. It never assumes that a move worked, but checks. Its rules:

- Obstacles (cookie banners, newsletters, modals) are dismissed first.
- It waits for a page that is still loading.
- It searches for what is not visible by scrolling to one end of the page, then to the other.
- A move that did not change the screen is tried once more.
- If the website refuses a page, it starts again once from the front page.
- After that, or if something cannot be found, it answers that the task could not be done.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

from webgym.agent.elements import (
    LIST_ROLES,
    TEXT_ROLES,
    find_click,
    find_home,
    find_named,
    is_home,
    path_of,
    same_host,
    shows_all,
    target_of,
    usable,
)
from webgym.core.action import (
    Action,
    Answer,
    Direction,
    GoBack,
    LeftClick,
    Mode,
    Navigate,
    Scroll,
    Type,
    Wait,
)
from webgym.core.observation import Element, Observation
from webgym.core.text import fold
from webgym.core.truth import Back, Choose, Click, Done, Fill, Give, Home, Move, Remember, See

IN_THE_WAY: Final = frozenset(
    "accept all|accept all cookies|accept cookies|allow all|allow all cookies|got it|i agree|maybe later|"
    "no thanks|no, thanks|not now|only necessary|reject all".split("|")
)
"""Names of buttons that dismiss an obstacle and do nothing else; clicked whenever they are visible."""

IN_THE_WAY_IF_LOST: Final = frozenset({"×", "✕", "close", "close dialog", "dismiss", "skip"})
"""Names of buttons that may be part of a page; clicked only if the current move's element is not visible."""

LOADING_WAIT_SECONDS: Final = 1.0
MAX_WAITS: Final = 3
"""How many times in a row it waits for a page that is still loading."""

MAX_INNER_SCROLLS: Final = 5
"""How often in a row it scrolls while the page's scroll position stays the same: a box in the page may be
scrolling, or the screen may only change because of an animation."""

_REFUSED: Final = frozenset({403, 429, 503})
"""HTTP statuses of pages that may succeed on another request."""

MAX_TRIES: Final = 2
_POINTS: Final = ((0.5, 0.5), (0.2, 0.3))
"""The point of an element that is clicked at the first and the second try, as fractions of its size."""

_SELECTABLE_ROLES: Final = frozenset({"option", "radio", "tab"})
"""Roles for which a click changes nothing if the element is already selected."""


@dataclasses.dataclass(frozen=True)
class Act:
    """An action, and one sentence that describes it."""

    action: Action
    description: str


@dataclasses.dataclass
class _Sweep:
    """A search by scrolling.

    Attributes:
        page: path of the page's URL.
        ends: ends of the page that are still to be visited.
        seen: name of the last screenshot.
        offset: last scroll position, CSS pixels.
        idle: how many times in a row the scroll position was the same.
    """

    page: str
    ends: list[Direction]
    seen: str = ""
    offset: float = -1.0
    idle: int = 0


@dataclasses.dataclass
class _Effort:
    """The state of the current move.

    Attributes:
        tries: how often the move was carried out.
        before: the observation before it was carried out; ``None`` unless its effect is still to be checked.
        role: role of the element that was clicked.
        opened: whether the list to choose from was opened.
        waited: whether it has waited for a missing element.
        sweep: the search for a missing element.
    """

    tries: int = 0
    before: Observation | None = None
    role: str = ""
    opened: bool = False
    waited: bool = False
    sweep: _Sweep | None = None


class Solver:
    """Carries out one solution.

    Args:
        website: the URL where the task starts.
        moves: the solution, which ends with an answer.

    Attributes:
        seen: the texts that were searched for and found so far.
        memory: the memory entries that the solution has written so far, in order.
    """

    def __init__(self, website: str, moves: Sequence[Move]) -> None:
        self._website = website
        self._moves = tuple(moves)
        self._position = 0
        self._effort = _Effort()
        self._waits = 0
        self._cleared: dict[str, int] = {}
        self._previous: Observation | None = None
        self._redone: set[int] = set()
        self._reopened = False
        self.seen: list[tuple[str, ...]] = []
        self.memory: dict[str, str] = {}

    @property
    def writes_memory(self) -> bool:
        """Whether the solution writes memory entries."""
        return any(isinstance(move, Remember) for move in self._moves)

    def progress(self) -> dict[str, str]:
        """State of every part of the task; of every move, if the solution does not mark parts."""
        parts = {move.part: index for index, move in enumerate(self._moves) if isinstance(move, Done)}
        if parts:
            return {
                part: "finished" if end < self._position else "not finished" for part, end in parts.items()
            }
        return {
            f"{index + 1}. {in_words(move)}": "finished" if index < self._position else "not finished"
            for index, move in enumerate(self._moves)
        }

    def intention(self) -> str:
        """The key of the current subtask in :meth:`progress`."""
        subtasks = self.progress()
        if len(subtasks) == len(self._moves):
            return list(subtasks)[min(self._position, len(self._moves) - 1)] if subtasks else ""
        return next((part for part, state in subtasks.items() if state != "finished"), list(subtasks)[-1])

    def next(self, observation: Observation, mode: Mode) -> Act:
        """The next action, given the current observation."""
        if self._waits < MAX_WAITS and _is_loading(observation):
            self._waits += 1
            return Act(Wait(LOADING_WAIT_SECONDS), "Wait for the page to load")
        self._waits = 0
        if (given_up := self._check_effect(observation)) is not None:
            return given_up
        while self._position < len(self._moves):
            move = self._moves[self._position]
            if isinstance(move, Give):
                return Act(Answer(move.text), "Give the answer")
            if (act := self._clear(observation, move, mode)) is not None:
                return act
            if not self._is_satisfied(move, observation):
                return self._carry_out_move(move, observation, mode)
            self._finish()
        return _give_up("finish the task")

    # --- checking the last action -----------------------------------------------------------------

    def _check_effect(self, observation: Observation) -> Act | None:
        """Finish the current move if the screen changed; give up if it has not after the last try."""
        before = self._effort.before
        if before is None:
            return None
        self._effort.before = None
        move = self._moves[self._position]
        if (observation.screenshot, observation.url) != (before.screenshot, before.url):
            self._finish(before)
        elif self._effort.tries >= MAX_TRIES:
            if not (isinstance(move, Choose) or self._effort.role in _SELECTABLE_ROLES):
                return _give_up(in_words(move))
            self._finish(before)
        return None

    def _finish(self, before: Observation | None = None) -> None:
        """Continue with the next move; ``before`` is the observation before this one's action, if it had
        one."""
        move = self._moves[self._position]
        if isinstance(move, See):
            self.seen.append(move.texts)
        if isinstance(move, Remember):
            self.memory[move.key] = move.value
        self._previous = before
        self._position += 1
        self._effort = _Effort()

    def _is_satisfied(self, move: Move, observation: Observation) -> bool:
        match move:
            case Remember() | Done():
                return True
            case Home():
                return is_home(observation.url, self._front_page())
            case See(texts=texts):
                return shows_all(observation, texts)
            case Fill(field=field, text=text):
                return _holds_value(find_named(observation, field, TEXT_ROLES), text)
            case Choose(field=field, option=option):
                return _holds_value(find_named(observation, field, LIST_ROLES), option)
            case Click(name=name, path=path):
                if path is not None and path_of(observation.url) == path_of(path):
                    return True
                element = find_click(observation, move)
                if element is None:
                    cleared = name is not None and fold(name) in self._cleared
                    return cleared or self._was_submitted(move, observation)
                return element.role == "radio" and element.value == "true"
            case _:
                return False

    def _was_submitted(self, move: Click, observation: Observation) -> bool:
        """Whether pressing Enter in the move before has already submitted the form of this button."""
        before = self._previous
        if before is None or self._position == 0 or not isinstance(self._moves[self._position - 1], Fill):
            return False
        button = find_click(before, move)
        return button is not None and button.role == "button" and observation.url != before.url

    # --- obstacles --------------------------------------------------------------------------------

    def _clear(self, observation: Observation, move: Move, mode: Mode) -> Act | None:
        visible = self._is_satisfied(move, observation) or self._find(move, observation) is not None
        own = fold(move.name or "") if isinstance(move, Click) else ""
        if visible and own in IN_THE_WAY | IN_THE_WAY_IF_LOST:
            return None  # the move itself dismisses it
        names = IN_THE_WAY if visible else IN_THE_WAY | IN_THE_WAY_IF_LOST
        for element in usable(observation):
            name = fold(element.name)
            tries = self._cleared.get(name, 0)
            if element.role == "button" and name in names and tries < MAX_TRIES:
                self._cleared[name] = tries + 1
                target = target_of(element, observation, mode, at=_POINTS[tries])
                return Act(LeftClick(target), f'Click "{element.name}" to clear what is in the way')
        return None

    def _find(self, move: Move, observation: Observation) -> Element | None:
        match move:
            case Home():
                return find_home(observation, self._front_page())
            case Click():
                return find_click(observation, move)
            case Fill(field=field):
                return find_named(observation, field, TEXT_ROLES)
            case Choose(field=field, option=option):
                chosen = find_named(observation, option, {"option"}) if self._effort.opened else None
                return chosen or find_named(observation, field, LIST_ROLES)
            case _:
                return None

    # --- carrying out a move ----------------------------------------------------------------------

    def _front_page(self) -> str:
        """Front page of the website on which the current move takes place."""
        homes = [move.url for move in self._moves[: self._position + 1] if isinstance(move, Home)]
        return (homes and homes[-1]) or self._website

    def _carry_out_move(self, move: Move, observation: Observation, mode: Mode) -> Act:
        if isinstance(move, Back):
            return self._act(observation, GoBack(), "Go back to the previous page")
        if isinstance(move, Home) and not same_host(observation.url, self._front_page()):
            return self._act(observation, Navigate(self._front_page()), f"Open {self._front_page()}")
        element = self._find(move, observation)
        if element is None:
            return self._search(move, observation, mode)
        self._effort.sweep = None
        target = target_of(element, observation, mode, at=_POINTS[self._effort.tries])
        match move:
            case Fill(text=text):
                return self._act(observation, Type(target, text), f'Type "{text}" into "{element.name}"')
            case Choose(option=option) if element.role != "option":
                if not self._effort.opened:
                    self._effort.opened = True
                    return Act(LeftClick(target), f'Open the list "{element.name}"')
                return self._act(observation, Type(target, option), f'Pick "{option}" by typing it')
            case _:
                self._effort.role = element.role
                named = f'"{element.name}"' if element.name else f"the {element.role}"
                return self._act(observation, LeftClick(target), f"Click {named}")

    def _act(self, observation: Observation, action: Action, description: str) -> Act:
        self._effort.tries += 1
        self._effort.before = observation
        return Act(action, description)

    # --- searching --------------------------------------------------------------------------------

    def _search(self, move: Move, observation: Observation, mode: Mode) -> Act:
        if (direction := self._next_scroll(move, observation)) is not None:
            return Act(Scroll(direction), f"Scroll {direction} to {in_words(move)}")
        if not self._effort.waited:
            self._effort.waited = True
            return Act(Wait(LOADING_WAIT_SECONDS), "Wait in case the page is not complete yet")
        if observation.status in _REFUSED and not self._reopened:
            self._reopened = True
            return Act(
                Navigate(self._front_page()), "Open the front page again: the website refused this page"
            )
        return self._not_found(move, observation, mode)

    def _next_scroll(self, move: Move, observation: Observation) -> Direction | None:
        """Direction of the next scroll; ``None`` once both ends of the page have been visited."""
        page = path_of(observation.url)
        sweep = self._effort.sweep
        is_over = sweep is not None and not sweep.ends and sweep.seen != observation.screenshot
        if sweep is None or sweep.page != page or is_over:  # another page, or more of this one
            sweep = self._effort.sweep = _Sweep(page, _ends(move, observation))
        sweep.idle = sweep.idle + 1 if sweep.offset == observation.scroll[0] else 0
        if sweep.ends and (sweep.seen == observation.screenshot or sweep.idle >= MAX_INNER_SCROLLS):
            sweep.ends.pop(0)
            sweep.idle = 0
        while sweep.ends and _is_at_end(observation, sweep.ends[0]):
            sweep.ends.pop(0)
        sweep.seen, sweep.offset = observation.screenshot, observation.scroll[0]
        return sweep.ends[0] if sweep.ends else None

    def _not_found(self, move: Move, observation: Observation, mode: Mode) -> Act:
        """The element is nowhere on this page: repeat the move before once, then give up."""
        before = self._previous
        last = self._moves[self._position - 1] if self._position else None
        if isinstance(last, Fill) and isinstance(move, Click) and move.role == "button":
            self._finish()  # pressing Enter submitted the form, which is gone
            return self.next(observation, mode)
        is_same_page = before is not None and before.url == observation.url
        if (
            is_same_page
            and self._position not in self._redone
            and isinstance(last, Click | Fill | Choose | Back)
        ):
            self._redone.add(self._position)
            self._position -= 1
            self._effort = _Effort()
            return self.next(observation, mode)
        return _give_up(in_words(move))


def in_words(move: Move) -> str:
    """A move as text, in the form of a subtask."""
    match move:
        case Home(url=url):
            return f"go to {url}" if url else "go to the front page"
        case Click(name=name, role=role, path=path):
            what = f'"{name}"' if name is not None else f"the link to {path}" if path else f"the {role}"
            return f"click {what}"
        case Fill(field=field, text=text):
            return f'fill "{field}" with "{text}"'
        case Choose(field=field, option=option):
            return f'choose "{option}" in "{field}"'
        case See(texts=texts):
            return "see " + " and ".join(f'"{text}"' for text in texts)
        case Back():
            return "go back"
        case Remember(key=key, value=value):
            return f"remember that {key} is {value}"
        case Done(part=part):
            return f"finish part {part}"
        case Give():
            return "give the answer"


def _give_up(what: str) -> Act:
    return Act(Answer(f"I could not {what}."), "Say that it could not be done")


def _is_loading(observation: Observation) -> bool:
    if any(notice.kind == "still_loading" for notice in observation.notices):
        return True
    return not observation.elements and not (observation.text or "").strip()


def _holds_value(element: Element | None, value: str) -> bool:
    return element is not None and element.value is not None and fold(element.value) == fold(value)


def _ends(move: Move, observation: Observation) -> list[Direction]:
    """The ends of the page to visit, the nearer one first.

    A search for texts goes both ways even from the top: they must be in view together, and scrolling back
    stops at other positions. A search for an element that starts at the top only goes down.
    """
    offset, extent = observation.scroll
    if offset <= 1 and not isinstance(move, See | Home):
        return ["down"]
    return ["up", "down"] if 0 < offset < extent - observation.viewport[1] - offset else ["down", "up"]


def _is_at_end(observation: Observation, direction: Direction) -> bool:
    """Whether the page cannot scroll further. ``False`` for a page that does not scroll: a box in it may."""
    offset, extent = observation.scroll
    height = observation.viewport[1]
    if extent <= height + 1:
        return False
    return offset <= 1 if direction == "up" else offset + height >= extent - 1
