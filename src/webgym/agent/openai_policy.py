"""A policy that is a model behind an endpoint with the OpenAI chat API, and the requests that it sends.

A step stores its messages, with pictures by name and size, and the sampling parameters that were sent. With
the stored screenshots that is the complete request: training rebuilds exactly the same bytes and tokens.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

import msgspec
from pydantic import SecretStr

from webgym.agent.image_codec import fit, media_type
from webgym.agent.policy import BasePolicy, PolicyInput
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile
from webgym.core.errors import (
    LLMError,
    LLMTimeout,
    LLMUnreachable,
    PolicyBadReply,
    PolicyError,
    PolicyTimeout,
    PolicyUnreachable,
)
from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import ImageRef, Message, Reply, Step, TextPart
from webgym.llm.client import ChatClient
from webgym.llm.config import ChatConfig, Sampling, altering


class OpenAIPolicy(BasePolicy):
    """A model behind an endpoint. It has no state between turns: the request contains everything.

    Args:
        config: endpoint, model, sampling and limits. Its sampling overrides the profile's.
        profile: profile of the model family; by default chosen by the model's name.
        api_key: used instead of the environment variable that the config names.
        processed_logprobs: whether the endpoint's log-probabilities are those of the distribution that was
            sampled from (vLLM: ``--logprobs-mode processed_logprobs``). Otherwise they are kept only if the
            sampling parameters do not alter the model's distribution.
    """

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
        """Why requests are delayed at this moment; empty if they are not."""
        return self._client.problem

    @property
    def interruptions(self) -> int:
        """Number of tries so far after which the endpoint may be another process."""
        return self._client.interruptions

    def expect(self, model: str) -> None:
        """Expect replies of this model, as if the endpoint had named it in an earlier one."""
        self._client.served = model

    async def reply(self, turn: PolicyInput) -> Reply:
        """The model's reply.

        Raises:
            PolicyUnreachable: nothing answers at the endpoint.
            PolicyTimeout: no complete reply came in time.
            PolicyBadReply: the endpoint's answer is not a completion.
        """
        return await self.ask(turn.messages, turn.images, turn.sampling)

    async def ask(
        self, messages: Sequence[Message], images: Mapping[str, bytes], sampling: Sampling | None = None
    ) -> Reply:
        """The model's reply to any request.

        Args:
            messages: the messages of the request.
            images: its pictures by name, encoded.
            sampling: overrides the policy's parameters.

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
            tokens=self._with_valid_logprobs(completion.tokens, body),
            weight_version=", ".join(dict.fromkeys(completion.weight_versions)),
            separated=completion.separated,
        )

    def _with_valid_logprobs(
        self, tokens: ReplyTokens | None, sampling: Mapping[str, object]
    ) -> ReplyTokens | None:
        """The tokens, without log-probabilities unless they are those of the distribution sampled from.

        At temperature 0, every endpoint gives the log-probabilities of the unaltered model.
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
    """The policy error for an error of a model's endpoint."""
    if isinstance(error, LLMUnreachable):
        return PolicyUnreachable(error.message, hint=error.hint)
    if isinstance(error, LLMTimeout):
        return PolicyTimeout(error.message, hint=error.hint)
    return PolicyBadReply(error.message, hint=error.hint)


def to_openai(messages: Sequence[Message], images: Mapping[str, bytes]) -> list[dict[str, Any]]:
    """Messages in the form of the OpenAI chat API, with pictures as ``data:`` URLs.

    The content of a message without pictures is a plain string, which every chat template supports.

    Args:
        messages: the messages of a request.
        images: its pictures by name, encoded, at the size at which they are sent.
    """
    return [{"role": message.role, "content": _content(message, images)} for message in messages]


def request_of(step: Step, model: str, picture: Callable[[str], bytes]) -> dict[str, Any]:
    """The body of the request that a stored step is the reply to, with its fields in the order sent.

    Args:
        step: a step from the run store.
        model: name of the model in the request (``Episode.policy``).
        picture: returns a stored screenshot by its name, e.g. ``RunReader(run).image``.

    Raises:
        ProtocolError: a stored screenshot cannot be read as a picture.
    """
    parts = (part for message in step.messages for part in message.content)
    sizes = {part.screenshot: (part.width, part.height) for part in parts if isinstance(part, ImageRef)}
    images = {name: fit(picture(name), size) for name, size in sizes.items()}
    body = {"model": model, "messages": to_openai(step.messages, images), "stream": False}
    return dict(sorted((body | step.reply.sampling).items()))


def _content(message: Message, images: Mapping[str, bytes]) -> str | list[dict[str, Any]]:
    if all(isinstance(part, TextPart) for part in message.content):
        return "".join(part.text for part in message.content if isinstance(part, TextPart))
    return [_part(part, images) for part in message.content]


def _part(part: TextPart | ImageRef, images: Mapping[str, bytes]) -> dict[str, Any]:
    if isinstance(part, TextPart):
        return {"type": "text", "text": part.text}
    data = images[part.screenshot]
    url = f"data:{media_type(data)};base64,{base64.b64encode(data).decode()}"
    return {"type": "image_url", "image_url": {"url": url} | ({"detail": part.detail} if part.detail else {})}
