"""An episode of a task, with the functions of solvers: read the page, point, act."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any, TypeAlias

import msgspec

from webgym.agent.computer_use import Refused, from_arguments, to_arguments
from webgym.browser.config import PageOptions
from webgym.browser.slot import Slot
from webgym.core.action import (
    GRID,
    Answer,
    BrowserAction,
    DoubleClick,
    Drag,
    Hover,
    LeftClick,
    Mode,
    Modifier,
    Navigate,
    Press,
    RightClick,
    Scroll,
    Side,
    Space,
    Target,
    Type,
    Wait,
)
from webgym.core.observation import Element, Observation

CALL_SECONDS = 20.0
MAX_STEPS = 100
EPISODE_MILLISECONDS = 2**31 - 1
"""Time limit of episodes: the greatest value of a timer. That of the pages is for people and fast scripts."""

Box: TypeAlias = tuple[float, float, float, float]
Point: TypeAlias = tuple[float, float]

BESIDE = "beside what has opened"

FIND = """(css, text) => [...document.querySelectorAll(css)].filter(one => {
    const style = getComputedStyle(one);
    return one.getClientRects().length && style.visibility !== 'hidden' &&
        (text === null || (one.textContent || one.value || '').replace(/\\s+/g, ' ').trim() === text);
}).map(one => { const box = one.getClientRects()[0]; return [box.x, box.y, box.width, box.height]; })"""

WATCH = """window.__pushed = [];
new MutationObserver(changes => changes.forEach(({target, oldValue}) => {
    if (target.classList.contains('push') && !/push/.test(oldValue)) __pushed.push(target.dataset.button);
})).observe(document, {attributeFilter: ['class'], attributeOldValue: true, subtree: true});
if (window.shapes) {
    const render = shapes.renderGrid;
    shapes.renderGrid = (svg, grid) => { window.__grid = grid; return render(svg, grid); };
}"""
"""Script that records what a person sees in the picture: elements that light up, shapes that are drawn."""


class MissingMark(Exception):
    """An element that the task requires has no mark."""


class OutOfSpace(Exception):
    """The script requires an action or a kind of target that the action space does not have."""


class Unsolved(Exception):
    """A solver cannot continue on the page."""


class Finished(Exception):
    """The page has given a reward, so the episode has ended."""


@dataclass(frozen=True)
class At:
    """An element of the page: by a selector, its text, and its index among the matching elements."""

    css: str
    text: str | None = None
    index: int = 0


Where: TypeAlias = str | At | Element | Point


class _Value(msgspec.Struct):
    value: Any = None


class _Result(msgspec.Struct):
    result: _Value
    exceptionDetails: Any = None  # noqa: N815 - the protocol's name


def middle(box: Box) -> Point:
    x, y, width, height = box
    return x + width / 2, y + height / 2


def is_inside(point: Point, box: Box) -> bool:
    x, y, width, height = box
    return x <= point[0] <= x + width and y <= point[1] <= y + height


def overlap(one: Box, other: Box) -> float:
    """The intersection over union of two boxes."""
    wide = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    tall = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    common = max(wide, 0) * max(tall, 0)
    return common / max(one[2] * one[3] + other[2] * other[3] - common, 1e-9)


class Episode:
    """An episode of a task. Actions are those of agents; reading uses the document of the page.

    In marks mode, a click requires the mark of the element. In the extended action space, the target of a
    drag, a hover, or a place in a drawing may be a point; see ``docs/actions.md``.

    Raises:
        Finished: by every action after which the page has given a reward.
        MissingMark: by actions, if the target has no mark.
        OutOfSpace: by actions that the action space does not have.
        Unsolved: if the page is not as expected, or the episode takes too many steps.
    """

    def __init__(self, slot: Slot, mode: Mode, space: Space) -> None:
        self.slot = slot
        self.space = space
        self.options = PageOptions(mode=mode, text=True, elements=True)
        self.seen: Observation | None = None
        self.steps = 0
        self.query = ""
        self.fields: dict[str, str] = {}
        """The values that the instruction asks for, as given by the page, if the instruction is free text."""

    async def start(self, url: str, seed: int) -> None:
        """Open the page and start its task."""
        await self.slot.open(self.options)
        await self.slot.step(Navigate(url))
        await self.js(WATCH)
        await self.js(f"core.EPISODE_MAX_TIME = {EPISODE_MILLISECONDS}; Math.seedrandom({seed})")
        await self.js("core.startEpisodeReal()")
        self.seen = (await self.slot.step(Wait(0))).observation  # waits until the page is settled
        utterance = await self.js("core.getUtterance()")
        if isinstance(utterance, dict):
            self.fields = utterance["fields"]
            utterance = utterance["utterance"]
        self.query = utterance

    async def js(self, expression: str) -> Any:
        """Evaluate an expression in the page."""
        params = {"expression": expression, "returnByValue": True}
        session = self.slot.page.session
        answer = await session.call("Runtime.evaluate", params, reply=_Result, seconds=CALL_SECONDS)
        if answer.exceptionDetails:
            raise Unsolved(f"{expression[:80]}: {answer.exceptionDetails['exception'].get('description')}")
        return answer.result.value

    async def reward(self) -> float | None:
        """The reward of the page in [-1, 1], without the deduction for time; ``None`` before it is given."""
        reward: float | None = await self.js("WOB_DONE_GLOBAL ? WOB_RAW_REWARD_GLOBAL : null")
        return reward

    async def look(self) -> Observation:
        self.seen = (await self.slot.step()).observation
        return self.seen

    async def act(self, action: BrowserAction) -> None:
        self.steps += 1
        if self.steps > MAX_STEPS:
            raise Unsolved(f"more than {MAX_STEPS} steps")
        try:
            parsed = from_arguments(to_arguments(action), self.options.mode, space=self.space)
        except Refused as refused:
            raise OutOfSpace(refused.message) from None
        assert not isinstance(parsed, Answer)
        self.seen = (await self.slot.step(parsed)).observation
        if await self.reward() is not None:
            raise Finished

    # --- reading ------------------------------------------------------------------------------------

    async def boxes(self, css: str, text: str | None = None) -> list[Box]:
        """The boxes of the visible elements of a selector."""
        boxes = await self.js(f"({FIND})({json.dumps(css)}, {json.dumps(text)})")
        return [(x, y, width, height) for x, y, width, height in boxes]

    async def box(self, where: Where) -> Box:
        if isinstance(where, Element):
            return where.box
        if isinstance(where, tuple):
            return (*where, 0, 0)
        at = At(where) if isinstance(where, str) else where
        found = await self.boxes(at.css, at.text)
        if len(found) <= at.index:
            raise Unsolved(f"no {at}")
        return found[at.index]

    async def shows(self, css: str, text: str | None = None) -> bool:
        return bool(await self.boxes(css, text))

    async def texts(self, css: str) -> list[str]:
        """The texts of elements, with normalised white space."""
        script = f"[...document.querySelectorAll({json.dumps(css)})].map(one => one.textContent)"
        return [re.sub(r"\s+", " ", text).strip() for text in await self.js(script)]

    def quoted(self) -> list[str]:
        """The texts in double quotes in the instruction."""
        return re.findall(r'"([^"]*)"', self.query)

    def asked(self, pattern: str) -> tuple[str, ...]:
        """The groups of a pattern in the instruction."""
        found = re.search(pattern, self.query)
        if not found:
            raise Unsolved(f"the instruction is {self.query!r}")
        return found.groups()

    # --- pointing -----------------------------------------------------------------------------------

    def at_point(self, point: Point) -> Target:
        wide, tall = self.options.viewport
        x, y = point[0] / wide * GRID, point[1] / tall * GRID
        return Target(coordinate=(min(max(x, 0), GRID), min(max(y, 0), GRID)))

    def mark(self, box: Box) -> Element | None:
        """The marked element that covers a box best, if one overlaps with it."""
        assert self.seen is not None
        fitting = [
            one
            for one in self.seen.elements or ()
            if is_inside(middle(one.box), box) or is_inside(middle(box), one.box)
        ]
        return max(fitting, key=lambda one: overlap(one.box, box), default=None)

    def beside(self) -> Element | None:
        """The mark beside something that has opened, which a click closes."""
        assert self.seen is not None
        return next((one for one in self.seen.elements or () if one.name == BESIDE), None)

    async def target(self, where: Where, *, or_point: bool = False) -> Target:
        """The target of an action, in the mode of the episode."""
        if isinstance(where, tuple):
            return self.at_point(where)
        box = await self.box(where)
        if self.options.mode == "coordinates":
            return self.at_point(middle(box))
        mark = self.mark(box)
        if mark is None and not or_point:
            raise MissingMark(f"{where}")
        return Target(element=mark.number) if mark else self.at_point(middle(box))

    # --- acting -------------------------------------------------------------------------------------

    async def click(self, where: Where, *modifiers: Modifier) -> None:
        await self.act(LeftClick(await self.target(where), modifiers))

    async def click_text(self, css: str, text: str, index: int = 0) -> None:
        await self.click(At(css, text, index))

    async def double_click(self, where: Where) -> None:
        await self.act(DoubleClick(await self.target(where)))

    async def right_click(self, where: Where) -> None:
        await self.act(RightClick(await self.target(where)))

    async def hover(self, where: Where) -> None:
        await self.act(Hover(await self.target(where, or_point=True)))

    async def move(self, where: Where) -> None:
        """Move the mouse; in the paper's space by a click, so only where a click has no effect."""
        await (self.click(where) if self.space == "paper" else self.hover(where))

    async def drag(self, start: Where, end: Where, *between: Point) -> None:
        path = tuple(self.at_point(point).coordinate or (0, 0) for point in between)
        start_target = await self.target(start, or_point=True)
        await self.act(Drag(start_target, await self.target(end, or_point=True), path))

    async def type(self, where: Where, text: str, *, enter: bool = False) -> None:
        """Type text into an element. In the paper's space, Enter is always pressed at the end."""
        await self.act(Type(await self.target(where), text, enter or self.space == "paper"))

    async def press(self, *keys: str) -> None:
        await self.act(Press(keys))

    async def scroll(self, side: Side, where: Where) -> None:
        """Scroll at a place; in the paper's space, anywhere on the page."""
        await self.act(
            Scroll(side, None if self.space == "paper" else await self.target(where, or_point=True))
        )

    async def wait(self, seconds: float) -> None:
        await self.act(Wait(seconds))

    async def choose(self, css: str, text: str) -> None:
        """Choose an option of a drop-down list."""
        await self.click(css)
        assert self.seen is not None
        for _ in range(20):
            options = [one for one in self.seen.elements or () if one.role == "option"]
            fitting = [one for one in options if one.name == text]
            if fitting:
                await self.click(fitting[0])
                return
            if not options:
                break
            await self.scroll("down", options[0])
        raise Unsolved(f"no option {text!r}")

    async def submit(self) -> None:
        await self.click_text("button", "Submit")
