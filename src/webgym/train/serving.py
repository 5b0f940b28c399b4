"""Serving the policy during training: new weights are taken between two replies."""

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
from webgym.train.selftest import GREEDY, check, read_selftest


class Serving(Protocol):
    """A policy that can be given other weights. Entered once for a whole training run."""

    @property
    def policy(self) -> Policy:
        """What collects. Entering and leaving it does nothing: that is the serving's own matter."""
        ...

    async def publish(self, weights: Path, version: str) -> None:
        """Reply with these weights from now on, and be sure of it: what is served passes their self-test.

        Atomic: no reply comes from half-loaded weights.

        Args:
            weights: a folder that an update wrote.
            version: what replies will say.

        Raises:
            PublishError: they were not taken, or replies are not theirs.
        """
        ...

    async def watch(self) -> None:
        """Look after the server as long as the training runs; never returns.

        Raises:
            TrainingError: it is gone for good, or its replies cannot be trusted any more.
        """
        ...

    async def __aenter__(self) -> Self: ...

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class LocalServing:
    """The model in this process.

    Args:
        config: which model, and how it is sampled.
        profile: of its family.
    """

    def __init__(self, config: LocalConfig, profile: Profile | None = None) -> None:
        self._local = LocalPolicy(config, profile)
        self.policy: Policy = KeptOpen(self._local)

    async def publish(self, weights: Path, version: str) -> None:
        """See :class:`Serving`."""
        test = read_selftest(weights)
        is_other = test is not None and self._local.weight_version != version
        earlier = await self._local.ask(*test.request(), GREEDY) if test and is_other else None
        try:
            await self._local.publish(weights, version)
        except ConfigError as error:
            raise PublishError(error.message, hint=error.hint) from error
        if test is None:
            return
        reply = await self._local.ask(*test.request(), GREEDY)
        if reply.weight_version != version:
            raise PublishError(f"the weights {reply.weight_version} reply where {version} were published")
        check(test, reply, is_exact=self._local.config.dtype == "float32", earlier=earlier)

    async def watch(self) -> None:
        """See :class:`Serving`: there is nothing that could go away."""
        await asyncio.get_running_loop().create_future()

    async def __aenter__(self) -> Self:
        await self._local.__aenter__()
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._local.__aexit__(*exc)


class KeptOpen(BasePolicy):
    """A policy that many runs enter and leave, and that somebody else opens and closes.

    Args:
        policy: the policy itself.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def name(self) -> str:
        """Of the policy."""
        return self._policy.name

    @property
    def wants_elements(self) -> bool:
        """Whether the policy reads elements."""
        return self._policy.wants_elements

    def begin(self, task: Task, seed: int) -> PolicySession:
        """A player of the policy."""
        return self._policy.begin(task, seed)
