"""Collecting a run, and resuming one: tasks, browsers, agent, judge and store are put together here.

This is what ``webgym rollout`` and ``webgym demo`` call::

    from pathlib import Path
    from webgym import RunConfig, collect

    summary = await collect(RunConfig(), Path("runs/first"))
"""

from __future__ import annotations

import asyncio
import sys
import uuid
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import (
    AbstractAsyncContextManager,
    AsyncExitStack,
    ExitStack,
    asynccontextmanager,
    nullcontext,
    suppress,
)
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
from rich.console import Console

from webgym.agent.agent import Agent
from webgym.agent.openai_policy import OpenAIPolicy
from webgym.agent.policy import Policy
from webgym.agent.preflight import check_policy
from webgym.agent.scripted import POLICY_NAMES, create_policy
from webgym.core.calls import CallQueue, call_queues
from webgym.core.errors import RunFolderError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.text import plain
from webgym.judge.base import Judge
from webgym.judge.config import JudgeChoice
from webgym.judge.factory import check_judge, open_judge, refuse_unjudgeable
from webgym.llm.health import report_problems, watch_clients
from webgym.results.run_index import RunIndex
from webgym.results.summary import Summary, oracle_notes, summarise
from webgym.rollout.attempt import AttemptContext
from webgym.rollout.collector import Collector
from webgym.rollout.driver import Browsers, SiteState
from webgym.rollout.judging import judge_again
from webgym.rollout.live import showing
from webgym.rollout.live_file import exposing, feeding
from webgym.rollout.lockstep import Lockstep
from webgym.rollout.plan import Plan
from webgym.rollout.progress import Progress
from webgym.rollout.sessions import KeptLeases, Places
from webgym.rollout.sharing import Claims, sharing
from webgym.rollout.trackers import check_installed, tracking
from webgym.run.choice import choose_tasks, given_tasks, health_of, tell_left_out
from webgym.run.config import (
    PolicyChoice,
    RunConfig,
    Secrets,
    ServerChoice,
    Tell,
    profile_for,
    read_config,
    resolved,
    say,
    with_pinned_tasks,
)
from webgym.run.services import open_services
from webgym.server.client import BrowserClient
from webgym.store.files import LEASES, METRICS, SITES
from webgym.store.runs import RunReader, RunWriter, refuse_taken
from webgym.tasks.files import NEEDS_PICTURES
from webgym.tasks.selection import BLOCKED

Show: TypeAlias = Callable[[Progress], AbstractAsyncContextManager[None]]


def show_on_stderr(progress: Progress) -> AbstractAsyncContextManager[None]:
    """Show a run's progress on stderr: a panel in a terminal, else a line at intervals."""
    return showing(progress, Console(stderr=True))


def print_on_stderr(line: str) -> None:
    """Print a line that the user should read."""
    print(f"webgym: {plain(line)}", file=sys.stderr, flush=True)


async def collect(
    config: RunConfig,
    out: Path | str,
    *,
    tasks: Sequence[Task] | None = None,
    policy: Policy | None = None,
    secrets: Secrets | None = None,
    show: Show | None = show_on_stderr,
    tell: Tell | None = print_on_stderr,
    finishing: asyncio.Event | None = None,
    places: Places | None = None,
) -> Summary:
    """Collect a run: every task is attempted, judged and on disk when this returns.

    Args:
        config: of the run.
        out: the run folder; it must be missing or empty.
        tasks: replace those that ``config.tasks`` would choose; they must belong to its split.
        policy: one of your own, in place of the one that ``config.policy`` names.
        secrets: tokens of servers that run elsewhere.
        show: shows the progress while the run goes on; ``None`` for no display.
        tell: called with each line that the user should read, such as a warning; ``None`` for none.
        finishing: once set, no new attempt starts, and the run ends when those in progress have ended.
        places: for attempts, shared with other runs; ``None`` for ``collector.sessions`` of its own.

    Raises:
        ConfigError: there is no task to attempt, the judge cannot judge these tasks, or a tracker is missing.
        RunFolderError: the folder already holds a run or other files.
        WebGymError: the run could not start or continue; what was collected is on disk.
    """
    out = Path(out)
    check_installed(config.trackers)
    await asyncio.to_thread(lambda: config.attempt.access)
    refuse_taken(out)  # before anything starts; the folder is created later
    if policy is not None:
        own = PolicyChoice(name=policy.name, check=config.policy.check)
        config = config.model_copy(update={"policy": own})
    elif "name" not in config.policy.model_fields_set:
        say(tell, f"no policy is named: {''.join(oracle_notes([config.policy.name]))}")
    config = resolved(config, policy, tell)
    requested = tasks
    if requested is None:
        config = await asyncio.to_thread(with_pinned_tasks, config)
    # A file of hundreds of thousands of tasks takes seconds, and the caller's loop has others to serve.
    chosen = await asyncio.to_thread(
        lambda: choose_tasks(config, tell) if requested is None else given_tasks(requested, config)
    )
    tasks, selected = chosen.tasks, chosen.selected
    refuse_unjudgeable(config.judge, tasks)
    # Record the resolved choices: the split that a set without splits counts as, and the drawn subdomains.
    update = {"split": selected.split, "without": selected.without}
    config = config.model_copy(update={"tasks": config.tasks.model_copy(update=update)})
    if excluded := selected.told():
        say(
            tell,
            f"{len(selected.tasks):,} tasks to draw from, split {selected.split!r}; left out: {excluded}",
        )
    if BLOCKED in selected.left_out:
        say(tell, f"left alone: {await asyncio.to_thread(health_of(config).description)}")
    if requested is None and config.tasks.count is None and len(tasks) < len(selected.tasks):
        drawn = f"{len(tasks):,} of {len(selected.tasks):,} tasks are drawn"
        say(tell, f"{drawn}; --limit (tasks.count) takes another number, or all")
    elif requested is None and config.tasks.count == "all":
        say(tell, f"{len(tasks):,} tasks, {len(tasks) * config.samples:,} attempts; --limit N takes fewer")
    tell_left_out(chosen.broken, chosen.set_aside, tell)
    if pictured := sum(NEEDS_PICTURES in task.flags for task in tasks):
        say(
            tell, f"{pictured:,} of {len(tasks):,} tasks have a picture of their own, which no agent is shown"
        )
    settings = config.model_dump(mode="json", exclude={"sites": {"token"}})
    stamp = {"run_id": uuid.uuid4().hex, "started": datetime.now(UTC).isoformat(timespec="seconds")}
    left_out: dict[str, Any] = {"left_out_tasks": dict(selected.left_out)}
    left_out |= {"skipped_records": len(chosen.broken), "set_aside_tasks": len(chosen.set_aside)}
    async with (
        _run_services(config, secrets or Secrets(), tasks, policy, tell) as run_services,
        # Only once everything else is open: a run that cannot start leaves no folder.
        await RunWriter.create(
            out, {**stamp, "software": run_services.software, **left_out, **settings}, tasks
        ) as store,
    ):
        run_id = stamp["run_id"]
        return await _carry_out(
            config, run_id, tasks, run_services, store, show, finishing=finishing, places=places
        )


async def resume(
    out: Path | str,
    *,
    policy: Policy | None = None,
    secrets: Secrets | None = None,
    server: ServerChoice | None = None,
    judge: JudgeChoice | None = None,
    skip_corrupt: bool = False,
    retry_errors: bool = False,
    show: Show | None = show_on_stderr,
    tell: Tell | None = print_on_stderr,
    finishing: asyncio.Event | None = None,
    places: Places | None = None,
) -> Summary:
    """Continue an interrupted run: attempts on disk are kept and not repeated.

    Args:
        out: the run folder.
        policy: one of your own, if the run was started with one.
        secrets: tokens of servers that run elsewhere.
        server: other servers than before; what is not set in it stays as it was.
        judge: in place of the run's; the same one, at another address.
        skip_corrupt: continue without records whose checksum does not match.
        retry_errors: attempt again what ended in an error of the environment or the policy as often as the
            run allows; else what has exhausted its retries stays as it is.
        show: shows the progress while the run goes on; ``None`` for no display.
        tell: called with each line that the user should read, such as a warning; ``None`` for none.
        finishing: once set, no new attempt starts, and the run ends when those in progress have ended.
        places: for attempts, shared with other runs; ``None`` for ``collector.sessions`` of its own.

    Raises:
        RunFolderError: the folder is not a run folder.
        ConfigError: the judge cannot judge these tasks.
        StoreCorrupt: a record is damaged.
        WebGymError: as in :func:`collect`.
    """
    reader = RunReader(out)
    config, run_id = read_config(reader)
    await asyncio.to_thread(lambda: config.attempt.access)
    if policy is None and config.policy.name not in POLICY_NAMES:
        raise RunFolderError(
            f"{reader.path} was made with the policy {config.policy.name!r}, which a name does not give",
            hint="webgym train --resume resumes trainings, webgym.resume(folder, policy=...) other runs",
        )
    if server is not None:
        given = {name: getattr(server, name) for name in server.model_fields_set}
        config = config.model_copy(update={"server": config.server.model_copy(update=given)})
    if judge is not None:
        config = config.model_copy(update={"judge": judge})
    tasks = await asyncio.to_thread(lambda: reader.drawn)
    refuse_unjudgeable(config.judge, tasks)
    async with await RunWriter.reopen(reader.path, skip_corrupt=skip_corrupt) as store:
        if store.torn_bytes:
            say(tell, f"cut off {store.torn_bytes} bytes of an unfinished record")
        for line in store.skipped:
            say(tell, f"skipped {line}")
        if _is_complete(config, tasks, store, retry_errors=retry_errors):
            say(tell, "the run is complete: no attempt is left to make or to judge")
            async with open_judge(config.judge) as opened:
                return await _summarised(store, tasks, config, opened)
        model = await asyncio.to_thread(_model_of, reader.path)
        recorded = (tasks, policy, tell, model)
        async with _run_services(config, secrets or Secrets(), *recorded, is_resumed=True) as run_services:
            return await _carry_out(
                config,
                run_id,
                tasks,
                run_services,
                store,
                show,
                finishing=finishing,
                places=places,
                retry_errors=retry_errors,
            )


def _is_complete(config: RunConfig, tasks: Sequence[Task], store: RunWriter, *, retry_errors: bool) -> bool:
    """Whether a run, if it shares no tasks, needs neither browsers nor a judge any more."""
    if config.collector.sharing.folder is not None:
        return False
    plan = _plan(config, tasks, store, retry_errors=retry_errors)
    return not plan.waiting and all(
        entry.outcome is not Outcome.JUDGE_ERROR for entry in store.attempts.values()
    )


def _model_of(run: Path) -> str:
    """The model of the first recorded reply, as its endpoint named it; empty if there is none."""
    recorded = RunReader(run, skip_corrupt=True).trajectories()
    return next((step.reply.policy for each in recorded for step in each.episode.steps), "")


@dataclass(frozen=True)
class _RunServices:
    """The services that a run uses, and the versions of its software."""

    software: dict[str, Any]
    site_state: SiteState | None
    client: Browsers
    agent: Agent
    judge: Judge
    calls: dict[str, CallQueue]
    problem: Callable[[], str]
    tell: Tell | None


@asynccontextmanager
async def _run_services(
    config: RunConfig,
    secrets: Secrets,
    tasks: Sequence[Task],
    policy: Policy | None,
    tell: Tell | None,
    recorded_model: str = "",
    *,
    is_resumed: bool = False,
) -> AsyncIterator[_RunServices]:
    choice, profile, is_ours = config.policy, profile_for(config, policy), policy is None
    policy = policy or create_policy(
        choice.name, mistake_rate=choice.mistakes, chat=choice.chat, profile=profile
    )
    if is_ours and isinstance(policy, OpenAIPolicy):
        policy.expect(recorded_model)
    async with AsyncExitStack() as stack:
        problem = stack.enter_context(watch_clients())
        judge = await stack.enter_async_context(open_judge(config.judge))
        agent = await stack.enter_async_context(Agent(policy, config.agent, profile))
        async with report_problems(problem, tell) if tell else nullcontext():
            if choice.check and is_ours and choice.name == "openai":
                await check_policy(agent, config.attempt.viewport)
            if choice.check:
                await check_judge(config.judge)
        limits = {"policy": config.collector.policy_calls, "judge": config.collector.judges}
        calls = call_queues(config.limits.calls | limits)
        site_state, client = await stack.enter_async_context(
            open_services(
                config,
                secrets,
                tasks,
                tell,
                calls,
                attempts=len(tasks) * config.samples,
                are_recorded=is_resumed,
            )
        )
        software = await _software(client, is_ours=config.server.url is None)

        def problems() -> str:
            silent = client.problem if isinstance(client, BrowserClient) else ""
            return "; ".join(filter(None, (problem(), silent)))

        yield _RunServices(software, site_state, client, agent, judge, calls, problems, tell)


async def _software(client: Browsers, *, is_ours: bool) -> dict[str, Any]:
    """The versions of a run's software, and how a server elsewhere is set up, for its record."""
    versions: dict[str, Any] = {"webgym": version("webgym-rl")}
    if isinstance(client, BrowserClient):
        info = await client.info()
        versions |= {"browser": info.browser, "sandboxed": info.sandboxed}
        if info.without:
            versions["without"] = list(info.without)
        if not is_ours and info.egress is not None:
            versions["egress"] = msgspec.to_builtins(info.egress)
    return versions


async def _carry_out(
    config: RunConfig,
    run_id: str,
    tasks: Sequence[Task],
    run_services: _RunServices,
    store: RunWriter,
    show: Show | None,
    *,
    finishing: asyncio.Event | None,
    places: Places | None,
    retry_errors: bool = False,
) -> Summary:
    shared, is_resumed = config.collector.sharing, bool(store.attempts)
    async with AsyncExitStack() as stack:
        client = run_services.client
        if config.server.url is not None and isinstance(client, BrowserClient):
            client = await stack.enter_async_context(KeptLeases(client, store.path / LEASES))
        claims = await stack.enter_async_context(
            sharing(shared, run_id, tasks, store.path, is_resumed=is_resumed)
        )
        plan = _plan(config, tasks, store, retry_errors=retry_errors, claims=claims)
        return await _collected(config, tasks, run_services, client, store, plan, show, finishing, places)


def _plan(
    config: RunConfig,
    tasks: Sequence[Task],
    store: RunWriter,
    *,
    retry_errors: bool,
    claims: Claims | None = None,
) -> Plan:
    return Plan(
        tasks,
        samples=config.samples,
        retries=config.retries,
        recorded=list(store.attempts.values()),
        retired=store.retired,
        retry_errors=retry_errors,
        hardest_first=config.collector.order == "hardest_first",
        claims=claims,
        per_website=config.collector.sessions_per_website,
    )


async def _collected(
    config: RunConfig,
    tasks: Sequence[Task],
    run_services: _RunServices,
    client: Browsers,
    store: RunWriter,
    plan: Plan,
    show: Show | None,
    finishing: asyncio.Event | None,
    places: Places | None,
) -> Summary:
    progress = Progress(
        total=plan.total,
        levels={task.id: task.level for task in tasks},
        note="".join(oracle_notes([run_services.agent.policy.name])),
        problem=run_services.problem,
    )
    if store.attempts:

        def count_recorded() -> None:
            with _index_of(store, tasks) as index:
                for attempt in index.digests(0):
                    progress.recorded(attempt)

        await asyncio.to_thread(count_recorded)
    judge = run_services.judge
    context = AttemptContext(
        client=client,
        agent=run_services.agent,
        store=store,
        config=config.attempt,
        progress=progress,
        site_state=run_services.site_state,
        seed=config.seed,
        identity=config.browser.identity,
        calls=run_services.calls,
        lockstep=Lockstep() if config.collector.schedule == "step_barrier" else None,
    )

    async def pictures(name: str) -> bytes:
        return await asyncio.to_thread(RunReader(store.path).image, name)

    async def summarised() -> Summary:
        elsewhere = Counter(task_id for task_id, _ in plan.elsewhere)
        return await _summarised(store, tasks, config, judge, elsewhere)

    try:
        with exposing(progress, config.collector.metrics_port):
            async with (
                _tracked(config, store, progress, run_services.tell),
                feeding(progress, store.path),
                show(progress) if show else nullcontext(),
            ):
                health = health_of(config, store.path / SITES)
                collector = Collector(context, judge, pictures, config.collector, health, places)
                await collector.run(plan, finishing)
                again = (context, tasks, judge, pictures, config.collector, health, plan, finishing)
                await judge_again(*again)
                await asyncio.to_thread(health.tidy)
    except BaseException:
        # A stopped run gets a summary of what is on disk, too, if it can be written.
        with suppress(Exception):
            await summarised()
        raise
    return await summarised()


@asynccontextmanager
async def _tracked(
    config: RunConfig, store: RunWriter, progress: Progress, tell: Tell | None
) -> AsyncIterator[None]:
    """Send trackers the metrics recorded so far, and new ones until the block ends."""
    if not config.trackers:
        yield
        return
    stack = ExitStack()  # in a thread: trackers read and write files, and may use the network

    def begin() -> Callable[[Mapping[str, Any]], None]:
        rows = msgspec.json.Decoder(dict[str, Any]).decode_lines((store.path / METRICS).read_bytes())
        return stack.enter_context(tracking(config.trackers, store.path, config.project, rows, failed))

    def failed(message: str) -> None:
        progress.tracker_error = message

    store.on_metric = await asyncio.to_thread(begin)
    try:
        yield
    finally:
        await asyncio.to_thread(stack.close)
        if progress.tracker_error:
            say(tell, progress.tracker_error)


async def _summarised(
    store: RunWriter,
    tasks: Sequence[Task],
    config: RunConfig,
    judge: Judge,
    elsewhere: Mapping[str, int] | None = None,
) -> Summary:
    def of_disk() -> Summary:
        with _index_of(store, tasks) as index:
            return summarise(
                index.digests(0),
                tasks,
                config.samples,
                seed=config.seed,
                policy=config.policy.chat.model if config.policy.chat else config.policy.name,
                judge=judge.name,
                elsewhere=elsewhere,
            )

    summary = await asyncio.to_thread(of_disk)
    await store.write_summary(summary)
    return summary


def _index_of(store: RunWriter, tasks: Sequence[Task]) -> RunIndex:
    """The index of a run's records on disk, which the run's report and viewer then need not make. The writer
    has verified every record; an index that has others is made again."""
    index = RunIndex(store.path, {task.id: task for task in tasks})
    index.refresh()
    if not index.agrees_with(store.attempts):
        index.forget()
        index.refresh()
    return index
