"""Completions, and their parsing from an endpoint's response."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol

import msgspec

from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import ended_by, was_cut_off
from webgym.llm.config import Sampling

_QUOTED_CHARS: Final = 200
"""Most characters of an invalid reply that an error quotes."""


class Completion(msgspec.Struct, frozen=True):
    """A reply.

    Attributes:
        text: the model's text; may be empty. Tool calls that the endpoint has parsed are appended as
            ``<tool_call>`` blocks, as models write them.
        finish_reason: as the endpoint gave it; empty if it gave none.
        prompt_tokens, completion_tokens: as the endpoint counted them; 0 if it did not.
        seconds: wall time of the successful try, from request to last byte; 0 from a batch.
        model: as the endpoint named it, else as requested.
        prompt_tokens_cached: how many of the prompt's tokens were in the endpoint's own cache.
        refusal: the model's refusal, if the endpoint reports it separately from the text.
        cached: whether it was paid for before: it comes from the cache, or is the reply to an identical
            request that was in flight.
        reasoning: thinking, if the endpoint reports it separately from the text.
        separated: whether it does, even if there was no thinking.
        tokens: the tokens read and sampled; ``None`` if the endpoint does not return them (vLLM:
            ``return_token_ids``, and ``logprobs``, whose meaning depends on its ``--logprobs-mode``).
        weight_versions: version labels of the weights that sampled the reply, in order; empty if the endpoint
            does not return them.
    """

    text: str
    finish_reason: str
    prompt_tokens: int
    completion_tokens: int
    seconds: float
    model: str
    prompt_tokens_cached: int = 0
    refusal: str = ""
    cached: bool = False
    reasoning: str = ""
    tokens: ReplyTokens | None = None
    weight_versions: tuple[str, ...] = ()
    separated: bool = False

    @property
    def was_not_generated(self) -> bool:
        """Whether it holds nothing, and nothing shows that a model chose to say nothing.

        A model's own empty reply has a reason for its end and, as its end is a token, tokens; one that was
        cut off has some, too.
        """
        if self.text or self.reasoning or self.refusal or ended_by(self.finish_reason) != "model":
            return False
        has_tokens = self.completion_tokens or self.tokens or was_cut_off(self.finish_reason)
        return not (self.finish_reason and has_tokens)


class Completes(Protocol):
    """Anything that answers messages: a client, a collector of batches, a test double."""

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Completion:
        """One reply to these messages, in the format of the OpenAI chat API.

        Raises:
            LLMError: the request failed.
        """
        ...


class NoCompletion(Exception):
    """The reply is not a completion. Callers in this package turn it into an error that names the
    endpoint."""


def read_completion(data: bytes, *, model: str, seconds: float, cached: bool = False) -> Completion:
    """Parse a completion.

    Args:
        data: body of the endpoint's response.
        model: the requested model.
        seconds: wall time of the request.
        cached: whether it was paid for before.

    Raises:
        NoCompletion: the body is not a completion; the message describes it.
    """
    if not data.strip():
        raise NoCompletion("an empty reply")
    try:
        body = msgspec.json.decode(data, type=_Body)
    except (ValueError, RecursionError) as error:  # ValueError: also bytes that are not UTF-8
        is_page = data.lstrip()[:1] == b"<"
        what = "a web page" if is_page else f"something that is not a completion ({first_line(str(error))})"
        raise NoCompletion(f"{what}: {quote(data)}") from error
    if not body.choices:
        raise NoCompletion(f"a reply without choices: {error_message(data) or quote(data)}")
    choice, message = body.choices[0], body.choices[0].message
    prompt_tokens, completion_tokens, cached_tokens = _usage(body.usage)
    stated, fields = message.refusal, (message.reasoning, message.reasoning_content)
    reasoning = [field for field in fields if isinstance(field, str)]
    return Completion(
        text=_text(message),
        finish_reason=choice.finish_reason or "",
        prompt_tokens=prompt_tokens,
        completion_tokens=completion_tokens,
        seconds=seconds,
        model=body.model or model,
        prompt_tokens_cached=cached_tokens,
        refusal=stated if isinstance(stated, str) else _of_parts(message.content, "refusal"),
        cached=cached,
        reasoning=next(filter(None, reasoning), ""),
        tokens=_tokens(body.prompt_token_ids, choice),
        weight_versions=_versions(choice.weight_versions) or _version(body.metadata),
        separated=bool(reasoning),
    )


def read_unusable(data: bytes, *, model: str) -> Completion | None:
    """What can be known of a body that :func:`read_completion` refuses, for its cost: a completion without a
    text. ``None`` if it holds no choices in JSON, so that nothing was generated."""
    try:
        body = json.loads(data)
    except (ValueError, RecursionError):
        return None
    if not isinstance(body, dict) or not body.get("choices"):
        return None
    prompt_tokens, completion_tokens, cached_tokens = _usage(body.get("usage"))
    return Completion("", "", prompt_tokens, completion_tokens, 0.0, model, cached_tokens)


class _Message(msgspec.Struct):
    content: str | list[Any] | None = None
    tool_calls: Any = None
    refusal: Any = None
    reasoning: Any = None  # OpenRouter, and vLLM of late
    reasoning_content: Any = None  # vLLM, SGLang


class _Function(msgspec.Struct):
    name: str
    arguments: Any = None  # JSON as a string, as in the API; some endpoints send an object


class _ToolCall(msgspec.Struct):
    function: _Function


def _text(message: _Message) -> str:
    calls = message.tool_calls or []
    blocks = [_block(call) for call in (calls if isinstance(calls, list) else [calls])]
    content = message.content
    text = content if isinstance(content, str) else _of_parts(content, "text")
    return "\n".join([text, *blocks] if text else blocks)


def _of_parts(content: Any, kind: str) -> str:
    """What the parts of a content say in the field ``kind``, such as ``text``, joined; parts of thinking and
    of other kinds have no such field."""
    parts = content if isinstance(content, list) else []
    said = (part.get(kind) for part in parts if isinstance(part, dict))
    return "".join(text for text in said if isinstance(text, str))


def _block(call: Any) -> str:
    """A tool call as a ``<tool_call>`` block. Invalid JSON in the arguments is kept, for the parser to
    report, and so is a call of another form."""
    try:
        function = msgspec.convert(call, _ToolCall).function
    except msgspec.ValidationError:
        return f"<tool_call>\n{msgspec.json.encode(call).decode()}\n</tool_call>"
    raw = function.arguments
    arguments = raw if isinstance(raw, str) else msgspec.json.encode(raw).decode()
    name = msgspec.json.encode(function.name).decode()
    return f'<tool_call>\n{{"name": {name}, "arguments": {arguments or "{}"}}}\n</tool_call>'


class _Choice(msgspec.Struct):
    message: _Message
    finish_reason: str | None = None
    token_ids: Any = None  # vLLM
    prompt_token_ids: Any = None  # SGLang
    response_token_ids: Any = None  # SGLang
    logprobs: Any = None
    weight_versions: Any = None  # vLLM of late


class _Body(msgspec.Struct):
    choices: list[_Choice] = []
    model: str | None = None
    usage: Any = None
    prompt_token_ids: Any = None  # vLLM
    metadata: Any = None  # SGLang


class _LogProb(msgspec.Struct):
    logprob: float


class _LogProbs(msgspec.Struct):
    content: list[_LogProb] = []


class _Span(msgspec.Struct):
    version: str


# Other endpoints may use these fields differently, so values of another form count as missing.


def _tokens(prompt: Any, choice: _Choice) -> ReplyTokens | None:
    try:
        prompt_ids, reply_ids = (
            msgspec.convert(ids, list[int])
            for ids in (prompt or choice.prompt_token_ids, choice.token_ids or choice.response_token_ids)
        )
        logprobs = _logprobs(choice.logprobs)
        return ReplyTokens.of(prompt_ids, reply_ids, logprobs if len(logprobs) == len(reply_ids) else None)
    except (msgspec.ValidationError, OverflowError):
        return None


def _logprobs(value: Any) -> list[float]:
    try:
        return [item.logprob for item in msgspec.convert(value, _LogProbs).content]
    except msgspec.ValidationError:
        return []


def _versions(value: Any) -> tuple[str, ...]:
    try:
        return tuple(span.version for span in msgspec.convert(value, list[_Span]))
    except msgspec.ValidationError:
        return ()


def _version(metadata: Any) -> tuple[str, ...]:
    """The label of the weights as SGLang gives it."""
    version = metadata.get("weight_version") if isinstance(metadata, dict) else None
    return (version,) if isinstance(version, str) else ()


def _usage(usage: Any) -> tuple[int, int, int]:
    """Tokens of the prompt, of the reply, and those of the prompt that the endpoint's own cache held."""
    usage = usage if isinstance(usage, dict) else {}
    details = usage.get("prompt_tokens_details")
    prompt = _count(usage.get("prompt_tokens"))
    cached = _count(details.get("cached_tokens")) if isinstance(details, dict) else 0
    return prompt, _count(usage.get("completion_tokens")), min(cached, prompt)


def _count(value: Any) -> int:
    return value if isinstance(value, int) and not isinstance(value, bool) and value > 0 else 0


# --- parts of error messages --------------------------------------------------------------------------


def error_object(data: bytes) -> dict[str, Any]:
    """The content of the endpoint's error object, ``{"error": {...}}``; empty if it sent none."""
    try:
        body = msgspec.json.decode(data)
    except (ValueError, RecursionError):
        return {}
    error = body.get("error") if isinstance(body, dict) else None
    if isinstance(error, dict):
        return error
    return {"message": error} if isinstance(error, str) else {}


def error_message(data: bytes) -> str:
    """The message in the endpoint's error object; empty if it sent none."""
    message = error_object(data).get("message")
    return first_line(message) if isinstance(message, str) else ""


def quote(data: bytes) -> str:
    """The beginning of a reply on one line, for error messages."""
    return _cut(" ".join(data[: 4 * _QUOTED_CHARS].decode(errors="replace").split()))


def first_line(text: str) -> str:
    """The first line of a message, shortened if necessary."""
    return _cut(" ".join(text.split("\n", 1)[0].split()))


def _cut(text: str) -> str:
    return text if len(text) <= _QUOTED_CHARS else text[: _QUOTED_CHARS - 1] + "…"


def size(count: int) -> str:
    """A number of bytes as text."""
    return f"{count / 1024:.0f} KiB" if count >= 1024 else f"{count} bytes"
