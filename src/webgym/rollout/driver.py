"""The environment's side of an attempt: the browser, its observations, and the actions taken.

Attempts of a run (:mod:`webgym.rollout.attempt`) use it with WebGym's policies, the environment
(:mod:`webgym.environment`) with the steps of its caller.
"""

from __future__ import annotations

import hashlib
import re
import secrets
import time
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Protocol

from webgym.agent.agent import AgentTraits
from webgym.browser.config import Cookie
from webgym.core.action import Answer, BrowserAction, Navigate
from webgym.core.errors import AttemptOverdue, EgressRefused, NavigationFailed, WebGymError
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, ending_of
from webgym.core.trajectory import Episode, Failure, Step
from webgym.core.websites import host_or_text
from webgym.rollout.config import AttemptConfig
from webgym.rollout.plan import Planned
from webgym.server.messages import SessionOptions, View

_ORIGIN = re.compile(r"(?<![^\s(\"])https?://[^/\s?#\"]+", re.IGNORECASE)
"""The beginning of a URL, and not that of another one in its query."""
_CONNECTION = re.compile(
    r"gave no answer within|the page broke off|has nothing to show yet|too many new connections|"
    r"net::ERR_(CONNECTION|NAME|DNS|ADDRESS|INTERNET|NETWORK|EMPTY_RESPONSE|TIMED_OUT|SOCK|INSUFFICIENT)"
)
"""Parts of a browser's error message that mean that the connection to the website failed, not the page."""


def _origin(url: str) -> str:
    origins = _ORIGIN.findall(url)
    return origins[-1].lower().rstrip(":") if origins else ""


class BrowserSession(Protocol):
    """An open session: :class:`webgym.server.client.Session`, or a replacement for it."""

    @property
    def id(self) -> str:
        """Its id, for the record."""
        ...

    async def step(self, action: BrowserAction | None = None) -> View:
        """Carry out an action, if any, and observe the page.

        Raises:
            WebGymError: the browser, the page or the server failed.
        """
        ...

    async def close(self) -> None:
        """Release it."""
        ...


class Browsers(Protocol):
    """Opens sessions: :class:`webgym.server.client.BrowserClient`, or a replacement for it."""

    async def open(self, options: SessionOptions | None = None) -> BrowserSession:
        """Open a session.

        Raises:
            WebGymError: no session could be opened.
        """
        ...


class ImageStore(Protocol):
    """Stores screenshots: :class:`webgym.rollout.store.RunWriter`, or a replacement for it."""

    async def put_image(self, name: str, data: bytes) -> None:
        """Store a picture.

        Raises:
            StoreError: it cannot be stored.
        """
        ...


class NoStore:
    """Stores nothing."""

    async def put_image(self, name: str, data: bytes) -> None:
        """Drop a picture."""


class SiteState(Protocol):
    """The state of the offline web's servers for a visitor, such as cart, bookings and messages."""

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        """Cookies that make a browser this visitor."""
        ...

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a website's server for this visitor; ``None`` if the visitor is unknown to it.

        Raises:
            SitesError: the offline web does not answer.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class EpisodeContext:
    """The services and settings that episodes share.

    Attributes:
        store: stores the screenshots.
        config: limits of an attempt.
        site_state: server states of the offline web; ``None`` for other tasks.
        seed: seed of the run.
    """

    store: ImageStore
    config: AttemptConfig
    site_state: SiteState | None
    seed: int


class EpisodeDriver:
    """One episode at one task. :meth:`episode` returns its record at any time::

        view = await driver.start(session)
        while not driver.is_over:
            view = await driver.take(step)  # the step for this view
        await driver.conclude()

    Args:
        context: the shared services and settings.
        planned: the planned attempt.
        traits: of the agent that acts.

    Attributes:
        planned: as given.
        seed: seed of everything random in the policy.
        visitor: the visitor of the offline web that this episode's browser is.
        budget: most steps.
        steps: the steps so far.
        ending: why it stopped; ``CANCELLED`` until it does.
        failure: the error that stopped it.
        started_at, started: when the session was opened: Unix time, and on the monotonic clock, seconds.
    """

    def __init__(self, context: EpisodeContext, planned: Planned, traits: AgentTraits) -> None:
        self.planned = planned
        self._traits = traits
        self.budget = context.config.budget.for_task(planned.task)
        self.steps: list[Step] = []
        self.ending = Ending.CANCELLED
        self.failure: Failure | None = None
        self._context = context
        self.started_at, self.started = time.time(), time.monotonic()
        self._spent = 0.0
        """Time that counts towards ``longest_seconds``."""
        self._seconds = 0.0
        self._final: Observation | None = None
        self._final_state: dict[str, Any] | None = None
        self._answer: str | None = None
        self._reached: set[str] = set()
        self._session: BrowserSession | None = None
        # New for every episode: a killed attempt that is made again finds nothing of its first time.
        self.visitor = secrets.token_hex(16)
        # Without the retry: a retried attempt has the same seed.
        sample = f"{context.seed}\x1f{planned.task.id}\x1f{planned.sample}"
        self.seed = int(hashlib.sha256(sample.encode()).hexdigest()[:15], 16)

    @property
    def elapsed(self) -> float:
        """Seconds since the session was opened."""
        return time.monotonic() - self.started

    @property
    def is_over(self) -> bool:
        """Whether it has ended regularly: answered, or the budget of steps is used up."""
        return self._answer is not None or len(self.steps) >= self.budget

    def options(self) -> SessionOptions:
        """The browser session that this episode needs."""
        context, traits = self._context, self._traits
        return SessionOptions(
            mode=traits.mode,
            viewport=context.config.viewport,
            text=context.config.record_text,
            cuts=context.config.record_cuts,
            elements=traits.elements,
            cookies=context.site_state.cookies(self.visitor) if context.site_state else (),
            files=self.planned.task.files if traits.space == "extended" else (),
        )

    async def reach_site_state(self) -> None:
        """Ask the offline web for this episode's state, which it does not have yet, to see that it answers.

        Raises:
            SitesError: it does not, although the task is on it.
        """
        truth, site_state = self.planned.task.truth, self._context.site_state
        if site_state is not None and truth is not None:
            await site_state.state(self.visitor, truth.host)

    async def start(self, session: BrowserSession) -> View:
        """Open the start page.

        Raises:
            NavigationFailed: it cannot be opened, which is the environment's failure.
            WebGymError: the browser, the server or the disk failed.
        """
        self._session = session
        self.started_at, self.started = time.time(), time.monotonic()
        website = self.planned.task.website
        url = website if "://" in website else f"https://{website}"
        refused = ""
        self._reached.add(_origin(url))
        for _ in range(self._context.config.start_tries):
            view = await self._act(Navigate(url))
            notices, broken = view.observation.notices, self._broken_connection(view.observation)
            refused = broken or next((it.text for it in notices if it.kind == "navigation_failed"), "")
            if not refused or (view.observation.status is not None and not broken):
                if view.observation.status == HTTPStatus.NOT_FOUND and self.planned.task.truth is not None:
                    raise NavigationFailed(f"{url} is not among the websites that are served")
                return await self._record_view(view)
        # For the user alone: the agent sees notices, and this ends the episode before its first request.
        allow = (
            "; browser.egress.allow, or webgym serve --allow-host, allows it"
            if EgressRefused.by_policy in refused
            else ""
        )
        raise NavigationFailed(f"{url} cannot be opened: {refused}{allow}")

    async def take(self, step: Step) -> View | None:
        """Record a step, and carry out its action.

        Returns:
            The next view; ``None`` after an answer.

        Raises:
            WebGymError: the browser, the server or the disk failed; the step is recorded.
        """
        self._final = None
        self.steps.append(step)
        if isinstance(step.action, Answer):
            self._answer = step.action.text
            self.ending = Ending.ANSWERED
            return None
        view = await self._record_view(await self._act(step.action))
        self.steps[-1] = step.followed_by(view.observation)
        if self.is_over:
            self.ending = Ending.BUDGET_SPENT
        return view

    async def conclude(self) -> None:
        """Complete the record; call it once, however the episode ended."""
        self._seconds = self.elapsed
        await self._read_site_state()

    def spend(self, seconds: float) -> None:
        """Add to the time that counts towards ``longest_seconds``.

        Raises:
            AttemptOverdue: the limit is exceeded.
        """
        self._spent += seconds
        if self._spent > (longest := self._context.config.longest_seconds):
            raise AttemptOverdue(f"the attempt took longer than {longest:g} s, without waiting in queues")

    def stop(self, ending: Ending, failure: Failure) -> None:
        """End the episode with this ending and failure."""
        self.ending, self.failure = ending, failure

    def fail(self, error: Exception) -> None:
        """End the episode with this error."""
        if isinstance(error, WebGymError):
            self.stop(ending_of(error), Failure(error.code, error.message))
        else:
            self.stop(ending_of(error), Failure("internal_error", f"{type(error).__name__}: {error}"))

    async def _act(self, action: BrowserAction | None) -> View:
        assert self._session is not None, "start comes first"
        view = await self._session.step(action)
        self.spend(view.observation.own_seconds)
        return view

    async def _record_view(self, view: View) -> View:
        """Check a view, store its screenshot, and keep it as the last observation."""
        self._check_connection(view.observation)
        await self._context.store.put_image(view.observation.screenshot, view.image)
        self._final = view.observation  # recorded even if no reply follows
        return view

    def _check_connection(self, observation: Observation) -> None:
        """Fail if a website that could be reached earlier cannot be reached any more: the environment's
        failure.

        Raises:
            NavigationFailed: a website cannot be reached any more.
        """
        if broken := self._broken_connection(observation):
            raise NavigationFailed(f"the website became unreachable during the attempt: {broken}")
        if observation.status is not None:
            self._reached.add(_origin(observation.url))

    def _broken_connection(self, observation: Observation) -> str:
        """How the connection to a website that could be reached failed; empty if it did not.

        A URL that never answered may have been made up by the agent, and does not count. A part of a page, or
        an error of the server, counts only on the offline web, which is part of the environment and has none
        by itself.
        """
        truth, status = self.planned.task.truth, observation.status or 0
        is_own = truth is not None and host_or_text(observation.url) in truth.hosts
        if is_own and status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            return f"{observation.url}: HTTP status {status}"
        failed = [it.text for it in observation.notices if it.kind == "navigation_failed"]
        failed = [text for text in failed if _CONNECTION.search(text)]
        if truth is not None:
            failed += observation.broken
        return next((text for text in failed if _origin(text) in self._reached), "")

    async def _read_site_state(self) -> None:
        truth, site_state = self.planned.task.truth, self._context.site_state
        if site_state is None or truth is None or self.ending is Ending.ENVIRONMENT_FAILED:
            return
        if any(fact.state for fact in truth.facts):
            ended, self.ending = self.ending, Ending.CANCELLED  # until the state for the judge is known
            try:
                self._final_state = await site_state.state(self.visitor, truth.host)
            except WebGymError as error:
                self.fail(error)
            else:
                self.ending = ended

    def episode(self) -> Episode:
        """The record of the episode so far."""
        planned = self.planned
        return Episode(
            attempt_id=planned.attempt_id,
            task_id=planned.task.id,
            sample=planned.sample,
            retry=planned.retry,
            seed=self.seed,
            policy=self._traits.policy,
            started_at=self.started_at,
            seconds=self._seconds or self.elapsed,
            steps=tuple(self.steps),
            ending=self.ending,
            final=self._final,
            answer=self._answer,
            final_state=self._final_state,
            failure=self.failure,
            session=self._session.id if self._session else "",
        )
