"""Any model behind any endpoint that speaks the OpenAI chat API."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Final, Self

from webgym.agent.images import media_type
from webgym.agent.policy import Turn
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
from webgym.core.trajectory import ImageRef, Message, Reply, TextPart
from webgym.llm.client import ChatClient
from webgym.llm.config import ChatConfig, Sampling

PAPER_SAMPLING: Final = Sampling(temperature=1.0, top_p=0.99, max_tokens=3072, extra_body={"top_k": 2})
"""How the paper samples in training (appendix F). ``top_k`` is known to vLLM and SGLang, not to all."""

DEFAULT_SAMPLING: Final = Sampling(temperature=1.0, top_p=0.99, max_tokens=3072)
"""The paper's sampling as far as every endpoint understands it."""


class OpenAIPolicy:
    """A model that knows nothing but the request; it plays every attempt the same way.

    Args:
        config: endpoint, model, sampling and limits. A config that names no sampling gets
            :data:`DEFAULT_SAMPLING`.
    """

    wants_elements = False

    def __init__(self, config: ChatConfig) -> None:
        self._sampling = DEFAULT_SAMPLING if config.sampling == Sampling() else config.sampling
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
        messages = [to_openai(message, turn.images) for message in turn.messages]
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


def to_openai(message: Message, images: Mapping[str, bytes]) -> dict[str, Any]:
    """A message in the shape of the OpenAI chat API, its pictures as ``data:`` URLs.

    A message of text alone has a plain string as its content, which every chat template understands.
    """
    if all(isinstance(part, TextPart) for part in message.content):
        text = "".join(part.text for part in message.content if isinstance(part, TextPart))
        return {"role": message.role, "content": text}
    return {"role": message.role, "content": [_part(part, images) for part in message.content]}


def _part(part: TextPart | ImageRef, images: Mapping[str, bytes]) -> dict[str, Any]:
    if isinstance(part, TextPart):
        return {"type": "text", "text": part.text}
    data = images[part.screenshot]
    url = f"data:{media_type(data)};base64,{base64.b64encode(data).decode()}"
    return {"type": "image_url", "image_url": {"url": url}}


def as_policy_error(error: LLMError) -> PolicyError:
    """What a failure of a model's endpoint means when the model is the policy."""
    if isinstance(error, LLMUnreachable):
        return PolicyUnreachable(error.message, hint=error.hint)
    if isinstance(error, LLMTimeout):
        return PolicyTimeout(error.message, hint=error.hint)
    return PolicyBadReply(error.message, hint=error.hint)
