"""Pages that change between the picture and the action: what is pressed, and what the agent is told.

    .venv/bin/python -m benchmarks.moved
    .venv/bin/python -m benchmarks.moved --cases 100 --mode marks --seed 7

Every case is a page made from a seed: rows with the same buttons, cards, a toolbar, fields that are called
the same, in the page, in a frame, a shadow root or a box that scrolls. After the picture was taken the page
inserts, removes, re-sorts, redraws, renames, covers or moves something. Then the agent presses, or types
into, what it chose in the picture. What was hit is told by the page itself: the row it belongs to and what
it does, as they are written at that moment.

A press is wrong if it hits something else than what was chosen. Exit code 1 if one is wrong without a notice.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.types import Receive, Scope, Send
from tests.serving import serving

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import BrowserAction, LeftClick, Mode, Navigate, Target, Type
from webgym.core.observation import Element

VIEWPORT: Final = (800, 600)
CITIES: Final = ("Paris", "Oslo", "Rome", "Lima", "Cairo", "Quito", "Delhi", "Turin", "Bern", "Riga")
KINDS: Final = ("Choose", "Edit", "Delete", "More")
LAYOUTS: Final = ("list", "table", "cards", "toolbar", "fields", "flat")
PLACES: Final = ("page", "frame", "shadow", "box")
CHANGES: Final = (
    "nothing", "banner", "insert", "remove_chosen", "remove_other", "resort", "redraw", "redraw_sorted",
    "recycle", "rename", "swap_kinds", "cover", "scroll", "slide", "clone", "picture", "count",
)  # fmt: skip

_PAGE: Final = Path(__file__).with_suffix(".html").read_text("utf-8")


class Case(msgspec.Struct, frozen=True):
    """A page, what is chosen in it and how it changes, all made from a seed."""

    seed: int
    layout: str
    place: str
    change: str
    cities: tuple[str, ...]
    sorted: tuple[str, ...]
    kinds: tuple[str, ...]
    chosen: str
    height: int


class Result(msgspec.Struct, frozen=True):
    """What came of a case.

    Attributes:
        case: the case.
        pressed: what was hit, as the page tells it; ``None`` for nothing.
        notices: the kinds of notices that the agent got.
    """

    case: Case
    pressed: str | None
    notices: frozenset[str]

    @property
    def verdict(self) -> str:
        """``right``, ``told`` (something else or nothing was hit, with a notice), ``missed`` (nothing was
        hit, without one) or ``wrong``."""
        if self.pressed == self.case.chosen:
            return "right"
        if self.notices:
            return "told"
        return "missed" if self.pressed is None else "wrong"


def make_case(seed: int) -> Case:
    """The case of a seed."""
    rng = random.Random(seed)
    layout = rng.choice(LAYOUTS)
    cities = tuple(rng.sample(CITIES, rng.randint(3, 6)))
    while (resorted := tuple(rng.sample(cities, len(cities)))) == cities:
        pass
    kinds = tuple(rng.sample(KINDS, rng.randint(1, 3)))
    return Case(
        seed=seed,
        layout=layout,
        place=rng.choice(PLACES),
        change=rng.choice(CHANGES),
        cities=cities,
        sorted=resorted,
        kinds=kinds,
        chosen=f"{rng.choice(cities)}|{rng.choice(kinds)}",
        height=rng.choice((24, 40, 60, 90)),
    )


def page_of(case: Case) -> str:
    """The page of a case."""
    return _PAGE.replace("GIVEN", msgspec.json.encode(case).decode())


class Pages:
    """The cases' pages, by seed."""

    def __init__(self, port: int) -> None:
        self.port = port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        case = make_case(int(Request(scope, receive).url.path.strip("/") or 0))
        await HTMLResponse(page_of(case))(scope, receive, send)


class _Value(msgspec.Struct):
    value: Any = None


class _Evaluated(msgspec.Struct):
    result: _Value


async def _evaluate(slot: Slot, expression: str) -> Any:
    params = {"expression": expression, "returnByValue": True}
    done = await slot.page.session.call("Runtime.evaluate", params, reply=_Evaluated, seconds=30)
    return done.result.value


def _chosen(case: Case, elements: Sequence[Element]) -> Element:
    """The element that a person who looks at the picture means."""
    city, kind = case.chosen.split("|")
    name = f"{kind} {city}" if case.layout == "toolbar" else kind
    same = [element for element in elements if element.name == name]
    return same[0 if case.layout == "toolbar" else case.cities.index(city)]


async def run_case(slot: Slot, url: str, case: Case, mode: Mode) -> Result:
    """Open the page in the slot's episode, have it change, act."""
    look = await slot.step(Navigate(url))
    element = _chosen(case, look.observation.elements or ())
    x, y, width, height = element.box
    point = ((x + width / 2) / VIEWPORT[0] * 1000, (y + height / 2) / VIEWPORT[1] * 1000)
    target = Target(element=element.number) if mode == "marks" else Target(coordinate=point)
    await _evaluate(slot, "change()")
    action: BrowserAction = (
        Type(target, "secret", enter=False) if case.layout == "fields" else LeftClick(target)
    )
    look = await slot.step(action)
    kinds = frozenset(notice.kind for notice in look.observation.notices)
    return Result(case, await _evaluate(slot, "window.pressed"), kinds)


async def _run(seeds: Sequence[int], mode: Mode) -> list[Result]:
    results = []
    with tempfile.TemporaryDirectory() as folder:
        async with (
            serving(Pages, lambda pages: pages) as pages,
            Egress(EgressConfig(allow=("127.0.0.1",))) as egress,
        ):
            slot = Slot(BrowserConfig(), find_browser().path, ProfileRoot(Path(folder)), egress)
            try:
                await slot.open(PageOptions(mode=mode, elements=True, viewport=VIEWPORT))
                for seed in seeds:
                    url = f"http://127.0.0.1:{pages.port}/{seed}"
                    results.append(await run_case(slot, url, make_case(seed), mode))
            finally:
                await slot.stop()
    return results


def _table(results: Sequence[Result]) -> str:
    verdicts = ("right", "told", "missed", "wrong")
    counts = Counter((result.case.change, result.verdict) for result in results)
    lines = [f"{'':16}" + "".join(f"{verdict:>8}" for verdict in verdicts)]
    lines += [
        f"{change:16}" + "".join(f"{counts[change, verdict]:8}" for verdict in verdicts) for change in CHANGES
    ]
    total = Counter(result.verdict for result in results)
    lines.append(f"{'all':16}" + "".join(f"{total[verdict]:8}" for verdict in verdicts))
    return "\n".join(lines)


def main() -> int:
    """Run the cases of both modes and print what came of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=1000, help="cases of each mode (default: 1000)")
    parser.add_argument("--mode", choices=["marks", "coordinates"], help="only this mode")
    parser.add_argument("--seed", type=int, default=0, help="of the first case (default: 0)")
    given = parser.parse_args()
    modes: tuple[Mode, ...] = (given.mode,) if given.mode else ("marks", "coordinates")
    silent = 0
    for mode in modes:
        results = asyncio.run(_run(range(given.seed, given.seed + given.cases), mode))
        print(f"{mode}, {len(results)} cases\n{_table(results)}\n")
        for result in results:
            if result.verdict in ("wrong", "missed"):
                case = msgspec.json.encode(result.case).decode()
                print(f"{result.verdict}: {case} pressed {result.pressed}")
        silent += sum(result.verdict == "wrong" for result in results)
    print(f"wrong without a notice: {silent}")
    return 1 if silent else 0


if __name__ == "__main__":
    sys.exit(main())
