"""Where the rooms are put together: tasks, browsers, agent, judge and store become a run.

This is what ``webgym rollout`` and ``webgym demo`` do, for those who would rather call it::

    from pathlib import Path
    from webgym import RunConfig, collect

    summary = await collect(RunConfig(), Path("runs/first"))
"""

from __future__ import annotations

import asyncio
import uuid
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import (
    AbstractAsyncContextManager,
    AsyncExitStack,
    ExitStack,
    asynccontextmanager,
    nullcontext,
)
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import msgspec
from pydantic import Field, SecretStr, ValidationError, model_validator

from webgym.agent.agent import Agent
from webgym.agent.config import AgentConfig
from webgym.agent.factory import create_policy
from webgym.agent.policy import ORACLES, Policy
from webgym.agent.preflight import check_policy
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile, profile_of
from webgym.core.calls import CallQueue, call_queues
from webgym.core.errors import ConfigError, RunFolderError, Unauthorized
from webgym.core.task import Task
from webgym.judge import Judge
from webgym.judge.factory import JudgeChoice, check_judge, open_judge, refuse_unjudgeable
from webgym.llm.config import ChatConfig
from webgym.llm.trouble import telling, watched
from webgym.offline import OfflineWeb
from webgym.offline.app import SitesConfig, serving
from webgym.offline.client import SitesClient
from webgym.offline.web import COLLECTIONS
from webgym.offline.website import Split
from webgym.rehearsal import Rehearsal
from webgym.rollout.attempt import AttemptContext
from webgym.rollout.blocklist import Blocklist, BlocklistConfig
from webgym.rollout.collector import Collector, CollectorConfig
from webgym.rollout.driver import AttemptConfig, Browsers, SiteState
from webgym.rollout.exposition import exposing
from webgym.rollout.feed import feeding
from webgym.rollout.files import METRICS
from webgym.rollout.lockstep import Lockstep
from webgym.rollout.plan import Plan
from webgym.rollout.progress import Progress
from webgym.rollout.sharing import sharing
from webgym.rollout.store import RunReader, RunWriter, refuse_taken
from webgym.rollout.summary import Summary, oracle_note, summarise
from webgym.rollout.trackers import TrackerName, check_installed, tracking
from webgym.rollout.unjudged import judge_again
from webgym.server import BrowserClient, BrowserConfig, ClientLimits, Cookie, ServerConfig, running_server
from webgym.server.config import Admission, Queues
from webgym.settings import Settings, first_problem
from webgym.tasks import BrokenRecord, TaskFile, draw, draw_spread, read_tasks
from webgym.tasks.brands import brand_or_text
from webgym.tasks.files import unfit
from webgym.tasks.sampling import Sampler, SamplerConfig
from webgym.tasks.selection import BLOCKED, Selected, Selection, select

FEW: Final = 20
"""Tasks of a run that does not say how many, unless somebody has put a file of no more than :data:`MANY`
together for it."""

MANY: Final = 100
"""Tasks that are attempted without being asked for by number."""


class TaskChoice(Selection):
    """Which tasks. Training tasks, unless ``split`` says otherwise."""

    file: Path | None = None
    """A task file; without one, the tasks of the offline web."""

    count: Annotated[int, Field(ge=1)] | Literal["all"] | None = None
    """How many, drawn at random without replacement, or ``all``. By default all of a file of up to 100, and
    20 of a larger one and of the offline web, which has thousands. With a ``ratio``, which needs a count, a
    task comes again once all of its level have come."""

    spread: bool = False
    """Draw from every website, all of a brand's being one, before drawing from one again: small samples
    then show all of them."""

    @model_validator(mode="after")
    def _check_count(self) -> TaskChoice:
        if self.ratio is not None and (not isinstance(self.count, int) or self.spread):
            raise ValueError("a ratio needs a count, and goes without spread")
        return self

    def drawn(self, there: int) -> int | None:
        """How many are drawn of those that are there; ``None`` for all.

        Args:
            there: tasks to draw from.
        """
        if self.count is None:
            return FEW if self.file is None or there > MANY else None
        return None if self.count == "all" else self.count


class PolicyChoice(Settings):
    """Which policy."""

    name: str = "scripted"
    """``scripted`` (an oracle: it plays the known solutions), ``random`` or ``openai``. By default ``openai``
    where ``chat`` is given, else ``scripted``."""

    mistakes: float = Field(default=0.0, ge=0, le=1)
    """Of the scripted policy: the share of attempts in which it makes a mistake."""

    chat: ChatConfig | None = None
    """Of the openai policy: endpoint and model."""

    check: bool = True
    """Ask for a reply before anything else starts: one of the openai policy, which must hold an action
    (:mod:`webgym.agent.preflight`), and one of every model of a rubric judge."""

    @model_validator(mode="before")
    @classmethod
    def _name(cls, given: Any) -> Any:
        if isinstance(given, Mapping) and given.get("chat") and not given.get("name"):
            return {**given, "name": "openai"}
        return given

    @model_validator(mode="after")
    def _is_whole(self) -> PolicyChoice:
        # Else an oracle's success would stand under a model's name.
        if self.chat is not None and self.name in ("scripted", "random"):
            raise ValueError(f"the {self.name} policy asks no model: leave chat out, or choose openai")
        return self


class ServerChoice(Settings):
    """Which browsers."""

    url: str | None = None
    """A running browser server; without one, browsers are started here for the time of the run."""

    queues: Queues = "per_operation"
    """Of a server that is started here: ``per_operation``, or ``global``, the paper's baseline."""

    sites_url: str | None = None
    """Where the offline web is served; without one it is served here, if the tasks are its."""

    rehearsed: bool = False
    """Without browsers (:mod:`webgym.rehearsal`); for the small websites, and for studies alone."""

    pictures: Path = Path("runs/pictures")
    """Folder for the pages that are drawn where there are no browsers."""


class RunConfig(Settings):
    """A whole run, resolved; ``config.yaml`` in the run folder holds it. No secrets."""

    seed: int = 0
    """Of the order of tasks and of everything random in the attempts."""

    samples: int = Field(default=1, ge=1)
    """Attempts wanted for every task."""

    retries: int = Field(default=1, ge=0)
    """How often a sample is attempted again after an error of the environment or the policy."""

    tasks: TaskChoice = TaskChoice()
    policy: PolicyChoice = PolicyChoice()
    agent: AgentConfig = AgentConfig()
    judge: JudgeChoice = JudgeChoice()
    server: ServerChoice = ServerChoice()
    browser: BrowserConfig = BrowserConfig()
    sites: SitesConfig = SitesConfig()
    attempt: AttemptConfig = AttemptConfig()
    collector: CollectorConfig = CollectorConfig()
    blocklist: BlocklistConfig = BlocklistConfig()
    limits: ClientLimits = ClientLimits()

    trackers: tuple[TrackerName, ...] = ()
    """Who gets the figures of ``metrics.jsonl`` while the run goes on: ``tensorboard``, ``wandb``."""

    project: str = "webgym"
    """In Weights & Biases."""


class Secrets(Settings):
    """What a run needs and its folder must not hold."""

    server_token: SecretStr | None = None
    sites_token: SecretStr | None = None


Show = Callable[[Progress], AbstractAsyncContextManager[None]]
Tell = Callable[[str], None]


class Chosen(NamedTuple):
    """The tasks of a run.

    Attributes:
        tasks: in the order of their attempts.
        broken, set_aside: records of the file that were skipped, and tasks without a fact to judge.
        selected: what the tasks were drawn from.
    """

    tasks: list[Task]
    broken: list[BrokenRecord]
    set_aside: list[BrokenRecord]
    selected: Selected


def choose_tasks(config: RunConfig) -> Chosen:
    """The tasks of a run.

    Raises:
        TaskFileError: the file cannot be read or holds no task.
        ConfigError: no task is left, or there is no such domain.
    """
    choice = config.tasks
    one = choice.split if choice.split in ("train", "test") else None
    found = _read(config, one)
    selected = select(found.tasks, choice, Blocklist(config.blocklist).blocked())
    if not selected.tasks:
        raise ConfigError(
            f"there is no task to attempt for the split {choice.split!r}: {selected.told()}",
            hint="choose another split or more domains",
        )
    return Chosen(_drawn(selected.tasks, config), found.broken, found.set_aside, selected)


def all_tasks(config: RunConfig) -> list[Task]:
    """The whole task set that a run's tasks are chosen from, every split of it.

    Raises:
        TaskFileError: the file cannot be read or holds no task.
    """
    return _read(config, None).tasks


def _read(config: RunConfig, split: Split | None) -> TaskFile:
    """A file is read whole; of the offline web only the split that is asked for is made."""
    if config.tasks.file is not None:
        return read_tasks(config.tasks.file)
    sites = config.sites
    web = OfflineWeb(sites.seed, per_family=sites.per_family, collection=sites.collection)
    return TaskFile(list(web.tasks(split)), [])


def _given(tasks: Sequence[Task], config: RunConfig) -> Chosen:
    """Tasks that somebody else has drawn.

    Raises:
        ConfigError: some are not what the config lets through: of another split, or without anything to
        judge.
    """
    selected = select(tasks, config.tasks)
    if len(selected.tasks) != len(tasks):
        raise ConfigError(f"of {len(tasks)} given tasks some must not be attempted: {selected.told()}")
    for task in tasks:
        if why := unfit(task):
            raise ConfigError(f"the task {task.id[:80]} must not be attempted: {why}")
    return Chosen(list(tasks), [], [], selected)


def _drawn(tasks: list[Task], config: RunConfig) -> list[Task]:
    choice, count = config.tasks, config.tasks.drawn(len(tasks))
    if choice.ratio is not None and count is not None:
        selected_already = SamplerConfig(split="all", ratio=choice.ratio, seed=config.seed)
        return Sampler(tasks, selected_already).draw(count)
    if choice.spread:
        return draw_spread(tasks, count, config.seed, key=lambda task: brand_or_text(task.website))
    return draw(tasks, count, config.seed)


async def collect(
    config: RunConfig,
    out: Path,
    *,
    tasks: Sequence[Task] | None = None,
    policy: Policy | None = None,
    secrets: Secrets | None = None,
    show: Show | None = None,
    tell: Tell | None = None,
    finishing: asyncio.Event | None = None,
) -> Summary:
    """Make a run: every task attempted, judged and on disk when this returns.

    Args:
        config: of the run.
        out: the run folder; does not exist yet or is empty.
        tasks: drawn by the caller, in place of what ``config.tasks`` would choose; they must be of its split.
        policy: one of your own, in place of the one that ``config.policy`` names.
        secrets: tokens of servers that run elsewhere.
        show: shows the progress while the run goes on.
        tell: is told, a line at a time, what a person should know.
        finishing: once it is set, no attempt is begun, and the run ends when those in flight have.

    Raises:
        WebGymError: the run could not start, or could not go on; what was collected is on disk.
    """
    check_installed(config.trackers)
    refuse_taken(out)  # before anything is asked or started; the folder itself is made later
    if policy is not None:
        own = PolicyChoice(name=policy.name, check=config.policy.check)
        config = config.model_copy(update={"policy": own})
    config = resolved(config, policy, tell)
    given = tasks
    # A file of hundreds of thousands of tasks takes seconds, and the caller's loop has others to serve.
    chosen = await asyncio.to_thread(lambda: choose_tasks(config) if given is None else _given(given, config))
    tasks, selected = chosen.tasks, chosen.selected
    refuse_unjudgeable(config.judge, tasks)
    # As it came out, for the record: what a set without splits was taken as, which subdomains were drawn.
    update = {"split": selected.split, "without": selected.without}
    config = config.model_copy(update={"tasks": config.tasks.model_copy(update=update)})
    if told := selected.told():
        _say(tell, f"{len(selected.tasks):,} tasks to draw from, split {selected.split!r}; left out: {told}")
    if BLOCKED in selected.left_out:
        _say(tell, f"left alone: {await asyncio.to_thread(Blocklist(config.blocklist).told)}")
    if given is None and config.tasks.count is None and len(tasks) < len(selected.tasks):
        told = f"{len(tasks):,} of {len(selected.tasks):,} tasks are drawn"
        _say(tell, f"{told}; --limit (tasks.count) takes another number, or all")
    for line in chosen.broken:
        _say(tell, f"skipped {line}")
    if aside := chosen.set_aside:
        _say(tell, f"set aside {len(aside):,} tasks without a fact to judge; the first: {aside[0]}")
    held = config.model_dump(mode="json", exclude={"sites": {"token"}})
    stamp = {"run_id": uuid.uuid4().hex, "started": datetime.now(UTC).isoformat(timespec="seconds")}
    left_out: dict[str, Any] = {"left_out_tasks": dict(selected.left_out)}
    left_out |= {"skipped_records": len(chosen.broken), "set_aside_tasks": len(chosen.set_aside)}
    async with (
        _run_services(config, secrets or Secrets(), tasks, policy, tell) as run_services,
        # Not before all else is there: a run that cannot start leaves no folder.
        await RunWriter.create(
            out, {**stamp, "software": run_services.software, **left_out, **held}, tasks
        ) as store,
    ):
        run_id = stamp["run_id"]
        return await _carry_out(config, run_id, tasks, run_services, store, show, finishing=finishing)


async def resume(
    out: Path,
    *,
    policy: Policy | None = None,
    secrets: Secrets | None = None,
    server: ServerChoice | None = None,
    skip_corrupt: bool = False,
    retry_errors: bool = False,
    show: Show | None = None,
    tell: Tell | None = None,
    finishing: asyncio.Event | None = None,
) -> Summary:
    """Go on with a run that was interrupted: what is on disk is neither lost nor made again.

    Args:
        out: the run folder.
        policy: one of your own, if the run was started with one.
        secrets: tokens of servers that run elsewhere.
        server: other servers than before.
        skip_corrupt: continue without records whose checksum does not match.
        retry_errors: attempt again what ended in an error of the environment or the policy as often as the
            run allows; else what has exhausted its retries stays as it is.
        show: shows the progress while the run goes on.
        tell: is told, a line at a time, what a person should know.
        finishing: once it is set, no attempt is begun, and the run ends when those in flight have.

    Raises:
        RunFolderError: the folder is no run.
        StoreCorrupt: a record cannot be trusted.
        WebGymError: as in :func:`collect`.
    """
    reader = RunReader(out)
    config, run_id = read_config(reader)
    if server is not None:
        config = config.model_copy(update={"server": server})
    tasks = await asyncio.to_thread(lambda: reader.drawn)
    refuse_unjudgeable(config.judge, tasks)
    async with (
        await RunWriter.reopen(out, skip_corrupt=skip_corrupt) as store,
        _run_services(config, secrets or Secrets(), tasks, policy, tell) as run_services,
    ):
        if store.torn_bytes:
            _say(tell, f"cut off {store.torn_bytes} bytes of an unfinished record")
        for line in store.skipped:
            _say(tell, f"skipped {line}")
        return await _carry_out(
            config, run_id, tasks, run_services, store, show, finishing=finishing, retry_errors=retry_errors
        )


def resolved(config: RunConfig, policy: Policy | None, tell: Tell | None) -> RunConfig:
    """The config with what the model's profile and the websites decide, as the run folder holds it.

    Args:
        config: as it was given.
        policy: one of the caller's own, if there is one.
        tell: is told if no profile knows the model.

    Raises:
        ConfigError: the config names a profile that is not there.
    """
    profile = _profile(config, policy)
    update: dict[str, Any] = {
        "agent": config.agent.model_copy(update={"profile": profile.name, "mode": profile.mode})
    }
    if "viewport" not in config.attempt.model_fields_set:
        viewport = COLLECTIONS[config.sites.collection].viewport
        update["attempt"] = config.attempt.model_copy(update={"viewport": viewport})
    chat = config.policy.chat
    if policy is None and chat is not None:
        if config.agent.profile is None and profile_of(chat.model) is None:
            unknown = f"no profile knows the model {chat.model}: the profile {profile.name} is used"
            _say(tell, f"{unknown}; --profile chooses another")
        chat = chat.model_copy(update={"sampling": profile.sampling_of(chat.sampling)})
        update["policy"] = config.policy.model_copy(update={"chat": chat})
    return config.model_copy(update=update)


def _profile(config: RunConfig, policy: Policy | None) -> Profile:
    """Of the policy's family of models.

    Raises:
        ConfigError: the config names a profile that is not there.
    """
    model = policy.name if policy else config.policy.chat.model if config.policy.chat else config.policy.name
    return choose_profile(config.agent.profile, model, config.agent.mode)


def read_config(reader: RunReader) -> tuple[RunConfig, str]:
    """A run's config and id, as its folder holds them.

    Raises:
        RunFolderError: ``config.yaml`` is not what a run of this version writes.
    """
    held = dict(reader.config)
    run_id = str(held.pop("run_id", ""))
    for stamp in ("started", "software", "skipped_records", "set_aside_tasks", "left_out_tasks"):
        held.pop(stamp, None)
    try:
        return RunConfig.model_validate(held), run_id
    except ValidationError as error:
        raise RunFolderError(f"{reader.path}/config.yaml: {first_problem(error, RunConfig)}") from error


@dataclass(frozen=True)
class _RunServices:
    """Everything that a run talks to, and which versions of it."""

    software: dict[str, Any]
    site_state: SiteState | None
    client: Browsers
    agent: Agent
    judge: Judge
    calls: dict[str, CallQueue]
    trouble: Callable[[], str]
    tell: Tell | None


@asynccontextmanager
async def _run_services(
    config: RunConfig, secrets: Secrets, tasks: Sequence[Task], policy: Policy | None, tell: Tell | None
) -> AsyncIterator[_RunServices]:
    choice, profile, is_ours = config.policy, _profile(config, policy), policy is None
    policy = policy or create_policy(
        choice.name, mistake_rate=choice.mistakes, chat=choice.chat, profile=profile
    )
    async with AsyncExitStack() as stack:
        trouble = stack.enter_context(watched())
        judge = await stack.enter_async_context(open_judge(config.judge))
        agent = await stack.enter_async_context(Agent(policy, config.agent, profile))
        async with telling(trouble, tell) if tell else nullcontext():
            if choice.check and is_ours and choice.name == "openai":
                await check_policy(agent, config.attempt.viewport)
            if choice.check:
                await check_judge(config.judge)
        limits = {"policy": config.collector.policy_calls, "judge": config.collector.judges}
        calls = call_queues(config.limits.calls | limits)
        site_state, client = await stack.enter_async_context(places(config, secrets, tasks, tell, calls))
        yield _RunServices(await _software(client), site_state, client, agent, judge, calls, trouble, tell)


async def _software(client: Browsers) -> dict[str, Any]:
    """What a run is made with, for its record."""
    told: dict[str, Any] = {"webgym": version("webgym-rl")}
    if isinstance(client, BrowserClient):
        info = await client.info()
        told |= {"browser": info.browser, "sandboxed": info.sandboxed}
    return told


@asynccontextmanager
async def places(
    config: RunConfig,
    secrets: Secrets,
    tasks: Sequence[Task],
    tell: Tell | None,
    calls: dict[str, CallQueue],
) -> AsyncIterator[tuple[SiteState | None, Browsers]]:
    """Websites and browsers, or what stands in for both, open until the block ends.

    Args:
        config: of the run.
        secrets: tokens of servers that run elsewhere.
        tasks: that are to be attempted, ``config.samples`` times each.
        tell: is told, a line at a time, what a person should know.
        calls: the queues in which a client waits, by kind of call.

    Raises:
        WebGymError: they cannot be started or reached, or do not serve these tasks.
    """
    if config.server.rehearsed:
        if config.sites.collection != "small" or config.tasks.file is not None:
            raise ConfigError(
                "only attempts at the small websites can be made without browsers",
                hint="set sites.collection to small, or server.rehearsed to false",
            )
        web = OfflineWeb(config.sites.seed, per_family=config.sites.per_family, collection="small")
        async with Rehearsal(web, config.server.pictures) as rehearsal:
            yield rehearsal, rehearsal
        return
    async with (
        _sites(config, secrets, tasks) as (site_state, allowed),
        _browsers(config, secrets, allowed, tell, len(tasks) * config.samples, calls) as client,
    ):
        yield site_state, client


async def _carry_out(
    config: RunConfig,
    run_id: str,
    tasks: Sequence[Task],
    run_services: _RunServices,
    store: RunWriter,
    show: Show | None,
    *,
    finishing: asyncio.Event | None,
    retry_errors: bool = False,
) -> Summary:
    shared, goes_on = config.collector.sharing, bool(store.attempts)
    async with sharing(shared, run_id, tasks, config.samples, store.path, goes_on=goes_on) as claims:
        plan = Plan(
            tasks,
            samples=config.samples,
            retries=config.retries,
            recorded=list(store.attempts.values()),
            retired=store.retired,
            retry_errors=retry_errors,
            hardest_first=config.collector.order == "hardest_first",
            claims=claims,
        )
        return await _collected(config, run_id, tasks, run_services, store, plan, show, finishing)


async def _collected(
    config: RunConfig,
    run_id: str,
    tasks: Sequence[Task],
    run_services: _RunServices,
    store: RunWriter,
    plan: Plan,
    show: Show | None,
    finishing: asyncio.Event | None,
) -> Summary:
    name = run_services.agent.policy.name
    progress = Progress(
        total=plan.total,
        levels={task.id: task.level for task in tasks},
        note=oracle_note(name) if name in ORACLES else "",
        trouble=run_services.trouble,
    )
    judge = run_services.judge
    context = AttemptContext(
        client=run_services.client,
        agent=run_services.agent,
        store=store,
        config=config.attempt,
        progress=progress,
        site_state=run_services.site_state,
        run_id=run_id,
        seed=config.seed,
        calls=run_services.calls,
        lockstep=Lockstep() if config.collector.schedule == "step_barrier" else None,
    )
    try:
        with exposing(progress, config.collector.metrics_port):
            async with (
                _tracked(config, store, progress, run_services.tell),
                feeding(progress, store.path),
                show(progress) if show else nullcontext(),
            ):
                blocklist = Blocklist(config.blocklist)
                pictures = _pictures(store.path)
                await Collector(context, judge, pictures, config.collector, blocklist).run(plan, finishing)
                await judge_again(context, tasks, judge, pictures, config.collector, blocklist, plan)
    finally:
        # Also of a run that was stopped: what is on disk has a summary.
        elsewhere = Counter(task_id for task_id, _ in plan.elsewhere)
        summary = await asyncio.to_thread(_summarise, store.path, tasks, config, judge, elsewhere)
        await store.write_summary(summary)
    return summary


@asynccontextmanager
async def _tracked(
    config: RunConfig, store: RunWriter, progress: Progress, tell: Tell | None
) -> AsyncIterator[None]:
    """Let trackers have what the run has told so far, and what it tells until the block ends."""
    if not config.trackers:
        yield
        return
    stack = ExitStack()  # in a thread: they read and write files, and may ask the network

    def begin() -> Callable[[Mapping[str, Any]], None]:
        rows = msgspec.json.Decoder(dict[str, Any]).decode_lines((store.path / METRICS).read_bytes())
        return stack.enter_context(tracking(config.trackers, store.path, config.project, rows, failed))

    def failed(told: str) -> None:
        progress.tracker_error = told

    store.on_metric = await asyncio.to_thread(begin)
    try:
        yield
    finally:
        await asyncio.to_thread(stack.close)
        if progress.tracker_error:
            _say(tell, progress.tracker_error)


class _ServedState:
    """The offline web as a collector knows it."""

    def __init__(self, sites: SitesClient) -> None:
        self._sites = sites

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        name, value, domain = self._sites.visitor_cookie(visitor)
        return (Cookie(name, value, domain),)

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        return await self._sites.state(visitor, host)


@asynccontextmanager
async def _sites(
    config: RunConfig, secrets: Secrets, tasks: Sequence[Task]
) -> AsyncIterator[tuple[SiteState | None, tuple[str, ...]]]:
    """The offline web, here or elsewhere, and the rules that lead browsers to it."""
    if not any(task.truth for task in tasks):
        yield None, ()
    elif config.server.sites_url is not None:
        if secrets.sites_token is None:
            raise ConfigError(
                "the offline web's token is missing",
                hint="set WEBGYM_SITES_TOKEN to what it was started with",
            )
        token = secrets.sites_token.get_secret_value()
        async with SitesClient(config.server.sites_url, token) as client:
            await client.websites()  # fails now, in one line, rather than once per attempt
            yield _ServedState(client), ()
    elif config.server.url is not None:
        raise ConfigError(
            "these tasks are the offline web's, and the browser server is elsewhere",
            hint="start webgym sites serve where its browsers run, and give its address",
        )
    else:
        async with serving(config.sites) as sites, SitesClient(sites.url, sites.token) as client:
            _check_served(tasks, set(sites.web.specs))
            yield _ServedState(client), tuple(sites.allowed_hosts)


def _check_served(tasks: Sequence[Task], hosts: set[str]) -> None:
    """Refuse tasks whose websites are not served: every attempt would be the environment's failure."""
    for task in tasks:
        if task.truth is not None and (missing := sorted(task.truth.hosts - hosts)):
            raise ConfigError(
                f"the task {task.id} is on {missing[0]}, which is not served",
                hint="sites.collection, seed and per_family must be what the tasks were made with",
            )


@asynccontextmanager
async def _browsers(
    config: RunConfig,
    secrets: Secrets,
    allowed: tuple[str, ...],
    tell: Tell | None,
    attempts: int,
    calls: dict[str, CallQueue],
) -> AsyncIterator[BrowserClient]:
    """A client of a browser server, which is started here unless there is one, and no larger than needed."""
    if config.server.url is not None:
        token = secrets.server_token
        if token is None:
            raise Unauthorized(
                "the browser server's token is missing", hint="set WEBGYM_TOKEN to what it was started with"
            )
        async with BrowserClient(
            config.server.url, token=token.get_secret_value(), limits=config.limits, calls=calls
        ) as client:
            await client.info()  # fails now, in one line, rather than once per attempt
            yield client
        return
    browser = config.browser.allowing(*allowed)
    slots = max(1, min(config.collector.sessions, attempts))
    admission = Admission(queues=config.server.queues)
    async with (
        running_server(ServerConfig(slots=slots, browser=browser, admission=admission)) as server,
        BrowserClient(server.url, token=server.token, limits=config.limits, calls=calls) as client,
    ):
        info = await client.info()
        if not info.sandboxed:
            _say(tell, "browsers run without a sandbox here: open only pages that you trust")
        yield client


@asynccontextmanager
async def services(config: RunConfig, secrets: Secrets) -> AsyncIterator[tuple[ServerChoice, Secrets]]:
    """Browsers, and the offline web if the tasks are its, started once for many runs.

    Yields:
        What :func:`collect` needs to use them: ``config.server`` and its secrets. Services that run elsewhere
        already are passed on as they are.
    """
    if config.server.url is not None or config.server.rehearsed:
        yield config.server, secrets
        return
    async with AsyncExitStack() as stack:
        choice, allowed = config.server, tuple[str, ...]()
        if config.tasks.file is None and choice.sites_url is None:
            sites = await stack.enter_async_context(serving(config.sites))
            choice = choice.model_copy(update={"sites_url": sites.url})
            secrets = secrets.model_copy(update={"sites_token": SecretStr(sites.token)})
            allowed = tuple(sites.allowed_hosts)
        serve = ServerConfig(
            slots=config.collector.sessions,
            browser=config.browser.allowing(*allowed),
            admission=Admission(queues=config.server.queues),
        )
        server = await stack.enter_async_context(running_server(serve))
        choice = choice.model_copy(update={"url": server.url})
        token = server.token if isinstance(server.token, SecretStr) else SecretStr(server.token)
        yield choice, secrets.model_copy(update={"server_token": token})


def _pictures(run: Path) -> Callable[[str], Any]:
    async def read(name: str) -> bytes:
        return await asyncio.to_thread(RunReader(run).image, name)

    return read


def _summarise(
    run: Path, tasks: Sequence[Task], config: RunConfig, judge: Judge, elsewhere: Mapping[str, int]
) -> Summary:
    reader = RunReader(run, skip_corrupt=True)
    return summarise(
        reader.trajectories(),
        tasks,
        config.samples,
        seed=config.seed,
        policy=config.policy.chat.model if config.policy.chat else config.policy.name,
        judge=judge.name,
        elsewhere=elsewhere,
    )


def _say(tell: Tell | None, line: str) -> None:
    if tell is not None:
        tell(line)
