"""The client. Whatever an endpoint does, the caller gets a completion or one typed error."""

from __future__ import annotations

import asyncio
import email.utils
import ipaddress
import os
import random
import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Final, Self

import httpx
import msgspec
from pydantic import SecretStr

from webgym.core.errors import ConfigError, LLMBadReply, LLMError, LLMTimeout, LLMUnreachable
from webgym.llm.config import ChatConfig, Sampling

_TRY_AGAIN: Final = frozenset({408, 429, 500, 502, 503, 504, 529})
_QUOTED_CHARS: Final = 200
"""How much of a bad reply an error quotes."""


class Completion(msgspec.Struct, frozen=True):
    """A reply.

    Attributes:
        text: what the model said; empty if it said nothing before it was stopped.
        finish_reason: as the endpoint gave it; empty if it gave none.
        prompt_tokens, completion_tokens: as the endpoint counted them; 0 if it did not.
        seconds: wall time of the try that succeeded, from request to last byte.
        model: as the endpoint named it, else as it was asked for.
    """

    text: str
    finish_reason: str
    prompt_tokens: int
    completion_tokens: int
    seconds: float
    model: str


class ChatClient:
    """A long-lived client of one endpoint. Connections are kept and shared by all callers.

    Args:
        config: endpoint, model, limits.
        api_key: used in place of the environment variable that the config names.

    Raises:
        ConfigError: the key cannot stand in an HTTP header.
    """

    def __init__(self, config: ChatConfig, *, api_key: SecretStr | None = None) -> None:
        self.config = config
        self._url = f"{config.base_url}/chat/completions"
        self._key = api_key or SecretStr(os.environ.get(config.api_key_env, "").strip())
        if not self._key.get_secret_value().isascii() or not self._key.get_secret_value().isprintable():
            hint = f"look at the environment variable {config.api_key_env}"
            raise ConfigError("the API key holds characters that no HTTP header may hold", hint=hint)
        self._slots = asyncio.Semaphore(config.concurrency)
        self._http: httpx.AsyncClient | None = None

    async def __aenter__(self) -> Self:
        headers = {"Accept": "application/json", "Content-Type": "application/json"}
        if key := self._key.get_secret_value():
            headers["Authorization"] = f"Bearer {key}"
        config = self.config
        self._http = httpx.AsyncClient(
            headers=headers,
            timeout=httpx.Timeout(config.read_seconds, connect=config.connect_seconds, pool=None),
            limits=httpx.Limits(
                max_connections=config.concurrency, max_keepalive_connections=config.concurrency
            ),
            trust_env=not _is_loopback(config.base_url),
        )
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._http is not None:
            await self._http.aclose()
            self._http = None

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Completion:
        """One reply to these messages, in the shape of the OpenAI chat API.

        Args:
            messages: ``{"role": ..., "content": ...}``, oldest first.
            sampling: in place of the config's.

        Raises:
            LLMUnreachable: nothing answers, however often it is asked.
            LLMTimeout: no complete reply came within the deadlines.
            LLMBadReply: the endpoint refused, or what it sent is no completion.
        """
        if self._http is None:
            raise RuntimeError("the client is not open: use it in an async with statement")
        sampling = sampling or self.config.sampling
        body = {"model": self.config.model, "messages": messages, "stream": False} | sampling.body()
        content = msgspec.json.encode(body)
        async with self._slots:
            progress = _Progress()
            try:
                async with asyncio.timeout(self.config.total_seconds):
                    return await self._until_answered(self._http, content, progress)
            except TimeoutError as error:
                raise self._overdue(progress) from error

    async def _until_answered(
        self, http: httpx.AsyncClient, content: bytes, progress: _Progress
    ) -> Completion:
        deadline = time.monotonic() + self.config.total_seconds
        retry = self.config.retry
        for number in range(1, retry.tries + 1):
            try:
                return await self._once(http, content, progress)
            except _TryAgain as again:
                progress.last = again.error
                pause = min(retry.longest_seconds, retry.first_seconds * 2 ** (number - 1))
                pause = max(pause * random.uniform(0.5, 1), again.not_before_seconds)
                if number == retry.tries or time.monotonic() + pause > deadline:
                    raise again.error from again.error.__cause__
            await asyncio.sleep(pause)
        raise AssertionError("unreachable: the last try returns or raises")

    async def _once(self, http: httpx.AsyncClient, content: bytes, progress: _Progress) -> Completion:
        """One try.

        Raises:
            _TryAgain: it failed in a way that may pass.
            LLMError: it failed for good.
        """
        started = time.monotonic()
        progress.restart()
        try:
            async with http.stream("POST", self._url, content=content) as response:
                progress.answered = True
                data = await self._read(response, progress)
        except httpx.ConnectTimeout as error:
            raise _TryAgain(self._unreachable("no connection in time")) from error
        except httpx.TimeoutException as error:
            silent = f"{self._where()} was silent for {self.config.read_seconds:g} s"
            hint = "is the model loaded? a longer read_seconds waits longer"
            raise LLMTimeout(silent, hint=hint) from error
        except httpx.TransportError as error:
            raise _TryAgain(self._broken(error, progress)) from error
        except httpx.HTTPError as error:
            raise LLMBadReply(f"{self._where()} sent a reply that cannot be read: {error}") from error
        if response.status_code != 200:
            raise self._refusal(response, data)
        return self._completion(response, data, time.monotonic() - started)

    async def _read(self, response: httpx.Response, progress: _Progress) -> bytes:
        kind = response.headers.get("content-type", "")
        if response.status_code == 200 and kind.startswith("text/event-stream"):
            hint = "the endpoint must honour stream=false"
            raise LLMBadReply(f"{self._where()} sent a stream where one reply was asked for", hint=hint)
        data = bytearray()
        async for chunk in response.aiter_bytes():
            data += chunk
            progress.received = len(data)
            if len(data) > self.config.max_reply_bytes:
                hint = "is this a chat endpoint? max_reply_bytes is the limit"
                raise LLMBadReply(f"{self._where()} sent more than {_size(len(data))}", hint=hint)
        return bytes(data)

    def _completion(self, response: httpx.Response, data: bytes, seconds: float) -> Completion:
        hint = f"does the endpoint speak the OpenAI chat API at {self._url}?"
        if not data.strip():
            raise LLMBadReply(f"{self._where()} sent an empty reply", hint=hint)
        try:
            found = msgspec.json.decode(data, type=_Body)
        except (msgspec.DecodeError, RecursionError) as error:
            is_page = data.lstrip()[:1] == b"<" or "html" in response.headers.get("content-type", "")
            what = "a web page" if is_page else f"something that is no completion ({_first_line(str(error))})"
            raise LLMBadReply(f"{self._where()} sent {what}: {_quote(data)}", hint=hint) from error
        if not found.choices:
            told = _told(data) or _quote(data)
            raise LLMBadReply(f"{self._where()} sent a reply without choices: {told}", hint=hint)
        choice = found.choices[0]
        usage = found.usage if isinstance(found.usage, dict) else {}
        return Completion(
            text=choice.message.content or "",
            finish_reason=choice.finish_reason or "",
            prompt_tokens=_count(usage.get("prompt_tokens")),
            completion_tokens=_count(usage.get("completion_tokens")),
            seconds=seconds,
            model=found.model or self.config.model,
        )

    def _refusal(self, response: httpx.Response, data: bytes) -> LLMError | _TryAgain:
        status = response.status_code
        said = _told(data) or _quote(data)
        error = LLMBadReply(
            f"{self._where()} answered {status} {response.reason_phrase}".rstrip()
            + (f": {said}" if said else ""),
            hint=self._advice(status),
        )
        if status in _TRY_AGAIN:
            return _TryAgain(error, _retry_after(response.headers.get("retry-after", "")))
        return error

    def _advice(self, status: int) -> str:
        if status in (401, 403):
            return f"is the key in the environment variable {self.config.api_key_env} right?"
        if status == 404:
            return f"does the endpoint serve {self._url} and the model {self.config.model}?"
        if status == 429:
            return "lower the concurrency or raise the number of tries"
        if 300 <= status < 400:
            return "redirects are not followed; give the address that they lead to"
        return "the endpoint's own log says more" if status >= 500 else "the endpoint refused the request"

    def _overdue(self, progress: _Progress) -> LLMError:
        seconds = f"{self.config.total_seconds:g} s"
        if progress.received:
            told = f"was still sending after {seconds} ({_size(progress.received)} so far)"
            return LLMBadReply(f"{self._where()} {told}", hint="is this a chat endpoint?")
        hint = "is the endpoint overloaded? total_seconds is the limit"
        before = f"; before that, {progress.last.message}" if progress.last else ""
        return LLMTimeout(f"{self._where()} gave no reply within {seconds}{before}", hint=hint)

    def _broken(self, error: httpx.TransportError, progress: _Progress) -> LLMError:
        why = _first_line(str(error)) or type(error).__name__
        if progress.answered:
            return LLMBadReply(
                f"{self._where()} broke off its reply: {why}", hint="the endpoint's own log says more"
            )
        return self._unreachable(why)

    def _unreachable(self, why: str) -> LLMUnreachable:
        hint = "is the endpoint running, and the base URL right?"
        return LLMUnreachable(f"{self._where()} cannot be reached: {why}", hint=hint)

    def _where(self) -> str:
        return f"the endpoint {self.config.base_url}"


class _Progress:
    """How far a request came, for telling why it did not come to its end."""

    def __init__(self) -> None:
        self.last: LLMError | None = None
        self.restart()

    def restart(self) -> None:
        """Begin a try."""
        self.answered = False
        self.received = 0


class _TryAgain(Exception):
    """A failure that may pass."""

    def __init__(self, error: LLMError, not_before_seconds: float = 0.0) -> None:
        super().__init__(str(error))
        self.error = error
        self.not_before_seconds = not_before_seconds


class _Said(msgspec.Struct):
    content: str | None = None


class _Choice(msgspec.Struct):
    message: _Said
    finish_reason: str | None = None


class _Body(msgspec.Struct):
    choices: list[_Choice] = []
    model: str | None = None
    usage: Any = None


def _is_loopback(base_url: str) -> bool:
    """Whether the endpoint is on this machine, where no proxy of the environment has a say."""
    host = httpx.URL(base_url).host
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _retry_after(value: str) -> float:
    """Seconds until the endpoint wants to be asked again; 0 if it does not say."""
    value = value.strip()
    if value.isascii() and value.isdecimal():
        return float(value[:9])
    try:
        at = email.utils.parsedate_to_datetime(value)
    except ValueError:
        return 0.0
    return max(0.0, at.timestamp() - time.time())


def _told(data: bytes) -> str:
    """The endpoint's own words in an error object, if that is what it sent."""
    try:
        found = msgspec.json.decode(data)
    except (msgspec.DecodeError, RecursionError):
        return ""
    error = found.get("error") if isinstance(found, dict) else None
    said = error.get("message") if isinstance(error, dict) else error
    return _first_line(said) if isinstance(said, str) else ""


def _quote(data: bytes) -> str:
    said = " ".join(data[: 4 * _QUOTED_CHARS].decode(errors="replace").split())
    return _cut(said)


def _first_line(text: str) -> str:
    return _cut(" ".join(text.split("\n", 1)[0].split()))


def _cut(text: str) -> str:
    return text if len(text) <= _QUOTED_CHARS else text[: _QUOTED_CHARS - 1] + "…"


def _count(value: Any) -> int:
    return value if isinstance(value, int) and not isinstance(value, bool) and value > 0 else 0


def _size(count: int) -> str:
    return f"{count / 1024:.0f} KiB"
