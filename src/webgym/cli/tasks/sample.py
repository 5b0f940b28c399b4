"""``webgym tasks sample``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from webgym.tasks.sampling import Sampler, SamplerConfig, Weigh


def sample(
    files: list[Path] = typer.Argument(..., help="Task files, or folders of them."),
    count: int = typer.Option(1_024, "--count", min=1, help="Tasks to draw."),
    out: Path | None = typer.Option(None, "--out", help="Task file to write.", show_default="print the ids"),
    split: str = typer.Option(
        "train", "--split", help="train, test, all, or unsplit (tasks that do not say)."
    ),
    ratio: str | None = typer.Option(
        None, "--ratio", help="Shares of easy:medium:hard, such as 2:1:1.", show_default="as they come"
    ),
    domain: list[str] = typer.Option(
        [], "--domain", help="Draw only from this domain or subdomain. Repeatable."
    ),
    without: list[str] = typer.Option(
        [], "--without", help="Do not draw from this domain or subdomain. Repeatable."
    ),
    without_share: float = typer.Option(
        0.0, "--without-share", min=0.0, help="Also leave out this share of the subdomains, chosen at random."
    ),
    without_seed: int = typer.Option(0, "--without-seed", help="Seed of that choice."),
    block: list[str] = typer.Option([], "--block", help="Do not draw from this website. Repeatable."),
    blocklist: Path | None = typer.Option(
        None, "--blocklist", help="Do not draw from websites in this blocklist file of a run."
    ),
    blocked_hours: float = typer.Option(
        12.0,
        "--blocked-hours",
        min=0.0,
        help="Hours for which a website is left out after it blocked an attempt.",
    ),
    shard: str = typer.Option(
        "0/1", "--shard", help="This worker's number and the number of workers, such as 0/4."
    ),
    seed: int = typer.Option(0, "--seed", help="Seed of every shuffle."),
    state: Path | None = typer.Option(
        None,
        "--state",
        help="Continue from the state in this file, if it exists, and save the new state in it.",
    ),
    spread: bool = typer.Option(
        False, "--spread-websites", help="Give every website the same weight, however many tasks it has."
    ),
    near: list[Path] = typer.Option(
        [], "--curriculum", help="Prefer tasks that succeeded about half the time in this run. Repeatable."
    ),
    target: float = typer.Option(0.5, "--target", min=0.0, max=1.0, help="Success rate to prefer."),
) -> None:
    """Draw tasks without replacement; with --state, continue where the last call ended."""
    import sys

    from webgym.cli.tasks._files import with_own_ids
    from webgym.core.errors import ConfigError
    from webgym.core.text import plain
    from webgym.rollout.blocklist import Blocklist, BlocklistConfig
    from webgym.tasks.formats import write_tasks
    from webgym.tasks.sampling import Sampler, near_success, spread_websites

    if spread and near:
        raise ConfigError("there are two ways of weighing", hint="give --spread-websites or --curriculum")
    weigh: Weigh | None = spread_websites() if spread else None
    if near:
        weigh = near_success(_results(near), target=target)
    choice = {
        "split": split,
        "domains": domain,
        "without": without,
        "without_share": without_share,
        "without_seed": without_seed,
    }
    config = _config(choice, seed=seed, ratio=ratio, shard=shard)
    held = Blocklist(BlocklistConfig(file=blocklist, hours=blocked_hours))
    sampler = Sampler(with_own_ids(files), config, blocked=held.blocked, weigh=weigh, anew=bool(near))
    if left_out := sampler.selected.told():
        print(f"{len(sampler.selected.tasks):,} tasks to draw from; left out: {left_out}", file=sys.stderr)
    _restore(sampler, state)
    sampler.block(*map(_checked, block))
    drawn = sampler.draw(count)
    if passed := sampler.passed_over:
        told = f"{passed.total():,} tasks on {len(passed):,} blocked websites passed over"
        print(told, file=sys.stderr)
    if out is not None:
        distinct = list({task.id: task for task in drawn}.values())
        write_tasks(out, distinct)
        print(f"{len(distinct):,} tasks written to {out}")
        if again := len(drawn) - len(distinct):
            print(f"{again:,} drawn a second time are left out: a file holds a task once", file=sys.stderr)
    else:
        print("\n".join(plain(task.id) for task in drawn))
    _keep(sampler, state)


def _config(choice: dict[str, Any], *, seed: int, ratio: str | None, shard: str) -> SamplerConfig:
    from webgym.core.errors import ConfigError
    from webgym.settings import validated
    from webgym.tasks.sampling import SamplerConfig, parse_ratio

    number, slash, of = shard.partition("/")
    if not (slash and number.isdecimal() and of.isdecimal()):
        raise ConfigError(f"{shard!r} is not a shard", hint="give which of how many, from 0, such as 0/4")
    told = {"seed": seed, "ratio": None if ratio is None else parse_ratio(ratio)}
    return validated(SamplerConfig, {**choice, **told, "shard": int(number), "shards": int(of)})


def _checked(website: str) -> str:
    from webgym.core.errors import ConfigError
    from webgym.core.websites import site_of

    try:
        return site_of(website)
    except ValueError as error:
        raise ConfigError(str(error), hint="give a host or a URL to --block") from error


def _restore(sampler: Sampler, state: Path | None) -> None:
    import json

    from webgym.core.errors import ConfigError

    if state is None or not state.exists():
        return
    try:
        held: Any = json.loads(state.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"{state} is not a sampler's state: {error}", hint="remove it to start over"
        ) from error
    sampler.restore(held if isinstance(held, dict) else {})


def _keep(sampler: Sampler, state: Path | None) -> None:
    import json

    from webgym.tasks.files import whole_file

    if state is not None:
        with whole_file(state) as file:
            file.write(json.dumps(sampler.state()).encode() + b"\n")


def _results(runs: list[Path]) -> dict[str, tuple[int, int]]:
    """Successes and attempts that carry a reward, by task."""
    from webgym.core.outcome import Outcome
    from webgym.rollout.store import RunReader

    results: dict[str, tuple[int, int]] = {}
    for path in runs:
        for entry in RunReader(path).attempts.values():
            if entry.outcome.is_rewarded:
                successes, attempts = results.get(entry.task_id, (0, 0))
                results[entry.task_id] = (successes + (entry.outcome == Outcome.SUCCESS), attempts + 1)
    return results
