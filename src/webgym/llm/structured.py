"""Asking a model for a value of a type, and taking nothing less."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, Final, TypeVar

import msgspec

from webgym.core.errors import LLMUnusable
from webgym.llm.client import EndpointRefused
from webgym.llm.completion import Completes, Completion, first_line
from webgym.llm.config import Sampling
from webgym.llm.formats import FORMATS, Format, Formats
from webgym.llm.labelled import EndpointClient

T = TypeVar("T")
Message = Mapping[str, Any]

_NOT_UNDERSTOOD: Final = frozenset({400, 415, 422, 501})
"""How endpoints refuse a ``response_format`` that they do not know."""

_SHOWN_CHARS: Final = 4000
"""How much of a refused reply the model is shown again; more would be paid for and help nobody."""


async def ask_for(
    model: Completes,
    messages: Sequence[Message],
    type: type[T],
    *,
    check: Callable[[T], str | None] | None = None,
    tries: int = 3,
    sampling: Sampling | None = None,
) -> T:
    """A value of this type, from a model.

    The model is held to the type's JSON schema where its endpoint can do that (``response_format``), to JSON
    where it can do only that, and to its word otherwise; in the latter cases the schema stands at the end of
    the last message. What it says is decoded strictly, whatever the endpoint promised. A reply that is
    refused is shown to the model with the reason, and it is asked again.

    Args:
        model: whom to ask.
        messages: the question, in the shape of the OpenAI chat API; the last one is the user's.
        type: what to decode into, as msgspec understands it: a Struct, or a type that JSON can hold.
        check: what else must hold: gives the reason why a value is refused, in words for the model, or
            ``None``.
        tries: how often to ask in all.
        sampling: in place of the model's own.

    Raises:
        LLMUnusable: no reply was accepted; it holds them all, and the last reason.
        LLMError: the model gave no reply.
    """
    asker = _Asker(model, type, sampling)
    asked = list(messages)
    replies: list[str] = []
    reason = ""
    for _ in range(tries):
        completion = await asker.ask(asked)
        replies.append(completion.text or completion.refusal)
        try:
            value = read_value(completion, type)
            refused = check(value) if check is not None else None
        except Refused as error:
            refused = str(error)
        if not refused:
            return value
        reason = refused
        asked += [
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
    """A reply cannot be used; the message is for the model. Never leaves this package."""


def read_value(completion: Completion, type: type[T]) -> T:
    """The value that a reply holds.

    Thinking before it and a code fence around it are no part of it; anything else is.

    Raises:
        Refused: it holds none.
    """
    if completion.refusal or completion.finish_reason == "content_filter":
        raise Refused("it is a refusal, not the JSON that was asked for.")
    if completion.finish_reason == "length":
        raise Refused("it was cut off before its end. Be briefer.")
    text = _without_fence(_without_thinking(completion.text))
    if not text:
        raise Refused("it is empty.")
    try:
        return msgspec.json.decode(text, type=type)
    except msgspec.ValidationError as error:
        raise Refused(f"it is JSON, but not as asked for: {error}.") from error
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError) as error:
        raise Refused(f"it is not valid JSON: {first_line(str(error))}.") from error


def _without_thinking(text: str) -> str:
    text = text.strip()
    if text.startswith("<think>"):
        _, ended, text = text.partition("</think>")
        if not ended:
            raise Refused("it is all thinking, and no answer.")
    return text.strip()


def _without_fence(text: str) -> str:
    if text.startswith("```") and text.endswith("```") and "\n" in text:
        text = text[text.index("\n") : -3]
    return text.strip()


def _shown(reply: str) -> str:
    """A refused reply as the model sees it again. Some endpoints refuse messages that are empty."""
    return reply if 0 < len(reply) <= _SHOWN_CHARS else f"{reply[:_SHOWN_CHARS]} …"


class _Asker:
    """Asks for a type's schema in the strictest way that the endpoint takes."""

    def __init__(self, model: Completes, type: Any, sampling: Sampling | None) -> None:
        self._model = model
        if isinstance(model, EndpointClient):
            self._formats = model.formats
            self._sampling = sampling or model.sampling
        else:
            self._formats = Formats()
            self._sampling = sampling or Sampling()
        self._name = "".join(filter(str.isalnum, getattr(type, "__name__", ""))) or "reply"
        self._schema = strict_schema(type)

    async def ask(self, messages: Sequence[Message]) -> Completion:
        first: EndpointRefused | None = None
        for form in FORMATS[FORMATS.index(await self._formats.known()) :]:
            try:
                completion = await self._ask_in(form, messages)
            except EndpointRefused as error:
                if error.status not in _NOT_UNDERSTOOD:
                    raise
                first = first or error
            else:
                if first is not None:  # so what it refused before was the form
                    await self._formats.learn(form)
                return completion
        assert first is not None, "there is at least one form to ask in"
        raise first

    async def _ask_in(self, form: Format, messages: Sequence[Message]) -> Completion:
        extra = dict(self._sampling.extra_body)
        if form == "json_schema":
            schema = {"name": self._name, "schema": self._schema, "strict": True}
            extra["response_format"] = {"type": form, "json_schema": schema}
        else:
            messages = _with_schema(messages, self._schema)
            if form == "json_object":
                extra["response_format"] = {"type": form}
        return await self._model.complete(messages, self._sampling.model_copy(update={"extra_body": extra}))


def _with_schema(messages: Sequence[Message], schema: Mapping[str, Any]) -> list[Message]:
    """The messages, with the schema at the end of the last one: a message more would break some templates."""
    told = f"\n\nAnswer with JSON alone, by this schema:\n{msgspec.json.encode(schema).decode()}"
    *others, last = messages
    content = last["content"]
    if isinstance(content, str):
        return [*others, {**last, "content": content + told}]
    return [*others, {**last, "content": [*content, {"type": "text", "text": told}]}]


@cache
def strict_schema(type: Any) -> dict[str, Any]:
    """A type's JSON schema as endpoints want it that hold a model to it.

    The root is spelt out, every object is closed, and all its properties are required, in the type's order.
    Worked out once for a type, and shared by all who ask: it must not be changed.
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
        return schema.get("$ref") == reference or any(_refers_to(each, reference) for each in schema.values())
    return isinstance(schema, list) and any(_refers_to(each, reference) for each in schema)


def _closed(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_closed(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    closed = {key: _closed(value) for key, value in schema.items() if key != "default"}
    if isinstance(properties := closed.get("properties"), dict) and closed.get("type") == "object":
        closed |= {"additionalProperties": False, "required": list(properties)}
    return closed
