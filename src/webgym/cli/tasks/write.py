"""``webgym tasks split``, ``sample``, ``convert`` and ``offline``: write task sets to files."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer
from rich.console import Console

from webgym.cli import EXIT_USAGE
from webgym.cli._checks import check_writable
from webgym.cli._fields import Given, Option, Options, takes
from webgym.cli._options import web_options
from webgym.cli._push import Public
from webgym.cli.tasks._files import print_set_aside, read_unique
from webgym.core.errors import ConfigError
from webgym.core.identity import Identity
from webgym.core.settings import validated
from webgym.core.tables import show
from webgym.core.text import plain
from webgym.rollout.site_health import HealthConfig, SiteHealth
from webgym.tasks.files import whole_file
from webgym.tasks.formats import Format, read_tasks, write_tasks
from webgym.tasks.sampling import SamplerConfig, parse_ratio
from webgym.tasks.split import SplitConfig

if TYPE_CHECKING:
    from webgym.core.task import Task
    from webgym.tasks.sampling import Sampler, Weigh

SPLIT = Options(SplitConfig, {"--test": "test_tasks", "--seed": "seed"})


@takes(settings=SPLIT)
def split(
    settings: Given,
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    out: Path = typer.Option(..., "--out", help="Folder to write a file per split to, or one file for both."),
    left_out: Path | None = typer.Option(
        None,
        "--left-out",
        help="Write id, website and reason of every task that is left out to this file (JSON lines).",
    ),
) -> None:
    """Choose test tasks from distinct websites; leave these websites and related tasks out of training."""
    import msgspec

    from webgym.tasks.split import split as run

    config = validated(SplitConfig, settings)
    check_writable(left_out)
    result = run(read_unique(files), config)
    write_tasks(out, result.tasks)
    if left_out is not None:
        with whole_file(left_out) as file:
            file.writelines(msgspec.json.encode(task) + b"\n" for task in result.left_out)
    show([result.table()], Console())
    counts, *left_out_lines = result.lines()
    print(f"{counts} written to {out}", *left_out_lines, sep="\n")


def convert(
    source: Path = typer.Argument(
        ..., metavar="IN", help="Task file of any format, or a folder with tasks.*, train.* or test.*."
    ),
    out: Path = typer.Argument(
        ..., metavar="OUT", help="File to write (.parquet, .jsonl, .jsonl.gz, .jsonl.zst), or a folder."
    ),
    format: Format | None = typer.Option(
        None,
        "--format",
        help="Format of OUT. A folder gets a file per split.",
        show_default="by the name of a file, jsonl in a folder",
    ),
) -> None:
    """Write a task set in another format. Fails if a record could not be read; the rest is written.

    Tasks without a fact to judge are not written; their number is printed.
    """
    records = read_tasks(source)
    count = write_tasks(out, records.tasks, format=format)
    print(f"{count} tasks written to {out}")
    print_set_aside(records.set_aside)
    if records.broken:
        for record in records.broken:
            print(f"left out {record}", file=sys.stderr)
        raise typer.Exit(EXIT_USAGE)


def push(
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    to: str = typer.Option(..., "--to", help="Data set to push to: hub:OWNER/NAME[@BRANCH]."),
    public: Public = False,
    licence: str | None = typer.Option(
        None,
        "--licence",
        help="Identifier of the licence that you publish under, such as cc-by-4.0.",
        show_default="none; the card lists those of the sources",
    ),
) -> None:
    """Push a task set to the Hugging Face hub, in the published format and with a card.

    Sets with splits become train.jsonl and test.jsonl, others tasks.jsonl. Needs `hf auth login` or HF_TOKEN.
    """
    import tempfile

    from webgym.cli._push import push_folder, target, tasks_card

    address, tasks = target(to), read_unique(files)
    with tempfile.TemporaryDirectory(prefix="webgym-push-") as scratch:
        folder = Path(scratch)
        has_splits = all(task.split for task in tasks)
        write_tasks(folder if has_splits else folder / "tasks.jsonl", tasks, format="published")
        names = {file.stem: file.name for file in sorted(folder.iterdir())}
        card = tasks_card(tasks, names if has_splits else {"train": "tasks.jsonl"}, licence)
        push_folder(folder, address, card, is_public=public)


@takes(settings=web_options("seed", "collection", "per_family"))
def offline(
    settings: Given,
    out: Path = typer.Option(..., "--out", help="Task file to write: .jsonl or .parquet."),
    split: Literal["train", "test"] | None = typer.Option(
        None, "--split", help="Split to write.", show_default="both"
    ),
) -> None:
    """Write the offline web's tasks to a file, with the hidden truths that they are judged by."""
    from rich.progress import track

    from webgym.offline.config import SitesConfig
    from webgym.offline.web import OfflineWeb

    config = validated(SitesConfig, settings)
    web = OfflineWeb(config.seed, per_family=config.per_family, collection=config.collection)
    hosts = [host for host, spec in web.specs.items() if split in (None, spec.split)]
    console = Console(stderr=True)
    shown = track(hosts, "websites", console=console, transient=True, disable=not console.is_terminal)
    count = write_tasks(out, (task for host in shown for task in web.tasks_of(host)))
    print(f"{count} tasks written to {out}")


SAMPLER = Options(
    SamplerConfig,
    {
        "--split": "split",
        "--ratio": Option(
            "ratio",
            help="Ratio of easy:medium:hard, such as 2:1:1.",
            default="as in the files",
            metavar="RATIO",
            parse=parse_ratio,
        ),
        "--domain": "domains",
        "--without": "without",
        "--seed": "seed",
    },
)
HEALTH = Options(HealthConfig, {"--health": "file", "--refused-hours": "refused_hours"})


@takes(settings=SAMPLER, health=HEALTH)
def sample(
    settings: Given,
    health: Given,
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    count: int = typer.Option(1_024, "--count", min=1, help="Number of tasks to draw."),
    out: Path | None = typer.Option(None, "--out", help="Task file to write.", show_default="print ids only"),
    block: list[str] = typer.Option([], "--block", help="Do not draw from this website. May be repeated."),
    shard: str = typer.Option(
        "0/1", "--shard", help="Index of this worker and number of workers, such as 0/4."
    ),
    state: Path | None = typer.Option(
        None,
        "--state",
        help="File of the sampler's state: continue from it if it exists, and save the new state in it.",
    ),
    spread: bool = typer.Option(
        False, "--spread-websites", help="Give every website the same weight, however many tasks it has."
    ),
    near: list[Path] = typer.Option(
        [],
        "--curriculum",
        help="Prefer tasks whose success rate in this run is near --target. May be repeated.",
    ),
    target: float = typer.Option(
        0.5, "--target", min=0.0, max=1.0, help="Success rate that --curriculum prefers."
    ),
) -> None:
    """Draw tasks without replacement; with --state, continue where the last call ended."""
    from webgym.tasks.sampling import Sampler, near_success, spread_websites

    if spread and near:
        raise ConfigError("--spread-websites and --curriculum exclude each other", hint="give one of them")
    weigh: Weigh | None = spread_websites() if spread else None
    if near:
        weigh = near_success(_results(near), target=target)
    config = validated(SamplerConfig, settings | _shard(shard))
    websites = SiteHealth(validated(HealthConfig, health), identity=Identity().label)
    sampler = Sampler(read_unique(files), config, blocked=websites.blocked, weigh=weigh, anew=bool(near))
    if left_out := sampler.selected.told():
        print(f"{len(sampler.selected.tasks):,} tasks to draw from; left out: {left_out}", file=sys.stderr)
    _restore(sampler, state)
    sampler.block(*map(_site, block))
    drawn = sampler.draw(count)
    if passed_over := sampler.passed_over:
        message = f"{passed_over.total():,} tasks on {len(passed_over):,} blocked websites were not drawn"
        print(message, file=sys.stderr)
    _write(drawn, out)
    if state is not None:
        with whole_file(state) as file:
            file.write(json.dumps(sampler.state()).encode() + b"\n")


def _write(drawn: list[Task], out: Path | None) -> None:
    """Write tasks to a file, or print their ids."""
    distinct = list({task.id: task for task in drawn}.values())
    if repeated := len(drawn) - len(distinct):
        what = (
            "printed: all tasks had been drawn" if out is None else "left out: a file contains each task once"
        )
        print(f"{repeated:,} repeated draws are {what}", file=sys.stderr)
    if out is None:
        print("\n".join(plain(task.id) for task in drawn))
        return
    write_tasks(out, distinct)
    print(f"{len(distinct):,} tasks written to {out}")


def _shard(shard: str) -> dict[str, int]:
    index, slash, count = shard.partition("/")
    if not (slash and index.isdecimal() and count.isdecimal()):
        raise ConfigError(f"{shard!r} is not a shard", hint="give INDEX/COUNT, counted from 0, such as 0/4")
    return {"shard": int(index), "shards": int(count)}


def _site(website: str) -> str:
    from webgym.core.websites import site_of

    try:
        return site_of(website)
    except ValueError as error:
        raise ConfigError(str(error), hint="give a host or a URL to --block") from error


def _restore(sampler: Sampler, state: Path | None) -> None:
    if state is None or not state.exists():
        return
    try:
        decoded: Any = json.loads(state.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"{state} is not a sampler's state: {error}", hint="remove it to start over"
        ) from error
    sampler.restore(decoded if isinstance(decoded, dict) else {})


def _results(runs: list[Path]) -> dict[str, tuple[int, int]]:
    """The numbers of successes and of attempts with a reward, by task."""
    from webgym.core.outcome import Outcome
    from webgym.store.runs import RunReader

    results: dict[str, tuple[int, int]] = {}
    for path in runs:
        for entry in RunReader(path).attempts.values():
            if entry.outcome.is_rewarded:
                successes, attempts = results.get(entry.task_id, (0, 0))
                results[entry.task_id] = (successes + (entry.outcome == Outcome.SUCCESS), attempts + 1)
    return results
