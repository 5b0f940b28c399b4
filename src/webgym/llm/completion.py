"""A reply, whoever gives it, and how it is read from what an endpoint sends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol

import msgspec

from webgym.core.tokens import ReplyTokens
from webgym.llm.config import Sampling

_QUOTED_CHARS: Final = 200
"""How much of a bad reply an error quotes."""


class Completion(msgspec.Struct, frozen=True):
    """A reply.

    Attributes:
        text: what the model said; empty if it said nothing before it was stopped. Tool calls that the
            endpoint has parsed stand at its end as ``<tool_call>`` blocks, as models write them.
        finish_reason: as the endpoint gave it; empty if it gave none.
        prompt_tokens, completion_tokens: as the endpoint counted them; 0 if it did not.
        seconds: wall time of the try that succeeded, from request to last byte; 0 from a batch.
        model: as the endpoint named it, else as it was asked for.
        prompt_tokens_cached: how many of the prompt's tokens the endpoint had read before, and sells cheaper.
        refusal: in place of the text, where the endpoint tells a refusal apart.
        cached: whether it was paid for before: it comes from the cache, or answers an identical request
            that was in flight.
        reasoning: thinking, where the endpoint tells it apart from the text.
        tokens: what was read and sampled, where the endpoint gives it (vLLM: ``return_token_ids``, and
            ``logprobs`` for log-probabilities, whose meaning depends on its ``--logprobs-mode``).
        weight_versions: labels of the weights that sampled the reply, in order, where the endpoint says.
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


class Completes(Protocol):
    """Whatever answers messages: a client, one that collects batches, a test's stand-in."""

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Completion:
        """One reply to these messages, in the shape of the OpenAI chat API.

        Raises:
            LLMError: none could be had.
        """
        ...


class NoCompletion(Exception):
    """The reply is not a completion. Never leaves this package: the caller knows whose reply it was."""


def read_completion(data: bytes, *, model: str, seconds: float, cached: bool = False) -> Completion:
    """The completion that these bytes, an endpoint's reply, hold.

    Args:
        data: the body of the reply.
        model: as it was asked for.
        seconds: how long it took.
        cached: whether it was paid for before.

    Raises:
        NoCompletion: they hold none; says what they are.
    """
    if not data.strip():
        raise NoCompletion("an empty reply")
    try:
        found = msgspec.json.decode(data, type=_Body)
    except (msgspec.DecodeError, RecursionError) as error:
        is_page = data.lstrip()[:1] == b"<"
        what = "a web page" if is_page else f"something that is no completion ({first_line(str(error))})"
        raise NoCompletion(f"{what}: {quote(data)}") from error
    if not found.choices:
        raise NoCompletion(f"a reply without choices: {told(data) or quote(data)}")
    choice = found.choices[0]
    usage = found.usage if isinstance(found.usage, dict) else {}
    details = usage.get("prompt_tokens_details")
    prompt_tokens = _count(usage.get("prompt_tokens"))
    known = _count(details.get("cached_tokens")) if isinstance(details, dict) else 0
    return Completion(
        text=_text(choice.message),
        finish_reason=choice.finish_reason or "",
        prompt_tokens=prompt_tokens,
        completion_tokens=_count(usage.get("completion_tokens")),
        seconds=seconds,
        model=found.model or model,
        prompt_tokens_cached=min(known, prompt_tokens),
        refusal=choice.message.refusal if isinstance(choice.message.refusal, str) else "",
        cached=cached,
        reasoning=_thought(choice.message),
        tokens=_tokens(found.prompt_token_ids, choice),
        weight_versions=_versions(choice.weight_versions),
    )


class _Said(msgspec.Struct):
    content: str | None = None
    tool_calls: Any = None
    refusal: Any = None
    reasoning: Any = None  # OpenRouter, and vLLM of late
    reasoning_content: Any = None  # vLLM, SGLang


class _Function(msgspec.Struct):
    name: str
    arguments: Any = None  # a string of JSON, as the API has it; some endpoints send the object


class _ToolCall(msgspec.Struct):
    function: _Function


def _text(said: _Said) -> str:
    try:
        calls = msgspec.convert(said.tool_calls or [], list[_ToolCall])
    except msgspec.ValidationError:
        calls = []
    blocks = [_block(call.function) for call in calls]
    return "\n".join([said.content, *blocks] if said.content else blocks)


def _block(function: _Function) -> str:
    """Arguments that are no JSON stay as they are: it is the reader who says what is wrong with them."""
    given = function.arguments
    arguments = given if isinstance(given, str) else msgspec.json.encode(given).decode()
    name = msgspec.json.encode(function.name).decode()
    return f'<tool_call>\n{{"name": {name}, "arguments": {arguments or "{}"}}}\n</tool_call>'


def _thought(said: _Said) -> str:
    found = (said.reasoning, said.reasoning_content)
    return next((thought for thought in found if isinstance(thought, str)), "")


class _Choice(msgspec.Struct):
    message: _Said
    finish_reason: str | None = None
    token_ids: Any = None  # vLLM
    logprobs: Any = None
    weight_versions: Any = None  # vLLM of late


class _Body(msgspec.Struct):
    choices: list[_Choice] = []
    model: str | None = None
    usage: Any = None
    prompt_token_ids: Any = None  # vLLM


class _LogProb(msgspec.Struct):
    logprob: float


class _LogProbs(msgspec.Struct):
    content: list[_LogProb] = []


class _Span(msgspec.Struct):
    version: str


# What other endpoints make of these fields is not known, so what does not fit counts as absent.


def _tokens(prompt: Any, choice: _Choice) -> ReplyTokens | None:
    try:
        prompt_ids, reply_ids = (msgspec.convert(ids, list[int]) for ids in (prompt, choice.token_ids))
        logprobs = _logprobs(choice.logprobs)
        return ReplyTokens.of(prompt_ids, reply_ids, logprobs if len(logprobs) == len(reply_ids) else None)
    except (msgspec.ValidationError, OverflowError):
        return None


def _logprobs(given: Any) -> list[float]:
    try:
        return [each.logprob for each in msgspec.convert(given, _LogProbs).content]
    except msgspec.ValidationError:
        return []


def _versions(given: Any) -> tuple[str, ...]:
    try:
        return tuple(span.version for span in msgspec.convert(given, list[_Span]))
    except msgspec.ValidationError:
        return ()


def _count(value: Any) -> int:
    return value if isinstance(value, int) and not isinstance(value, bool) and value > 0 else 0


# --- words for errors ---------------------------------------------------------------------------------


def error_object(data: bytes) -> dict[str, Any]:
    """The endpoint's error object, ``{"error": {...}}``, if that is what it sent; else empty."""
    try:
        found = msgspec.json.decode(data)
    except (msgspec.DecodeError, RecursionError):
        return {}
    error = found.get("error") if isinstance(found, dict) else None
    if isinstance(error, dict):
        return error
    return {"message": error} if isinstance(error, str) else {}


def told(data: bytes) -> str:
    """The endpoint's own words in an error object, if that is what it sent."""
    said = error_object(data).get("message")
    return first_line(said) if isinstance(said, str) else ""


def quote(data: bytes) -> str:
    """The beginning of a reply, as one line."""
    return _cut(" ".join(data[: 4 * _QUOTED_CHARS].decode(errors="replace").split()))


def first_line(text: str) -> str:
    """The first line of a message, not too long."""
    return _cut(" ".join(text.split("\n", 1)[0].split()))


def _cut(text: str) -> str:
    return text if len(text) <= _QUOTED_CHARS else text[: _QUOTED_CHARS - 1] + "…"


def size(count: int) -> str:
    """A number of bytes, for people."""
    return f"{count / 1024:.0f} KiB"
