"""Serves the policy during training; weights are replaced between replies."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from webgym.agent.policy import BasePolicy, Policy, PolicySession
from webgym.agent.profile import Profile
from webgym.core.errors import ConfigError, PublishError
from webgym.core.task import Task
from webgym.inference.local import LocalConfig, LocalPolicy
from webgym.train.selftest import EXACT_TOLERANCE, GREEDY, TOLERANCE, check, read_selftest


class Serving(Protocol):
    """Serves a policy whose weights can be replaced. Entered once for a training."""

    @property
    def policy(self) -> Policy:
        """The policy that collects. Entering and leaving it does nothing; the serving opens and closes it."""
        ...

    async def publish(self, weights: Path, version: str) -> None:
        """Reply with these weights from now on; the served model must pass their self-test.

        Atomic: no reply comes from partly loaded weights.

        Args:
            weights: a folder that an update wrote.
            version: recorded in replies.

        Raises:
            PublishError: the weights were not loaded, or replies do not come from them.
        """
        ...

    def copy(self) -> Serving | None:
        """The same model with weights of its own, not entered: evaluations keep theirs while training goes
        on. ``None`` if there can be none; then new weights wait for the end of an evaluation."""
        ...

    async def watch(self) -> None:
        """Supervise the server during the training; never returns.

        Raises:
            TrainingError: the server has failed for good, or its replies are no longer reliable.
        """
        ...

    async def __aenter__(self) -> Self: ...

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class LocalServing:
    """Serves the model in this process.

    Args:
        config: the model and its sampling.
        profile: of the model's family.
    """

    def __init__(self, config: LocalConfig, profile: Profile | None = None) -> None:
        self._profile = profile
        self._local = LocalPolicy(config, profile)
        self.policy: Policy = KeptOpen(self._local)

    async def publish(self, weights: Path, version: str) -> None:
        """See :class:`Serving`."""
        test = read_selftest(weights)
        is_next = test is not None and self._local.weight_version == test.since
        earlier = await self._local.ask(*test.request(), GREEDY) if test and is_next else None
        try:
            await self._local.publish(weights, version)
        except ConfigError as error:
            raise PublishError(error.message, hint=error.hint) from error
        if test is None:
            return
        reply = await self._local.ask(*test.request(), GREEDY)
        if reply.weight_version != version:
            raise PublishError(f"the weights {reply.weight_version} reply instead of the published {version}")
        is_exact = test.is_exact and self._local.config.dtype == "float32"
        check(test, reply, tolerance=EXACT_TOLERANCE if is_exact else TOLERANCE, earlier=earlier)

    def copy(self) -> LocalServing:
        """See :class:`Serving`."""
        return LocalServing(self._local.config, self._profile)

    async def watch(self) -> None:
        """See :class:`Serving`; nothing can fail here."""
        await asyncio.get_running_loop().create_future()

    async def __aenter__(self) -> Self:
        await self._local.__aenter__()
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._local.__aexit__(*exc)


class KeptOpen(BasePolicy):
    """A policy that runs enter and leave without opening or closing it.

    Args:
        policy: the policy itself.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def name(self) -> str:
        """Name of the policy."""
        return self._policy.name

    @property
    def wants_elements(self) -> bool:
        """Whether the policy reads elements."""
        return self._policy.wants_elements

    def begin(self, task: Task, seed: int) -> PolicySession:
        """Start a session of the policy."""
        return self._policy.begin(task, seed)
