"""The environment's side of an attempt: the browser, its observations, and the actions taken.

Who caused the end of an attempt is decided here, by what was asked for and by whom
(:class:`~webgym.core.observation.Fault`), never by the words of a message:

- An address that the agent typed and that fails is a step with a notice.
- A request to the task's own website that a page or the environment made, and that failed, is followed by one
  probe of the start page from outside the session. If that fails too, the website is down: the environment's
  failure. Otherwise it is a step with a notice.
- If the last page of its own website that an agent asked for did not come, whoever asked, that probe is made
  before the attempt is judged: what an agent did while its website was down says nothing about it.
- An upstream proxy that failed is the environment's failure, whoever asked for what, if that probe shows that
  it does not lead to the task's own website either.
- A renderer that is lost takes with it what the page's scripts had done, so that nothing the agent does
  afterwards counts: the environment's failure, unless the agent had typed the page's address.

Attempts of a run (:mod:`webgym.rollout.attempt`) use it with WebGym's policies, the environment
(:mod:`webgym.env.environment`) with the steps of its caller.
"""

from __future__ import annotations

import asyncio
import hashlib
import secrets
import time
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final, Protocol

from webgym.agent.agent import AgentTraits
from webgym.browser.config import Cookie
from webgym.core.action import Answer, BrowserAction, Navigate
from webgym.core.errors import (
    AttemptOverdue,
    BrowserCrashed,
    EgressRefused,
    NavigationFailed,
    RouteFailed,
    SiteRefused,
    WebGymError,
    error_from_code,
)
from webgym.core.identity import Identity
from webgym.core.observation import Fault, Observation, Probed
from webgym.core.outcome import Ending, ending_of
from webgym.core.settings import set_values
from webgym.core.trajectory import Arrival, Episode, Failure, Step
from webgym.core.websites import host_or_text, site_or_text
from webgym.rollout.arrival import Finding, dead_by_error, finding_of, has_login_wall
from webgym.rollout.config import AttemptConfig
from webgym.rollout.plan import Planned
from webgym.server.messages import SessionOptions, View

INSIST_SECONDS = 10.0
"""Pause before a start page that was refused is asked for again."""

_START_TRIES: Final = 2
"""How often the start page is tried before the attempt counts as the environment's failure."""


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

    async def probe(self, url: str) -> Probed:
        """Ask for a page from outside the session.

        Raises:
            WebGymError: the server failed.
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
    """Stores screenshots: :class:`webgym.store.runs.RunWriter`, or a replacement for it."""

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
        identity: of the browsers, as far as it is known.
    """

    store: ImageStore
    config: AttemptConfig
    site_state: SiteState | None
    seed: int
    identity: Identity = field(default_factory=Identity)


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
        start_url: address of the start page.
        identity: name of the browser's identity.
        arrival: what was found at the start page; ``None`` so far.
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
        website = planned.task.website
        self.start_url = website if "://" in website else f"https://{website}"
        hosts = planned.task.truth.hosts if planned.task.truth is not None else ()
        self._own = {site_or_text(each) for each in (website, *hosts)}
        """The task's own website; on the offline web, all that it is about."""
        self._has_typed = False
        """Whether the agent has typed an address."""
        self._is_doubted = False
        """Whether what was last asked of the task's own website did not come."""
        self._is_suspect = False
        """Whether other sessions left no connections to the website, so that the page may lack parts."""
        self._session: BrowserSession | None = None
        self.arrival: Arrival | None = None
        own_identity = set_values(context.config.identity) | planned.task.identity
        self.identity = context.identity.over(own_identity).label
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
        context, traits, identity = self._context, self._traits, self._context.config.identity
        own = {name: value for name, value in set_values(identity).items() if name != "credentials"}
        return SessionOptions(
            mode=traits.mode,
            viewport=context.config.viewport,
            text=True,  # the offline judge needs it
            cuts=context.config.record_cuts,
            elements=traits.elements,
            cookies=context.site_state.cookies(self.visitor) if context.site_state else (),
            files=self.planned.task.files if traits.space == "extended" else (),
            keep_dialogs=traits.space == "extended",
            identity=own | self.planned.task.identity,
            credentials=context.config.access.credentials,
            storage=context.config.access.storage_of(self.planned.task),
            shared=f"{context.seed} {self.planned.task.id}" if context.config.share_parts else "",
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
            SiteRefused: it is refused, also after a pause.
            SiteDead: there is none.
            WebGymError: the browser, the server or the disk failed.
        """
        self._session = session
        self.started_at, self.started = time.time(), time.monotonic()
        found, view, seconds = await self._look_at_start()
        seen, state = view.observation, found.state
        if state is not None:
            code = found.dead if state == "dead" else ""
            wall = state == "open" and has_login_wall(self.start_url, seen)
            route = seen.route or "direct"
            self.arrival = Arrival(state, code, found.why, wall, seconds, self.identity, route)
        if found.is_open or found.is_of_page:
            await self._record_view(view)
        self._refuse(found, seen)
        self._own.add(site_or_text(seen.url))  # where the start page leads
        self._suspect(seen, None, None)
        return view

    async def _look_at_start(self) -> tuple[Finding, View, float]:
        """Open the start page until it is certain what it shows: that, and the longest time that it took."""
        seconds, refusals, nth = 0.0, 0, 0
        while True:
            view = await self._act(Navigate(self.start_url))
            found = self._find(view.observation)
            seconds, nth = max(seconds, view.observation.own_seconds), nth + 1
            refusals += found.is_refused
            is_enough = nth >= _START_TRIES and (refusals >= _START_TRIES or not found.is_refused)
            if found.is_open or found.is_lasting or is_enough:
                return found, view, seconds
            if found.dead == "no_answer" and "://" not in self.planned.task.website:
                self.start_url = f"http://{self.planned.task.website}"  # it may have no HTTPS
            if found.is_of_page:
                await asyncio.sleep(INSIST_SECONDS)

    def _find(self, seen: Observation) -> Finding:
        """What a look at the start page shows."""
        causes = ("renderer", "route")
        failed = next((it for it in seen.faults if it.kind in causes or self._is_of_website(it)), None)
        problem = failed.why if failed else ""
        if not problem and seen.status is None:
            problem = next((it.text for it in seen.notices if it.kind == "navigation_failed"), "")
        if self.planned.task.truth is not None:  # the offline web is a part of the environment
            return Finding(why=problem)
        if problem:
            is_route = failed is not None and failed.kind == "route"  # which says nothing about the website
            errors = (it.error for it in seen.faults if it.kind == "connection" and not is_route)
            error = next(errors, "")
            return Finding(dead=dead_by_error(error), why=problem)
        return finding_of(self.start_url, seen)

    def _refuse(self, found: Finding, seen: Observation) -> None:
        """Raise if no attempt can be made at the start page."""
        url = self.start_url
        if found.is_refused:
            raise SiteRefused(f"{url} was refused twice: {found.why}", url=seen.url)
        if found.dead:
            raise error_from_code(f"site_{found.dead}", f"{url} cannot be opened: {found.why}")
        if not found.is_open:
            # For the user alone: the agent sees notices, and this ends the episode before its first request.
            hint = "; browser.egress.allow, or webgym serve --allow-host, allows it"
            allow = hint if EgressRefused.by_policy in found.why else ""
            kind = RouteFailed if any(it.kind == "route" for it in seen.faults) else NavigationFailed
            raise kind(f"{url} cannot be opened: {found.why}{allow}")
        if seen.status == HTTPStatus.NOT_FOUND and self.planned.task.truth is not None:
            raise NavigationFailed(f"{url} is not among the websites that are served")

    async def take(self, step: Step) -> View | None:
        """Record a step, and carry out its action.

        Returns:
            The next view; ``None`` after an answer.

        Raises:
            WebGymError: the browser, the server or the disk failed; the step is recorded.
        """
        before, self._final = self._final, None
        self.steps.append(step)
        if isinstance(step.action, Answer):
            self._answer = step.action.text
            self.ending = Ending.ANSWERED
            return None
        view = await self._act(step.action)
        self._suspect(view.observation, before, step.action)
        await self._check_website(view.observation, before, is_typed=isinstance(step.action, Navigate))
        await self._record_view(view)
        self.steps[-1] = step.followed_by(view.observation)
        if self.is_over:
            self.ending = Ending.BUDGET_SPENT
        return view

    async def conclude(self) -> None:
        """Complete the record; call it once, however the episode ended."""
        self._seconds = self.elapsed
        if self.ending.is_regular:
            ended, self.ending = self.ending, Ending.CANCELLED  # until what judges need is known
            try:
                if self._is_suspect:
                    why = "other sessions left the last page no connections, so that it may lack parts"
                    raise EgressRefused(f"{why}; browser.egress.rate and burst are the limits")
                if self._is_doubted:
                    await self._check_up("the last page that was asked for did not come")
                await self._read_site_state()
            except WebGymError as error:
                self.fail(error)
            else:
                self.ending = ended

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
        """Store a view's screenshot, and keep it as the last observation."""
        await self._context.store.put_image(view.observation.screenshot, view.image)
        self._final = view.observation  # recorded even if no reply follows
        return view

    def _suspect(self, seen: Observation, before: Observation | None, action: BrowserAction | None) -> None:
        """Note whether what the page shows may be due to other sessions, until another is opened. What the
        limits refuse for this session's own sake excuses nothing: an agent that hammers would choose it."""
        if any(site_or_text(host) in self._own for host in seen.crowded):
            self._is_suspect = True
        elif before is None or before.url != seen.url or isinstance(action, Navigate):
            self._is_suspect = False

    def _is_of_website(self, fault: Fault) -> bool:
        """Whether the task's own website failed. On the web, a part of a page may always be missing, and a
        server may refuse one page; the offline web, which is part of the environment, has no such faults."""
        is_ours = self.planned.task.truth is not None or fault.kind in ("connection", "renderer")
        return is_ours and site_or_text(fault.url) in self._own

    async def _check_website(self, seen: Observation, before: Observation | None, *, is_typed: bool) -> None:
        """End the attempt if the environment failed.

        Args:
            seen: the observation after an action.
            before: the one before it.
            is_typed: whether the action typed an address.

        Raises:
            BrowserCrashed: the renderer of a page was lost that the agent had not chosen.
            RouteFailed: an upstream proxy failed.
            NavigationFailed: the task's own website is down.
        """
        if failed := next((fault.why for fault in seen.faults if fault.kind == "route"), ""):
            await self._check_up(failed)  # a proxy may hang up for one address alone, which an agent may type
        has_led_away, self._has_typed = self._has_typed, self._has_typed or is_typed
        asked = [fault for fault in seen.faults if self._is_of_website(fault)]
        unchosen = [fault for fault in seen.faults if not (fault.is_typed and self._has_typed)]
        for fault in unchosen:
            # Beyond the task's website, pages may have led on from one that the agent chose.
            if fault.kind == "renderer" and (fault in asked or not has_led_away):
                raise BrowserCrashed(
                    f"the renderer of {fault.url} was lost: {fault.why}; "
                    "a website that loses it in every attempt is unhealthy"
                )
        if made := next((fault.why for fault in unchosen if fault in asked), ""):
            await self._check_up(made)
        is_another = before is None or (before.url, before.status) != (seen.url, seen.status)
        has_come = is_another and seen.status is not None and site_or_text(seen.url) in self._own
        self._is_doubted = bool(asked) or (self._is_doubted and not has_come)

    async def _check_up(self, failed: str) -> None:
        """Probe the start page.

        Args:
            failed: what raised the doubt.

        Raises:
            RouteFailed: an upstream proxy failed.
            NavigationFailed: the task's website is down; or it was, and has lost what this attempt did.
            WebGymError: the server or the offline web does not answer.
        """
        assert self._session is not None
        probed, is_offline = await self._session.probe(self.start_url), self.planned.task.truth is not None
        problem, site_state = probed.problem, self._context.site_state
        if is_offline and (probed.status or 0) >= HTTPStatus.INTERNAL_SERVER_ERROR:
            problem = f"{self.start_url}: HTTP status {probed.status}"
        if is_offline and site_state is not None and not problem:
            is_known = await site_state.state(self.visitor, host_or_text(self.start_url)) is not None
            problem = "" if is_known else "the offline web was started again during the attempt"
        if probed.is_route:
            raise RouteFailed(problem)
        if problem:
            raise NavigationFailed(f"the website failed during the attempt: {failed}; probed: {problem}")

    async def _read_site_state(self) -> None:
        truth, site_state = self.planned.task.truth, self._context.site_state
        if site_state is not None and truth is not None and any(fact.state for fact in truth.facts):
            self._final_state = await site_state.state(self.visitor, truth.host)

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
            arrival=self.arrival,
        )
