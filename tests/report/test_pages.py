"""The report in a real browser, from a file and from a server."""

from __future__ import annotations

import asyncio
import io
import re
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from PIL import Image, ImageStat
from playwright.async_api import Browser, Locator, Page, expect

from webgym.core.trajectory import Trajectory
from webgym.report.config import ReportConfig, ViewConfig
from webgym.report.live import serve_view
from webgym.report.write import write_report
from webgym.store.runs import RunReader, RunWriter

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


@pytest.fixture(scope="module")
def report(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = shutil.copytree(run_folder, tmp_path_factory.mktemp("report") / "run")
    return write_report(run, config=ReportConfig(embed=True, image_width=400))


@asynccontextmanager
async def opened(browser: Browser, url: str, **options: Any) -> AsyncIterator[Page]:
    """A page that must not complain."""
    context = await browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
    page = await context.new_page()
    said: list[str] = []
    page.on(
        "console", lambda message: said.append(message.text) if message.type in ("error", "warning") else None
    )
    page.on("pageerror", lambda error: said.append(str(error)))
    await page.goto(url)
    yield page
    assert said == []
    assert await page.evaluate("window.pwned") is None
    await context.close()


def attempt(run: Path, sample: int) -> Trajectory:
    return next(t for t in RunReader(run).trajectories() if t.episode.sample == sample)


def address(report: Path, run: Path, sample: int, step: int = 1) -> str:
    return f"{report.as_uri()}#/t/{quote(attempt(run, sample).episode.attempt_id, safe='')}/{step}"


async def box_of(locator: Locator) -> dict[str, float]:
    box = await locator.bounding_box()
    assert box is not None
    return {name: float(box[name]) for name in ("x", "y", "width", "height")}


async def loaded(page: Page, width: int) -> None:
    """Until the large picture is there, so many pixels wide."""
    await expect(page.locator(".stage img")).to_have_js_property("naturalWidth", width)


# --- the list ----------------------------------------------------------------------------------------


async def test_the_list_shows_the_run(browser: Browser, report: Path) -> None:
    async with opened(browser, report.as_uri()) as page:
        await expect(page.locator("h1")).to_have_text("run")
        await expect(page.locator(".tiles")).to_contain_text("Success rate57.1%")  # 4 of 7
        await expect(page.locator("tbody#rows-body tr")).to_have_count(12)
        legend = page.locator(".legend button")
        await expect(legend).to_have_count(8)
        counts = [int(re.sub(r"\D", "", text)) for text in await legend.all_inner_texts()]
        assert sum(counts) == 12
        await expect(page.locator(".losses tbody tr")).to_have_count(5)
        width = await page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert width[0] <= width[1]


async def test_search_filters_and_order(browser: Browser, report: Path) -> None:
    async with opened(browser, report.as_uri()) as page:
        lines = page.locator("#rows-body tr")
        await page.get_by_role("searchbox").fill("FERNHILL salt")
        await expect(lines).to_have_count(1)
        await page.get_by_role("button", name="Clear").click()
        await page.get_by_role("combobox", name="Outcome").select_option("failure")
        await expect(lines).to_have_count(2)
        assert "outcome=failure" in page.url
        await page.get_by_role("combobox", name="Difficulty").select_option("easy")
        await expect(page.locator("#nothing")).to_be_visible()
        await page.get_by_role("combobox", name="Difficulty").select_option("")
        await page.locator(".key[data-value=blocked]").click()
        await expect(lines).to_have_count(1)
        await page.reload()  # the address tells the state
        await expect(lines).to_have_count(1)
        await page.locator(".key[data-value=blocked]").click()
        await expect(lines).to_have_count(12)
        await page.get_by_role("button", name="Steps").click()
        steps = [int(text) for text in await page.locator("#rows-body td:nth-child(6)").all_inner_texts()]
        assert steps == sorted(steps)
        await page.get_by_role("button", name="Steps").click()
        assert int(await page.locator("#rows-body td:nth-child(6)").first.inner_text()) == max(steps)
        await expect(page.locator("th[aria-sort=descending]")).to_have_text("Steps")


async def test_a_trajectory_is_opened_and_left_again(browser: Browser, report: Path) -> None:
    async with opened(browser, report.as_uri()) as page:
        await page.get_by_role("combobox", name="Outcome").select_option("success")
        await page.locator("#rows-body tr").nth(1).locator("td").nth(3).click()
        await expect(page.locator(".verdict-badge")).to_have_text("Success")
        await expect(page.locator(".where")).to_have_text("2 of 4")
        await page.keyboard.press("]")
        await expect(page.locator(".where")).to_have_text("3 of 4")
        await page.keyboard.press("Escape")
        await expect(page.locator("#rows-body tr")).to_have_count(4)
        await page.go_back()
        await expect(page.locator(".where")).to_have_text("3 of 4")


# --- a trajectory ------------------------------------------------------------------------------------


async def test_the_screenshot_is_shown_with_the_click_on_its_place(
    browser: Browser, report: Path, run_folder: Path
) -> None:
    step = attempt(run_folder, 0).episode.steps[2]  # clicks “Add to basket”
    async with opened(browser, address(report, run_folder, 0, 3), reduced_motion="reduce") as page:
        await loaded(page, 400)
        await expect(page.locator("#did")).to_contain_text("Clicked “Add to basket”")
        picture, ring = await box_of(page.locator(".stage img")), await box_of(page.locator(".ring"))
        target = next(e.box for e in step.observation.elements or () if e.name == "Add to basket")
        scale = picture["width"] / 1280
        assert ring["x"] + ring["width"] / 2 == pytest.approx(
            picture["x"] + (target[0] + target[2] / 2) * scale, abs=1
        )
        assert ring["y"] + ring["height"] / 2 == pytest.approx(
            picture["y"] + (target[1] + target[3] / 2) * scale, abs=1
        )
        assert picture["width"] / picture["height"] == pytest.approx(1280 / 768, abs=0.01)
        # The pixels: the picture is the one that was seen, the mark is on the button.
        shot = Image.open(io.BytesIO(await page.locator(".stage").screenshot())).convert("RGB")
        original = Image.open(RunReader(run_folder).image_path(step.observation.screenshot)).convert("RGB")
        for x, y in ((300, 32), (500, 400), (1200, 700)):
            seen, truth = shot.getpixel((int(x * scale), int(y * scale))), original.getpixel((x, y))
            assert isinstance(seen, tuple)
            assert isinstance(truth, tuple)
            assert max(abs(a - b) for a, b in zip(seen, truth, strict=True)) < 24
        mark = shot.getpixel(
            (int((target[0] + target[2] / 2) * scale), int((target[1] + target[3] / 2) * scale))
        )
        assert mark == (0xE3, 0x12, 0x5B)


async def test_an_element_is_framed_and_the_typed_text_stands_by_it(
    browser: Browser, report: Path, run_folder: Path
) -> None:
    seen = attempt(run_folder, 8).episode.steps[0].observation  # in marks mode: types into element 1
    async with opened(browser, address(report, run_folder, 8)) as page:
        await loaded(page, 400)
        picture, frame = await box_of(page.locator(".stage img")), await box_of(page.locator(".target"))
        x, y, w, h = next(e.box for e in seen.elements or () if e.number == 1)
        scale = picture["width"] / 1280
        wanted = {
            "x": picture["x"] + x * scale,
            "y": picture["y"] + y * scale,
            "width": w * scale,
            "height": h * scale,
        }
        assert frame == pytest.approx(wanted, abs=1)
        await expect(page.locator(".bubble")).to_have_text("cheapest edition")
        await expect(page.locator("#did")).to_contain_text(
            'Typed "cheapest edition" into “Search the catalogue”'
        )


async def test_facts_and_their_evidence(browser: Browser, report: Path, run_folder: Path) -> None:
    made = attempt(run_folder, 1)  # a failure: every second fact holds
    assert made.verdict is not None
    async with opened(browser, address(report, run_folder, 1)) as page:
        facts = page.locator("#rubric .finding")
        await expect(facts).to_have_count(len(made.verdict.facts))
        await expect(page.locator("#judges")).to_have_count(0)  # there is one judge, and no choice
        for place, fact in enumerate(made.verdict.facts):
            await expect(facts.nth(place)).to_contain_text(fact.fact)
            await expect(facts.nth(place)).to_contain_text(fact.judgement.reason)
            await expect(facts.nth(place)).to_have_attribute(
                "data-passed", str(fact.judgement.passed).lower()
            )
        await expect(page.locator("#rubric h2")).to_have_text("Facts: 3 of 5 confirmed")
        cited = made.verdict.facts[2].judgement.steps[0] + 1
        await facts.nth(2).get_by_role("button").click()
        await expect(page.locator(".now .count")).to_have_text(f"Step {cited} of {len(made.episode.steps)}")
        await expect(page.locator("#answer")).to_contain_text("It costs £12.50.")
        await expect(page.locator("#answer .finding")).to_have_count(2)


async def test_arrows_walk_through_the_steps(browser: Browser, report: Path, run_folder: Path) -> None:
    made = attempt(run_folder, 2)  # truncated: an end that was looked at
    async with opened(browser, address(report, run_folder, 2)) as page:
        frames = page.locator(".frame")
        await expect(frames).to_have_count(len(made.episode.steps) + 1)
        for number in (2, 3, 4):
            await page.keyboard.press("ArrowRight")
            await expect(page.locator(".frame[aria-current=step]")).to_have_attribute(
                "data-step", str(number)
            )
        assert page.url.endswith("/4")
        await expect(page.locator(".notices")).to_have_count(0)
        await page.keyboard.press("ArrowLeft")
        await expect(page.locator(".frame[aria-current=step]")).to_have_attribute("data-step", "3")
        notice = page.locator(".notices")  # of what the third action did: the fourth observation brings it
        await expect(notice).to_contain_text("Subscribe to our letter?")
        await page.keyboard.press("End")
        await expect(page.locator(".now .count")).to_have_text("End")
        await expect(page.locator(".frame[aria-current=step]")).to_be_in_viewport()
        await page.keyboard.press("ArrowRight")  # there is nothing after it
        await expect(page.locator(".now .count")).to_have_text("End")
        no_action = next(step.index for step in made.episode.steps if step.action is None)
        await frames.nth(no_action).click()
        await expect(page.locator(".notices")).to_contain_text("no tool call in the reply")


UNREWARDED = {
    3: ("Blocked", "a challenge page that stays"),
    4: ("Environment error", "browser_crashed"),
    5: ("Policy error", "policy_timeout"),
    6: ("Judge error", "three replies without a verdict line"),
    7: ("Cancelled", "the attempt ended before its first step"),
}


async def test_attempts_without_a_reward(browser: Browser, report: Path, run_folder: Path) -> None:
    async with opened(browser, report.as_uri()) as page:
        for sample, (outcome, text) in UNREWARDED.items():
            await page.goto(address(report, run_folder, sample))
            await expect(page.locator(".verdict-badge")).to_have_text(outcome)
            await expect(page.locator("#trajectory")).to_contain_text(text)


async def test_hostile_text_is_shown_and_inert(browser: Browser, report: Path, run_folder: Path) -> None:
    hostile = attempt(run_folder, 1).episode.steps[0].reply.text
    assert "</script>" in hostile
    async with opened(browser, address(report, run_folder, 1)) as page:
        await expect(page.locator("#trajectory h1")).to_contain_text("</script><script>window.pwned=1")
        assert await page.locator("details.reply pre").text_content() == hostile
        assert await page.locator("#trajectory script, #trajectory img[src=x]").count() == 0
        await page.goto(report.as_uri() + "#/")
        await expect(page.locator("#rows-body")).to_contain_text(
            "<img src=x"
        )  # opened() looks at window.pwned


async def test_an_unknown_trajectory_is_said(browser: Browser, report: Path) -> None:
    async with opened(browser, report.as_uri() + "#/t/nothing%231.0") as page:
        await expect(page.locator("#trajectory")).to_contain_text("has no such trajectory")


async def test_pictures_come_from_the_folder_and_a_report_that_was_moved_says_so(
    browser: Browser, run_folder: Path, tmp_path: Path
) -> None:
    run = shutil.copytree(run_folder, tmp_path / "run")
    report = write_report(run, config=ReportConfig())
    made = attempt(run, 0)
    gone = RunReader(run).image_path(made.episode.steps[1].observation.screenshot)
    async with opened(browser, address(report, run, 0)) as page:
        await loaded(page, 1280)
        await expect(page.locator("#moved")).to_be_hidden()
    gone.unlink()
    context = await browser.new_context()
    page = await context.new_page()
    await page.goto(address(report, run, 0, 2))
    absent = page.locator(".stage .absent")
    await expect(absent).to_contain_text(f"screenshots/{gone.parent.name}/{gone.name} does not exist")
    await page.goto("about:blank")
    await page.goto(address(report.rename(tmp_path / "moved.html"), run, 0))
    await expect(absent).to_contain_text("If the report was moved, move it back into its run folder")
    await expect(page.locator("#moved")).to_contain_text("the report was moved. Move it back")
    notice, crumbs = await box_of(page.locator("#moved")), await box_of(page.locator(".crumbs"))
    assert notice["y"] + notice["height"] <= crumbs["y"], "what is missing covers no links"
    await context.close()


async def test_a_phone_shows_figures_and_steps_whole(
    browser: Browser, report: Path, run_folder: Path
) -> None:
    phone = {"width": 390, "height": 800}
    async with opened(browser, report.as_uri(), viewport=phone) as page:
        ticks = [await box_of(tick) for tick in await page.locator(".timings .ticks span").all()]
        for one, other in pairwise(ticks):
            assert one["x"] + one["width"] < other["x"]
        for name in await page.locator(".timings tbody th:not(:empty)").all():
            assert await name.evaluate("e => e.scrollWidth <= e.clientWidth")
        card, losses = page.locator("[aria-labelledby=losses-title]"), page.locator(".losses a").first
        assert (await box_of(losses))["width"] >= 200
        assert await card.evaluate("e => e.scrollWidth <= e.clientWidth")
        await page.locator("[aria-labelledby=domain-title] tbody th").first.evaluate(
            "e => { e.textContent = 'D'.repeat(120); }"
        )
        for table in await page.locator("table.plots").all():
            edges = "e => [e.getBoundingClientRect().right, e.parentElement.getBoundingClientRect().right]"
            right, card_right = await table.evaluate(edges)
            assert right <= card_right
        assert await page.evaluate("document.documentElement.scrollWidth") == 390
        bar = await page.evaluate(
            """() => { const live = document.getElementById("live"); live.hidden = false;
            live.textContent = "finished, 12,000 attempts"; return live.offsetHeight; }"""
        )
        assert bar < 30
    async with opened(browser, address(report, run_folder, 0, 3), viewport=phone) as page:
        film, did = await box_of(page.locator(".film")), await box_of(page.locator("#did"))
        assert did["y"] > film["y"] + film["height"]
        assert did["width"] > 300
        assert await page.evaluate("document.documentElement.scrollWidth") == 390


async def _brightness(page: Page) -> float:
    """Mean of the visible pixels, 0 to 255."""
    shot = Image.open(io.BytesIO(await page.screenshot())).convert("L")
    return float(ImageStat.Stat(shot).mean[0])


async def test_light_and_dark(browser: Browser, report: Path) -> None:
    async with opened(browser, report.as_uri(), color_scheme="dark") as page:
        await expect(page.locator("#rows-body tr")).to_have_count(12)
        assert await _brightness(page) < 70
        await page.get_by_role("button", name="Switch between light and dark").click()
        assert await _brightness(page) > 200
        await page.reload()  # the choice stays
        assert await _brightness(page) > 200
    async with opened(browser, report.as_uri(), color_scheme="light") as page:
        assert await _brightness(page) > 200


CONTRAST = """() => {
  const channel = (v) => (v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  const light = ([r, g, b]) => 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
  const canvas = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const rgb = (css) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = css;
    canvas.fillRect(0, 0, 1, 1);
    return canvas.getImageData(0, 0, 1, 1).data;
  };
  const ground = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const colour = rgb(getComputedStyle(e).backgroundColor);
      if (colour[3] > 250) return colour;
    }
    return rgb("white");
  };
  const poor = [];
  for (const e of document.querySelectorAll("body *")) {
    if (!e.checkVisibility() || e.closest("svg, .stage, :disabled, .visually-hidden, .skip")) continue;
    if (![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())) continue;
    const [a, b] = [light(rgb(getComputedStyle(e).color)), light(ground(e))].sort((x, y) => y - x);
    if ((a + 0.05) / (b + 0.05) < 4.5) poor.push(`${e.tagName}.${e.className} ${e.textContent.slice(0, 30)}`);
  }
  return poor;
}"""  # WCAG 2.1, 1.4.3: 4.5 to 1 for text


@pytest.mark.parametrize("scheme", ["light", "dark"])
async def test_text_has_contrast_and_controls_have_names(
    browser: Browser, report: Path, run_folder: Path, scheme: str
) -> None:
    for url in (report.as_uri(), address(report, run_folder, 1)):
        async with opened(browser, url, color_scheme=scheme) as page:
            await page.wait_for_selector(".card h2:visible")
            assert await page.evaluate(CONTRAST) == []
            nameless = "e => e.filter(e => !(e.ariaLabel || e.textContent.trim() || e.labels?.length)).length"
            assert await page.locator("button, a[href], input, select").evaluate_all(nameless) == 0


# --- live --------------------------------------------------------------------------------------------


@asynccontextmanager
async def viewed(run: Path) -> AsyncIterator[str]:
    """The address of a run that is served, and looked at often."""
    loop = asyncio.get_running_loop()
    ready: asyncio.Future[str] = loop.create_future()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("webgym.report.live.REFRESH_SECONDS", 0.1)
        patch.setattr("webgym.report.live.MONITOR_SECONDS", 0.05)
        async with asyncio.TaskGroup() as group:
            serving = group.create_task(serve_view(run, ViewConfig(), ready.set_result))
            yield await ready
            serving.cancel()


async def test_a_run_in_progress_is_followed(browser: Browser, run_folder: Path, tmp_path: Path) -> None:
    done = list(RunReader(run_folder).trajectories())
    tasks = list(RunReader(run_folder).tasks.values())
    source = RunReader(run_folder)
    async with await RunWriter.create(tmp_path / "run", {"seed": 7}, tasks) as writer:

        async def record(made: Trajectory) -> None:
            for seen in made.episode.observations:
                await writer.put_image(seen.screenshot, source.image(seen.screenshot))
            await writer.append(made)

        await record(done[0])
        async with viewed(tmp_path / "run") as url, opened(browser, url) as page:
            await expect(page.locator("#rows-body tr")).to_have_count(1)
            await expect(page.locator(".headline")).to_contain_text("not finished")
            await record(done[1])
            await record(done[2])
            await expect(page.locator("#rows-body tr")).to_have_count(3)
            await expect(page.locator(".tiles")).to_contain_text("Attempts3")
            await expect(page.locator("#live")).to_have_text("live, 3 attempts")
            await writer.write_summary({"attempts": 3})
            await expect(page.locator("#live")).to_have_text("finished, 3 attempts")
            await expect(page.locator(".headline")).not_to_contain_text("not finished")
