"""The client of a chat endpoint. Every call ends with a completion or a typed error, whatever the endpoint
does."""

from __future__ import annotations

import asyncio
import email.utils
import io
import os
import random
import ssl
import time
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from functools import cache
from typing import Any, Final, Self
from urllib.parse import urlsplit
from urllib.request import getproxies, proxy_bypass

import aiohttp
import certifi
from pydantic import SecretStr

from webgym.core.errors import ConfigError, LLMBadReply, LLMError, LLMTimeout, LLMUnreachable
from webgym.core.trajectory import ended_by
from webgym.core.websites import is_loopback
from webgym.llm.cache import CachedReply, ReplyCache
from webgym.llm.completion import (
    Completion,
    NoCompletion,
    error_message,
    error_object,
    first_line,
    quote,
    read_completion,
    read_unusable,
    size,
)
from webgym.llm.config import ChatConfig, Sampling
from webgym.llm.health import note_cut_off, register_client
from webgym.llm.ledger import Ledger
from webgym.llm.prices import Call
from webgym.llm.request import Formats, Labelled, Request
from webgym.llm.tokens import count_messages, most_tokens

_RETRIED_STATUSES: Final = frozenset({408, 429, 500, 502, 503, 504, 529})
_OVERLOADED_STATUSES: Final = frozenset({429, 503, 529})
_QUOTA: Final = "insufficient_quota"
"""Error code of a 429 that waiting does not resolve."""
_SHORTEST_KEY: Final = 8
"""Shorter keys (``EMPTY``) are not looked for in messages."""
_SLOW_SECONDS: Final = 30.0
"""A request in flight for longer is reported as a problem."""
_MOST_HEADER_BYTES: Final = 65_536
"""Largest header of a reply."""
_MOST_DOUBLINGS: Final = 60
"""Most doublings of a pause, to avoid an overflow."""
_IDLE_SECONDS: Final = 3.0
"""How long a connection is kept without a request. Servers such as vLLM's close it after 5 s, and a request
that is sent at that moment fails."""

MAX_REPLY_BYTES = 8 * 1024 * 1024
"""Largest reply; a larger one is rejected."""


class EndpointRefused(LLMBadReply):
    """The endpoint answered with an HTTP error status.

    Attributes:
        status: the status.
    """

    def __init__(self, message: str, *, hint: str = "", status: int = 0) -> None:
        super().__init__(message, hint=hint)
        self.status = status


class ChatClient:
    """A long-lived client of one endpoint. Connections are kept and shared by all callers.

    Args:
        config: endpoint, model, limits.
        api_key: used instead of the environment variable that the config names.
        cache: an open cache of replies. A request whose reply it contains is not sent.
        ledger: counts the cost and enforces a budget. If it has a cache, it must be the same one.

    Attributes:
        config: as given.
        formats: formats that the endpoint accepts as ``response_format``, as far as that is known.
        served: the model of the first reply, as the endpoint named it; empty before. Replies of another one
            are refused, unless the config's ``any_model`` is set.
        interruptions: number of tries so far after which the endpoint may be another process: connections
            that failed or broke, and error statuses but 429.

    Raises:
        ConfigError: the key contains characters that are invalid in an HTTP header.
    """

    def __init__(
        self,
        config: ChatConfig,
        *,
        api_key: SecretStr | None = None,
        cache: ReplyCache | None = None,
        ledger: Ledger | None = None,
    ) -> None:
        self.config = config
        self.formats = Formats(config.base_url, config.model, cache)
        self.served = ""
        self.interruptions = 0
        self._url = f"{config.base_url}/chat/completions"
        self._key = api_key or SecretStr(os.environ.get(config.api_key_env, "").strip())
        if not self._key.get_secret_value().isascii() or not self._key.get_secret_value().isprintable():
            hint = f"check the environment variable {config.api_key_env}"
            raise ConfigError("the API key contains characters that are invalid in an HTTP header", hint=hint)
        if ledger is not None and ledger.cache not in (None, cache):
            raise ValueError("the ledger has another cache than the client")
        self._cache = cache
        self._ledger = ledger or Ledger(cache)
        self._places = asyncio.Semaphore(config.concurrency)
        self._not_before = 0.0
        """Until when the endpoint asked for a pause, on the monotonic clock."""
        self._http: aiohttp.ClientSession | None = None
        self._in_flight: set[_Progress] = set()
        self._answered: float | None = None
        """When the newest answered try was sent, on the monotonic clock; ``None`` if none was answered."""
        self._failing_since: float | None = None
        """When the first try after the last answer failed."""

    @property
    def sampling(self) -> Sampling:
        """Default sampling parameters of requests."""
        return self.config.sampling

    async def __aenter__(self) -> Self:
        headers = {"Accept": "application/json", "Content-Type": "application/json"}
        if key := self._key.get_secret_value():
            headers["Authorization"] = f"Bearer {key}"
        limits = {"connect_seconds": self.config.connect_seconds, "read_seconds": self.config.read_seconds}
        self._http = open_session(self.config.base_url, headers, **limits)
        register_client(self)
        return self

    async def __aexit__(self, *exc: object) -> None:
        if self._http is not None:
            await self._http.close()
            self._http = None

    def labelled(self, purpose: str) -> Labelled:
        """This client, its calls counted for a purpose."""
        return Labelled(self.complete, purpose, self.sampling, self.formats)

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None, *, purpose: str = ""
    ) -> Completion:
        """One reply to these messages, in the format of the OpenAI chat API.

        With a cache, the reply is on disk before this returns.

        Args:
            messages: ``{"role": ..., "content": ...}``, oldest first.
            sampling: overrides the config's parameters one by one.
            purpose: label under which the ledger counts the call.

        Raises:
            LLMUnreachable: nothing answers, after all retries.
            LLMTimeout: no complete reply came within the deadlines.
            LLMBadReply: the endpoint refused the request, its answer is not a completion, or, after all
                retries, its engine broke off the reply, generated none, or it is another model's.
            BudgetSpent: the call could cost more than is left of the budget.
            CacheError: the cache cannot be read or written.
        """
        if self._http is None:
            raise RuntimeError("the client is not open: use it in an async with statement")
        request = Request.of(self.config, messages, sampling)
        if self._cache is None:
            async with self._paid(request, purpose) as (fresh, _):
                return self._read(fresh, cached=False)
        reply, cached = await self._cache.answer(request.key, lambda: self._paid(request, purpose))
        if cached:
            self._cache.hit(purpose, self.config.model)
            self._ledger.hit(purpose, self.config.model)
        return self._read(reply, cached=cached)

    def _read(self, reply: CachedReply, *, cached: bool) -> Completion:
        try:
            return read_completion(reply.body, model=self.config.model, seconds=reply.seconds, cached=cached)
        except NoCompletion as error:
            hint = f"does the endpoint speak the OpenAI chat API at {self._url}?"
            what = self._without_key(str(error).encode(errors="replace")).decode()
            raise LLMBadReply(f"{self._where()} sent {what}", hint=hint) from error

    # --- sending and accounting -------------------------------------------------------------------------

    @asynccontextmanager
    async def _paid(self, request: Request, purpose: str) -> AsyncIterator[tuple[CachedReply, Call]]:
        """Send a request, and count its cost at the end of the block.

        Its place and its reservation are held until it is counted: so the number of replies that are paid
        for but not stored is limited by the concurrency, and the budget includes all of them.
        """
        progress = _Progress(self.config.total_seconds)
        with self._tracked(progress):
            async with self._places, AsyncExitStack() as reservation:
                reply = await self._until_answered(request, purpose, progress, reservation)
                call = self._call(request, self._read(reply, cached=False), purpose)
                yield reply, call
                self._ledger.paid(call)

    async def _until_answered(
        self, request: Request, purpose: str, progress: _Progress, reservation: AsyncExitStack
    ) -> CachedReply:
        """Send a request until it is answered, which leaves the reservation of its highest cost in the stack,
        or the retries are used up.

        An outage of the endpoint that lasts no longer than its patience does not count, nor does a pause that
        the endpoint asked others for.
        """
        while True:
            while (pause := self._not_before - time.monotonic()) > 0:  # noqa: ASYNC110 (it may grow meanwhile)
                await asyncio.sleep(pause)
            await reservation.enter_async_context(self._reserved(request))
            try:
                return await self._try(request, purpose, progress)
            except _TemporaryFailure as failure:
                await reservation.aclose()
                pause = self._pause_after(failure, progress)
            await asyncio.sleep(pause)

    def _call(self, request: Request, completion: Completion, purpose: str) -> Call:
        return self._ledger.prices.call(
            purpose, request.model, completion, lambda: count_messages(request.messages)
        )

    @asynccontextmanager
    async def _reserved(self, request: Request) -> AsyncIterator[None]:
        ledger = self._ledger
        if not ledger.has_budget:
            yield
            return
        longest = request.longest_reply or ledger.budget.longest_reply
        async with ledger.reserved(request.model, most_tokens(request.content, request.messages), longest):
            yield

    async def _discard(self, request: Request, completion: Completion, purpose: str) -> None:
        """Count a reply that was paid for and cannot be used."""
        call = self._call(request, completion, purpose)
        if self._cache is not None:
            await self._cache.discarded(request.key, call)
        self._ledger.paid(call)

    def _pause_after(self, failure: _TemporaryFailure, progress: _Progress) -> float:
        """Seconds until the next try of a request; raises the failure's error if there is none."""
        retry = self.config.retry
        status = failure.error.status if isinstance(failure.error, EndpointRefused) else 0
        self.interruptions += not failure.is_answer and status != 429
        is_away = not failure.is_answer and self._is_away(progress)
        progress.last = failure.error
        pause: float = min(retry.longest_seconds, retry.first_seconds * 2**progress.doublings)
        pause = max(pause * random.uniform(0.5, 1), failure.not_before_seconds)
        progress.doublings = min(progress.doublings + 1, _MOST_DOUBLINGS)
        if failure.is_refusal and failure.not_before_seconds <= self.config.total_seconds:
            # No request is sent before. A pause longer than any deadline is not waited for: requests fail.
            self._not_before = max(self._not_before, time.monotonic() + failure.not_before_seconds)
        is_last = False
        if is_away:
            progress.remaining_seconds = self.config.total_seconds
        else:
            progress.failed_at = time.monotonic()
            progress.refused += failure.is_refusal
            progress.failed += not failure.is_refusal
            is_last = progress.refused >= retry.refused_tries or progress.failed >= retry.tries
        progress.remaining_seconds -= pause
        if is_last or progress.remaining_seconds <= 0:
            raise failure.error from failure.error.__cause__
        return pause

    def _is_away(self, progress: _Progress) -> bool:
        """Whether a try failed because the endpoint, which has worked before, is away for a moment.

        It is not away if it has answered a request that was sent since this one failed before. What was sent
        earlier says nothing: a server that is stopped answers what it has, and takes nothing new.
        """
        now = time.monotonic()
        self._failing_since = self._failing_since or now
        if self._answered is None or self._answered > progress.failed_at:
            return False
        return now - self._failing_since < self.config.retry.patience_seconds

    def _temporary(self, error: LLMError, *, is_answer: bool = False) -> LLMError | _TemporaryFailure:
        """A failure that passes if the endpoint has worked before; else it never will."""
        return error if self._answered is None else _TemporaryFailure(error, is_answer=is_answer)

    @contextmanager
    def _tracked(self, progress: _Progress) -> Iterator[None]:
        self._in_flight.add(progress)
        try:
            yield
        except asyncio.CancelledError:
            note_cut_off(progress.last.message if progress.last else self._waits_for(progress))
            raise
        finally:
            self._in_flight.discard(progress)

    @property
    def problem(self) -> str:
        """Why requests are delayed at this moment, as a message for users; empty if they are not."""
        requests = tuple(self._in_flight)
        refused = [request for request in requests if request.last is not None]
        if refused:
            newest = max(refused, key=lambda request: request.started)
            assert newest.last is not None
            return f"{len(refused)} of {len(requests)} requests are sent again: {newest.last.message}"
        oldest = min(requests, key=lambda request: request.started, default=None)
        if oldest is None or time.monotonic() - oldest.started < _SLOW_SECONDS:
            return ""
        return self._waits_for(oldest)

    def _waits_for(self, request: _Progress) -> str:
        so_far = f"has sent {size(request.received)}" if request.received else "is silent"
        return f"{self._where()} {so_far} for {time.monotonic() - request.started:.0f} s"

    async def _try(self, request: Request, purpose: str, progress: _Progress) -> CachedReply:
        """Send a request once.

        Raises:
            _TemporaryFailure: it failed, and may succeed on another try.
            LLMError: it failed permanently.
        """
        started = time.monotonic()
        try:
            async with asyncio.timeout(progress.remaining_seconds):
                data = await self._once(request.content, progress)
        except TimeoutError as error:
            raise self._overdue(progress) from error
        finally:
            progress.remaining_seconds -= time.monotonic() - started
        reply = CachedReply(data, time.monotonic() - started)
        try:
            completion = self._read(reply, cached=False)
        except LLMBadReply as error:
            unusable = read_unusable(data, model=self.config.model)
            if unusable is not None:
                await self._discard(request, unusable, purpose)
            raise self._temporary(error, is_answer=unusable is not None) from error.__cause__
        if (problem := self._problem_of(completion)) is not None:
            await self._discard(request, completion, purpose)
            raise _TemporaryFailure(problem, is_answer=True)
        self._answered = max(self._answered or 0.0, progress.started)
        self._failing_since = None
        return reply

    def _problem_of(self, completion: Completion) -> LLMBadReply | None:
        """Why a completion cannot be used, through a fault of the endpoint; ``None`` if it can."""
        if ended_by(completion.finish_reason) == "engine":
            problem = f"broke off its reply: finish_reason {completion.finish_reason!r}"
            return LLMBadReply(f"{self._where()} {problem}", hint="the endpoint's own log says more")
        if completion.was_not_generated:
            return LLMBadReply(
                f"{self._where()} sent a reply with nothing in it", hint="is its model loaded?"
            )
        self.served = self.served or completion.model
        if completion.model == self.served or self.config.any_model:
            return None
        problem = f"replies as the model {completion.model!r}, and replied as {self.served!r} before"
        return LLMBadReply(f"{self._where()} {problem}", hint="the chat's setting any_model accepts several")

    async def _once(self, content: bytes, progress: _Progress) -> bytes:
        """The body of a reply with status 200."""
        if self._http is None:
            raise RuntimeError("the client was closed while a request was in flight")
        progress.restart()
        try:
            async with self._http.post(
                self._url, data=io.BytesIO(content), allow_redirects=False
            ) as response:
                progress.answered = True
                data = await self._receive(response, progress)
        except aiohttp.ConnectionTimeoutError as error:
            raise _TemporaryFailure(self._unreachable("no connection in time")) from error
        except aiohttp.ServerTimeoutError as error:
            silent = f"{self._where()} was silent for {self.config.read_seconds:g} s"
            hint = "is the model loaded? a longer read_seconds waits longer"
            raise LLMTimeout(silent, hint=hint) from error
        except (aiohttp.ClientError, OSError) as error:
            raise _TemporaryFailure(self._broken(error, progress)) from error
        if response.status != 200:
            raise self._refusal(response, data)
        return data

    async def _receive(self, response: aiohttp.ClientResponse, progress: _Progress) -> bytes:
        kind = response.headers.get("content-type", "")
        if response.status == 200 and kind.startswith("text/event-stream"):
            hint = "the endpoint must honour stream=false"
            raise LLMBadReply(f"{self._where()} sent a stream instead of one reply", hint=hint)
        data = bytearray()
        async for chunk in response.content.iter_any():
            data += chunk
            progress.received = len(data)
            if len(data) > MAX_REPLY_BYTES:
                hint = "is this a chat endpoint?"
                raise LLMBadReply(f"{self._where()} sent more than {size(len(data))}", hint=hint)
        return bytes(data)

    def _refusal(self, response: aiohttp.ClientResponse, data: bytes) -> LLMError | _TemporaryFailure:
        status = response.status
        data = self._without_key(data)
        reason = error_message(data) or quote(data)
        pause = _retry_after(response.headers.get("retry-after", ""))
        is_long = pause > self.config.total_seconds
        error = EndpointRefused(
            f"{self._where()} answered {status} {response.reason or ''}".rstrip()
            + (f": {reason}" if reason else "")
            + (f" (Retry-After: {pause:,.0f} s)" if is_long else ""),
            hint=self._advice(status),
            status=status,
        )
        if _QUOTA in map(error_object(data).get, ("code", "type")):
            return error
        if status not in _RETRIED_STATUSES:
            return self._temporary(error) if status == 404 or status >= 502 else error
        return _TemporaryFailure(error, pause, is_refusal=status in _OVERLOADED_STATUSES)

    def _without_key(self, data: bytes) -> bytes:
        """A body that is to be quoted, without the key. A short one is no secret but stands for none."""
        key = self._key.get_secret_value().encode()
        return data.replace(key, b"***") if len(key) >= _SHORTEST_KEY else data

    def _advice(self, status: int) -> str:
        if status in (401, 403):
            return f"is the key in the environment variable {self.config.api_key_env} right?"
        if status == 404:
            return f"does the endpoint serve {self._url} and the model {self.config.model}?"
        if status == 429:
            return "its rate limit is exceeded; retry.refused_tries is the number of tries"
        if 300 <= status < 400:
            return "redirects are not followed; set the URL that they lead to"
        return "the endpoint's own log says more" if status >= 500 else "the endpoint refused the request"

    def _overdue(self, progress: _Progress) -> LLMError:
        seconds = f"{self.config.total_seconds:g} s"
        if progress.received:
            problem = f"was still sending after {seconds} ({size(progress.received)} so far)"
            return LLMBadReply(f"{self._where()} {problem}", hint="is this a chat endpoint?")
        hint = "is the endpoint overloaded? total_seconds is the limit"
        earlier = f"; before that, {progress.last.message}" if progress.last else ""
        return LLMTimeout(f"{self._where()} gave no reply within {seconds}{earlier}", hint=hint)

    def _broken(self, error: Exception, progress: _Progress) -> LLMError:
        cause = error.__cause__ or error
        why = first_line(getattr(cause, "message", "") or str(cause)) or type(cause).__name__
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
    """The state of a request in flight: its current try, and its remaining time for tries and pauses."""

    def __init__(self, seconds: float) -> None:
        self.remaining_seconds = seconds
        self.last: LLMError | None = None
        self.failed_at = 0.0
        """When the newest try failed that counts."""
        self.refused = self.failed = self.doublings = 0
        """Number of tries that count, and of pauses that were doubled."""
        self.restart()

    def restart(self) -> None:
        """Start a try."""
        self.answered = False
        self.received = 0
        self.started = time.monotonic()


class _TemporaryFailure(Exception):
    """A failure after which the request is sent again.

    Attributes:
        error: the error to raise if there are no further tries.
        not_before_seconds: the endpoint's ``Retry-After``; 0 if it sent none.
        is_refusal: whether the endpoint is overloaded.
        is_answer: whether the endpoint sent a reply, which counts and costs, but cannot be used.
    """

    def __init__(
        self,
        error: LLMError,
        not_before_seconds: float = 0.0,
        *,
        is_refusal: bool = False,
        is_answer: bool = False,
    ) -> None:
        super().__init__(str(error))
        self.error = error
        self.not_before_seconds = not_before_seconds
        self.is_refusal = is_refusal
        self.is_answer = is_answer


def open_session(
    base_url: str,
    headers: Mapping[str, str],
    *,
    connect_seconds: float,
    read_seconds: float | None = None,
) -> aiohttp.ClientSession:
    """An HTTP session for an endpoint, with the proxy and the authorities that the environment names.

    Args:
        base_url: the endpoint's base URL.
        headers: headers of every request.
        connect_seconds: deadline for opening a connection.
        read_seconds: longest time without receiving data.
    """
    return aiohttp.ClientSession(
        connector=aiohttp.TCPConnector(
            limit=0,
            keepalive_timeout=_IDLE_SECONDS,
            resolver=aiohttp.ThreadedResolver(),  # the system's names, as every other program sees them
            ssl=certificates(),
        ),
        headers=headers,
        timeout=aiohttp.ClientTimeout(connect=connect_seconds, sock_read=read_seconds),
        proxy=_proxy(base_url),
        max_field_size=_MOST_HEADER_BYTES,
    )


def _proxy(base_url: str) -> str | None:
    """The proxy that the environment names for an endpoint on another machine."""
    url, proxies = urlsplit(base_url), getproxies()
    proxy = proxies.get(url.scheme) or proxies.get("all")
    if not proxy or is_loopback(url.hostname) or proxy_bypass(url.netloc):
        return None
    return proxy if "://" in proxy else f"http://{proxy}"


@cache
def certificates() -> ssl.SSLContext:
    """The authorities that are trusted: those that the environment names, else certifi's. Reading them takes
    30 ms."""
    is_named = "SSL_CERT_FILE" in os.environ or "SSL_CERT_DIR" in os.environ
    context = ssl.create_default_context(cafile=None if is_named else certifi.where())
    context.set_alpn_protocols(["http/1.1"])
    return context


def _retry_after(value: str) -> float:
    """Seconds of a ``Retry-After`` header; 0 if there is none."""
    value = value.strip()
    if value.isascii() and value.isdecimal():
        return float(value[:9])
    try:
        at = email.utils.parsedate_to_datetime(value).timestamp()
    except (ValueError, OverflowError):
        return 0.0
    return max(0.0, at - time.time())
