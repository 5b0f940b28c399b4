"""Take the pictures of the monitor for the README, during a run.

    python benchmarks/monitor_pictures.py --out docs/figures
    python benchmarks/monitor_pictures.py --draw 1000

Real browsers run tasks of the offline web. The replies are scripted, with mistakes, and take as long as those
of a model, so that the pictures show attempts that wait for a reply. With --draw, generated attempts change
their state instead, and the drawing times of page and terminal are printed.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import random
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from statistics import median

from playwright.async_api import Browser, async_playwright
from rich.console import Console

from webgym.agent.policy import PolicyInput, PolicySession
from webgym.agent.scripted import ScriptedPolicy
from webgym.browser.find import find_browser
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.report.config import ViewConfig
from webgym.report.live import serve_view
from webgym.rollout.config import CollectorConfig
from webgym.rollout.live import panel
from webgym.rollout.live_file import feeding
from webgym.rollout.progress import STATES, Progress
from webgym.run.collect import collect
from webgym.run.config import RunConfig, TaskChoice
from webgym.store.runs import RunWriter

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
    """The scripted policy, as slow as a model."""

    def __init__(self, mistake_rate: float, seconds: float) -> None:
        super().__init__(mistake_rate)
        self._seconds = seconds

    def begin(self, task: Task, seed: int) -> PolicySession:
        """A session whose replies take time."""
        return _Thinking(super().begin(task, seed), self._seconds, random.Random(seed))


class _Thinking:
    def __init__(self, player: PolicySession, seconds: float, chance: random.Random) -> None:
        self._player, self._seconds, self._chance = player, seconds, chance

    async def reply(self, turn: PolicyInput) -> Reply:
        """The reply, after a delay."""
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
    """Wait until enough attempts have ended, then take the pictures."""
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    async with async_playwright() as playwright, asyncio.TaskGroup() as group:
        browser = await playwright.chromium.launch(
            executable_path=str((await asyncio.to_thread(find_browser)).path), args=["--no-sandbox"]
        )
        serving = group.create_task(serve_view(run, ViewConfig(), ready.set_result))
        page = await browser.new_page(viewport={"width": 1200, "height": 900})
        await page.goto(f"{await ready}monitor")
        await page.wait_for_function(
            "least => parseInt(document.getElementById('done').textContent) >= least",
            arg=options.after,
            timeout=0,
        )
        await _picture_of_svg(browser, _terminal(progress, 100, 26), options.out / "terminal.png")
        await page.screenshot(path=options.out / "monitor.png", full_page=True)
        await browser.close()
        serving.cancel()


async def draw(count: int, seconds: float = 15.0) -> None:
    """Print how long it takes to draw generated attempts."""
    progress, chance = Progress(total=10 * count), random.Random(0)
    names = [f"shop/task-{number}#0.0" for number in range(count)]
    for name in names:
        progress.move(None, "opening", name)
    terminal = Console(width=200, height=60, file=io.StringIO(), force_terminal=True)
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    drawn: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        async with await RunWriter.create(run, {}, []), asyncio.TaskGroup() as group:
            serving = group.create_task(serve_view(run, ViewConfig(), ready.set_result))
            async with feeding(progress, run), async_playwright() as playwright:
                path = str((await asyncio.to_thread(find_browser)).path)
                browser = await playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
                page = await browser.new_page(viewport={"width": 1400, "height": 900})
                await page.add_init_script(COUNT_FRAMES)
                await page.goto(f"{await ready}monitor")
                for _ in range(int(seconds * 2)):
                    for name in chance.sample(names, count // 4):
                        progress.move(progress.cells[name].state, chance.choice(STATES), name)
                        progress.stepped(name)
                    began = time.perf_counter()
                    terminal.print(panel(progress))
                    drawn.append((time.perf_counter() - began) * 1000)
                    await asyncio.sleep(0.5)
                frames = await page.evaluate("window.frames_ms")
                await browser.close()
            serving.cancel()
    for what, values in (("page", frames), ("terminal", drawn)):
        print(f"{what}: {count} attempts in {median(values):.1f} ms (median), {max(values):.1f} ms at most")


async def main(options: argparse.Namespace) -> None:
    """Run tasks, and take the pictures meanwhile."""
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
        collecting.cancel()  # the rest of the run is not needed
        await asyncio.gather(collecting, return_exceptions=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    parser.add_argument("--sessions", type=int, default=40, help="number of parallel attempts")
    parser.add_argument("--tasks", type=int, default=150)
    parser.add_argument("--think", type=float, default=2.0, help="median time of a reply, seconds")
    parser.add_argument(
        "--after", type=int, default=35, help="number of ended attempts at which the pictures are taken"
    )
    parser.add_argument("--draw", type=int, help="number of generated attempts to draw instead of a run")
    given = parser.parse_args()
    asyncio.run(draw(given.draw) if given.draw else main(given))
