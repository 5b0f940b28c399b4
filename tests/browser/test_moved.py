"""A page that changes between the picture and the action: nothing else than what was chosen is hit unsaid.

One case of every change here; ``python -m benchmarks.moved`` has a thousand.
"""

from __future__ import annotations

import asyncio
import itertools

import pytest
from benchmarks.moved import CHANGES, Case, make_case, page_of, run_case

from webgym.core.action import LeftClick, Mode

from .conftest import Open, Site
from .test_marks import evaluate

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

HARMLESS = (
    "nothing",
    "banner",
    "insert",
    "remove_other",
    "resort",
    "redraw",
    "scroll",
    "slide",
    "clone",
    "count",
)
"""Changes after which the chosen element is still there, perhaps elsewhere."""


def cases() -> list[Case]:
    """The first case of every change that several rows with several buttons can tell."""
    every = (case for seed in itertools.count() if len((case := make_case(seed)).kinds) > 1)
    found: dict[str, Case] = {}
    while len(found) < len(CHANGES):
        case = next(every)
        found.setdefault(case.change, case)
    return list(found.values())


@pytest.mark.parametrize("mode", ["marks", "coordinates"])
async def test_what_is_hit_is_what_was_chosen_or_the_agent_is_told(
    site: Site, open_tab: Open, mode: Mode
) -> None:
    tab = await open_tab(mode)
    results = [await run_case(tab.slot, site.page(page_of(case)), case, mode) for case in cases()]
    verdicts = {result.case.change: result.verdict for result in results}
    assert not {change for change, verdict in verdicts.items() if verdict in ("wrong", "missed")}, verdicts
    assert verdicts["nothing"] == verdicts["count"] == "right"
    if mode == "marks":
        assert {verdicts[change] for change in HARMLESS} == {"right"}, verdicts
        assert {verdicts[change] for change in ("remove_chosen", "rename", "recycle", "cover")} == {"told"}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("one.remove()", "element {n} is not on this page any more; nothing was done"),
        ("one.style.visibility = 'hidden'", "element {n} is covered by something now; nothing was done"),
        ("one.textContent = 'Pay'", 'element {n} was "Keep 3" and is "Pay" now; nothing was done'),
        ("document.body.inert = true", "element {n} is covered by something now; nothing was done"),
    ],
)
async def test_an_element_that_cannot_be_acted_on_is_not(
    site: Site, open_tab: Open, change: str, told: str
) -> None:
    tab = await open_tab("marks")
    await tab.goto(
        site.page("<button id=one onclick='document.title = 1'>Keep 3</button><button>Other</button>")
    )
    target = tab.at("Keep 3")
    await evaluate(tab, change)
    look = await tab.step(LeftClick(target))
    assert tab.notices == [("action_failed", told.format(n=target.element))]
    assert look.observation.title == ""


async def test_an_element_that_counts_is_acted_on_and_the_agent_is_told(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(site.page("<button id=one onclick='document.title = 1'>Keep 3</button>"))
    target = tab.at("Keep 3")
    await evaluate(tab, "one.textContent = 'Keep 2'")
    look = await tab.step(LeftClick(target))
    assert look.observation.title == "1"
    assert tab.notices == [
        ("changed", f'element {target.element} was "Keep 3" in the picture and is "Keep 2" now')
    ]


@pytest.mark.parametrize("delay", [0, 10, 25])
async def test_a_banner_that_comes_during_the_click_is_told_or_makes_no_difference(
    site: Site, open_tab: Open, delay: int
) -> None:
    """The browser's own event tells what was hit, however late the page changes."""
    tab = await open_tab("marks")
    buttons = (
        "<button onclick='document.title += 1'>Keep</button><br><button onclick='document.title += 2'>Delete"
    )
    await tab.goto(site.page(f"<style>button {{ height: 60px }}</style>{buttons}"))
    target = tab.at("Keep")
    await evaluate(tab, f"setTimeout(() => document.body.style.marginTop = '-50px', {delay}); 0")
    look = await tab.step(LeftClick(target))
    assert look.observation.title == "1" or tab.notices


async def test_what_came_while_the_page_stood_still_has_its_turn_first(site: Site, open_tab: Open) -> None:
    """A timer that was due while the processes were stopped fires before the agent's next action lands."""
    tab = await open_tab("marks")
    buttons = (
        "<button onclick='document.title += 1'>Keep</button><br><button onclick='document.title += 2'>Delete"
    )
    await tab.goto(site.page(f"<style>button {{ height: 60px }}</style>{buttons}"))
    target = tab.at("Keep")
    await evaluate(tab, "setTimeout(() => document.body.style.marginTop = '60px', 20); 0")
    with tab.slot.asleep():
        await asyncio.sleep(0.05)
    look = await tab.step(LeftClick(target))
    assert (look.observation.title, tab.notices) == ("1", [])


async def test_an_element_of_another_origin_is_found_again(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    inner = site.elsewhere(site.page("<button onclick='this.textContent = `pressed`'>In</button>"))
    await tab.goto(site.page(f"<button>Out</button><iframe src={inner} height=200></iframe>"))
    target = tab.at("In")
    await evaluate(tab, "document.body.insertAdjacentHTML('afterbegin', '<p style=height:150px>')")
    await tab.step(LeftClick(target))
    assert tab.notices == []
    tab.find("pressed")
    await evaluate(tab, "document.querySelector('iframe').remove()")
    await tab.step(LeftClick(target))
    assert tab.notices == [
        ("action_failed", f"element {target.element} is not on this page any more; nothing was done")
    ]
