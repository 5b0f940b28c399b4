"""One attempt at one task: observe, query the policy, act, until it ends."""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from webgym.agent.agent import Agent, Conversation
from webgym.core.calls import CallQueue, call_queues
from webgym.core.errors import PolicyTimeout, StoreError
from webgym.core.outcome import Ending
from webgym.core.trajectory import Failure, Step
from webgym.rollout.driver import Browsers, BrowserSession, EpisodeContext, EpisodeDriver, ImageStore
from webgym.rollout.lockstep import Lockstep
from webgym.rollout.plan import Planned
from webgym.rollout.progress import Progress, State
from webgym.server.messages import View

StoreT = TypeVar("StoreT", bound=ImageStore, covariant=True)


@dataclass(frozen=True, kw_only=True)
class AttemptContext(EpisodeContext, Generic[StoreT]):
    """The services and settings that attempts share.

    Attributes:
        client: client of the browser server.
        agent: the agent.
        progress: records the state of attempts.
        calls: queues of the kinds of calls, at least ``policy`` and ``judge``.
        lockstep: makes attempts wait for each other before they query the policy; ``None`` if they do not.
    """

    store: StoreT
    client: Browsers
    agent: Agent
    progress: Progress
    calls: dict[str, CallQueue] = field(default_factory=lambda: call_queues({"policy": 256, "judge": 8}))
    lockstep: Lockstep | None = None


class Attempt(EpisodeDriver):
    """An attempt in progress: an episode in which the agent acts.

    Args:
        context: the shared services and settings.
        planned: the planned attempt.
    """

    def __init__(self, context: AttemptContext[ImageStore], planned: Planned) -> None:
        super().__init__(context, planned, context.agent.traits)
        self._attempts = context
        self._state: State | None = None
        self._clock: asyncio.Timeout | None = None
        self._due: float | None = None
        """When the attempt is ended as a straggler, event loop time."""

    def end_as_straggler(self, after: float) -> None:
        """End the attempt after this many seconds, unless it ends earlier."""
        self._due = asyncio.get_running_loop().time() + max(0.0, after)
        if self._clock is not None and not self._clock.expired():
            self._clock.reschedule(self._due)

    async def run(self, session: BrowserSession) -> None:
        """Carry out the attempt. Failures are recorded, not raised.

        Raises:
            StoreError: a screenshot cannot be stored, so that the run cannot continue.
            asyncio.CancelledError: the run is being stopped.
        """
        clock = self._clock = asyncio.timeout_at(self._due)
        try:
            async with clock:
                await self._play(session)
        except StoreError:
            raise
        except Exception as error:
            if isinstance(error, TimeoutError) and clock.expired():
                message = "ended by the collector: nearly all others were done"
                self.stop(Ending.STRAGGLER, Failure("straggler", message))
            else:
                self.fail(error)
        finally:
            self._clock = None
            if self._attempts.lockstep is not None:
                self._attempts.lockstep.leave(self)
            self._move(None)
        await self.conclude()

    async def _play(self, session: BrowserSession) -> None:
        context = self._attempts
        conversation = context.agent.begin(self.planned.task, self.seed, self.budget)
        self._move("acting")
        view: View | None = await self.start(session)
        while view is not None and not self.is_over:
            self._move("thinking")
            step = await self._query_policy(conversation, view)
            context.progress.stepped(self.planned.attempt_id, is_valid=step.action is not None)
            self._move("acting")
            view = await self.take(step)

    async def _query_policy(self, conversation: Conversation, view: View) -> Step:
        """Get the policy's next step."""
        context, longest = self._attempts, self._attempts.config.longest_seconds
        at = self.elapsed
        queue = context.calls["policy"]
        async with AsyncExitStack() as turns:
            if context.lockstep is not None:
                await turns.enter_async_context(context.lockstep.turn(self))
            await turns.enter_async_context(queue.turn())
            started = time.monotonic()
            deadline = asyncio.timeout(longest)
            try:
                async with deadline:
                    step = await conversation.turn(view.observation, view.image, at)
            except TimeoutError as error:
                if not deadline.expired():
                    raise
                raise PolicyTimeout(f"no reply within {longest:g} s") from error
            took = time.monotonic() - started
        # Time that is not part of the reply's own time was spent waiting for the endpoint.
        reply_seconds = min(step.reply.seconds or took, took)
        queue.waited_elsewhere(took - reply_seconds)
        self.spend(reply_seconds)
        return step

    def _move(self, state: State | None) -> None:
        if state != self._state:
            self._attempts.progress.move(self._state, state, self.planned.attempt_id)
            self._state = state
