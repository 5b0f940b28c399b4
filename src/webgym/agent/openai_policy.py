"""Any model behind any endpoint that speaks the OpenAI chat API."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from webgym.agent.policy import Turn
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile
from webgym.agent.request import to_openai
from webgym.core.errors import (
    LLMError,
    LLMTimeout,
    LLMUnreachable,
    PolicyBadReply,
    PolicyError,
    PolicyTimeout,
    PolicyUnreachable,
)
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.llm.client import ChatClient
from webgym.llm.config import ChatConfig


class OpenAIPolicy:
    """A model that knows nothing but the request; it plays every attempt the same way.

    Args:
        config: endpoint, model, sampling and limits. Its sampling is laid over the profile's.
        profile: of the model's family; by default the one that the model's name leads to.
    """

    wants_elements = False

    def __init__(self, config: ChatConfig, profile: Profile | None = None) -> None:
        profile = profile or choose_profile(None, config.model)
        self._sampling = profile.sampling_of(config.sampling)
        self._client = ChatClient(config)

    @property
    def name(self) -> str:
        """The model's name."""
        return self._client.config.model

    def begin(self, task: Task, seed: int) -> OpenAIPolicy:  # noqa: ARG002
        """Itself: nothing is kept from turn to turn, and an endpoint draws its own random numbers."""
        return self

    async def reply(self, turn: Turn) -> Reply:
        """The model's reply.

        Raises:
            PolicyUnreachable: nothing answers at the endpoint.
            PolicyTimeout: no complete reply came in time.
            PolicyBadReply: what came is no completion.
        """
        messages = to_openai(turn.messages, turn.images)
        try:
            completion = await self._client.complete(messages, self._sampling)
        except LLMError as error:
            raise as_policy_error(error) from error
        return Reply(
            completion.text,
            policy=completion.model,
            finish_reason=completion.finish_reason,
            sampling=self._sampling.body(),
            prompt_tokens=completion.prompt_tokens,
            completion_tokens=completion.completion_tokens,
            seconds=completion.seconds,
            reasoning=completion.reasoning,
        )

    async def __aenter__(self) -> Self:
        await self._client.__aenter__()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self._client.__aexit__(kind, error, trace)


def as_policy_error(error: LLMError) -> PolicyError:
    """What a failure of a model's endpoint means when the model is the policy."""
    if isinstance(error, LLMUnreachable):
        return PolicyUnreachable(error.message, hint=error.hint)
    if isinstance(error, LLMTimeout):
        return PolicyTimeout(error.message, hint=error.hint)
    return PolicyBadReply(error.message, hint=error.hint)
