"""One attempt at one task: observe, ask, act, until it ends."""

from __future__ import annotations

import asyncio
import hashlib
import re
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import msgspec
from pydantic import Field

from webgym.agent.agent import Agent, Conversation
from webgym.core.action import Answer, BrowserAction, Navigate
from webgym.core.calls import CallQueue, call_queues
from webgym.core.errors import (
    AttemptOverdue,
    NavigationFailed,
    PolicyBadReply,
    PolicyTimeout,
    StoreError,
    WebGymError,
)
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, ending_of
from webgym.core.task import StepBudget
from webgym.core.trajectory import Episode, Failure, Step
from webgym.rollout.lockstep import Lockstep
from webgym.rollout.plan import Planned
from webgym.rollout.progress import Progress, State
from webgym.server import Cookie, SessionOptions, View
from webgym.settings import Settings

_ORIGIN = re.compile(r"https?://[^/\s?#\"]+", re.IGNORECASE)
_CONNECTION = re.compile(
    r"gave no answer within|too many new connections|"
    r"net::ERR_(CONNECTION|NAME|DNS|ADDRESS|INTERNET|NETWORK|EMPTY_RESPONSE|TIMED_OUT|SOCKS|INSUFFICIENT)"
)
"""In what a browser says when a navigation failed: the way to the website is broken, not the page."""


def _origin(url: str) -> str:
    found = _ORIGIN.findall(url)
    return found[-1].lower().rstrip(":") if found else ""


class BrowserSession(Protocol):
    """An open session: :class:`webgym.server.Session`, or one that stands in for it."""

    @property
    def id(self) -> str:
        """Its name, for the record."""
        ...

    async def step(self, action: BrowserAction | None = None) -> View:
        """Carry an action out and look.

        Raises:
            WebGymError: the browser, the page or the server is at fault.
        """
        ...

    async def close(self) -> None:
        """Give it back."""
        ...


class Browsers(Protocol):
    """Where sessions come from: :class:`webgym.server.BrowserClient`, or what stands in for it."""

    async def open(self, options: SessionOptions | None = None) -> BrowserSession:
        """A session.

        Raises:
            WebGymError: there is none to be had.
        """
        ...


class ImageStore(Protocol):
    """What keeps pictures: :class:`webgym.rollout.store.RunWriter`, or what stands in for it."""

    async def put_image(self, name: str, data: bytes) -> None:
        """Keep a picture.

        Raises:
            StoreError: it cannot be kept.
        """
        ...


class Backstage(Protocol):
    """What the offline web tells a collector behind the agent's back."""

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        """Cookies that make a browser this visitor."""
        ...

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """What a website's server holds for this visitor; ``None`` if it does not know it.

        Raises:
            SitesError: the offline web does not answer.
        """
        ...


class AttemptConfig(Settings):
    """How an attempt is made."""

    viewport: tuple[int, int] = (1280, 768)
    """Width and height, CSS pixels (paper §4); 192 x 128 for the offline web's small websites, unless set."""

    budget_easy: int = Field(default=15, ge=1)
    """Steps for a task of 1 to 3 facts (paper §5: 15, better 10, in training; 30 in testing)."""

    budget_medium: int = Field(default=30, ge=1)
    """Steps for a task of 4 to 6 facts (paper §5: 30, better 20, in training; 50 in testing)."""

    budget_hard: int = Field(default=45, ge=1)
    """Steps for a task of 7 facts and more (paper §5: 45, better 30, in training; 70 in testing)."""

    start_tries: int = Field(default=2, ge=1)
    """How often the start page is tried before the attempt counts as the environment's failure."""

    longest_seconds: float = Field(default=3600.0, gt=0)
    """How long an attempt may take of its own: replies, and actions and looks in its browser, without waits
    in queues. An attempt that does ends without a reward, as the environment's failure: the agent's own limit
    is its budget of steps."""

    record_text: bool = True
    """Record the text that is visible in each screenshot; the offline judge reads it."""

    record_cuts: bool = False
    """Record the lines of each page that are cut off; ``webgym sites check`` reads them."""

    @property
    def budget(self) -> StepBudget:
        """The three budgets as one value."""
        return StepBudget(self.budget_easy, self.budget_medium, self.budget_hard)


StoreT = TypeVar("StoreT", bound=ImageStore, covariant=True)


@dataclass(frozen=True)
class Stage(Generic[StoreT]):
    """What an attempt is made with.

    Attributes:
        client: of the browser server.
        agent: decides.
        store: keeps the pictures.
        config: limits.
        progress: is told what goes on.
        backstage: the offline web, if the tasks are its.
        run_id: makes visitors of different runs different.
        seed: of the run.
        calls: queues of the kinds of calls, at least ``policy`` and ``judge``.
        lockstep: where attempts wait for each other before they ask, if they do.
    """

    client: Browsers
    agent: Agent
    store: StoreT
    config: AttemptConfig
    progress: Progress
    backstage: Backstage | None
    run_id: str
    seed: int
    calls: dict[str, CallQueue] = field(default_factory=lambda: call_queues({"policy": 256, "judge": 8}))
    lockstep: Lockstep | None = None


class Attempt:
    """An attempt in progress. Whatever happens, :meth:`episode` tells all that was seen and said.

    Args:
        stage: what it is made with.
        planned: what it is.
        session: an open browser session; the attempt closes it.
    """

    def __init__(self, stage: Stage[ImageStore], planned: Planned) -> None:
        self.planned = planned
        self._stage = stage
        self._started_at = time.time()
        self.started = time.monotonic()
        self._spent = 0.0
        """Seconds of the attempt's own."""
        self._seconds = 0.0
        self._steps: list[Step] = []
        self._final: Observation | None = None
        self._final_state: dict[str, Any] | None = None
        self._answer: str | None = None
        self._ending = Ending.CANCELLED
        self._failure: Failure | None = None
        self._reached: set[str] = set()
        self._session = ""
        self._state: State | None = None
        self._clock: asyncio.Timeout | None = None
        self._due: float | None = None
        """When the attempt is ended, on the loop's clock."""
        digest = hashlib.sha256(f"{stage.run_id}\x1f{planned.attempt_id}".encode()).hexdigest()
        self._visitor = digest[:32]
        # Not of the retry: an attempt that is made again is made under the same seed.
        sample = f"{stage.seed}\x1f{planned.task.id}\x1f{planned.sample}"
        self._seed = int(hashlib.sha256(sample.encode()).hexdigest()[:15], 16)

    def options(self) -> SessionOptions:
        """The browser session that this attempt needs."""
        stage = self._stage
        return SessionOptions(
            mode=stage.agent.mode,
            viewport=stage.config.viewport,
            text=stage.config.record_text,
            cuts=stage.config.record_cuts,
            elements=stage.agent.wants_elements,
            cookies=stage.backstage.cookies(self._visitor) if stage.backstage else (),
            files=self.planned.task.files if stage.agent.config.actions == "extended" else (),
        )

    def end_as_straggler(self, after: float) -> None:
        """End the attempt in so many seconds, if it runs for so long."""
        self._due = asyncio.get_running_loop().time() + max(0.0, after)
        if self._clock is not None and not self._clock.expired():
            self._clock.reschedule(self._due)

    async def run(self, session: BrowserSession) -> None:
        """Make the attempt; its end, good or bad, is data.

        Raises:
            StoreError: a picture cannot be kept. The run cannot go on.
            asyncio.CancelledError: the run is being stopped.
        """
        self._session = session.id
        self.started, self._started_at = time.monotonic(), time.time()
        clock = self._clock = asyncio.timeout_at(self._due)
        try:
            async with clock:
                self._ending = await self._play(session)
        except StoreError:
            raise
        except Exception as error:
            if isinstance(error, TimeoutError) and clock.expired():
                self._ending = Ending.STRAGGLER
                self._failure = Failure("straggler", "ended by the collector: nearly all others were done")
            else:
                self.fail(error)
        finally:
            self._clock = None
            if self._stage.lockstep is not None:
                self._stage.lockstep.leave(self)
            self._move(None)
            self._seconds = time.monotonic() - self.started
        self._refuse_without_action()
        await self._look_backstage()

    async def _play(self, session: BrowserSession) -> Ending:
        stage, task = self._stage, self.planned.task
        budget = stage.config.budget.for_task(task)
        conversation = stage.agent.begin(task, self._seed, budget)
        view = await self._arrive(session, task.website)
        for _ in range(budget):
            await stage.store.put_image(view.observation.screenshot, view.image)
            self._move("thinking")
            self._final = view.observation  # if no reply comes, what was open is on record all the same
            step = await self._ask(conversation, view)
            self._final = None
            self._steps.append(step)
            stage.progress.stepped(self.planned.attempt_id, is_valid=step.action is not None)
            if isinstance(step.action, Answer):
                self._answer = step.action.text
                return Ending.ANSWERED
            view = await self._act(session, step.action)
            self._check_connection(view.observation)
            changed = view.observation.screenshot != step.observation.screenshot
            self._steps[-1] = msgspec.structs.replace(step, changed=changed)
        await stage.store.put_image(view.observation.screenshot, view.image)
        self._final = view.observation
        return Ending.BUDGET_SPENT

    async def _ask(self, conversation: Conversation, view: View) -> Step:
        """A turn of the policy's."""
        stage, longest = self._stage, self._stage.config.longest_seconds
        at = time.monotonic() - self.started
        queue = stage.calls["policy"]
        async with AsyncExitStack() as turns:
            if stage.lockstep is not None:
                await turns.enter_async_context(stage.lockstep.turn(self))
            await turns.enter_async_context(queue.turn())
            asked = time.monotonic()
            deadline = asyncio.timeout(longest)
            try:
                async with deadline:
                    step = await conversation.turn(view.observation, view.image, at)
            except TimeoutError as error:
                if not deadline.expired():
                    raise
                raise PolicyTimeout(f"no reply within {longest:g} s") from error
            took = time.monotonic() - asked
        # What a policy does not count as its reply's is a wait for its endpoint.
        own = min(step.reply.seconds or took, took)
        queue.waited_elsewhere(took - own)
        self._spend(own)
        return step

    async def _act(self, session: BrowserSession, action: BrowserAction | None) -> View:
        """A step in the browser."""
        self._move("acting")
        view = await session.step(action)
        self._spend(view.observation.own_seconds)
        return view

    def _spend(self, seconds: float) -> None:
        self._spent += seconds
        if self._spent > (longest := self._stage.config.longest_seconds):
            raise AttemptOverdue(f"the attempt took longer than {longest:g} s of its own")

    async def _arrive(self, session: BrowserSession, website: str) -> View:
        """The start page. A website that cannot be opened at all is the environment's failure."""
        url = website if "://" in website else f"https://{website}"
        refused = ""
        for _ in range(self._stage.config.start_tries):
            view = await self._act(session, Navigate(url))
            notices = view.observation.notices
            refused = next((notice.text for notice in notices if notice.kind == "navigation_failed"), "")
            if not refused or view.observation.status is not None:
                self._check_connection(view.observation)
                return view
        raise NavigationFailed(f"{url} cannot be opened: {refused}")

    def _check_connection(self, seen: Observation) -> None:
        """A website that could be reached, and now cannot, is the environment's failure, not the agent's.

        An address that never answered may be the agent's own invention.

        Raises:
            NavigationFailed: it cannot be reached any more.
        """
        for notice in seen.notices:
            if (
                notice.kind == "navigation_failed"
                and _CONNECTION.search(notice.text)
                and _origin(notice.text) in self._reached
            ):
                raise NavigationFailed(f"the website went away under the attempt: {notice.text}")
        if seen.status is not None:
            self._reached.add(_origin(seen.url))

    def _refuse_without_action(self) -> None:
        """A model that never once replied in the format was asked wrongly: no measure of what it can do."""
        unread = [step.parse_error for step in self._steps if step.action is None]
        if self._ending is Ending.BUDGET_SPENT and 0 < len(unread) == len(self._steps):
            self.fail(
                PolicyBadReply(f"none of {len(unread)} replies holds an action; the first: {unread[0]}")
            )

    async def _look_backstage(self) -> None:
        truth = self.planned.task.truth
        if self._stage.backstage is None or truth is None or self._ending is Ending.ENVIRONMENT_FAILED:
            return
        if any(fact.state for fact in truth.facts):
            ended, self._ending = self._ending, Ending.CANCELLED  # until judges have what they look at
            try:
                self._final_state = await self._stage.backstage.state(self._visitor, truth.host)
            except WebGymError as error:
                self.fail(error)
            else:
                self._ending = ended

    def fail(self, error: Exception) -> None:
        """The attempt ends with this error."""
        self._ending = ending_of(error)
        if isinstance(error, WebGymError):
            self._failure = Failure(error.code, error.message)
        else:
            self._failure = Failure("internal_error", f"{type(error).__name__}: {error}")

    def _move(self, state: State | None) -> None:
        if state != self._state:
            self._stage.progress.move(self._state, state, self.planned.attempt_id)
            self._state = state

    def episode(self) -> Episode:
        """All that was seen and said so far."""
        planned = self.planned
        return Episode(
            attempt_id=planned.attempt_id,
            task_id=planned.task.id,
            sample=planned.sample,
            retry=planned.retry,
            seed=self._seed,
            policy=self._stage.agent.policy.name,
            started_at=self._started_at,
            seconds=self._seconds or time.monotonic() - self.started,
            steps=tuple(self._steps),
            ending=self._ending,
            final=self._final,
            answer=self._answer,
            final_state=self._final_state,
            failure=self._failure,
            session=self._session,
        )
