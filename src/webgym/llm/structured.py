"""Structured replies: queries a model for a value of a type until the reply is valid."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import cache
from typing import Any, Final, TypeAlias, TypeVar

import msgspec

from webgym.core.errors import LLMUnusable
from webgym.core.text import THOUGHT, THOUGHT_END
from webgym.core.trajectory import ended_by, was_cut_off
from webgym.llm.client import EndpointRefused
from webgym.llm.completion import Completes, Completion, first_line
from webgym.llm.config import Sampling
from webgym.llm.request import FORMATS, Format, Formats

T = TypeVar("T")
Message = Mapping[str, Any]
Check: TypeAlias = Callable[[T], str | Awaitable[str | None] | None]
"""Returns, or awaits, the reason why a value is rejected, for the model; ``None`` if it is accepted."""

_UNSUPPORTED_STATUSES: Final = frozenset({400, 415, 422, 501})
"""HTTP statuses with which endpoints refuse an unsupported ``response_format``."""

_SHOWN_CHARS: Final = 4000
"""Most characters of a rejected reply that are sent back to the model; more would cost without helping."""


async def ask_for(
    model: Completes,
    messages: Sequence[Message],
    type: type[T],
    *,
    check: Check[T] | None = None,
    tries: int = 3,
    sampling: Sampling | None = None,
) -> T:
    """Query a model for a value of a type.

    The endpoint enforces the type's JSON schema if it can (``response_format``), or valid JSON if it can
    only do that; otherwise nothing is enforced. In the latter cases the schema is appended to the last
    message. The reply is always decoded strictly. A rejected reply is sent back to the model with the
    reason, and the model is queried again.

    Args:
        model: the model's client.
        messages: the question, in the format of the OpenAI chat API; the last message is the user's.
        type: the type to decode into: an msgspec Struct, or another type that msgspec can decode from JSON.
        check: further validation: returns the reason why a value is rejected, for the model, or ``None``.
        tries: most queries.
        sampling: used instead of the client's own parameters.

    Raises:
        LLMUnusable: no reply was accepted; it contains all replies, and the last reason.
        LLMError: a request failed.
    """
    query = _TypedQuery(model, type, sampling)
    return await _ask_until(query.send, messages, lambda reply: read_value(reply, type), check, tries)


async def ask_for_text(
    model: Completes, messages: Sequence[Message], *, check: Check[str], tries: int = 3
) -> str:
    """As :func:`ask_for`, for plain text."""
    return await _ask_until(model.complete, messages, read_text, check, tries)


async def _ask_until(
    send: Callable[[Sequence[Message]], Awaitable[Completion]],
    messages: Sequence[Message],
    read: Callable[[Completion], T],
    check: Check[T] | None,
    tries: int,
) -> T:
    conversation = list(messages)
    replies: list[str] = []
    reason = ""
    for _ in range(tries):
        completion = await send(conversation)
        replies.append(completion.text or completion.refusal)
        try:
            value = read(completion)
            rejection = check(value) if check is not None else None
            reason = (await rejection if isinstance(rejection, Awaitable) else rejection) or ""
        except Refused as error:
            reason = str(error)
        else:
            if not reason:
                return value
        conversation += [
            {"role": "assistant", "content": _shown(replies[-1])},
            {"role": "user", "content": f"This reply cannot be used: {reason}\nAnswer again, in full."},
        ]
    times = "once" if tries == 1 else f"{tries} times"
    raise LLMUnusable(
        f"the model was asked {times} and gave no usable reply: {first_line(reason)}",
        hint="another model, or a larger max_tokens, may do better",
        reason=reason,
        replies=tuple(replies),
    )


class Refused(Exception):
    """A reply is rejected; the message is for the model. Handled inside of this package."""


def read_value(completion: Completion, type: type[T]) -> T:
    """Decode the value in a reply.

    Thinking before it and a code fence around it are removed; any other text makes it invalid.

    Raises:
        Refused: the reply does not contain a valid value.
    """
    text = _without_fence(read_text(completion))
    if not text:
        raise Refused("it is empty.")
    try:
        return msgspec.json.decode(text, type=type)
    except msgspec.ValidationError as error:
        raise Refused(f"it is JSON, but not as asked for: {error}.") from error
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError) as error:
        raise Refused(f"it is not valid JSON: {first_line(str(error))}.") from error


def read_text(completion: Completion) -> str:
    """The text of a reply without the thinking before it.

    Raises:
        Refused: the model refused, or the reply is cut off, empty or all thinking.
    """
    if completion.refusal or ended_by(completion.finish_reason) == "filter":
        raise Refused("it is a refusal, not what was asked for.")
    if was_cut_off(completion.finish_reason):
        raise Refused("it was cut off before its end. Be briefer.")
    text = THOUGHT_END.split(completion.text)[-1].strip()  # the chat template may have begun the thinking
    if THOUGHT.match(text):
        raise Refused("it is all thinking, and no answer.")
    if not text:
        raise Refused("it is empty.")
    return text


def _without_fence(text: str) -> str:
    if text.startswith("```") and text.endswith("```") and "\n" in text:
        text = text[text.index("\n") : -3]
    return text.strip()


def _shown(reply: str) -> str:
    """A rejected reply as it is sent back to the model: shortened, and never empty, which endpoints
    refuse."""
    return reply if 0 < len(reply) <= _SHOWN_CHARS else f"{reply[:_SHOWN_CHARS]} …"


class _TypedQuery:
    """Sends requests with a type's schema, in the strictest format that the endpoint accepts."""

    def __init__(self, model: Completes, type: Any, sampling: Sampling | None) -> None:
        self._model = model
        self._formats: Formats = getattr(model, "formats", None) or Formats()
        self._sampling: Sampling = sampling or getattr(model, "sampling", None) or Sampling()
        self._name = "".join(filter(str.isalnum, getattr(type, "__name__", ""))) or "reply"
        self._schema = strict_schema(type)

    async def send(self, messages: Sequence[Message]) -> Completion:
        first: EndpointRefused | None = None
        for response_format in FORMATS[FORMATS.index(await self._formats.known()) :]:
            try:
                completion = await self._send_in(response_format, messages)
            except EndpointRefused as error:
                if error.status not in _UNSUPPORTED_STATUSES:
                    raise
                first = first or error
            else:
                if first is not None:  # then it refused because of the format
                    await self._formats.learn(response_format)
                return completion
        assert first is not None, "there is at least one format"
        raise first

    async def _send_in(self, response_format: Format, messages: Sequence[Message]) -> Completion:
        extra = dict(self._sampling.extra_body)
        if response_format == "json_schema":
            schema = {"name": self._name, "schema": self._schema, "strict": True}
            extra["response_format"] = {"type": response_format, "json_schema": schema}
        else:
            messages = _with_schema(messages, self._schema)
            if response_format == "json_object":
                extra["response_format"] = {"type": response_format}
        return await self._model.complete(messages, self._sampling.model_copy(update={"extra_body": extra}))


def _with_schema(messages: Sequence[Message], schema: Mapping[str, Any]) -> list[Message]:
    """The messages, with the schema appended to the last one: an additional message would break some chat
    templates."""
    suffix = f"\n\nAnswer with JSON alone, by this schema:\n{msgspec.json.encode(schema).decode()}"
    *others, last = messages
    content = last["content"]
    if isinstance(content, str):
        return [*others, {**last, "content": content + suffix}]
    return [*others, {**last, "content": [*content, {"type": "text", "text": suffix}]}]


@cache
def strict_schema(type: Any) -> dict[str, Any]:
    """A type's JSON schema in the form that endpoints require to enforce it.

    The root is not a reference, every object is closed, and all its properties are required, in the type's
    order.
    Cached per type: the result must not be modified.
    """
    schema = msgspec.json.schema(type)
    definitions = schema.pop("$defs", {})
    root = schema
    if (reference := schema.get("$ref", "")).startswith("#/$defs/"):
        name = reference.removeprefix("#/$defs/")
        root = definitions[name]
        if not _refers_to(definitions, reference):
            del definitions[name]
    if definitions:
        root = {**root, "$defs": definitions}
    closed: dict[str, Any] = _closed(root)
    return closed


def _refers_to(schema: Any, reference: str) -> bool:
    if isinstance(schema, dict):
        return schema.get("$ref") == reference or any(_refers_to(it, reference) for it in schema.values())
    return isinstance(schema, list) and any(_refers_to(item, reference) for item in schema)


def _closed(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_closed(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    closed = {key: _closed(value) for key, value in schema.items() if key != "default"}
    if isinstance(properties := closed.get("properties"), dict) and closed.get("type") == "object":
        closed |= {"additionalProperties": False, "required": list(properties)}
    return closed
