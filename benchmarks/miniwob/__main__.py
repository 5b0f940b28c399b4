"""``python -m benchmarks.miniwob --cache DIR``: MiniWoB++ by coordinates and by marks."""

from __future__ import annotations

import argparse
import asyncio
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import cast

from benchmarks.miniwob import clicks, drawings, fields, widgets
from benchmarks.miniwob.hand import Finished, Hand, MissingMark, Unsolved
from benchmarks.miniwob.pages import install, serving
from benchmarks.miniwob.registry import SOLVERS
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from webgym.browser import BrowserConfig, Egress, EgressConfig, ProfileRoot, Slot
from webgym.browser.find import find_browser
from webgym.core.action import Mode

_ = clicks, drawings, fields, widgets  # they register what they solve
MODES: tuple[Mode, ...] = ("coordinates", "marks")


async def attempt(slot: Slot, url: str, mode: Mode, seed: int) -> tuple[bool, str]:
    """Whether a task is solved, and why not."""
    hand = Hand(slot, mode)
    try:
        await hand.start(url, seed)
        await SOLVERS[url.rsplit("/", 1)[-1].removesuffix(".html")](hand)
        why = "the script ended before the task"
    except Finished:
        reward = await hand.reward()
        return bool(reward and reward > 0), f"reward {reward}"
    except MissingMark as error:
        why = f"no mark: {error}"
    except Unsolved as error:
        why = str(error)
    except (LookupError, ValueError, TypeError, RuntimeError) as error:
        why = f"the script failed: {error!r}"
    finally:
        if slot.is_open:
            await slot.close()
    return False, why


async def measure(options: argparse.Namespace, results: dict[str, list[object]]) -> None:
    """Try what has no result yet; results are kept after every attempt."""
    folder = install(options.cache)
    modes = MODES if options.mode == "both" else (cast(Mode, options.mode),)
    wanted = [
        (task, mode, seed)
        for task in (options.tasks or sorted(SOLVERS))
        for seed in range(options.seeds)
        for mode in modes
        if f"{task} {mode} {seed}" not in results
    ]
    with tempfile.TemporaryDirectory() as scratch, serving(folder) as address, Progress() as progress:
        async with Egress(EgressConfig(allow=("127.0.0.1",))) as egress:
            slot = Slot(BrowserConfig(freeze=False), find_browser().path, ProfileRoot(Path(scratch)), egress)
            try:
                for task, mode, seed in progress.track(wanted, description="attempts"):
                    is_solved, why = await attempt(slot, f"{address}/miniwob/{task}.html", mode, seed)
                    results[f"{task} {mode} {seed}"] = [is_solved, why]
                    (options.cache / "results.json").write_text(json.dumps(results, indent=1))
                    if not is_solved:
                        progress.console.print(f"{task} {mode} {seed}: {why}", markup=False, highlight=False)
            finally:
                await slot.stop()


def tell(options: argparse.Namespace, results: dict[str, list[object]]) -> None:
    """Print the table."""
    console = Console()
    table = Table("task", *MODES)
    totals = dict.fromkeys(MODES, (0, 0))
    for task in options.tasks or sorted(SOLVERS):
        row = []
        for mode in MODES:
            tried = [
                results[key] for seed in range(options.seeds) if (key := f"{task} {mode} {seed}") in results
            ]
            solved = sum(bool(one) for one, _ in tried)
            row.append(f"{solved} of {len(tried)}")
            totals[mode] = (totals[mode][0] + solved, totals[mode][1] + len(tried))
        if options.all or len(set(row)) > 1 or row[0].split(" of ")[0] != row[0].split(" of ")[1]:
            table.add_row(task, *row)
    shares = {mode: solved / tried if tried else 0.0 for mode, (solved, tried) in totals.items()}
    table.add_row("in all", *(f"{a} of {b} ({shares[mode]:.1%})" for mode, (a, b) in totals.items()))
    console.print(table)
    if shares["coordinates"]:
        console.print(f"by marks / by coordinates: {shares['marks'] / shares['coordinates']:.1%}")
    pages = {page.stem for page in (options.cache / "miniwob/html/miniwob").glob("*.html")}
    console.print(f"no solver ({len(pages - set(SOLVERS))} of {len(pages)}):", *sorted(pages - set(SOLVERS)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.miniwob", description=__doc__)
    parser.add_argument(
        "--cache", type=Path, required=True, help="pages and results; results are taken up again"
    )
    parser.add_argument("--seeds", type=int, default=1, help="episodes of a task")
    parser.add_argument(
        "--tasks", type=lambda text: text.split(","), help="separated by commas; all by default"
    )
    parser.add_argument("--mode", choices=(*MODES, "both"), default="both")
    parser.add_argument("--all", action="store_true", help="show the tasks that are always solved as well")
    options = parser.parse_args(arguments)
    kept = options.cache / "results.json"
    results = json.loads(kept.read_text()) if kept.exists() else {}
    asyncio.run(measure(options, results))
    tell(options, results)


if __name__ == "__main__":
    main()
