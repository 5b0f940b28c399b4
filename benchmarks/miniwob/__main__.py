"""``python -m benchmarks.miniwob --cache DIR``: MiniWoB++ in both modes and both action spaces."""

from __future__ import annotations

import argparse
import asyncio
import json
import tempfile
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import TypeAlias, cast

from benchmarks.miniwob import clicks, drawings, fields, widgets
from benchmarks.miniwob.episode import Episode, Finished, MissingMark, OutOfSpace, Unsolved
from benchmarks.miniwob.pages import install, serving
from benchmarks.miniwob.registry import SOLVERS
from rich.console import Console
from rich.progress import Progress

from webgym.browser.config import BrowserConfig
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Mode, Space
from webgym.core.tables import Table, show

_ = clicks, drawings, fields, widgets  # importing them registers their solvers
MODES: tuple[Mode, ...] = ("coordinates", "marks")
SPACES: tuple[Space, ...] = ("paper", "extended")
FULL_REWARD = 0.99
"""Least reward that counts as full."""

Result: TypeAlias = tuple[float | None, str]
"""The reward of the page, ``None`` if it gave none, and a message."""


async def attempt(slot: Slot, url: str, mode: Mode, space: Space, seed: int) -> Result:
    """Run an episode of a task; a task without a script has no reward."""
    solver = SOLVERS.get(url.rsplit("/", 1)[-1].removesuffix(".html"))
    if solver is None:
        return None, "no script"
    episode = Episode(slot, mode, space)
    try:
        await episode.start(url, seed)
        await solver(episode)
        why = "the script ended before the task"
    except Finished:
        reward = await episode.reward()
        return reward, f"reward {reward}"
    except OutOfSpace as error:
        why = f"not in this space: {error}"
    except MissingMark as error:
        why = f"no mark: {error}"
    except Unsolved as error:
        why = str(error)
    except (LookupError, ValueError, TypeError, RuntimeError) as error:
        why = f"the script failed: {error!r}"
    finally:
        if slot.is_open:
            await slot.close()
    return None, why


async def measure(options: argparse.Namespace, results: dict[str, Result]) -> None:
    """Run all episodes without a result yet, and store the results after each."""
    wanted = [
        (seed, task, space, mode)
        for seed, task, space, mode in product(
            range(options.seeds), options.tasks, options.spaces, options.modes
        )
        if _key(task, seed, space, mode) not in results
    ]
    folder = options.cache / "miniwob/html"
    with tempfile.TemporaryDirectory() as scratch, serving(folder) as address, Progress() as progress:
        async with Egress(EgressConfig(allow=("127.0.0.1",))) as egress:
            slot = Slot(BrowserConfig(freeze=False), find_browser().path, ProfileRoot(Path(scratch)), egress)
            try:
                for seed, task, space, mode in progress.track(wanted, description="attempts"):
                    url = f"{address}/miniwob/{task}.html"
                    reward, why = results[_key(task, seed, space, mode)] = await attempt(
                        slot, url, mode, space, seed
                    )
                    (options.cache / "results.json").write_text(json.dumps(results, indent=1))
                    if not reward or reward < FULL_REWARD:
                        message = f"{_key(task, seed, space, mode)}: {why}"
                        progress.console.print(message, markup=False, highlight=False)
            finally:
                await slot.stop()


def _key(task: str, seed: int, space: Space, mode: Mode) -> str:
    return f"{task} {space} {mode} {seed}"


def print_tables(options: argparse.Namespace, results: dict[str, Result]) -> None:
    """Print the tables of all tasks, and of the tasks without a full reward in every episode."""
    console = Console()
    columns = list(product(options.spaces, options.modes))
    headings = [f"{space}, {mode}" for space, mode in columns]
    each: list[tuple[str, ...]] = []
    counts = {column: [0, 0] for column in columns}
    for task in options.tasks:
        row = []
        for space, mode in columns:
            tried = [
                reward or 0.0
                for seed in range(options.seeds)
                for reward, _ in [results[_key(task, seed, space, mode)]]
            ]
            solved, full = sum(one > 0 for one in tried), sum(one >= FULL_REWARD for one in tried)
            row.append(f"{solved}, {full}")
            counts[space, mode][0] += solved
            counts[space, mode][1] += full
        if options.all or set(row) != {f"{options.seeds}, {options.seeds}"}:
            each.append((task, *row))
    whole = len(options.tasks) * options.seeds
    total = []
    for index, name in enumerate(("solved (reward > 0)", f"paid in full (reward >= {FULL_REWARD})")):
        shares = [f"{counts[column][index]} ({counts[column][index] / whole:.1%})" for column in columns]
        total.append((name, *shares))
    show([Table(f"{options.seeds} episodes per task", ("solved, full reward", *headings), each)], console)
    show([Table(f"{len(options.tasks)} tasks, {whole} episodes each", ("", *headings), total)], console)
    for space in options.spaces:
        by = [counts[space, mode][0] for mode in MODES] if len(options.modes) == len(MODES) else [0, 0]
        if by[0]:
            console.print(f"{space}: solved by marks / by coordinates: {by[1] / by[0]:.1%}")
    console.print("without a script:", *(task for task in options.tasks if task not in SOLVERS))


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.miniwob", description=__doc__)
    parser.add_argument(
        "--cache",
        type=Path,
        required=True,
        help="folder of pages and results; stored results are not repeated",
    )
    parser.add_argument("--seeds", type=int, default=1, help="number of episodes per task")
    parser.add_argument(
        "--tasks", type=lambda text: text.split(","), help="tasks, separated by commas; by default all"
    )
    parser.add_argument("--mode", choices=(*MODES, "both"), default="both")
    parser.add_argument("--actions", choices=(*SPACES, "both"), default="both")
    parser.add_argument(
        "--all", action="store_true", help="also print tasks with a full reward in every episode"
    )
    options = parser.parse_args(arguments)
    pages = install(options.cache) / "miniwob"
    options.tasks = options.tasks or sorted(page.stem for page in pages.glob("*.html"))
    options.modes = MODES if options.mode == "both" else (cast(Mode, options.mode),)
    options.spaces = SPACES if options.actions == "both" else (cast(Space, options.actions),)
    kept = options.cache / "results.json"
    results = json.loads(kept.read_text()) if kept.exists() else {}
    asyncio.run(measure(options, results))
    print_tables(options, results)


if __name__ == "__main__":
    main()
