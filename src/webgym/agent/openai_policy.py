"""Any model behind any endpoint that speaks the OpenAI chat API."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self

import msgspec
from pydantic import SecretStr

from webgym.agent.policy import PolicyInput
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
from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import Message, Reply
from webgym.llm.client import ChatClient
from webgym.llm.config import ChatConfig, Sampling, altering


class OpenAIPolicy:
    """A model that knows nothing but the request; it plays every attempt the same way.

    Args:
        config: endpoint, model, sampling and limits. Its sampling is laid over the profile's.
        profile: of the model's family; by default the one that the model's name leads to.
        api_key: used in place of the environment variable that the config names.
        processed_logprobs: whether log-probabilities that the endpoint gives are of the distribution that
            was sampled from (vLLM: ``--logprobs-mode processed_logprobs``). They are else kept only where
            sampling leaves the model's distribution as it is.
    """

    wants_elements = False

    def __init__(
        self,
        config: ChatConfig,
        profile: Profile | None = None,
        *,
        api_key: SecretStr | None = None,
        processed_logprobs: bool = False,
    ) -> None:
        profile = profile or choose_profile(None, config.model)
        self._sampling = profile.sampling_of(config.sampling)
        self._client = ChatClient(config, api_key=api_key)
        self._processed_logprobs = processed_logprobs

    @property
    def name(self) -> str:
        """The model's name."""
        return self._client.config.model

    @property
    def problem(self) -> str:
        """What holds its requests up at this moment; empty for nothing."""
        return self._client.problem

    def begin(self, task: Task, seed: int) -> OpenAIPolicy:  # noqa: ARG002
        """Itself: nothing is kept from turn to turn, and an endpoint draws its own random numbers."""
        return self

    async def reply(self, turn: PolicyInput) -> Reply:
        """The model's reply.

        Raises:
            PolicyUnreachable: nothing answers at the endpoint.
            PolicyTimeout: no complete reply came in time.
            PolicyBadReply: what came is no completion.
        """
        return await self.ask(turn.messages, turn.images)

    async def ask(
        self, messages: Sequence[Message], images: Mapping[str, bytes], sampling: Sampling | None = None
    ) -> Reply:
        """The model's reply to a request of one's own.

        Args:
            messages: of the request.
            images: its pictures by name, encoded.
            sampling: laid over the policy's.

        Raises:
            PolicyError: as :meth:`reply`.
        """
        used = sampling.over(self._sampling) if sampling else self._sampling
        try:
            completion = await self._client.complete(to_openai(messages, images), used)
        except LLMError as error:
            raise as_policy_error(error) from error
        body = used.body()
        return Reply(
            completion.text,
            policy=completion.model,
            finish_reason=completion.finish_reason,
            sampling=body,
            prompt_tokens=completion.prompt_tokens,
            completion_tokens=completion.completion_tokens,
            seconds=completion.seconds,
            reasoning=completion.reasoning,
            tokens=self._own_tokens(completion.tokens, body),
            weight_version=", ".join(dict.fromkeys(completion.weight_versions)),
        )

    def _own_tokens(self, tokens: ReplyTokens | None, sampling: Mapping[str, object]) -> ReplyTokens | None:
        """Tokens without log-probabilities of another distribution than was sampled from.

        The likeliest tokens, at temperature 0, have the model's own with every endpoint.
        """
        is_plain = not altering(sampling) and sampling.get("temperature") in (0, 1)
        if tokens is None or is_plain or self._processed_logprobs:
            return tokens
        return msgspec.structs.replace(tokens, logprobs=None)

    async def __aenter__(self) -> Self:
        await self._client.__aenter__()
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._client.__aexit__(*exc)


def as_policy_error(error: LLMError) -> PolicyError:
    """What a failure of a model's endpoint means when the model is the policy."""
    if isinstance(error, LLMUnreachable):
        return PolicyUnreachable(error.message, hint=error.hint)
    if isinstance(error, LLMTimeout):
        return PolicyTimeout(error.message, hint=error.hint)
    return PolicyBadReply(error.message, hint=error.hint)
