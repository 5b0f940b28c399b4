"""The environment's side of an attempt: the browser, its observations, and the actions taken.

Attempts of a run (:mod:`webgym.rollout.attempt`) and the environment that others step
(:mod:`webgym.environment`) are this, with a policy of ours or of theirs.
"""

from __future__ import annotations

import hashlib
import re
import time
from dataclasses import dataclass
from typing import Any, Protocol

from webgym.browser.config import Cookie
from webgym.core.action import Answer, BrowserAction, Mode, Navigate, Space
from webgym.core.errors import AttemptOverdue, NavigationFailed, PolicyBadReply, WebGymError
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, ending_of
from webgym.core.trajectory import Episode, Failure, Step
from webgym.rollout.config import AttemptConfig
from webgym.rollout.plan import Planned
from webgym.server.messages import SessionOptions, View

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
    """Opens sessions: :class:`webgym.server.BrowserClient`, or a replacement for it."""

    async def open(self, options: SessionOptions | None = None) -> BrowserSession:
        """A session.

        Raises:
            WebGymError: there is none to be had.
        """
        ...


class ImageStore(Protocol):
    """Stores screenshots: :class:`webgym.rollout.store.RunWriter`, or a replacement for it."""

    async def put_image(self, name: str, data: bytes) -> None:
        """Keep a picture.

        Raises:
            StoreError: it cannot be kept.
        """
        ...


class SiteState(Protocol):
    """What the servers of the offline web hold, which no page shows: a visitor's cart, bookings, messages."""

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        """Cookies that make a browser this visitor."""
        ...

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """What a website's server holds for this visitor; ``None`` if it does not know it.

        Raises:
            SitesError: the offline web does not answer.
        """
        ...


@dataclass(frozen=True)
class EpisodeContext:
    """What episodes are made with.

    Attributes:
        store: keeps the pictures.
        config: limits.
        site_state: of the offline web, if the tasks are its.
        run_id: makes visitors of different runs different.
        seed: of the run.
        policy: its name, for the record.
        mode: how targets are named.
        space: which actions there are.
        elements: whether observations must carry ``elements`` and ``text``.
    """

    store: ImageStore
    config: AttemptConfig
    site_state: SiteState | None
    run_id: str
    seed: int
    policy: str
    mode: Mode
    space: Space = "paper"
    elements: bool = False


class EpisodeDriver:
    """One episode at one task. Whatever happens, :meth:`episode` tells all that was seen and said::

        view = await driver.start(session)
        while not driver.is_over:
            view = await driver.take(step)  # a reply to the view, and what it means
        await driver.conclude()

    Args:
        context: what it is made with.
        planned: what it is.

    Attributes:
        planned: what it is.
        seed: of everything random in the policy's part.
        budget: steps at most.
        steps: so far.
        ending: why it stopped; ``CANCELLED`` until it does.
        failure: the error that stopped it.
        started_at, started: when the browser was there: Unix time, and on the monotonic clock, seconds.
    """

    def __init__(self, context: EpisodeContext, planned: Planned) -> None:
        self.planned = planned
        self.budget = context.config.budget.for_task(planned.task)
        self.steps: list[Step] = []
        self.ending = Ending.CANCELLED
        self.failure: Failure | None = None
        self._context = context
        self.started_at, self.started = time.time(), time.monotonic()
        self._spent = 0.0
        """Seconds of the attempt's own."""
        self._seconds = 0.0
        self._final: Observation | None = None
        self._final_state: dict[str, Any] | None = None
        self._answer: str | None = None
        self._reached: set[str] = set()
        self._session: BrowserSession | None = None
        digest = hashlib.sha256(f"{context.run_id}\x1f{planned.attempt_id}".encode()).hexdigest()
        self._visitor = digest[:32]
        # Not of the retry: an attempt that is made again is made under the same seed.
        sample = f"{context.seed}\x1f{planned.task.id}\x1f{planned.sample}"
        self.seed = int(hashlib.sha256(sample.encode()).hexdigest()[:15], 16)

    @property
    def elapsed(self) -> float:
        """Seconds since the browser was there."""
        return time.monotonic() - self.started

    @property
    def is_over(self) -> bool:
        """Whether it came to an end of its own: answered, or the budget is spent."""
        return self._answer is not None or len(self.steps) >= self.budget

    def options(self) -> SessionOptions:
        """The browser session that this episode needs."""
        context = self._context
        return SessionOptions(
            mode=context.mode,
            viewport=context.config.viewport,
            text=context.config.record_text,
            cuts=context.config.record_cuts,
            elements=context.elements,
            cookies=context.site_state.cookies(self._visitor) if context.site_state else (),
            files=self.planned.task.files if context.space == "extended" else (),
        )

    async def start(self, session: BrowserSession) -> View:
        """Open the start page.

        Raises:
            NavigationFailed: it cannot be opened at all, which is the environment's failure.
            WebGymError: the browser, the server or the disk is at fault.
        """
        self._session = session
        self.started_at, self.started = time.time(), time.monotonic()
        website = self.planned.task.website
        url = website if "://" in website else f"https://{website}"
        refused = ""
        for _ in range(self._context.config.start_tries):
            view = await self._act(Navigate(url))
            notices = view.observation.notices
            refused = next((notice.text for notice in notices if notice.kind == "navigation_failed"), "")
            if not refused or view.observation.status is not None:
                return await self._look(view)
        raise NavigationFailed(f"{url} cannot be opened: {refused}")

    async def take(self, step: Step) -> View | None:
        """Record a reply to the last view, and carry its action out.

        Returns:
            What there is to see then; ``None`` after an answer.

        Raises:
            WebGymError: the browser, the server or the disk is at fault; the step is on record.
        """
        self._final = None
        self.steps.append(step)
        if isinstance(step.action, Answer):
            self._answer = step.action.text
            self.ending = Ending.ANSWERED
            return None
        view = await self._look(await self._act(step.action))
        self.steps[-1] = step.followed_by(view.observation)
        if self.is_over:
            self.ending = Ending.BUDGET_SPENT
        return view

    async def conclude(self) -> None:
        """Find out what only the end tells; call it once, however the episode ended.

        A model that never once replied in the format was asked wrongly: no measure of what it can do.
        """
        self._seconds = self.elapsed
        unread = [step.parse_error for step in self.steps if step.action is None]
        if self.ending is Ending.BUDGET_SPENT and 0 < len(unread) == len(self.steps):
            self.fail(
                PolicyBadReply(f"none of {len(unread)} replies holds an action; the first: {unread[0]}")
            )
        await self._read_site_state()

    def spend(self, seconds: float) -> None:
        """Add to the episode's own time.

        Raises:
            AttemptOverdue: it is more than an attempt may take.
        """
        self._spent += seconds
        if self._spent > (longest := self._context.config.longest_seconds):
            raise AttemptOverdue(f"the attempt took longer than {longest:g} s of its own")

    def stop(self, ending: Ending, failure: Failure) -> None:
        """The episode ends so."""
        self.ending, self.failure = ending, failure

    def fail(self, error: Exception) -> None:
        """The episode ends with this error."""
        if isinstance(error, WebGymError):
            self.stop(ending_of(error), Failure(error.code, error.message))
        else:
            self.stop(ending_of(error), Failure("internal_error", f"{type(error).__name__}: {error}"))

    async def _act(self, action: BrowserAction | None) -> View:
        assert self._session is not None, "start comes first"
        view = await self._session.step(action)
        self.spend(view.observation.own_seconds)
        return view

    async def _look(self, view: View) -> View:
        """A view that counts."""
        self._check_connection(view.observation)
        await self._context.store.put_image(view.observation.screenshot, view.image)
        self._final = view.observation  # if no reply comes, what was open is on record all the same
        return view

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

    async def _read_site_state(self) -> None:
        truth, site_state = self.planned.task.truth, self._context.site_state
        if site_state is None or truth is None or self.ending is Ending.ENVIRONMENT_FAILED:
            return
        if any(fact.state for fact in truth.facts):
            ended, self.ending = self.ending, Ending.CANCELLED  # until judges have what they look at
            try:
                self._final_state = await site_state.state(self._visitor, truth.host)
            except WebGymError as error:
                self.fail(error)
            else:
                self.ending = ended

    def episode(self) -> Episode:
        """All that was seen and said so far."""
        planned = self.planned
        return Episode(
            attempt_id=planned.attempt_id,
            task_id=planned.task.id,
            sample=planned.sample,
            retry=planned.retry,
            seed=self.seed,
            policy=self._context.policy,
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
