"""Runs a build: completely, as a dry run, or up to writing batch files; and the files that it writes."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final

import msgspec
import yaml

from webgym.core.errors import ConfigError, TaskFileError, TooFewWebsites
from webgym.core.tables import Table, printed
from webgym.core.task import LEVELS, Task
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient
from webgym.llm.completion import Completes
from webgym.llm.config import ChatConfig
from webgym.llm.ledger import Ledger
from webgym.llm.prices import Prices
from webgym.tasks.files import whole_file
from webgym.tasks.formats import refuse_others, write_tasks
from webgym.taskset.batch import BatchFile, Collector, write_batches
from webgym.taskset.construction.accounting import CountMismatch
from webgym.taskset.construction.config import PURPOSES, BuildConfig, Purpose
from webgym.taskset.construction.estimate import Estimate, Estimator, estimate
from webgym.taskset.construction.pipeline import Build, Pipeline
from webgym.taskset.construction.progress import StageProgress
from webgym.taskset.statistics import describe
from webgym.taskset.validate import validate

REPLIES: Final = "replies.sqlite"
"""File name of the cache in a build's folder."""

CONFIG: Final = "config.yaml"
"""File name of the resolved config in a build's folder."""

_WORKERS_PER_CALL: Final = 2
"""Workers per concurrent call: while one waits for its reply, another's reply is checked."""

_FEWEST_WORKERS: Final = 64
"""Fewest workers. Cached replies are read in groups, so many concurrent requests are faster."""


@dataclass(frozen=True)
class BuildPaths:
    """The paths of a build.

    Attributes:
        out: the folder of the build.
        cache: the file that caches replies.
    """

    out: Path
    cache: Path

    @classmethod
    def of(cls, out: Path, cache: Path | None = None) -> BuildPaths:
        """The paths of a build in the folder ``out``; its cache is there, too, unless another file is
        given."""
        return cls(out, cache or out / REPLIES)


@dataclass(frozen=True)
class FinishedBuild:
    """A completed build.

    Attributes:
        build: the result.
        ledger: tokens and dollars spent, by all runs with the same cache.
        written: paths of the files.
    """

    build: Build
    ledger: Ledger
    written: list[Path]

    def __str__(self) -> str:
        return printed(self.parts())

    def parts(self) -> Iterator[Table | str]:
        """What every stage did with the tasks as a table, what was paid, and what failed."""
        cells = []
        for stage in dict.fromkeys(row.stage for row in self.build.accounting.rows):
            rows = [row for row in self.build.accounting.rows if row.stage == stage]
            reasons: Counter[str] = Counter()
            for row in rows:
                reasons.update(row.lost)
            came, made, left = (sum(getattr(row, name) for row in rows) for name in ("came", "made", "left"))
            why = ", ".join(f"{reason} {count:,}" for reason, count in reasons.items())
            cells.append((stage, str(came), str(made), str(reasons.total()), str(left), why))
        yield Table("", ("stage", "in", "created", "removed", "out", "reasons for removal"), cells)
        spent = self.ledger.totals.all
        unpriced = f", {spent.unpriced:,} of them without a known price" if spent.unpriced else ""
        yield f"\npaid     ${spent.dollars:,.4f} for {spent.calls:,} calls{unpriced}, {spent.tokens:,} tokens"
        if may_pass := sum(failure.may_pass for failure in self.build.failures):
            yield f"failed   {may_pass:,} requests, by the endpoint; run the command again to retry them"


async def run_build(config: BuildConfig, paths: BuildPaths, stages: StageProgress) -> FinishedBuild:
    """Build a task set, or resume one.

    Raises:
        UsageError: a source or the config cannot be used, or there are too few websites.
        LLMError: the endpoint cannot be used, or the budget is spent; replies so far are kept in the cache.
    """
    today = _write_config(config, paths.out)
    async with _clients(config, paths.cache) as (clients, ledger):
        most = max((chat.concurrency for chat in _chats(config).values()), default=0)
        workers = max(_FEWEST_WORKERS, _WORKERS_PER_CALL * most)
        pipeline = Pipeline(config, clients, stages, today=today, workers=workers)
        build = await _run(pipeline, paths.out)
    return FinishedBuild(build, ledger, write_build(build, paths.out, today, stages))


@dataclass(frozen=True)
class PendingBatches:
    """A build that waits for the results of batches.

    Attributes:
        build: its current state.
        files: the batch files written; empty if all requests are in earlier files already.
    """

    build: Build
    files: list[BatchFile]

    def __str__(self) -> str:
        new = sum(file.requests for file in self.files)
        waiting = f"{self.build.pending:,} replies, {new:,} of them requested in the files above"
        return "\n".join([*map(str, self.files), f"\nwaiting  {waiting}"])


async def run_batch(
    config: BuildConfig, paths: BuildPaths, folder: Path, stages: StageProgress
) -> FinishedBuild | PendingBatches:
    """As :func:`run_build`, but model requests are written to batch files.

    Rubrics do not depend on websites, so nearly all requests take two rounds of files: first websites and
    rubrics, then rewriting. Requests with unusable replies are repeated in the next round.

    Args:
        config: of the build.
        paths: of the build's folder and cache.
        folder: for the batch files.
        stages: shows the progress.

    Raises:
        UsageError: a source, the config or the folder cannot be used, or there are too few websites.
    """
    today = _write_config(config, paths.out)
    async with ReplyCache(paths.cache) as cache:
        collectors = {
            purpose: Collector(chat, cache).labelled(purpose) for purpose, chat in _chats(config).items()
        }
        pipeline = Pipeline(config, collectors, stages, today=today, workers=_FEWEST_WORKERS)
        build = await _run(pipeline, paths.out)
        if build.pending:
            return PendingBatches(build, await write_batches(cache, folder))
        ledger = Ledger(cache, prices=Prices(config.prices))
    return FinishedBuild(build, ledger, write_build(build, paths.out, today, stages))


async def run_dry(config: BuildConfig, paths: BuildPaths, stages: StageProgress) -> Estimate:
    """Estimate the rest of :func:`run_build`, without model requests and without writing files.

    Raises:
        UsageError: a source or the config cannot be used.
    """
    chats = _chats(config)
    async with AsyncExitStack() as stack:
        cache = await stack.enter_async_context(ReplyCache(paths.cache)) if paths.cache.exists() else None
        estimators = {
            purpose: Estimator(ChatClient(chat, cache=cache), cache) for purpose, chat in chats.items()
        }
        today = config.today or _earlier_today(paths.out) or date.today()
        build = await Pipeline(config, estimators, stages, today=today, workers=_FEWEST_WORKERS).run()
    names = {purpose: chat.model for purpose, chat in chats.items()}
    return estimate(build, estimators, names, Prices(config.prices))


async def _run(pipeline: Pipeline, out: Path) -> Build:
    """Run the stages; if too many tasks failed to make a split, write the list of failures."""
    try:
        return await pipeline.run()
    except TooFewWebsites as error:
        failures = pipeline.so_far.failures
        if not failures:
            raise
        raise TooFewWebsites(
            f"{error.message}; {len(failures):,} tasks failed, the last: {failures[-1].reason}",
            hint=f"{write_failures(pipeline.so_far, out)} has every reason and reply",
        ) from error


@asynccontextmanager
async def _clients(
    config: BuildConfig, cache_file: Path
) -> AsyncIterator[tuple[Mapping[Purpose, Completes], Ledger]]:
    """Open the model clients by purpose; purposes with the same endpoint and model share one."""
    chats = _chats(config)
    async with AsyncExitStack() as stack:
        cache_file.parent.mkdir(parents=True, exist_ok=True)
        cache = await stack.enter_async_context(ReplyCache(cache_file))
        ledger = Ledger(cache, prices=Prices(config.prices), budget=config.budget)
        opened: list[ChatClient] = []
        for chat in chats.values():
            if all(client.config != chat for client in opened):
                client = ChatClient(chat, cache=cache, ledger=ledger)
                opened.append(await stack.enter_async_context(client))
        yield (
            {
                purpose: next(client for client in opened if client.config == chat).labelled(purpose)
                for purpose, chat in chats.items()
            },
            ledger,
        )


def _chats(config: BuildConfig) -> dict[Purpose, ChatConfig]:
    asked = (purpose for purpose in PURPOSES if purpose != "critic" or config.writing.critic)
    chats = ((purpose, config.chat(purpose)) for purpose in asked)
    return {purpose: chat for purpose, chat in chats if chat is not None}


def _write_config(config: BuildConfig, out: Path) -> date:
    """Write the resolved config to the folder; the date that counts as today.

    Raises:
        TaskFileError: the folder cannot be written, or holds task files that no build wrote.
    """
    refuse_others(out, [name for names in TASK_FILES.values() for name in names])
    today = config.today or _earlier_today(out) or date.today()
    resolved = config.model_copy(update={"today": today}).model_dump(mode="json")
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / CONFIG).write_text(yaml.safe_dump(resolved, sort_keys=False, allow_unicode=True), "utf-8")
    except OSError as error:
        raise TaskFileError(f"cannot write to {out}: {error.strerror or error}") from error
    return today


def _earlier_today(out: Path) -> date | None:
    """The date that counted as today in an earlier run into the folder; ``None`` if there was none."""
    try:
        config = yaml.safe_load((out / CONFIG).read_text("utf-8"))
        return date.fromisoformat(str(config["today"]))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError) as error:
        raise ConfigError(
            f"{out / CONFIG} is not the config of a build", hint="give another --out, or remove the file"
        ) from error


MANIFEST: Final = "manifest.json"
FAILED: Final = "failed.jsonl"
TASK_FILES: Final = {
    split: tuple(f"{split}.{ending}" for ending in ("jsonl", "parquet")) for split in ("train", "test")
}
"""Names of the files of tasks, by split."""
_FORMAT: Final = 1


def write_build(build: Build, out: Path, today: date, stages: StageProgress) -> list[Path]:
    """Validate the task set and write all files of a build.

    Returns:
        The files written.

    Raises:
        CountMismatch: the set breaks a rule of :mod:`webgym.taskset.validate`, such as a leak between the
            splits.
        TaskFileError: the folder cannot be written.
    """
    # How a source derived its own tasks is its own affair.
    given = {task.id for task in build.imported.tasks if task.parent_id is not None}
    for offender in validate(build.tasks).offenders:
        if offender.rule != "derived" or offender.id not in given:
            raise CountMismatch(f"the task set breaks a rule: {offender}")
    written: list[Path] = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / MANIFEST).unlink(missing_ok=True)  # of an earlier build, whose files are replaced now
        with stages.stage("write", len(build.tasks)) as advance:
            for split, names in TASK_FILES.items():
                part = [task for task in build.tasks if task.split == split]
                for name in names:
                    written.append(out / name)
                    write_tasks(written[-1], part)
                advance(len(part))
        skipped = ({"source": name, **msgspec.structs.asdict(it)} for name, it in build.imported.skipped)
        lists = {FAILED: build.failures, "skipped.jsonl": skipped, "dropped.jsonl": build.dropped}
        for name, rows in lists.items():
            written.append(out / name)
            _write(written[-1], _rows(rows))
        with stages.stage("statistics", len(build.tasks)) as advance:
            statistics = describe(build.tasks)
            written.append(out / "statistics.json")
            _write(written[-1], _indented(statistics))
            if build.config.figures:
                from webgym.taskset.figures import draw_figures  # importing matplotlib takes seconds

                written += draw_figures(statistics, out / "figures")
            advance(len(build.tasks))
        written.append(out / MANIFEST)
        _write(written[-1], _indented(manifest(build, today)))
    except OSError as error:
        raise TaskFileError(f"cannot write to {out}: {error.strerror or error}") from error
    return written


def write_failures(build: Build, out: Path) -> Path:
    """Write only the list of failures, for a build that could not be finished; the path of the file.

    Raises:
        TaskFileError: the folder cannot be written.
    """
    try:
        _write(out / FAILED, _rows(build.failures))
    except OSError as error:
        raise TaskFileError(f"cannot write to {out}: {error.strerror or error}") from error
    return out / FAILED


def manifest(build: Build, today: date) -> dict[str, Any]:
    """The manifest: config, sources and counts of every stage; nothing that differs from run to run."""
    config = build.config.model_dump(
        mode="json", exclude={"budget", "assumptions", "today", "endpoint_failures", "figures"}
    )
    stages: dict[str, dict[str, Any]] = {}
    for row in build.accounting.rows:
        entry = {"came": row.came, "made": row.made, "lost": row.lost, "left": row.left}
        stages.setdefault(row.stage, {})[row.source] = entry
    return {
        "format": _FORMAT,
        "today": today.isoformat(),
        "config": config,
        "sources": build.imported.reports,
        "stages": stages,
        "asked": {purpose: msgspec.to_builtins(tally) for purpose, tally in build.tallies.items()},
        "capped_parents": build.capped,
        "tasks": _counts(build.tasks),
    }


def _counts(tasks: Sequence[Task]) -> dict[str, Any]:
    return {
        split: {
            "tasks": len(part),
            "derived": sum(task.parent_id is not None for task in part),
            "levels": {level: sum(task.level == level for task in part) for level in LEVELS},
        }
        for split in ("train", "test")
        for part in [[task for task in tasks if task.split == split]]
    }


def _write(path: Path, data: bytes) -> None:
    with whole_file(path) as file:
        file.write(data)


def _rows(rows: Iterable[Any]) -> bytes:
    return b"".join(msgspec.json.encode(row) + b"\n" for row in rows)


def _indented(value: Any) -> bytes:
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"
