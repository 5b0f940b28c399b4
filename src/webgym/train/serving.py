"""Who replies while a policy learns: something that takes new weights between two replies."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from webgym.agent.policy import Player, Policy
from webgym.agent.profile import Profile
from webgym.core.task import Task
from webgym.inference.local import LocalConfig, LocalPolicy


class Serving(Protocol):
    """A policy that can be given other weights. Entered once for a whole training run."""

    @property
    def policy(self) -> Policy:
        """What collects. Entering and leaving it does nothing: that is the serving's own matter."""
        ...

    async def publish(self, weights: Path, version: str) -> None:
        """Reply with these weights from now on, and be sure of it.

        Atomic: no reply comes from half-loaded weights.

        Args:
            weights: a folder that an update wrote.
            version: what replies will say.

        Raises:
            PublishError: they were not taken, or replies are not theirs.
        """
        ...

    async def __aenter__(self) -> Self: ...

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
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
        await self._local.publish(weights, version)

    async def __aenter__(self) -> Self:
        await self._local.__aenter__()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self._local.__aexit__(kind, error, trace)


class KeptOpen:
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

    def begin(self, task: Task, seed: int) -> Player:
        """A player of the policy."""
        return self._policy.begin(task, seed)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        return None
