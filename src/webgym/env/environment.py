"""The environment, to run your own policy or trainer: reset, step, and a reward at the end::

    async with webgym.make("offline-v2", split="train") as env:
        view, info = await env.reset(seed=7)
        while not info["is_over"]:
            view, reward, terminated, truncated, info = await env.step(act(info["messages"], info["images"]))

Episodes run the same code as the attempts of a run: the same browser, parser, record and judge.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import operator
import random
import sys
import uuid
import weakref
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, Literal, Self, SupportsIndex, TypeAlias, get_args

import msgspec

from webgym.agent.agent import AgentTraits, Dialogue
from webgym.agent.formats import render_reply
from webgym.agent.policy import PolicyInput
from webgym.agent.profiles import choose_profile
from webgym.core.action import GRID, Action, Answer, GoBack, LeftClick, Scroll, Target, Wait
from webgym.core.background import BackgroundTasks
from webgym.core.calls import call_queues
from webgym.core.errors import (
    BrowserCrashed,
    BrowserTimeout,
    ConfigError,
    EpisodeLost,
    NavigationFailed,
    ProtocolError,
    UsageError,
)
from webgym.core.outcome import Ending, outcome_of
from webgym.core.task import Task
from webgym.core.text import visible
from webgym.core.trajectory import Reply, Trajectory
from webgym.judge.base import Judge
from webgym.judge.factory import check_judge, open_judge, refuse_unjudgeable
from webgym.offline.config import TASK_SETS, SitesConfig, collection_of
from webgym.rollout.driver import Browsers, BrowserSession, EpisodeContext, EpisodeDriver, SiteState
from webgym.rollout.judging import judge_episode
from webgym.rollout.plan import Planned
from webgym.rollout.sessions import patiently
from webgym.run.choice import choose_tasks, health_of
from webgym.run.config import RunConfig, Secrets, resolved
from webgym.run.services import open_services
from webgym.server.messages import View
from webgym.tasks.hub import address_of
from webgym.tasks.selection import SplitName

log = logging.getLogger(__name__)

Info: TypeAlias = dict[str, Any]
"""What :meth:`Environment.reset` and :meth:`Environment.step` return besides the view:

``task_id``, ``instruction``, ``website``
    of the task.
``step``, ``budget``
    steps so far, and their maximum.
``messages``, ``images``
    the request that WebGym's own agent would send now: memory, history and screenshots in its prompt
    (:class:`~webgym.core.trajectory.Message`; pictures encoded, by name). Missing once the episode is over.
``parse_error``
    why the last reply held no action; empty if it did.
``is_over``
    whether the episode is over; then also
``outcome``
    one of eight (:class:`~webgym.core.outcome.Outcome`),
``failure``
    code and message of the error that ended the episode or prevented its verdict, else ``None``,
``trajectory``
    the whole record (:class:`~webgym.core.trajectory.Trajectory`), as a run's folder would hold it,
``pictures``
    its screenshots, encoded, by name.
"""

_OF_TASKS: Final = (BrowserCrashed, BrowserTimeout, ProtocolError)
"""Failures to open a browser that may be due to what the task needs, such as files: it is not put back."""

OnFault: TypeAlias = Literal["nan", "raise"]


@dataclass(frozen=True)
class _Services:
    """Services and tasks that several environments may share."""

    tasks: dict[str, Task]
    client: Browsers
    site_state: SiteState | None
    judge: Judge


class Environment:
    """Tasks on websites in a real browser, one at a time. Enter it before use, or call :func:`make`.

    Args:
        tasks: a task file, tasks, or ``None`` for those that ``config.tasks`` chooses (by default all
            training tasks of the offline web).
        browsers: an open client of a browser server, which several environments may share; by default what
            ``config.server`` says: a server elsewhere, or browsers that are started here, one unless
            ``config.collector.sessions`` is set.
        judge: gives the reward; by default the one that ``config.judge`` names.
        config: all other settings of a run: agent (prompt, mode, actions), browser, budgets.
        secrets: tokens of servers that run elsewhere.
        seed: of the order of tasks until :meth:`reset` is given one.
        on_fault: what :meth:`step` does at the end of an episode without a reward, because the website
            blocked it or environment, policy or judge failed. ``nan``: it returns a reward of NaN and
            ``truncated``, and ``info["outcome"]`` names the reason. ``raise``: it raises
            :class:`~webgym.core.errors.EpisodeLost`. The reward is never 0.

    Attributes:
        config: the resolved config.
        profile: the profile of the model family that the requests are made for.
        on_fault: as given.

    Raises:
        ConfigError: ``on_fault`` is neither of the two, or the seed is no integer.
    """

    def __init__(
        self,
        tasks: Path | str | Sequence[Task] | None = None,
        *,
        browsers: Browsers | None = None,
        judge: Judge | None = None,
        config: RunConfig | None = None,
        secrets: Secrets | None = None,
        seed: int = 0,
        on_fault: OnFault = "nan",
    ) -> None:
        if on_fault not in get_args(OnFault):
            raise ConfigError(f"on_fault is nan or raise, not {on_fault!r}")
        config = config or RunConfig()
        if isinstance(tasks, str | Path):
            chosen = config.tasks.model_copy(update={"file": Path(tasks)})
            config, tasks = config.model_copy(update={"tasks": chosen}), None
        # All tasks by default: a task costs nothing before it is drawn.
        if config.tasks.count is None:
            config = config.model_copy(update={"tasks": config.tasks.model_copy(update={"count": "all"})})
        if "sessions" not in config.collector.model_fields_set:
            config = with_browsers(config, 1)
        self.config = resolved(config, None, None)
        self.profile = choose_profile(self.config.agent.profile, "", self.config.agent.mode)
        self._given = tasks
        self._browsers, self._judge = browsers, judge
        self._secrets = secrets or Secrets()
        self.on_fault = on_fault
        self._stack = AsyncExitStack()
        self._services: _Services | None = None
        self._twin_of: Environment | None = None
        self._restart_order(seed)
        self._episode: _Episode | None = None

    # --- open and close ---------------------------------------------------------------------------------

    async def __aenter__(self) -> Self:
        if self._services is None:
            stack = AsyncExitStack()  # of its own: an opening that was interrupted may still be closing its
            try:
                services = await self._open(stack)
            except BaseException:
                await stack.aclose()
                raise
            self._stack, self._services = stack, services
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the browser session, and stop what was started for this environment. Safe to call twice."""
        await self.abandon()
        self._services = None
        await self._stack.aclose()

    async def _open(self, stack: AsyncExitStack) -> _Services:
        if self._twin_of is not None:
            return self._twin_of._opened
        config, given = self.config, self._given
        tasks = list(given) if given is not None else (await asyncio.to_thread(choose_tasks, config)).tasks
        if not tasks:
            raise ConfigError("there is no task", hint="give at least one")
        judge = self._judge
        if judge is None:
            refuse_unjudgeable(config.judge, tasks)
            if config.policy.check:
                await check_judge(config.judge)
            judge = await stack.enter_async_context(open_judge(config.judge))
        limits = {"policy": config.collector.policy_calls, "judge": config.collector.judges}
        calls = call_queues(config.limits.calls | limits)
        by_id = {task.id: task for task in tasks}
        if self._browsers is None:
            opened = open_services(config, self._secrets, tasks, None, calls)
            site_state, client = await stack.enter_async_context(opened)
            return _Services(by_id, client, site_state, judge)
        if any(task.truth is not None and any(fact.state for fact in task.truth.facts) for task in tasks):
            raise ConfigError(
                "some of these tasks are judged by the state of the offline web's servers, which a client of "
                "browsers cannot read",
                hint="give config.server its address and the offline web's, in place of browsers",
            )
        return _Services(by_id, self._browsers, None, judge)

    def twin(self, seed: int) -> Environment:
        """Another environment on the same browsers, websites, tasks and judge; this one must be closed last.

        Two episodes at once need two browsers: ``config.collector.sessions`` is their number.

        Args:
            seed: of the order of tasks.
        """
        other = Environment(self._given, config=self.config, seed=seed, on_fault=self.on_fault)
        other._twin_of = self._twin_of or self
        other._services = self._opened
        return other

    @property
    def _opened(self) -> _Services:
        is_closed = self._twin_of is not None and self._twin_of._services is not self._services
        if self._services is None or is_closed:
            raise UsageError(
                "the environment is not open", hint="use it as: async with webgym.make(…) as env"
            )
        return self._services

    @property
    def tasks(self) -> Mapping[str, Task]:
        """By id. Their ``truth`` is for judges and tests: no policy may see it."""
        return self._opened.tasks

    @property
    def episode_id(self) -> str:
        """A unique name of the current episode; empty if there is none."""
        return self._episode.id if self._episode else ""

    # --- reset and step ---------------------------------------------------------------------------------

    async def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[View, Info]:
        """Start an episode; one that is still running is abandoned.

        Args:
            seed: restarts the order of tasks: the same seed gives the same tasks. Without one, the order
                continues.
            options: ``task_id`` selects a task.

        Returns:
            The start page, as picture and description, and :data:`Info`.

        Raises:
            ConfigError: there is no such task or option, or the seed is no integer.
            UsageError: another call, such as a second reset, abandoned the episode before it had started.
            WebGymError: the browser or the website failed, and no episode started; reset again. A server
                without a browser is waited for (``config.collector.server_patience_seconds``), and no task is
                skipped for it.
        """
        services = self._opened
        await self.abandon()
        if seed is not None:
            self._restart_order(seed)
        options = options or {}
        task = self._choose(options)
        remaining, attempts = self._remaining, self._attempts
        attempts[task.id] += 1
        episode = _Episode(self, services, Planned(task, attempts[task.id] - 1))
        self._episode = episode
        try:
            view = await episode.begin()
            self._refuse_abandoned(episode)
        except BaseException as error:
            if episode.has_no_browser and not isinstance(error, _OF_TASKS):
                attempts[task.id] -= 1
                if options.get("task_id") is None:
                    remaining.append(task.id)
            await self._abandon(episode)
            raise
        return view, episode.info()

    async def step(self, action: Action | str | Reply) -> tuple[View, float, bool, bool, Info]:
        """Carry out an action, or what a model replied.

        Args:
            action: one of :mod:`webgym.core.action`; or a reply in the prompt's format, read by the same
                parser as in runs (a reply without a valid action counts as a step, and
                ``info["parse_error"]`` gives the reason); or a :class:`~webgym.core.trajectory.Reply` with
                its tokens and weight version, which go into the record.

        Returns:
            view: the new observation; at the end, the last one.
            reward: 0.0 until the end; then the judge's 1.0 or 0.0, or NaN if there is no reward.
            terminated: the episode was answered and judged.
            truncated: the budget was used up, or the episode has no reward.
            info: :data:`Info`.

        Raises:
            UsageError: there is no episode, or it is over, or another call abandoned it meanwhile; or another
                step is running, or this is no action, and the episode continues.
            EpisodeLost: there is no reward, and ``on_fault`` is ``raise``.
        """
        return await self._advance(self._as_reply(action))

    async def finish(self) -> tuple[View, float, bool, bool, Info]:
        """End the episode without an answer, as if its budget were used up: what the policy leaves undone is
        judged, so that a website that blocked it gives no reward.

        Returns, and raises:
            As :meth:`step`.
        """
        return await self._advance(None)

    async def _advance(self, reply: Reply | None) -> tuple[View, float, bool, bool, Info]:
        episode = self._episode
        if episode is None or episode.is_over:
            raise UsageError("there is no episode to step", hint="call reset first")
        if episode.is_stepping:
            raise UsageError("a step of this episode is still running", hint="await it first")
        episode.is_stepping = True
        try:
            is_over = await episode.step(reply)
            episode.is_stepping = False
            if not is_over:
                self._refuse_abandoned(episode)
        except BaseException:  # cancelled: the episode cannot continue
            await self._abandon(episode)
            raise
        info = episode.info()
        if not is_over:
            return episode.view, 0.0, False, False, info
        reward, outcome = episode.reward, info["outcome"]
        if math.isnan(reward) and self.on_fault == "raise":
            why = info["failure"]["message"] if info["failure"] else "the website blocked the agent"
            raise EpisodeLost(f"the episode ended as {outcome}: {why}")
        terminated = outcome in ("success", "failure")
        return episode.view, reward, terminated, not terminated, info

    def _as_reply(self, action: Action | str | Reply) -> Reply:
        if isinstance(action, Reply):
            return action
        if not isinstance(action, str | Action):
            raise UsageError(
                f"{type(action).__name__} is not an action",
                hint="give one of webgym.core.action, or a reply's text",
            )
        if isinstance(action, str):
            return Reply(action, "external")
        if self._episode is None:
            raise UsageError("there is no episode to step", hint="call reset first")
        # Rendered as a reply's text: a single parser decides what is a valid action.
        form, screen = self.config.agent.prompt_format, self._episode.turn.screen
        return Reply(render_reply(action, form, description="", screen=screen), "external")

    async def abandon(self) -> None:
        """Abandon the running episode and close its browser session. Safe to call at any time."""
        if self._episode is not None:
            await self._abandon(self._episode)

    async def _abandon(self, episode: _Episode) -> None:
        if self._episode is episode:  # a later one goes on
            self._episode = None
        if isinstance(sys.exception(), GeneratorExit):  # collected while it waited: it can wait no more
            episode.give_back_later()
        else:
            await asyncio.shield(episode.give_back())

    def _refuse_abandoned(self, episode: _Episode) -> None:
        """Refuse to continue an episode that another call has ended: steps would be those of a later one."""
        if self._episode is not episode:
            raise UsageError(
                "another call abandoned the episode while this one was running",
                hint="await a call before the next reset, or make an environment for each caller",
            )

    def _restart_order(self, seed: SupportsIndex) -> None:
        try:
            self._seed = operator.index(seed)  # such as numpy's integers, which no record holds
        except TypeError:
            raise ConfigError(f"a seed is an integer, not {seed!r}") from None
        self._random = random.Random(self._seed)
        self._remaining: list[str] = []
        self._attempts: Counter[str] = Counter()

    def _choose(self, options: Mapping[str, Any]) -> Task:
        tasks = self._opened.tasks
        if unknown := options.keys() - {"task_id"}:
            raise ConfigError(f"unknown option {sorted(unknown)[0]!r}", hint="the only option is task_id")
        task_id = options.get("task_id")
        if task_id is None:
            if not self._remaining:
                self._remaining = self._random.sample(list(tasks), len(tasks))
            task_id = self._remaining.pop()
        if task_id not in tasks:
            near = get_close_matches(str(task_id), tasks, 1)
            raise ConfigError(
                f"there is no task {str(task_id)[:80]!r}", hint=f"did you mean {near[0]}?" if near else ""
            )
        return tasks[task_id]


class _Pictures:
    """Stores an episode's pictures in memory, by name."""

    def __init__(self) -> None:
        self.by_name: dict[str, bytes] = {}

    async def put_image(self, name: str, data: bytes) -> None:
        self.by_name[name] = data


class _Episode:
    """An episode, from :meth:`Environment.reset` to its end."""

    def __init__(self, env: Environment, services: _Services, planned: Planned) -> None:
        config = env.config
        self.id = uuid.uuid4().hex
        self._services = services
        self._collector = config.collector
        self._pictures = _Pictures()
        context = EpisodeContext(
            store=self._pictures,
            config=config.attempt,
            site_state=services.site_state,
            seed=env._seed,
            identity=config.browser.identity,
        )
        mode = env.profile.mode
        traits = AgentTraits("external", mode, config.agent.actions, elements=mode == "marks")
        self._driver = EpisodeDriver(context, planned, traits)
        self._health = health_of(config)
        # A policy must not see how success is verified.
        public_task = msgspec.structs.replace(planned.task, truth=None)
        self._dialogue = Dialogue(public_task, self._driver.budget, config.agent, env.profile)
        self._session: BrowserSession | None = None
        self._finalizer: weakref.finalize[Any, _Episode] | None = None
        self._seen_at = 0.0
        self.is_stepping = False
        self._parse_error = ""
        self._trajectory: Trajectory | None = None
        self.view: View
        self.turn: PolicyInput

    async def begin(self) -> View:
        """Open the start page."""
        client, options = self._services.client, self._driver.options()
        session = await patiently(lambda: client.open(options), self._collector, tell=_log_waiting)
        self._session = session
        # An environment that is garbage-collected closes its browser session.
        self._finalizer = weakref.finalize(self, _close_later, asyncio.get_running_loop(), session)
        self._finalizer.atexit = False
        try:
            view = await self._driver.start(session)
        except NavigationFailed as error:
            self._driver.fail(error)
            await self._note(Trajectory(self._driver.episode(), outcome_of(self._driver.ending, None)))
            raise
        await self._see(view)
        return self.view

    async def _note(self, found: Trajectory) -> None:
        await asyncio.to_thread(self._health.note, self._driver.planned.task.website, found)

    async def step(self, reply: Reply | None) -> bool:
        """Apply a reply, and return whether the episode is over; ``None`` ends it as a spent budget does."""
        driver = self._driver
        if reply is None:
            driver.ending = Ending.BUDGET_SPENT
            await self._end()
            return True
        try:
            step = self._dialogue.receive(reply, self._seen_at)
            self._parse_error = step.parse_error
            view = await driver.take(step)
            if view is not None:
                await self._see(view)
        except Exception as error:
            driver.fail(error)  # no error may become a reward of 0
        if driver.is_over or driver.failure is not None:
            await self._end()
        return self.is_over

    async def _see(self, view: View) -> None:
        self.view, self._seen_at = view, self._driver.elapsed
        if not self._driver.is_over:
            self.turn = await self._dialogue.request(view.observation, view.image)

    async def _end(self) -> None:
        """Conclude the episode, judge it, and set its trajectory."""
        await self._driver.conclude()
        await self.give_back()
        episode = self._driver.episode()
        task = self._driver.planned.task
        seconds = self._collector.judge_seconds
        judged = await judge_episode(self._services.judge, task, episode, self._picture, seconds)
        self._trajectory = judged.of(episode)
        await self._note(self._trajectory)

    async def _picture(self, name: str) -> bytes:
        return self._pictures.by_name[name]

    async def give_back(self) -> None:
        """Close the browser session. Safe to call twice."""
        if self._finalizer is not None:
            self._finalizer.detach()
        session, self._session = self._session, None
        if session is not None:
            await session.close()

    def give_back_later(self) -> None:
        """Let the event loop close the browser session. Safe to call twice."""
        self._session = None
        if self._finalizer is not None:
            self._finalizer()

    @property
    def has_no_browser(self) -> bool:
        return self._session is None

    @property
    def is_over(self) -> bool:
        return self._trajectory is not None

    @property
    def reward(self) -> float:
        assert self._trajectory is not None
        reward = self._trajectory.outcome.reward
        return math.nan if reward is None else reward

    def info(self) -> Info:
        """See :data:`Info`."""
        driver, trajectory = self._driver, self._trajectory
        task = driver.planned.task
        info: Info = {
            "task_id": task.id,
            "instruction": visible(task.instruction),
            "website": task.website,
            "step": len(driver.steps),
            "budget": driver.budget,
            "parse_error": self._parse_error,
            "is_over": trajectory is not None,
        }
        if trajectory is None:
            return info | {"messages": self.turn.messages, "images": dict(self.turn.images)}
        failure = trajectory.episode.failure or trajectory.judge_failure
        return info | {
            "outcome": trajectory.outcome.value,
            "failure": msgspec.to_builtins(failure) if failure else None,
            "trajectory": trajectory,
            "pictures": self._pictures.by_name,
        }


def _log_waiting(problem: str) -> None:
    if problem:
        log.warning("an environment waits for a browser: %s", problem)


def _close_later(loop: asyncio.AbstractEventLoop, session: BrowserSession) -> None:
    with contextlib.suppress(RuntimeError):  # the loop is closed, and so is the client with all its sessions
        loop.call_soon_threadsafe(lambda: _CLOSING.start(session.close()))


_CLOSING = BackgroundTasks()


def random_action(seed: int) -> Action:
    """A random action of the paper's action space: mostly clicks and scrolls, sometimes an answer.

    Args:
        seed: of the random choice.
    """
    rng = random.Random(seed)
    match rng.choices(("click", "scroll", "back", "wait", "answer"), (10, 5, 1, 1, 1))[0]:
        case "click":
            return LeftClick(Target(coordinate=(float(rng.randrange(GRID)), float(rng.randrange(GRID)))))
        case "scroll":
            return Scroll(rng.choice(("up", "down")))
        case "back":
            return GoBack()
        case "wait":
            return Wait(1.0)
        case _:
            return Answer("I do not know.")


def make(
    name: str = "offline-v2", *, split: SplitName = "train", config: RunConfig | None = None, **given: Any
) -> Environment:
    """An environment by the name of its tasks.

    Args:
        name: ``offline-v2`` (655 websites as on the real web), ``offline-small-v2`` (360 websites of a few
            large signs), ``offline-cross-v2`` (tasks over two of the large collection's websites), or a task
            file's path.
        split: ``train`` (excludes all test tasks), ``test``, ``all``, or ``unsplit`` for tasks of a file that
            have no split.
        config: other settings; its task set and split are replaced.
        given: further arguments of :class:`Environment`.

    Raises:
        ConfigError: there are no tasks of this name, or there is no such split.
    """
    return Environment(config=config_of(name, split, config), **given)


def config_of(name: str, split: SplitName, config: RunConfig | None = None) -> RunConfig:
    """A config whose task set and split are those given; see :func:`make`.

    Raises:
        ConfigError: there are no tasks of this name, or there is no such split.
    """
    if split not in get_args(SplitName):
        raise ConfigError(f"the split is one of {', '.join(get_args(SplitName))}, not {split!r}")
    config = config or RunConfig()
    tasks = config.tasks.model_copy(update={"split": split})
    if (collection := collection_of(name)) is not None:
        delays = config.sites.model_dump(include={"latency", "latency_sigma", "latency_longest"})
        sites = SitesConfig(collection=collection, **delays)
        tasks = tasks.model_copy(update={"file": None})
        config = config.model_copy(update={"sites": sites})
    elif address_of(name) or Path(name).is_file():
        tasks = tasks.model_copy(update={"file": Path(name)})
    else:
        near = get_close_matches(name, TASK_SETS, 1)
        known = f"did you mean {near[0]}?" if near else f"give {', '.join(TASK_SETS)} or a task file's path"
        raise ConfigError(f"there are no tasks named {name!r}", hint=known)
    return config.model_copy(update={"tasks": tasks})


def with_browsers(config: RunConfig, count: int) -> RunConfig:
    """A config with this number of browsers.

    Raises:
        ConfigError: it is less than 1.
    """
    if count < 1:
        raise ConfigError(f"{count} browsers play no episode", hint="give at least 1")
    collector = config.collector.model_copy(update={"sessions": count})
    return config.model_copy(update={"collector": collector})
