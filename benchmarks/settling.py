"""Are screenshots final on foreign pages? Widgets of npm packages, with random actions and noise.

    .venv/bin/python benchmarks/settling.py --episodes 3 --seed 0 --out settling.jsonl
    .venv/bin/python benchmarks/settling.py --out settling.jsonl --minutes 0
    .venv/bin/python benchmarks/settling.py --watched 0.3 --idle 0.7 --out again.jsonl

An episode opens a page (from `npm_pages/`, or `npm_pages/remote/`, whose server takes 100 to 800 ms per
response) and makes random actions on elements of the observation: clicks, typing, hovers, scrolls, keys.
Two of three episodes have noise. After each step the page is left alone for five seconds; the screenshot
was final if a second one is equal to it, except for what keeps changing after that, such as a carousel.
Where a step used the last picture again, a new one is taken at once: they must be equal to the last pixel.
Trials are stored as they are made, with the screenshots of those that were not final; stored trials are not
repeated.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import random
import statistics
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from npm_pages import CACHE, FILES, PAGES, REMOTE, serving
from numpy.typing import NDArray
from PIL import Image

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import BrowserAction, Hover, LeftClick, Navigate, Press, Scroll, Target, Type, Wait
from webgym.core.errors import WebGymError
from webgym.core.observation import Element, Observation

ACTIONS = 7
"""Number of actions after the page was opened."""

LATER_SECONDS = (0.35, 0.6, 0.95, 3.1)
"""Pauses between further screenshots if the first two differ: carets drawn by pages blink every second."""

WORDS = ("ap", "gra", "berry", "ban", "a", "person 1", "town", "12", "be", "lem")
KEYS = ("ArrowDown", "Escape", "Tab", "Enter", "ArrowRight", "Backspace")
TYPED_INTO = frozenset({"textbox", "searchbox", "combobox", "spinbutton"})
DELAYS = (100, 800)
"""Range of the server's delay, milliseconds."""

LEVELS = 24
"""Least difference of a colour channel, of 255, at which pixels count as different."""

PIXELS = 10
"""Least number of different pixels at which screenshots count as different."""

TILE = 32
"""Size of the squares, in pixels, that are ignored if they keep changing."""

CORNERS = ((0, 24, 1180, 1280), (730, 768, 1240, 1280))
"""Areas in which `noise.js` draws: top, bottom, left, right."""

Mask = NDArray[np.bool_]


class Trial(msgspec.Struct, frozen=True):
    """A step of an episode.

    Attributes:
        key: page, seed and number of the episode, which determine its actions.
        number: index of the step; 0 opened the page.
        deed: kind and target of the action.
        settled: why the wait ended; with a ``!`` if a notice said that the page was still loading.
        seconds: duration of the wait.
        differing: number of different pixels.
        is_same: if the last picture was used again, whether a new one has the same pixels.
    """

    key: str
    number: int
    deed: str
    settled: str
    seconds: float
    differing: int
    is_same: bool | None = None

    @property
    def is_final(self) -> bool:
        return self.differing < PIXELS


# --- actions --------------------------------------------------------------------------------------------


def middle(element: Element, seen: Observation) -> Target:
    x, y, width, height = element.box
    across, down = seen.viewport
    return Target(coordinate=(1000 * (x + width / 2) / across, 1000 * (y + height / 2) / down))


IDLE: dict[str, BrowserAction] = {
    "wait": Wait(0),
    "press Shift": Press(("Shift",)),
    "click corner": LeftClick(Target(coordinate=(998, 998))),
    "hover corner": Hover(Target(coordinate=(998, 998))),
    "scroll up": Scroll("up"),
}
"""Actions that often change nothing."""


def choose(seen: Observation, chance: random.Random, idle: float) -> tuple[str, BrowserAction]:
    """A random action, and its name.

    Args:
        seen: the page.
        chance: where it comes from.
        idle: share of those that often change nothing.
    """
    if idle and chance.random() < idle:
        return chance.choice(list(IDLE.items()))
    elements = seen.elements or ()
    fields = [one for one in elements if one.role in TYPED_INTO]
    kinds = ["click"] * 8 + ["scroll"] * 2 + ["hover"] * 3 + ["press"] * 2 + ["type"] * (7 if fields else 0)
    kind = chance.choice(kinds)
    if kind == "press" or not elements:
        key = chance.choice(KEYS)
        return f"press {key}", Press((key,))
    one = chance.choice(fields if kind == "type" else elements)
    name, target = f"{kind} {one.role} {one.name[:30]!r}", middle(one, seen)
    match kind:
        case "type":
            word, enter = chance.choice(WORDS), chance.random() < 0.3
            return f"{name} {word!r}{' Enter' * enter}", Type(target, word, enter)
        case "hover":
            return name, Hover(target)
        case "scroll":
            side = chance.choice(("down", "down", "up"))
            return f"{name} {side}", Scroll(side, target if chance.random() < 0.6 else None)
    return name, LeftClick(target)


# --- is it final ----------------------------------------------------------------------------------------


def difference(one: bytes, other: bytes) -> Mask:
    """A mask of the pixels that differ between two screenshots."""
    first, second = (
        np.asarray(Image.open(io.BytesIO(each)).convert("RGB"), np.int16) for each in (one, other)
    )
    mask: Mask = (np.abs(first - second) >= LEVELS).any(axis=2)
    for top, bottom, left, right in CORNERS:
        mask[top:bottom, left:right] = False
    return mask


def without(mask: Mask, moving: Mask) -> Mask:
    """A mask without the squares that keep changing and their neighbours."""
    left = mask.copy()
    for row, column in {(y // TILE, x // TILE) for y, x in np.argwhere(moving).tolist()}:
        top, side = max(0, row - 1) * TILE, max(0, column - 1) * TILE
        left[top : (row + 2) * TILE, side : (column + 2) * TILE] = False
    return left


async def differing(slot: Slot, look: bytes, watched: float) -> tuple[int, bytes]:
    """The number of pixels that differ from a screenshot after a while, and the second screenshot."""
    await asyncio.sleep(watched)
    later = (await slot.observe()).image
    mask = difference(look, later)
    moving = np.zeros_like(mask)
    for seconds in LATER_SECONDS if mask.sum() >= PIXELS else ():
        await asyncio.sleep(seconds)
        moving |= difference(later, await slot.screenshot())
    return int(without(mask, moving).sum()), later


class Bench:
    """The remaining episodes, and the file of their trials."""

    def __init__(
        self, plan: list[tuple[str, str]], out: Path, until: float, watched: float, idle: float
    ) -> None:
        self.plan = plan
        self.out = out
        self.until = until
        self.watched = watched
        self.idle = idle
        self.lost = 0

    async def work(self, slot: Slot, address: str) -> None:
        """Run episodes until none is left or the time is up."""
        try:
            while self.plan and time.monotonic() < self.until:
                page, key = self.plan.pop()
                try:
                    trials = await self._play(slot, address, page, key)
                except WebGymError as error:
                    self.lost += 1
                    print(f"{key} failed: {error}")
                    continue
                with self.out.open("ab") as file:
                    file.writelines(msgspec.json.encode(trial) + b"\n" for trial in trials)
        finally:
            await slot.stop()

    async def _play(self, slot: Slot, address: str, page: str, key: str) -> list[Trial]:
        chance = random.Random(key)
        noise = "&noise=1" if chance.random() < 2 / 3 else ""
        url = f"{address}/{page}?ms={chance.randint(*DELAYS)}{noise}"
        await slot.open(PageOptions(elements=True))
        trials: list[Trial] = []
        name: str = "open"
        action: BrowserAction = Navigate(url)
        last = b""
        for number in range(ACTIONS + 1):
            look = await slot.step(action)
            seen = look.observation
            is_same = look.image == (await slot.observe()).image if look.image is last else None
            pixels, last = await differing(slot, look.image, self.watched)
            is_told = any(notice.kind == "still_loading" for notice in seen.notices)
            settled, seconds = seen.settled + "!" * is_told, seen.seconds("settle")
            trial = Trial(key, number, name, settled, seconds, pixels, is_same)
            if not trial.is_final or is_same is False:
                self._keep(trial, look.image, last)
            trials.append(trial)
            name, action = choose(seen, chance, self.idle)
        return trials

    def _keep(self, trial: Trial, look: bytes, later: bytes) -> None:
        folder = self.out.with_suffix(".misses")
        folder.mkdir(exist_ok=True)
        for name, picture in (("look", look), ("later", later)):
            (folder / f"{trial.key.replace('/', '-')}-{trial.number}-{name}.png").write_bytes(picture)


# --- the table ------------------------------------------------------------------------------------------


def read(out: Path) -> list[Trial]:
    """Read the stored trials."""
    lines = out.read_bytes().splitlines() if out.exists() else []
    return [msgspec.json.decode(line, type=Trial) for line in lines]


def table(trials: Sequence[Trial]) -> Iterator[str]:
    """A Markdown table, and a line for each trial that was not final."""
    yield "| deed | trials | final | or told | wait p50 | p95 |"
    yield "| --- | ---: | ---: | ---: | ---: | ---: |"
    kinds = Counter(trial.deed.split()[0] for trial in trials)
    for kind in ("all", *sorted(kinds)):
        own = [trial for trial in trials if kind in ("all", trial.deed.split()[0])]
        cuts = statistics.quantiles([trial.seconds for trial in own] * 2, n=20)
        final = sum(trial.is_final for trial in own)
        told = sum(trial.is_final or trial.settled.endswith("!") for trial in own)
        shares = f"{final / len(own):.1%} | {told / len(own):.1%}"
        yield f"| {kind} | {len(own)} | {shares} | {cuts[9]:.2f} s | {cuts[18]:.2f} s |"
    again = [trial.is_same for trial in trials if trial.is_same is not None]
    yield f"{len(again)} pictures were used again, {sum(again)} of them equal to a new one"
    for trial in trials:
        if not trial.is_final:
            yield f"{trial.key} {trial.number}: {trial.deed}; {trial.settled}, {trial.differing} pixels"


async def run(given: argparse.Namespace) -> None:
    done = {trial.key for trial in read(given.out)}
    keys = [(page, f"{page} {given.seed} {n}") for n in range(given.episodes) for page in given.pages]
    plan = [(page, key) for page, key in keys if key not in done]
    random.Random(given.seed).shuffle(plan)
    bench = Bench(plan, given.out, time.monotonic() + 60 * given.minutes, given.watched, given.idle)
    with serving(given.cache) as address:
        async with Egress(EgressConfig(allow=("127.0.0.1",))) as egress, asyncio.TaskGroup() as group:
            for _ in range(given.slots):
                slot = Slot(BrowserConfig(freeze=False), find_browser().path, ProfileRoot(), egress)
                group.create_task(bench.work(slot, address))
    print(f"{len(bench.plan)} episodes are left, {bench.lost} failed")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "--pages", nargs="+", default=[*PAGES["first"], *REMOTE], choices=FILES, metavar="PAGE"
    )
    parser.add_argument("--episodes", type=int, default=3, help="episodes per page")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--slots", type=int, default=6)
    parser.add_argument(
        "--minutes", type=float, default=60.0, help="time after which no more episodes are started"
    )
    parser.add_argument(
        "--watched", type=float, default=5.0, help="time after which a second screenshot is taken, seconds"
    )
    parser.add_argument("--idle", type=float, default=0.0, help="share of actions that often change nothing")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of the npm packages")
    parser.add_argument("--out", type=Path, required=True, help="file of the trials, JSON lines")
    given = parser.parse_args()
    asyncio.run(run(given))
    print("\n".join(table(read(given.out))))


if __name__ == "__main__":
    main()
