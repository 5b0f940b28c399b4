"""Runs a build: completely, as a dry run, or up to writing batch files."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Final

import yaml

from webgym.core.errors import ConfigError, TaskFileError, TooFewWebsites
from webgym.llm.batch import BatchFile, Collector, write_batches
from webgym.llm.cache import ReplyCache
from webgym.llm.client import ChatClient
from webgym.llm.completion import Completes
from webgym.llm.config import ChatConfig
from webgym.llm.ledger import Ledger
from webgym.llm.prices import Prices
from webgym.tasks.construction.config import PURPOSES, BuildConfig, Purpose
from webgym.tasks.construction.estimate import Estimate, Estimator, estimate
from webgym.tasks.construction.outputs import write_build, write_failures
from webgym.tasks.construction.pipeline import Build, Pipeline
from webgym.tasks.construction.progress import StageProgress

REPLIES: Final = "replies.sqlite"
"""The cache's name in a build's folder."""

CONFIG: Final = "config.yaml"
"""The resolved config's name in a build's folder."""

_WORKERS_PER_CALL: Final = 2
"""Things asked about per request in flight: while one waits for its reply, another's is checked."""

_FEWEST_WORKERS: Final = 64
"""Replies that are there already are read in groups, so it pays to ask for many at a time."""


@dataclass(frozen=True)
class BuildPaths:
    """The paths of a build.

    Attributes:
        out: its folder.
        cache: the file of replies.
    """

    out: Path
    cache: Path

    @classmethod
    def of(cls, out: Path, cache: Path | None = None) -> BuildPaths:
        """In a folder, with its replies there unless another file is given."""
        return cls(out, cache or out / REPLIES)


@dataclass(frozen=True)
class FinishedBuild:
    """A completed build.

    Attributes:
        build: what came of it.
        ledger: what was paid, by all runs into the same cache.
        written: the files.
    """

    build: Build
    ledger: Ledger
    written: list[Path]


async def run_build(config: BuildConfig, place: BuildPaths, stages: StageProgress) -> FinishedBuild:
    """Build a task set, or resume one.

    Raises:
        UsageError: a source, the config or the number of websites does not do.
        LLMError: the endpoint cannot be used, or the budget is spent; what was paid for is kept.
    """
    today = _settle(config, place.out)
    async with _clients(config, place.cache) as (clients, ledger):
        pipeline = Pipeline(config, clients, stages, today=today, workers=_workers(config))
        build = await _run(pipeline, place.out)
    return FinishedBuild(build, ledger, write_build(build, place.out, today, stages))


@dataclass(frozen=True)
class PendingBatches:
    """A build that waits for the results of batches.

    Attributes:
        build: as far as it came.
        files: the requests that were written; empty if all of them stand in files already.
    """

    build: Build
    files: list[BatchFile]


async def run_batch(
    config: BuildConfig, place: BuildPaths, folder: Path, stages: StageProgress
) -> FinishedBuild | PendingBatches:
    """As :func:`run_build`, but whatever has to be asked is written to batch files instead.

    Rubrics do not wait for websites. So two rounds of files do for nearly everything, rubrics and then
    rewriting, and what is refused is asked again with the next.

    Args:
        config: of the build.
        place: where it lives.
        folder: for the files.
        stages: shows how far it is.

    Raises:
        UsageError: a source, the config, the folder or the number of websites does not do.
    """
    today = _settle(config, place.out)
    async with ReplyCache(place.cache) as cache:
        collectors = {
            purpose: Collector(chat, cache).labelled(purpose) for purpose, chat in _chats(config).items()
        }
        pipeline = Pipeline(config, collectors, stages, today=today, workers=_FEWEST_WORKERS)
        build = await _run(pipeline, place.out)
        if build.pending:
            return PendingBatches(build, await write_batches(cache, folder))
        ledger = Ledger(cache, prices=Prices(config.prices))
    return FinishedBuild(build, ledger, write_build(build, place.out, today, stages))


async def run_dry(config: BuildConfig, place: BuildPaths, stages: StageProgress) -> Estimate:
    """What :func:`run_build` would take from here on. Nothing is asked and nothing is written.

    Raises:
        UsageError: a source or the config does not do.
    """
    chats = _chats(config)
    async with AsyncExitStack() as stack:
        cache = await stack.enter_async_context(ReplyCache(place.cache)) if place.cache.exists() else None
        estimators = {
            purpose: Estimator(ChatClient(chat, cache=cache), cache) for purpose, chat in chats.items()
        }
        today = config.today or _kept_today(place.out) or date.today()
        build = await Pipeline(config, estimators, stages, today=today, workers=_FEWEST_WORKERS).run()
    names = {purpose: chat.model for purpose, chat in chats.items()}
    return estimate(build, estimators, names, Prices(config.prices))


async def _run(pipeline: Pipeline, out: Path) -> Build:
    """Run the stages; if so many tasks failed that no split is left to make, leave a list of them."""
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
    """Open clients by purpose; purposes with the same endpoint and model share one."""
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
    chats = ((purpose, config.chat(purpose)) for purpose in PURPOSES)
    return {purpose: chat for purpose, chat in chats if chat is not None}


def _workers(config: BuildConfig) -> int:
    most = max((chat.concurrency for chat in _chats(config).values()), default=0)
    return max(_FEWEST_WORKERS, _WORKERS_PER_CALL * most)


def _settle(config: BuildConfig, out: Path) -> date:
    """Note the resolved config in the folder; the day that counts as today."""
    today = config.today or _kept_today(out) or date.today()
    resolved = config.model_copy(update={"today": today}).model_dump(mode="json")
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / CONFIG).write_text(yaml.safe_dump(resolved, sort_keys=False, allow_unicode=True), "utf-8")
    except OSError as error:
        raise TaskFileError(f"cannot write to {out}: {error.strerror or error}") from error
    return today


def _kept_today(out: Path) -> date | None:
    """The day that an earlier run into the folder took for today."""
    try:
        held = yaml.safe_load((out / CONFIG).read_text("utf-8"))
        return date.fromisoformat(str(held["today"]))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError) as error:
        raise ConfigError(
            f"{out / CONFIG} is no config of a build", hint="give another --out, or remove the file"
        ) from error
