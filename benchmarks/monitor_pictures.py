"""The pictures of the monitor in the README, from a run that goes on while they are taken.

    python benchmarks/monitor_pictures.py --out docs/figures

Real browsers play the offline web. The replies are a script's, with mistakes, and take as long as a model's:
without that wait nobody would be seen thinking. It also prints how long the page takes to draw itself.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import random
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from statistics import median

from playwright.async_api import Browser, async_playwright
from rich.console import Console

from webgym.agent.policy import Player, Turn
from webgym.agent.scripted import ScriptedPolicy
from webgym.browser.find import find_browser
from webgym.collection import RunConfig, TaskChoice, collect
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.report.config import ViewConfig
from webgym.report.live import serve_view
from webgym.rollout.collector import CollectorConfig
from webgym.rollout.live import panel
from webgym.rollout.progress import Progress

COUNT_FRAMES = """
  window.frames_ms = [];
  const later = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (draw) => later((at) => {
    const began = performance.now();
    draw(at);
    window.frames_ms.push(performance.now() - began);
  });
"""


class ThinkingPolicy(ScriptedPolicy):
    """The script, as slow as a model."""

    def __init__(self, mistake_rate: float, seconds: float) -> None:
        super().__init__(mistake_rate)
        self._seconds = seconds

    def begin(self, task: Task, seed: int) -> Player:
        """A player who takes its time."""
        return _Thinking(super().begin(task, seed), self._seconds, random.Random(seed))


class _Thinking:
    def __init__(self, player: Player, seconds: float, chance: random.Random) -> None:
        self._player, self._seconds, self._chance = player, seconds, chance

    async def reply(self, turn: Turn) -> Reply:
        """After a while."""
        await asyncio.sleep(self._chance.lognormvariate(0, 0.5) * self._seconds)
        return await self._player.reply(turn)


def _terminal(progress: Progress, width: int, height: int) -> str:
    console = Console(record=True, width=width, height=height, file=io.StringIO(), force_terminal=True)
    console.print(panel(progress))
    return console.export_svg(title="webgym rollout")


async def _picture_of_svg(browser: Browser, svg: str, out: Path) -> None:
    page = await browser.new_page(device_scale_factor=1)
    await page.set_content(f"<body style='margin:0'>{svg}</body>")
    await page.locator("svg").first.screenshot(path=out)
    await page.close()


async def _pictures(progress: Progress, run: Path, options: argparse.Namespace) -> None:
    """Wait until enough has ended, then take them."""
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    async with async_playwright() as playwright, asyncio.TaskGroup() as group:
        browser = await playwright.chromium.launch(
            executable_path=str((await asyncio.to_thread(find_browser)).path), args=["--no-sandbox"]
        )
        serving = group.create_task(serve_view(run, ViewConfig(), ready.set_result))
        page = await browser.new_page(viewport={"width": 1200, "height": 900})
        await page.add_init_script(COUNT_FRAMES)
        await page.goto(f"{await ready}monitor")
        await page.wait_for_function(
            "least => parseInt(document.getElementById('done').textContent) >= least",
            arg=options.after,
            timeout=0,
        )
        await _picture_of_svg(browser, _terminal(progress, 100, 26), options.out / "terminal.png")
        await page.screenshot(path=options.out / "monitor.png", full_page=True)
        drawn = await page.evaluate("window.frames_ms")
        print(f"{len(progress.cells)} attempts: drawn {len(drawn)} times, {median(drawn):.1f} ms (median)")
        await browser.close()
        serving.cancel()


async def main(options: argparse.Namespace) -> None:
    """Run, and take the pictures meanwhile."""
    options.out.mkdir(parents=True, exist_ok=True)
    config = RunConfig(
        tasks=TaskChoice(count=options.tasks, spread=True),
        collector=CollectorConfig(sessions=options.sessions),
    )
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "runs-first"
        taken = asyncio.Event()

        @asynccontextmanager
        async def show(progress: Progress) -> AsyncIterator[None]:
            async with asyncio.TaskGroup() as group:
                taking = group.create_task(_pictures(progress, run, options))
                taking.add_done_callback(lambda _: taken.set())
                yield

        collecting = asyncio.create_task(
            collect(config, run, policy=ThinkingPolicy(0.3, options.think), show=show)
        )
        await asyncio.wait([collecting, asyncio.create_task(taken.wait())], return_when="FIRST_COMPLETED")
        collecting.cancel()  # the pictures are all that is wanted
        await asyncio.gather(collecting, return_exceptions=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    parser.add_argument("--sessions", type=int, default=40, help="attempts at the same time")
    parser.add_argument("--tasks", type=int, default=150)
    parser.add_argument("--think", type=float, default=2.0, help="median seconds of a reply")
    parser.add_argument("--after", type=int, default=35, help="attempts that have ended when they are taken")
    asyncio.run(main(parser.parse_args()))
