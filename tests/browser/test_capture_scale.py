"""Smaller pictures: what they show, what is clicked by them, and what they are compared with."""

from __future__ import annotations

import io
from typing import Any

import pytest
from PIL import Image

from webgym.browser.config import BrowserConfig
from webgym.core.action import LeftClick, Mode, Scroll, Target

from .conftest import MODES, VIEWPORT, Open, Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

BANDS = "".join(
    f"<button style='position:absolute;left:0;top:{100 * n}px;width:3000px;height:100px;border:0;"
    f"background:rgb({n * 8},90,{250 - n * 8})' onclick='document.title += \" {n}\"'></button>"
    for n in range(30)
)


def pixel(image: bytes, x: float, y: float, scale: float) -> Any:
    """The colour at a point of the page, CSS pixels."""
    picture = Image.open(io.BytesIO(image)).convert("RGB")
    assert picture.size == tuple(round(side * scale) for side in VIEWPORT)
    return picture.getpixel((round(x * scale), round(y * scale)))


@MODES
@pytest.mark.parametrize("scale", [0.25, 0.5, 0.7])
async def test_a_small_picture_shows_the_same_and_is_clicked_the_same(
    site: Site, open_tab: Open, mode: Mode, scale: float
) -> None:
    tab = await open_tab(mode, viewport=VIEWPORT, capture_scale=scale)
    seen = await tab.goto(site.page(f"<title>.</title>{BANDS}"))
    for action in (None, Scroll("down"), Scroll("right"), Scroll("down"), Scroll("up")):
        seen = await tab.step(action)
        offset = seen.observation.scroll[0]
        for y in (30, 330, 570):
            band = int((y + offset) // 100)
            if abs((y + offset) % 100 - 50) < 40:  # far from an edge, and from a frame drawn around it
                assert pixel(seen.image, 500, y, scale) == (band * 8, 90, 250 - band * 8)
    element = next(iter(seen.observation.elements or ()), None)
    target = Target(element=element.number) if element else Target(coordinate=(600, 500))
    middle = element.box[1] + element.box[3] / 2 if element else VIEWPORT[1] / 2
    after = await tab.step(LeftClick(target))
    assert after.observation.title == f". {int((middle + seen.observation.scroll[0]) // 100)}"
    assert after.observation.viewport == VIEWPORT
    assert after.observation.picture_size == Image.open(io.BytesIO(after.image)).size


async def test_marks_are_drawn_where_things_lie_on_the_small_picture(site: Site, open_tab: Open) -> None:
    box = "<button style='position:fixed;left:200px;top:300px;width:200px;height:100px'>Do</button>"
    tab = await open_tab("marks", viewport=VIEWPORT, capture_scale=0.5)
    await tab.goto(site.page(box))
    seen = await tab.step()
    bare = await tab.slot.screenshot()
    assert tab.find("Do").box == (200, 300, 200, 100)
    frame = pixel(seen.image, 300, 298, 0.5)
    assert pixel(bare, 300, 298, 0.5) == (255, 255, 255)
    assert frame != (255, 255, 255)
    assert pixel(seen.image, 300, 402, 0.5) == pixel(seen.image, 198, 350, 0.5) == frame
    assert pixel(seen.image, 300, 350, 0.5) == pixel(bare, 300, 350, 0.5)


async def test_the_server_says_how_small_and_a_session_otherwise(site: Site, open_tab: Open) -> None:
    config = BrowserConfig(capture_scale=0.5)
    for given, scale in ((None, 0.5), (1.0, 1.0)):
        tab = await open_tab(config=config, viewport=VIEWPORT, capture_scale=given)
        seen = await tab.goto(site.page("Text"))
        assert seen.observation.capture_scale == scale
        assert Image.open(io.BytesIO(seen.image)).size == tuple(round(side * scale) for side in VIEWPORT)


@pytest.mark.parametrize("y", [50, 550])
async def test_a_point_on_a_small_picture_is_compared_with_the_page(
    site: Site, open_tab: Open, y: int
) -> None:
    """What has changed at the top is told to those alone who click there."""
    page = "<div id=d style='height:100px'></div><script>turn = () => d.style.background = 'red'</script>"
    tab = await open_tab(viewport=VIEWPORT, capture_scale=0.5)
    await tab.goto(site.page(page))
    call = {"expression": "turn()"}
    await tab.slot.page.session.do("Runtime.evaluate", call, seconds=5)
    seen = await tab.step(LeftClick(Target(coordinate=(500, y * 1000 / VIEWPORT[1]))))
    told = [notice.kind for notice in seen.observation.notices if notice.kind == "changed"]
    assert bool(told) == (y == 50)


async def test_a_page_does_not_see_that_its_picture_is_small(site: Site, open_tab: Open) -> None:
    page = (
        f"{BANDS}<script>let seen = ''; for (const target of [window, document, visualViewport])"
        "for (const name of ['resize', 'scroll']) target.addEventListener(name, () => document.title += name)"
        "\n"
        "new ResizeObserver(() => document.title += 'size').observe(document.documentElement);"
        "matchMedia('(resolution: 1dppx)').onchange = () => document.title += 'dots'</script>"
    )
    tab = await open_tab(viewport=VIEWPORT, capture_scale=0.25)
    first = await tab.goto(site.page(page))
    for _ in range(3):
        later = await tab.step()
    assert later.observation.title == first.observation.title == "size"
