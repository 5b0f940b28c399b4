"""The monitor's page over a real server, in a real browser."""

from __future__ import annotations

import json
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.async_api import Browser, Page, expect
from tests.report.conftest import ends_on_interrupt, view_command
from tests.report.test_pages import CONTRAST, opened, viewed

from webgym.core.outcome import Outcome
from webgym.report.live import read_history
from webgym.rollout.live_file import STALE_SECONDS, feeding
from webgym.rollout.progress import STATES, Progress, Queue
from webgym.store.files import LIVE, METRICS
from webgym.store.runs import RunWriter

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

HOSTILE = "a<img src=x onerror='window.pwned=1'>#0.0"


@pytest.fixture
async def run(tmp_path: Path) -> AsyncIterator[Path]:
    async with await RunWriter.create(tmp_path / "run", {}, []) as writer:
        await writer.metric({"at": 1.0, "steps_per_second": 2.5})
        yield writer.path


def _progress(count: int) -> Progress:
    progress = Progress(total=5000, done=7, queues=lambda: {"navigate": Queue(3, 4, 0.25, 1.5)})
    for number in range(count):
        attempt = HOSTILE if number == 0 else f"shop/task-{number}#0.0"
        progress.move(None, STATES[number % len(STATES)], attempt)
        progress.cells[attempt].steps = number % 30
    progress.outcomes[Outcome.SUCCESS] = 3
    progress.outcomes[Outcome.FAILURE] = 1
    progress.by_level["easy", Outcome.SUCCESS] = 3
    progress.errors["browser_crashed"] = 2
    return progress


@asynccontextmanager
async def watched(browser: Browser, run: Path, **options: Any) -> AsyncIterator[Page]:
    async with viewed(run) as url, opened(browser, f"{url}monitor", **options) as page:
        yield page


async def test_a_thousand_attempts_are_one_element(browser: Browser, run: Path) -> None:
    progress = _progress(1000)
    async with feeding(progress, run, 0.1), watched(browser, run) as page:
        await expect(page.locator("#live")).to_have_text("live")
        await expect(page.locator("[data-count=thinking]")).to_have_text("250")
        await expect(page.locator("#cells")).to_have_attribute(
            "aria-label", "1000 attempts in progress: 250 opening, 250 acting, 250 thinking, 250 judging"
        )
        elements = await page.evaluate("document.querySelectorAll('*').length")
        # Each cell has the color of its state: along the top of the first cells, above their steps.
        row = await page.evaluate(
            """() => {
              const canvas = document.getElementById("cells"), pen = canvas.getContext("2d");
              const data = pen.getImageData(0, 1, canvas.width, 1).data, runs = [];
              for (let at = 0; at < data.length; at += 4) {
                const color = data[at + 3] ? data.slice(at, at + 4).join() : "";
                if (color !== runs.at(-1)) runs.push(color);
              }
              return runs.filter(Boolean).slice(0, 8);
            }"""
        )
        assert len(set(row)) == len(STATES)
        assert row[:4] == row[4:]
        await page.hover("#cells", position={"x": 3, "y": 3})
        await expect(page.locator("#tip")).to_contain_text(HOSTILE)
        await expect(page.locator("#tip")).to_contain_text("opening for")
        for attempt_id in list(progress.cells)[10:]:
            progress.move(progress.cells[attempt_id].state, None, attempt_id)
            del progress.cells[attempt_id]
        await expect(page.locator("[data-count=thinking]")).to_have_text("2")
        assert abs(await page.evaluate("document.querySelectorAll('*').length") - elements) < 10


async def test_figures_are_those_of_the_collector(browser: Browser, run: Path) -> None:
    async with feeding(_progress(5), run, 0.1), watched(browser, run) as page:
        await expect(page.locator("#done")).to_have_text("7 of 5000")
        await expect(page.locator("#tiles")).to_contain_text("Success rate75.0%")
        await expect(page.locator("#levels")).to_contain_text("Easy100.0%3 of 3")
        await expect(page.locator("#queues")).to_contain_text("navigate34250 ms1.50 s")
        await expect(page.locator("#errors")).to_contain_text("browser_crashed2")


@pytest.mark.parametrize(("width", "scheme"), [(800, "dark"), (1400, "light")])
async def test_it_fits_and_can_be_read(browser: Browser, run: Path, width: int, scheme: str) -> None:
    options = {"viewport": {"width": width, "height": 900}, "color_scheme": scheme}
    async with feeding(_progress(90), run, 0.1), watched(browser, run, **options) as page:
        await expect(page.locator("#monitor")).to_be_visible()
        assert await page.evaluate("document.documentElement.scrollWidth") <= width
        assert await page.evaluate(CONTRAST) == []


async def test_the_end_and_a_kill_are_told_apart(browser: Browser, run: Path) -> None:
    async with watched(browser, run) as page:
        await expect(page.locator("#live")).to_have_text("not running")
        async with feeding(_progress(3), run, 0.1):
            await expect(page.locator("#live")).to_have_text("live")
        await expect(page.locator("#live")).to_have_text("not running")
        left = {**_progress(3).snapshot(), "at": time.time() - STALE_SECONDS - 60}
        (run / LIVE).write_text(json.dumps(left))
        await expect(page.locator("#live")).to_have_text("stopped")
        await expect(page.locator("#said")).to_contain_text("No update from the collector for 1:")
        (run / LIVE).write_text("{")
        await expect(page.locator("#said")).to_contain_text("not what a collector writes")


async def test_the_history_is_of_whole_lines(run: Path) -> None:
    with (run / METRICS).open("ab") as file:
        file.write(b'{"at": 2, "steps_per_second": 3}\n{"at": "x"}\n[]\n{"at": 3, "steps_per')
    assert read_history(run) == [
        {"at": 1.0, "steps_per_second": 2.5},
        {"at": 2.0, "steps_per_second": 3.0},
    ]


async def test_an_open_stream_does_not_keep_the_command_from_ending(run: Path) -> None:
    process, address = await view_command(run)
    async with (
        httpx.AsyncClient(timeout=60) as client,
        client.stream("GET", f"{address}api/monitor") as stream,
    ):
        assert stream.headers["content-type"].startswith("text/event-stream")
        parts = stream.aiter_text()
        assert (await anext(parts)).startswith("event: history")
        await ends_on_interrupt(process)
