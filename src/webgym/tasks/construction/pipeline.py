"""The stages of a build, in order.

import → websites → duplicates → rubrics → decomposition → rewriting → duplicates of derived tasks → split

The result is a function of the sources, the config and the models' replies. There are no checkpoints: what
has been paid for is in the cache of replies, and the rest is done anew in a minute. Near-duplicates among the
sources' tasks go before a rubric is paid for, those among derived tasks when their texts are known.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from typing import TypeVar

import msgspec

from webgym.core.errors import TooFewWebsites
from webgym.core.task import Rubric, Task
from webgym.core.websites import site_of
from webgym.llm.completion import Completes
from webgym.tasks.construction.accounting import TaskAccounting
from webgym.tasks.construction.bulk_requests import Done, Failed, Pending, ask_all
from webgym.tasks.construction.config import BuildConfig, Purpose, no_model
from webgym.tasks.construction.importing import Imported, import_tasks
from webgym.tasks.construction.progress import StageProgress
from webgym.tasks.decompose import Capped, decompose
from webgym.tasks.duplicates import drop_duplicates
from webgym.tasks.rules import Finding
from webgym.tasks.sources import SourceTask
from webgym.tasks.split import split
from webgym.tasks.taxonomy import DOMAIN_OF
from webgym.tasks.writing import Inferred, Written, infer_website, review, rewrite, write_rubric

T = TypeVar("T", SourceTask, Task)
R = TypeVar("R")


class Failure(msgspec.Struct, frozen=True, kw_only=True):
    """A task that a stage failed on.

    Attributes:
        id, source, stage: which, and where.
        reason: one line.
        may_pass: the endpoint did it; running again asks again.
        replies: what the model said.
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
        id, source, stage: which, and where.
        reason: why.
        of: the task or website that it gave way to, if there is one.
    """

    id: str
    source: str
    stage: str
    reason: str
    of: str


class Remark(msgspec.Struct, frozen=True, kw_only=True):
    """A rule that an accepted rubric seems to break.

    Attributes:
        id: of the task.
        rule, severity, message: of the finding. Errors come from rubrics that a source brought along.
    """

    id: str
    rule: str
    severity: str
    message: str


class Tally(msgspec.Struct):
    """Counts of the requests for one purpose.

    Attributes:
        things: tasks that were asked about.
        done, failed, pending: how it went with them.
    """

    things: int = 0
    done: int = 0
    failed: int = 0
    pending: int = 0


@dataclass
class Build:
    """A build in progress, and its results.

    Attributes:
        config: as given, seeded.
        accounting: where every task went.
        imported: what the sources held.
        tasks: the finished ones, ``split`` set; empty while replies are pending.
        failures, dropped, remarks, capped: what did not go as it might have.
        tallies: by purpose.
    """

    config: BuildConfig
    accounting: TaskAccounting
    imported: Imported = field(default_factory=lambda: Imported([], [], []))
    tasks: list[Task] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    dropped: list[DroppedTask] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    capped: list[Capped] = field(default_factory=list)
    tallies: dict[Purpose, Tally] = field(default_factory=dict)

    @property
    def pending(self) -> int:
        """Things whose reply is to come."""
        return sum(tally.pending for tally in self.tallies.values())


class Pipeline:
    """Runs the stages.

    Args:
        config: of the build.
        models: whom to ask, by purpose.
        stages: shows how far it is.
        today: what lies before it has passed.
        workers: how many things are asked about at a time.
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
        """The build on its way."""
        return self._build

    async def run(self) -> Build:
        """All stages, or as far as replies go: with some of them pending there is no split.

        Raises:
            LLMError: the endpoint cannot be used, or the budget is spent.
            UsageError: a source cannot be read, a model is needed and none is given, or there are too few
                websites for the test set.
            CountMismatch: a task was lost on the way.
        """
        build = self._build
        build.imported = import_tasks(self._config, self._today, build.accounting, self._stages)
        placed, waiting = await self._websites(build.imported.tasks)
        distinct = self._distinct("duplicates", placed)
        self._check_websites(distinct)
        finished = await self._rubrics(distinct, waiting)
        derived = self._decomposed(finished)
        rewritten = await self._rewritten(finished, derived)
        whole = self._distinct("duplicates of derived", rewritten)
        if not build.pending:
            build.tasks = self._split(whole)
        return build

    async def _websites(self, tasks: list[SourceTask]) -> tuple[list[SourceTask], set[str]]:
        """Website and domain where they are missing; and which tasks wait for theirs.

        Those that wait go on to be asked for their rubric, which does not depend on it, and leave there.
        """
        unplaced = [task for task in tasks if task.website is None or not _in_taxonomy(task)]
        limits = self._config.writing

        async def ask(model: Completes, task: SourceTask) -> Inferred:
            return await infer_website(model, task, limits=limits)

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
        self._enter("websites", tasks, placed)
        return placed, waiting

    def _distinct(self, stage: str, tasks: list[T]) -> list[T]:
        """One task of those that repeat each other."""
        with self._stages.stage(stage, len(tasks)) as advance:
            result = drop_duplicates(tasks, self._config.duplicates)
            advance(len(tasks))
        for each in result.dropped:
            self._drop(each.id, each.source, stage, each.why, each.of)
        self._enter(stage, tasks, result.kept)
        return result.kept

    def _check_websites(self, tasks: list[SourceTask]) -> None:
        """That there are enough for the test set, before a rubric is paid for. Those to come count as new."""
        known = {site_of(task.website) for task in tasks if task.website is not None}
        most = len(known) + sum(task.website is None for task in tasks)
        wanted = self._config.split.test_tasks
        if most < wanted:
            raise TooFewWebsites(
                f"{wanted:,} test tasks need as many websites, and there are {most:,}",
                hint="ask for fewer with --test-size, or give more tasks",
            )

    async def _rubrics(self, tasks: list[SourceTask], waiting: set[str]) -> list[Task]:
        """Finished tasks: with the rubric that the source gives, else one that is written."""
        bare = [task for task in tasks if task.rubric is None]
        limits = self._config.writing

        async def ask(model: Completes, task: SourceTask) -> Written:
            return await write_rubric(model, task, limits=limits)

        results = await self._ask("rubric", "rubrics", bare, ask)
        finished: list[Task] = []
        for task in tasks:
            result = results.get(task.id)
            if isinstance(result, Done):
                rubric, findings = result.value.rubric, result.value.findings
            elif result is None and task.rubric is not None:
                rubric, findings = task.rubric, tuple(review(task, task.rubric))
            else:
                continue
            if task.id not in waiting:
                finished.append(_finished(task, rubric))
                self._remark(task.id, findings)
        self._enter("rubrics", tasks, finished)
        return finished

    def _decomposed(self, tasks: list[Task]) -> list[Task]:
        """What can be derived from the tasks, their instructions still their parents'."""
        with self._stages.stage("decomposition", len(tasks)) as advance:
            result = decompose(tasks, self._config.decomposing)
            advance(len(tasks))
        self._build.capped = result.capped
        count = _by_source(tasks)
        made = _by_source(result.derived)
        self._build.accounting.enter("decomposition", came=count, made=made, left=count + made)
        return result.derived

    async def _rewritten(self, parents: list[Task], derived: list[Task]) -> list[Task]:
        """Parents, each followed by its children, whose instructions are now their own."""
        limits = self._config.writing
        by_id = {task.id: task for task in parents}

        async def ask(model: Completes, task: Task) -> str:
            return await rewrite(model, by_id[task.parent_id or ""], task.rubric.groups, limits=limits)

        results = await self._ask("rewriting", "rewriting", derived, ask)
        children: dict[str, list[Task]] = {}
        for task in derived:
            result = results[task.id]
            if isinstance(result, Done):
                text = msgspec.structs.replace(task, instruction=result.value)
                children.setdefault(task.parent_id or "", []).append(text)
        rewritten = [task for parent in parents for task in (parent, *children.get(parent.id, ()))]
        self._enter("rewriting", [*parents, *derived], rewritten)
        return rewritten

    def _split(self, tasks: list[Task]) -> list[Task]:
        with self._stages.stage("split", len(tasks)) as advance:
            result = split(tasks, self._config.split)
            advance(len(tasks))
        sources = {task.id: task.source for task in tasks}
        for each in result.left_out:
            self._drop(each.id, sources[each.id], "split", each.why, each.website)
        self._enter("split", tasks, result.tasks)
        return result.tasks

    # --- asking and accounting ----------------------------------------------------------------------------

    async def _ask(
        self, purpose: Purpose, stage: str, tasks: Sequence[T], ask: Callable[[Completes, T], Awaitable[R]]
    ) -> dict[str, Done[R] | Failed | Pending]:
        """What a model gave for each task, by id.

        Raises:
            ConfigError: there is something to ask, and no model to ask it.
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

    def _remark(self, id: str, findings: Iterable[Finding]) -> None:
        self._build.remarks.extend(
            Remark(id=id, rule=finding.rule, severity=finding.severity, message=finding.message)
            for finding in findings
        )

    def _enter(
        self, stage: str, came: Sequence[SourceTask | Task], left: Sequence[SourceTask | Task]
    ) -> None:
        """Enter a stage that makes no tasks; the reasons are those that were noted."""
        reasons = dict.fromkeys(self._pending, "pending")
        reasons |= {each.id: each.reason for each in self._build.dropped if each.stage == stage}
        reasons |= {each.id: "failed" for each in self._build.failures if each.stage == stage}
        stayed = {task.id for task in left}
        gone = [task for task in came if task.id not in stayed]
        lost = Counter((task.source, reasons[task.id]) for task in gone if task.id in reasons)
        self._build.accounting.enter(stage, came=_by_source(came), lost=lost, left=_by_source(left))


def _by_source(tasks: Iterable[SourceTask | Task]) -> Counter[str]:
    return Counter(task.source for task in tasks)


def _in_taxonomy(task: SourceTask) -> bool:
    return DOMAIN_OF.get(task.subdomain) == task.domain


def _finished(task: SourceTask, rubric: Rubric) -> Task:
    assert task.website is not None, "tasks without a website were left behind"
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
        website_from=task.website_from,
        flags=task.flags,
        extra=task.extra,
    )
