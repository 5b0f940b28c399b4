"""One session's steps against a loop that does not wait, in the same browser, round by round in turn.

    .venv/bin/python benchmarks/one_session.py --rounds 12

The page is quiet at once. The bare loop clicks or scrolls and takes a picture, with no pause at all; a step
waits until the page is quiet, and observes. The ratio of the two is taken per pair of rounds: other load on
the machine meets both.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import time
from collections.abc import Awaitable, Callable

from webgym.bench.pages import serving_pages
from webgym.bench.stepping import browser_for, deed
from webgym.browser import Egress, PageOptions, ProfileRoot, Slot
from webgym.browser.actions import perform
from webgym.browser.find import find_browser
from webgym.browser.observe import capture
from webgym.core.action import Navigate

STEPS = 8
"""Per round."""


async def timed(step: Callable[[int], Awaitable[object]]) -> float:
    """Milliseconds per step of one round."""
    start = time.perf_counter()
    for number in range(STEPS):
        await step(number)
    return (time.perf_counter() - start) * 1000 / STEPS


async def measure(rounds: int) -> str:
    """The line that is printed."""
    async with serving_pages() as pages:
        config = browser_for(pages)
        async with Egress(config.egress) as egress:
            slot = Slot(config, find_browser().path, ProfileRoot(), egress)

            async def bare(number: int) -> None:
                slot.page.begin_action()
                await perform(slot.page, deed(number))
                await capture(slot.page)

            async def ours(number: int) -> None:
                await slot.step(deed(number))

            try:
                await slot.open(PageOptions())
                await slot.step(Navigate(pages.url("static")))
                pairs = [(await timed(bare), await timed(ours)) for _ in range(rounds)]
            finally:
                await slot.stop()
    ratios = [theirs / own for theirs, own in pairs]
    theirs, own = (statistics.median(times) for times in zip(*pairs, strict=True))
    return (
        f"bare {theirs:.0f} ms, a step {own:.0f} ms; speed of steps over bare: "
        f"{statistics.median(ratios):.2f} ({min(ratios):.2f}-{max(ratios):.2f} of {rounds} rounds)"
    )


def main() -> None:
    """Print the line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=12)
    print(asyncio.run(measure(parser.parse_args().rounds)))


if __name__ == "__main__":
    main()
