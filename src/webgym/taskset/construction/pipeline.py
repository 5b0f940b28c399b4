"""The stages of a build, in order.

import → websites → duplicates → rubrics → decomposition → rewriting → duplicates of derived tasks → split

The import makes a task of every record of the sources, or leaves it out for a reason.

The result is a function of the sources, the config and the models' replies. There are no checkpoints: replies
are in a cache, and everything else is recomputed within a minute. Near-duplicates among the sources' tasks
are removed before rubrics are requested, those among derived tasks once their texts are written.
"""

from __future__ import annotations

import asyncio
import hashlib
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from functools import partial
from typing import Any, Final, Generic, TypeVar

import msgspec

from webgym.core.errors import (
    BudgetSpent,
    CacheError,
    LLMError,
    LLMUnreachable,
    LLMUnusable,
    NotCached,
    TaskFileError,
    TooFewWebsites,
)
from webgym.core.task import Rubric, Task
from webgym.core.websites import site_of
from webgym.llm.client import EndpointRefused
from webgym.llm.completion import Completes
from webgym.tasks.published import DIFFICULTY_DIFFERS
from webgym.tasks.sources import SOURCES, Skipped, SourceTask
from webgym.tasks.sources.base import ENCRYPTED_SOURCE
from webgym.tasks.sources.importing import read_source
from webgym.tasks.split import split
from webgym.tasks.taxonomy import DOMAIN_OF
from webgym.taskset.construction.accounting import TaskAccounting
from webgym.taskset.construction.config import BuildConfig, Purpose, no_model
from webgym.taskset.construction.progress import StageProgress
from webgym.taskset.decompose import decompose
from webgym.taskset.duplicates import drop_duplicates
from webgym.taskset.writing import infer_website, rewrite, write_rubric

WITHHELD = "plain text not asked for"
OVER_AT_MOST = "over at_most"


@dataclass(frozen=True)
class Imported:
    """Contents of all sources.

    Attributes:
        tasks: the tasks of the build, by source in the order of the paper's Table 1.
        skipped: records that gave no task, with the names of their sources.
        reports: by source, its counts beside those of the paper (SOURCES.md, pitfall 7), and its files
            without tasks.
        test_tasks: the sources' own test tasks, also those over ``at_most``.
    """

    tasks: list[SourceTask]
    skipped: list[tuple[str, Skipped]]
    reports: dict[str, dict[str, Any]]
    test_tasks: list[SourceTask] = field(default_factory=list)


def import_tasks(
    config: BuildConfig, today: date, accounting: TaskAccounting, stages: StageProgress
) -> Imported:
    """Read the sources.

    Tasks of an encrypted source are left out unless the config lists it in ``plaintext``: they are neither
    sent to a model nor written to a file.

    Raises:
        UsageError: a source cannot be read, or has no task.
    """
    imported = Imported([], [], {})
    came: Counter[str] = Counter()
    lost: Counter[tuple[str, str]] = Counter()
    with stages.stage("import", len(config.sources)) as advance:
        for name, choice in config.sources.items():
            read = read_source(name, choice.path, today=today)
            if not read.tasks:
                raise TaskFileError(
                    f"{choice.path} contains no task of {name}; the first skipped record: {read.skipped[0]}",
                    hint=f"webgym tasks sources --read {name}={choice.path} lists the reasons",
                )
            imported.test_tasks.extend(task for task in read.tasks if task.split == "test")
            came[name] = read.records
            lost[name, "no task"] = len(read.skipped)
            imported.skipped.extend((name, record) for record in read.skipped)
            tasks = [
                task for task in read.tasks if name in config.plaintext or ENCRYPTED_SOURCE not in task.flags
            ]
            lost[name, WITHHELD] = len(read.tasks) - len(tasks)
            chosen = draw(tasks, choice.at_most, config.seed)
            lost[name, OVER_AT_MOST] = len(tasks) - len(chosen)
            imported.tasks.extend(chosen)
            imported.reports[name] = {
                "name": name,
                "path": choice.path,
                "records": read.records,
                "tasks": len(read.tasks),
                "websites": read.websites(),
                "paper_tasks": SOURCES[name].paper_tasks,
                "paper_websites": SOURCES[name].paper_websites,
                "website_from": dict(sorted(read.websites_from().items())),
                "flags": dict(sorted(read.flags().items())),
                "passed_over": [str(file) for file in read.passed_over],
            }
            advance(1)
    accounting.record("import", came=came, lost=lost, left=Counter(task.source for task in imported.tasks))
    return imported


def draw(tasks: list[SourceTask], at_most: int | None, seed: int) -> list[SourceTask]:
    """At most ``at_most`` of the tasks, in their order. A larger ``at_most`` gives the same tasks and
    more."""
    if at_most is None or len(tasks) <= at_most:
        return tasks

    def key(task: SourceTask) -> bytes:
        return hashlib.blake2b(f"{seed}/{task.id}".encode(), digest_size=16).digest()

    chosen = {task.id for task in sorted(tasks, key=key)[:at_most]}
    return [task for task in tasks if task.id in chosen]


T = TypeVar("T", SourceTask, Task)
Item = TypeVar("Item")
R = TypeVar("R")

_PERMANENT_FAILURES: Final = frozenset({401, 402, 403, 404, 405})
"""HTTP statuses that every further request would get, too."""


class Done(msgspec.Struct, Generic[R], frozen=True):
    """The result of a request."""

    value: R


class Failed(msgspec.Struct, frozen=True):
    """A failed request.

    Attributes:
        reason: why, in one line.
        replies: the model's unusable replies, if any.
        may_pass: whether the endpoint failed rather than the model, so that another run may succeed.
    """

    reason: str
    replies: tuple[str, ...] = ()
    may_pass: bool = False


class Pending(msgspec.Struct, frozen=True):
    """A request without a reply yet: it will come from a batch, or from a run without ``--dry-run``."""


async def ask_all(
    items: Sequence[Item],
    ask: Callable[[Item], Awaitable[R]],
    *,
    workers: int,
    failures_in_a_row: int,
    advance: Callable[[], None],
) -> list[Done[R] | Failed | Pending]:
    """Send a request for each item.

    Args:
        items: what to ask about.
        ask: sends the request for one item and returns its result.
        workers: number of concurrent requests.
        failures_in_a_row: number of consecutive failures of the endpoint after which no more requests are
            sent.
        advance: called after each item.

    Returns:
        The results, in the order of the items.

    Raises:
        BudgetSpent: the budget is spent. Requests in flight are awaited first, so that their replies are
            kept.
        LLMError: the endpoint cannot be used at all, or failed too often in a row.
        CacheError: replies cannot be stored.
    """
    results: list[Done[R] | Failed | Pending] = [Pending()] * len(items)
    work = iter(range(len(items)))
    stop = _Stop(failures_in_a_row)

    async def worker(indices: Iterator[int]) -> None:
        for index in indices:
            if stop.reason is not None:
                return
            try:
                results[index] = Done(await ask(items[index]))
                stop.reply()
            except NotCached:
                results[index] = Pending()
            except LLMUnusable as error:
                results[index] = Failed(error.reason or error.message, error.replies)
                stop.reply()
            except (LLMError, CacheError) as error:
                stop.failure(error)
                results[index] = Failed(error.message, may_pass=True)
            advance()

    async with asyncio.TaskGroup() as group:
        for _ in range(min(workers, len(items))):
            group.create_task(worker(work))
    if stop.reason is not None:
        raise stop.reason
    return results


class _Stop:
    """Decides by the failures so far whether to stop; ``reason`` is then set."""

    def __init__(self, most_in_a_row: int) -> None:
        self.reason: LLMError | CacheError | None = None
        self._most = most_in_a_row
        self._in_a_row = 0

    def reply(self) -> None:
        self._in_a_row = 0

    def failure(self, error: LLMError | CacheError) -> None:
        self._in_a_row += 1
        is_permanent = isinstance(error, EndpointRefused) and error.status in _PERMANENT_FAILURES
        is_final = isinstance(error, BudgetSpent | CacheError | LLMUnreachable) or is_permanent
        if self.reason is None and (is_final or self._in_a_row >= self._most):
            self.reason = error


class Failure(msgspec.Struct, frozen=True, kw_only=True):
    """A task that failed at a stage.

    Attributes:
        id, source: of the task.
        stage: at which it failed.
        reason: why, in one line.
        may_pass: whether the endpoint failed rather than the model, so that another run may succeed.
        replies: the model's unusable replies.
    """

    id: str
    source: str
    stage: str
    reason: str
    may_pass: bool
    replies: tuple[str, ...]


class DroppedTask(msgspec.Struct, frozen=True, kw_only=True):
    """A task that was left out on purpose.

    Attributes:
        id, source: of the task.
        stage: at which it was left out.
        reason: why.
        of: id of the task that it duplicates, or the website that excludes it; empty if there is none.
    """

    id: str
    source: str
    stage: str
    reason: str
    of: str


class Tally(msgspec.Struct):
    """Counts of the requests for one purpose.

    Attributes:
        things: number of tasks that needed a request.
        done, failed, pending: number of them with a result, with a failure, and without a reply yet.
    """

    things: int = 0
    done: int = 0
    failed: int = 0
    pending: int = 0


@dataclass
class Build:
    """A build in progress, and its results.

    Attributes:
        config: the build's config, with its seed in all sections.
        accounting: counts of every stage.
        imported: contents of the sources.
        tasks: the finished tasks, with ``split`` set; empty while replies are pending.
        failures: tasks that failed.
        dropped: tasks that were left out on purpose.
        capped: number of tasks with more subsets than the limit on derived tasks.
        tallies: counts of requests, by purpose.
    """

    config: BuildConfig
    accounting: TaskAccounting
    imported: Imported = field(default_factory=lambda: Imported([], [], {}))
    tasks: list[Task] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    dropped: list[DroppedTask] = field(default_factory=list)
    capped: int = 0
    tallies: dict[Purpose, Tally] = field(default_factory=dict)

    @property
    def pending(self) -> int:
        """Number of requests without a reply yet."""
        return sum(tally.pending for tally in self.tallies.values())


class Pipeline:
    """Runs the stages of a build.

    Args:
        config: of the build.
        models: the model clients, by purpose.
        stages: shows the progress.
        today: tasks about earlier dates are flagged as dated.
        workers: number of concurrent requests.
    """

    def __init__(
        self,
        config: BuildConfig,
        models: Mapping[Purpose, Completes],
        stages: StageProgress,
        *,
        today: date,
        workers: int,
    ) -> None:
        self._config = config.seeded()
        self._models = models
        self._stages = stages
        self._today = today
        self._workers = workers
        self._pending: set[str] = set()
        self._build = Build(self._config, TaskAccounting(config.sources))

    @property
    def so_far(self) -> Build:
        """The build in its current state."""
        return self._build

    async def run(self) -> Build:
        """Run all stages. While replies are pending, the tasks are not split.

        Raises:
            LLMError: the endpoint cannot be used, or the budget is spent.
            UsageError: a source cannot be read, a model is needed and none is configured, or there are too
                few websites for the test set.
            CountMismatch: a stage lost a task (a bug).
        """
        build = self._build
        build.imported = import_tasks(self._config, self._today, build.accounting, self._stages)
        placed, waiting = await self._websites(build.imported.tasks)
        distinct = self._without_duplicates("duplicates", placed)
        self._check_websites(distinct)
        finished = await self._rubrics(distinct, waiting)
        derived = self._decomposed(finished)
        rewritten = await self._rewritten(finished, derived)
        whole = self._without_duplicates("duplicates of derived", rewritten)
        if not build.pending:
            build.tasks = self._split(whole)
        return build

    async def _websites(self, tasks: list[SourceTask]) -> tuple[list[SourceTask], set[str]]:
        """Infer missing websites and domains.

        Returns:
            The tasks, and the ids of those whose reply is pending. These are passed on, because their rubric
            can be requested without it, and removed at that stage.
        """
        unplaced = [
            task for task in tasks if task.website is None or DOMAIN_OF.get(task.subdomain) != task.domain
        ]
        ask = partial(infer_website, tries=self._config.writing.tries)
        results = await self._ask("website", "websites", unplaced, ask)
        placed: list[SourceTask] = []
        waiting: set[str] = set()
        for task in tasks:
            result = results.get(task.id)
            if isinstance(result, Done):
                place = result.value
                task = msgspec.structs.replace(
                    task, website=place.website, domain=place.domain, subdomain=place.subdomain
                )
            elif isinstance(result, Pending):
                waiting.add(task.id)
            elif result is not None:
                continue
            placed.append(task)
        self._record_stage("websites", tasks, placed)
        return placed, waiting

    def _without_duplicates(self, stage: str, tasks: list[T]) -> list[T]:
        """The tasks without duplicates."""
        with self._stages.stage(stage, len(tasks)) as advance:
            result = drop_duplicates(tasks, self._config.duplicates)
            advance(len(tasks))
        for duplicate in result.dropped:
            self._drop(duplicate.id, duplicate.source, stage, duplicate.why, duplicate.of)
        self._record_stage(stage, tasks, result.kept)
        return result.kept

    def _check_websites(self, tasks: list[SourceTask]) -> None:
        """Check that there are enough websites for the test set, before rubrics are requested.

        Every website that is still to be inferred counts as a new one.
        """
        known = {site_of(task.website) for task in tasks if task.website is not None}
        most = len(known) + sum(task.website is None for task in tasks)
        wanted = self._config.split.test_tasks
        if most < wanted:
            raise TooFewWebsites(
                f"{wanted:,} test tasks need as many websites, and there are {most:,}",
                hint="ask for fewer with --test-size, or give more tasks",
            )

    async def _rubrics(self, tasks: list[SourceTask], waiting: set[str]) -> list[Task]:
        """The tasks with rubrics: the source's own, or one that a model writes."""
        bare = [task for task in tasks if task.rubric is None]
        ask = partial(write_rubric, critic=self._critic(), tries=self._config.writing.tries)
        results = await self._ask("rubric", "rubrics", bare, ask)
        finished: list[Task] = []
        for task in tasks:
            result = results.get(task.id)
            rubric = result.value if isinstance(result, Done) else task.rubric
            if rubric is not None and task.id not in waiting:
                finished.append(_finished(task, rubric))
        self._record_stage("rubrics", tasks, finished)
        return finished

    def _decomposed(self, tasks: list[Task]) -> list[Task]:
        """The tasks derived from these, without those that are among them; their instructions are still
        those of their parents."""
        with self._stages.stage("decomposition", len(tasks)) as advance:
            result = decompose(tasks, self._config.decomposing)
            advance(len(tasks))
        self._build.capped = result.capped
        taken = {task.id for task in tasks}
        derived = [task for task in result.derived if task.id not in taken]
        count = _by_source(tasks)
        made = _by_source(derived)
        self._build.accounting.record("decomposition", came=count, made=made, left=count + made)
        return derived

    async def _rewritten(self, parents: list[Task], derived: list[Task]) -> list[Task]:
        """The parents, each followed by its derived tasks with rewritten instructions."""
        critic, tries = self._critic(), self._config.writing.tries
        by_id = {task.id: task for task in parents}

        async def ask(model: Completes, task: Task) -> str:
            parent = by_id[task.parent_id or ""]
            return await rewrite(model, parent, task.rubric.groups, critic=critic, tries=tries)

        results = await self._ask("rewriting", "rewriting", derived, ask)
        children: dict[str, list[Task]] = {}
        for task in derived:
            result = results[task.id]
            if isinstance(result, Done):
                text = msgspec.structs.replace(task, instruction=result.value)
                children.setdefault(task.parent_id or "", []).append(text)
        rewritten = [task for parent in parents for task in (parent, *children.get(parent.id, ()))]
        self._record_stage("rewriting", [*parents, *derived], rewritten)
        return rewritten

    def _split(self, tasks: list[Task]) -> list[Task]:
        with self._stages.stage("split", len(tasks)) as advance:
            result = split(tasks, self._config.split, self._build.imported.test_tasks)
            advance(len(tasks))
        sources = {task.id: task.source for task in tasks}
        for task in result.left_out:
            self._drop(task.id, sources[task.id], "split", task.why, task.website)
        self._record_stage("split", tasks, result.tasks)
        return result.tasks

    # --- requests and accounting ----------------------------------------------------------------------------

    def _critic(self) -> Completes | None:
        """The critic; ``None`` if there is to be none.

        Raises:
            ConfigError: there is to be one, and no model is configured.
        """
        if not self._config.writing.critic:
            return None
        if (critic := self._models.get("critic")) is None:
            raise no_model("critic")
        return critic

    async def _ask(
        self, purpose: Purpose, stage: str, tasks: Sequence[T], ask: Callable[[Completes, T], Awaitable[R]]
    ) -> dict[str, Done[R] | Failed | Pending]:
        """The result of a request for each task, by id.

        Raises:
            ConfigError: there are tasks, and no model is configured.
        """
        model = self._models.get(purpose)
        if model is None and tasks:
            raise no_model(purpose)

        async def ask_model(task: T) -> R:
            assert model is not None, "without one there are no tasks"
            return await ask(model, task)

        with self._stages.stage(stage, len(tasks)) as advance:
            results = await ask_all(
                tasks,
                ask_model,
                workers=self._workers,
                failures_in_a_row=self._config.endpoint_failures,
                advance=lambda: advance(1),
            )
        tally = self._build.tallies[purpose] = Tally(things=len(tasks))
        for task, result in zip(tasks, results, strict=True):
            if isinstance(result, Done):
                tally.done += 1
            elif isinstance(result, Pending):
                tally.pending += 1
                self._pending.add(task.id)
            else:
                tally.failed += 1
                self._build.failures.append(
                    Failure(
                        id=task.id,
                        source=task.source,
                        stage=stage,
                        reason=result.reason,
                        may_pass=result.may_pass,
                        replies=result.replies,
                    )
                )
        return {task.id: result for task, result in zip(tasks, results, strict=True)}

    def _drop(self, id: str, source: str, stage: str, reason: str, of: str) -> None:
        self._build.dropped.append(DroppedTask(id=id, source=source, stage=stage, reason=reason, of=of))

    def _record_stage(
        self, stage: str, came: Sequence[SourceTask | Task], left: Sequence[SourceTask | Task]
    ) -> None:
        """Record the counts of a stage that creates no tasks, with the noted reasons for removed ones."""
        reasons = dict.fromkeys(self._pending, "pending")
        reasons |= {task.id: task.reason for task in self._build.dropped if task.stage == stage}
        reasons |= {task.id: "failed" for task in self._build.failures if task.stage == stage}
        kept = {task.id for task in left}
        removed = [task for task in came if task.id not in kept]
        lost = Counter((task.source, reasons[task.id]) for task in removed if task.id in reasons)
        self._build.accounting.record(stage, came=_by_source(came), lost=lost, left=_by_source(left))


def _by_source(tasks: Iterable[SourceTask | Task]) -> Counter[str]:
    return Counter(task.source for task in tasks)


def _finished(task: SourceTask, rubric: Rubric) -> Task:
    assert task.website is not None, "tasks without a website were removed before"
    return Task(
        id=task.id,
        instruction=task.instruction,
        website=task.website,
        domain=task.domain,
        subdomain=task.subdomain,
        rubric=rubric,
        source=task.source,
        reference_answer=task.reference_answer,
        example_answer=task.example_answer,
        parent_id=task.parent_id,
        split=task.split,
        website_from=task.website_from,
        flags=tuple(flag for flag in task.flags if flag != DIFFICULTY_DIFFERS),
        extra=task.extra,
    )
