"""Steps of one session compared with a loop that does not wait, in the same browser, in alternating rounds.

Steps with marks, in a second browser, alternate with them. With ``--sessions``, as many sessions of each kind
step at once, so that the processors limit them. With ``--pauses``, there is a random pause before each step,
which does not count: without one, every step begins at the same moment between two ticks of the display
(16.7 ms), and one that takes a little longer than another may end a whole tick later.

    .venv/bin/python benchmarks/one_session.py --rounds 12
    .venv/bin/python benchmarks/one_session.py --rounds 12 --pauses
    .venv/bin/python benchmarks/one_session.py --rounds 12 --sessions 4

The page is settled at once. The bare loop clicks or scrolls and takes a screenshot without a pause; a step
waits until the page is settled, and makes an observation. The ratio is taken per pair of rounds, as other
load on the machine affects both.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import statistics
import time
from contextlib import AsyncExitStack

from webgym.bench.pages import serving_pages
from webgym.bench.stepping import StepFunction, browser_for, click_or_scroll
from webgym.browser.actions import perform
from webgym.browser.config import PageOptions
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.observe import capture
from webgym.browser.page import Page
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Mode, Navigate

STEPS = 8
"""Number of steps per round."""

MODES: tuple[Mode, ...] = ("coordinates", "marks")


PAUSES = (0.02, 0.07)
"""Shortest and longest pause before a step, seconds."""


async def timed(sessions: list[StepFunction], pauses: bool) -> float:
    """Milliseconds per step, mean of a round in which all sessions step at once."""

    async def play(step: StepFunction) -> float:
        paused = 0.0
        for number in range(STEPS):
            if pauses:
                start = time.perf_counter()
                await asyncio.sleep(random.uniform(*PAUSES))
                paused += time.perf_counter() - start
            await step(number)
        return paused

    start = time.perf_counter()
    paused = await asyncio.gather(*map(play, sessions))
    return (time.perf_counter() - start - statistics.mean(paused)) * 1000 / STEPS / len(sessions)


def _bare(page: Page) -> StepFunction:
    async def step(number: int) -> None:
        page.begin_action()
        await perform(page, click_or_scroll(number))
        await capture(page)

    return step


def _stepping(slot: Slot) -> StepFunction:
    return lambda number: slot.step(click_or_scroll(number))


async def measure(rounds: int, sessions: int, pauses: bool) -> str:
    """Measure, and return the lines to print."""
    async with AsyncExitStack() as stack:
        pages = await stack.enter_async_context(serving_pages())
        config = browser_for(pages)
        egress = await stack.enter_async_context(Egress(config.egress))
        slots: dict[Mode, list[Slot]] = {mode: [] for mode in MODES}
        for mode in MODES * sessions:
            slot = Slot(config, find_browser().path, ProfileRoot(), egress)
            stack.push_async_callback(slot.stop)
            await slot.open(PageOptions(mode=mode))
            await slot.step(Navigate(pages.url("static")))
            slots[mode].append(slot)
        plain, marked = slots.values()
        kinds = ([_bare(slot.page) for slot in plain], [*map(_stepping, plain)], [*map(_stepping, marked)])
        times = [[await timed(steps, pauses) for steps in kinds] for _ in range(rounds)]
    bare, step, marks = (statistics.median(column) for column in zip(*times, strict=True))
    return "\n".join(
        (
            f"bare {bare:.0f} ms, a step {step:.0f} ms, with marks {marks:.0f} ms; {rounds} rounds",
            "speed of steps over bare: " + _spread([bare / step for bare, step, _ in times]),
            "speed of steps with marks over those without: "
            + _spread([step / marks for _, step, marks in times]),
        )
    )


def _spread(ratios: list[float]) -> str:
    return f"{statistics.median(ratios):.2f} ({min(ratios):.2f}-{max(ratios):.2f})"


def main() -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--sessions", type=int, default=1)
    parser.add_argument("--pauses", action="store_true")
    given = parser.parse_args()
    print(asyncio.run(measure(given.rounds, given.sessions, given.pauses)))


if __name__ == "__main__":
    main()
