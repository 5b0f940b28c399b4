"""Several servers reply as one policy.

A session stays with one server, whose caches hold its earlier requests; a new one goes to the server with the
fewest. New weights reach all servers or none. A server that does not answer is left out: its sessions go on
with others, and it replies again once it has the newest weights.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Coroutine, Sequence
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any, Final, Self, TypeVar
from weakref import WeakSet

from webgym.agent.policy import BasePolicy, Policy, PolicyInput
from webgym.core.errors import PublishError, TrainingError, WebGymError
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.train.engine_serving import AnotherFailed, EnginePolicy, EngineServing

T = TypeVar("T")

log = logging.getLogger(__name__)

_POLL_SECONDS: Final = 2.0
"""How often a server is asked whether it is there."""
_SILENT_POLLS: Final = 2
"""After how many of them without an answer it is left out."""


class LeftOut(PublishError):
    """The server was left out, because it does not answer."""


class FleetPolicy(BasePolicy):
    """Replies of several servers.

    Args:
        servers: their policies.

    Attributes:
        left_out: for each, an event that is set while it is left out.
        sessions: for each, the sessions that it has.
    """

    def __init__(self, servers: Sequence[EnginePolicy]) -> None:
        self.name = servers[0].name
        self.left_out = {server: asyncio.Event() for server in servers}
        self.sessions: dict[EnginePolicy, WeakSet[FleetSession]] = {server: WeakSet() for server in servers}

    @property
    def problem(self) -> str:
        """Why requests are delayed at this moment; empty if they are not."""
        return next((server.problem for server in self.sessions if server.problem), "")

    def begin(self, task: Task, seed: int) -> FleetSession:  # noqa: ARG002
        """A session, which stays with one server as long as that one is there."""
        return FleetSession(self)

    async def assign(self, session: FleetSession) -> EnginePolicy:
        """The server with the fewest sessions, as soon as one is there."""
        while not (  # noqa: ASYNC110 (there are several events)
            present := [each for each, is_out in self.left_out.items() if not is_out.is_set()]
        ):
            await asyncio.sleep(_POLL_SECONDS)
        server = min(present, key=lambda each: len(self.sessions[each]))
        for sessions in self.sessions.values():
            sessions.discard(session)
        self.sessions[server].add(session)
        return server

    async def unless_left_out(self, server: EnginePolicy, call: Coroutine[Any, Any, T]) -> T:
        """The result of a call, which is cancelled if the server is left out meanwhile.

        Raises:
            LeftOut: it was.
        """
        calling = asyncio.create_task(call)
        out = asyncio.create_task(self.left_out[server].wait())
        try:
            await asyncio.wait({calling, out}, return_when=asyncio.FIRST_COMPLETED)
            if not calling.done():
                raise LeftOut("the server does not answer any more")
            return calling.result()
        finally:
            out.cancel()
            if calling.cancel():
                await asyncio.wait({calling})

    async def __aenter__(self) -> Self:
        for server in self.sessions:
            await server.__aenter__()
        return self


class FleetSession:
    """The requests of one attempt.

    Args:
        fleet: of the servers.
    """

    def __init__(self, fleet: FleetPolicy) -> None:
        self._fleet = fleet
        self._server: EnginePolicy | None = None

    async def reply(self, turn: PolicyInput) -> Reply:
        """The reply of the session's server, or of another one if that is left out meanwhile.

        Raises:
            PolicyError: as :meth:`webgym.train.engine_serving.EnginePolicy.reply`.
        """
        while True:
            if self._server is None or self._fleet.left_out[self._server].is_set():
                self._server = await self._fleet.assign(self)
            with suppress(LeftOut):
                return await self._fleet.unless_left_out(self._server, self._server.reply(turn))


class EngineFleet:
    """See :class:`webgym.train.serving.Serving`.

    Args:
        servings: one for each server.
    """

    def __init__(self, servings: Sequence[EngineServing]) -> None:
        self._servings = list(servings)
        self._fleet = FleetPolicy([each.replies for each in servings])
        self.policy: Policy = self._fleet
        self._newest: tuple[Path | None, str] = (None, "0")
        self._publishing = asyncio.Lock()
        self._opened = AsyncExitStack()

    async def publish(self, weights: Path, version: str) -> None:
        """See :class:`webgym.train.serving.Serving`. Servers that are left out get the weights later."""
        async with self._publishing:
            while True:
                present = [each for each in self._servings if not self._fleet.left_out[each.replies].is_set()]
                if not present:
                    raise PublishError(f"cannot publish the weights {version}: no server answers")
                together = asyncio.Barrier(len(present))
                errors = await _all(self._publish(each, weights, version, together) for each in present)
                causes = {each: error for each, error in zip(present, errors, strict=True) if error}
                away = [
                    each
                    for each, error in causes.items()
                    if isinstance(error, LeftOut) or not await each.is_up()
                ]
                if not causes:
                    self._newest = (weights, version)
                    return
                for each in away:
                    self._leave_out(each)
                if not away:
                    raise next(error for error in causes.values() if not isinstance(error, AnotherFailed))

    async def _publish(
        self, serving: EngineServing, weights: Path, version: str, together: asyncio.Barrier
    ) -> None:
        try:
            await self._fleet.unless_left_out(serving.replies, serving.publish(weights, version, together))
        except BaseException:
            await together.abort()
            raise

    def copy(self) -> None:
        """See :class:`webgym.train.serving.Serving`: a server has one set of weights."""

    async def watch(self) -> None:
        """See :class:`webgym.train.serving.Serving`."""
        async with asyncio.TaskGroup() as group:
            for serving in self._servings:
                group.create_task(self._watch(serving))
                group.create_task(self._look_after(serving))

    async def _watch(self, serving: EngineServing) -> None:
        try:
            await serving.watch()
        except TrainingError as error:
            others = [each for each in self._servings if each is not serving]
            if serving.replies.distrusted.is_set() or not others:
                raise
            log.warning("%s; the training goes on with %d servers", error.message, len(others))
            self._leave_out(serving)
            self._servings = others

    async def _look_after(self, serving: EngineServing) -> None:
        """Leave a server out while it does not answer, and bring it the newest weights when it does again."""
        silent, problem = 0, ""
        while serving in self._servings:
            await asyncio.sleep(_POLL_SECONDS)
            is_out = self._fleet.left_out[serving.replies]
            silent = 0 if await serving.is_up() else silent + 1
            if silent >= _SILENT_POLLS or serving.replies.lost.is_set():
                self._leave_out(serving)
            if not silent and is_out.is_set() and not serving.replies.lost.is_set():
                async with self._publishing:
                    try:
                        await serving.recover(*self._newest)
                        is_out.clear()
                    except WebGymError as error:
                        if error.message != problem:
                            problem = error.message
                            log.warning("a server answers again, and is left out still: %s", problem)

    def _leave_out(self, serving: EngineServing) -> None:
        is_out = self._fleet.left_out[serving.replies]
        if not is_out.is_set():
            log.warning("a server does not answer, and is left out until it does")
            is_out.set()

    async def __aenter__(self) -> Self:
        try:
            errors = await _all(self._opened.enter_async_context(each) for each in self._servings)
            for error in filter(None, errors):
                raise error
        except BaseException:
            await self._opened.aclose()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._opened.aclose()


async def _all(calls: Any) -> list[BaseException | None]:
    """Make all calls at once, and wait for each; returns what each raised."""
    made: list[Coroutine[Any, Any, object]] = list(calls)
    results = await asyncio.gather(*made, return_exceptions=True)
    return [each if isinstance(each, BaseException) else None for each in results]
