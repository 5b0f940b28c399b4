"""A policy endpoint of fixed capacity: an OpenAI-compatible server that takes as long as GPUs would.

Its replies are scripted: clicks on marked elements, scrolls and navigations that are determined by a seed,
and an answer at a given step. The time is that of a model of continuous batching with a prefix cache
(:class:`Engine`). The benchmark measures the system; attempts are not meant to succeed.
"""

from __future__ import annotations

import asyncio
import hashlib
import random
import time
from collections import OrderedDict, deque
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

import msgspec
from aiohttp import web

from webgym.agent.formats import render_reply
from webgym.core.action import Action, Answer, LeftClick, Navigate, Scroll, Target
from webgym.core.task import Task
from webgym.simulate.config import Costs

_CHARACTERS_PER_TOKEN: Final = 4
_TOKENS_PER_PICTURE: Final = 960
"""For 1280 by 768 pixels: a token per 32 by 32 pixels, as in Qwen3-VL."""
_CACHED_TOKENS: Final = 500_000
"""Capacity of the prefix cache of a GPU: about what fits into 80 GB beside a model of 8B parameters."""
_LARGEST_REQUEST: Final = 64 * 2**20
_MARKS: Final = 12
"""The greatest number of an element to click; most pages have as many elements."""


class Script(msgspec.Struct, frozen=True):
    """The replies of an attempt.

    Attributes:
        task: the task, whose instruction the requests contain.
        steps: number of steps; the last reply is an answer, unless the budget is spent before.
        tokens: number of tokens of each reply.
        seed: of the actions.
    """

    task: Task
    steps: int
    tokens: Sequence[float]
    seed: int

    def reply(self, step: int) -> str:
        """The reply of a step, counted from 0."""
        action = self._action(step)
        return render_reply(action, "memory", description=f"Step {step + 1}", intention="browse")

    def _action(self, step: int) -> Action:
        if step + 1 >= self.steps:
            return Answer("Nothing was found.")
        draw = random.Random(f"{self.seed}\n{self.task.id}\n{step}")
        kind = draw.random()
        if kind < 0.55:
            return LeftClick(Target(element=draw.randint(1, _MARKS)))
        if kind < 0.8:
            return Scroll("down" if draw.random() < 0.7 else "up")
        return Navigate(self.task.website)


class Endpoint:
    """The application that serves the endpoint.

    Args:
        scripts: of the attempts, which are identified by the instructions of their tasks.
        costs: speeds of a GPU.
        gpus: number of GPUs. A request goes to the GPU with the fewest requests, preferably to the one that
            served the previous request of the attempt.

    Attributes:
        url: base URL of the endpoint.
        prompt_tokens: number of tokens of all requests, cached ones included.
    """

    def __init__(self, scripts: Sequence[Script], costs: Costs, gpus: int) -> None:
        self.url = ""
        self.prompt_tokens = 0
        self._scripts = {script.task.instruction: script for script in scripts}
        self._steps: dict[str, int] = {}
        self._last: dict[str, int] = {}
        self._engines = [Engine[asyncio.Future[None]](costs) for _ in range(gpus)]
        self._caches = [PrefixCache(_CACHED_TOKENS) for _ in range(gpus)]
        self._arrived = [asyncio.Event() for _ in range(gpus)]

    @property
    def requests(self) -> int:
        """The number of requests at all GPUs now."""
        return sum(engine.requests for engine in self._engines)

    @property
    def busy_seconds(self) -> float:
        """The time during which GPUs were busy, summed over GPUs."""
        return sum(engine.busy_seconds for engine in self._engines)

    @property
    def read_tokens(self) -> int:
        """The number of prompt tokens that were not in the prefix cache."""
        return sum(engine.read_tokens for engine in self._engines)

    async def complete(self, request: web.Request) -> web.Response:
        """Handle ``POST /v1/chat/completions``."""
        messages = (await request.json())["messages"]
        script, step = self._next(messages)
        tokens = max(1, round(script.tokens[min(step, len(script.tokens) - 1)]))
        sizes = [_size(message) for message in messages]
        prompt = sum(size for _, size in sizes)
        self.prompt_tokens += prompt
        before = self._last.get(script.task.instruction)
        index = min(range(len(self._engines)), key=lambda gpu: (self._engines[gpu].requests, gpu != before))
        self._last[script.task.instruction] = index
        done = asyncio.get_running_loop().create_future()
        self._engines[index].submit(self._caches[index].unread(sizes), tokens, done)
        self._arrived[index].set()
        await done
        message = {"role": "assistant", "content": script.reply(step)}
        usage = {"prompt_tokens": prompt, "completion_tokens": tokens, "total_tokens": prompt + tokens}
        choice = {"index": 0, "finish_reason": "stop", "message": message}
        return web.json_response(
            {
                "id": "bench",
                "object": "chat.completion",
                "model": "bench",
                "choices": [choice],
                "usage": usage,
            }
        )

    def _next(self, messages: Sequence[Mapping[str, Any]]) -> tuple[Script, int]:
        """The attempt's script and the index of its step; a request without replies restarts the script."""
        text = "\n".join(part for message in messages for part in _texts(message))
        task = max((known for known in self._scripts if known in text), key=len, default=None)
        if task is None:
            raise web.HTTPBadRequest(text="no script has this task")
        is_first = not any(message["role"] == "assistant" for message in messages)
        step = self._steps[task] = 0 if is_first else self._steps[task] + 1
        return self._scripts[task], step

    async def drive(self, index: int) -> None:
        """Run a GPU forever, in real time; late wake-ups of this process are made up for."""
        engine, arrived = self._engines[index], self._arrived[index]
        due = time.monotonic()
        while True:
            if not engine.requests:
                arrived.clear()
                await arrived.wait()
                due = time.monotonic()
            seconds, done = engine.iterate()
            due += seconds
            await asyncio.sleep(due - time.monotonic())
            for future in done:
                if not future.done():
                    future.set_result(None)

    @property
    def gpus(self) -> int:
        """The number of GPUs."""
        return len(self._engines)


@asynccontextmanager
async def serving_endpoint(scripts: Sequence[Script], costs: Costs, gpus: int) -> AsyncIterator[Endpoint]:
    """Serve an endpoint on a free port of the loopback address until the block ends."""
    endpoint = Endpoint(scripts, costs, gpus)
    app = web.Application(client_max_size=_LARGEST_REQUEST)
    app.router.add_post("/v1/chat/completions", endpoint.complete)
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    drivers = [asyncio.create_task(endpoint.drive(index)) for index in range(gpus)]
    try:
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        endpoint.url = f"http://127.0.0.1:{runner.addresses[0][1]}/v1"
        yield endpoint
    finally:
        for driver in drivers:
            driver.cancel()
        await asyncio.gather(*drivers, return_exceptions=True)
        await runner.cleanup()


def _texts(message: Mapping[str, Any]) -> list[str]:
    content = message["content"]
    if isinstance(content, str):
        return [content]
    return [part["text"] for part in content if part["type"] == "text"]


def _size(message: Mapping[str, Any]) -> tuple[str, int]:
    """The content and the number of tokens of a message."""
    content = message["content"]
    texts = _texts(message)
    urls = (
        []
        if isinstance(content, str)
        else [p["image_url"]["url"] for p in content if p["type"] == "image_url"]
    )
    tokens = sum(map(len, texts)) // _CHARACTERS_PER_TOKEN + _TOKENS_PER_PICTURE * len(urls)
    return message["role"] + "".join((*texts, *urls)), tokens


T = TypeVar("T")


@dataclass
class _Request(Generic[T]):
    unread: int
    unwritten: int
    ticket: T


class Engine(Generic[T]):
    """A GPU. The caller waits for the time of each iteration.

    Args:
        costs: speeds of the GPU, as in the simulation.

    Attributes:
        read_tokens: number of prefilled tokens.
        written_tokens: number of generated tokens.
        busy_seconds: time of all iterations.
    """

    def __init__(self, costs: Costs) -> None:
        self.read_tokens = self.written_tokens = 0
        self.busy_seconds = 0.0
        self._costs = costs
        self._waiting: deque[_Request[T]] = deque()
        self._batch: list[_Request[T]] = []

    @property
    def requests(self) -> int:
        """The number of requests in the batch or waiting for it."""
        return len(self._waiting) + len(self._batch)

    def submit(self, prompt_tokens: int, reply_tokens: int, ticket: T) -> None:
        """Add a request.

        Args:
            prompt_tokens: number of tokens to prefill.
            reply_tokens: number of tokens of its reply, at least 1.
            ticket: returned by the iteration that completes the reply.
        """
        self._waiting.append(_Request(max(1, prompt_tokens), max(1, reply_tokens), ticket))

    def iterate(self) -> tuple[float, list[T]]:
        """Make an iteration.

        Returns:
            Its time in seconds, and the tickets of the replies that it completes.
        """
        costs = self._costs
        while self._waiting and len(self._batch) < costs.batch:
            self._batch.append(self._waiting.popleft())
        writing = [request for request in self._batch if not request.unread]
        left = costs.prefill_chunk
        for request in self._batch:
            chunk = min(left, request.unread)
            request.unread -= chunk
            left -= chunk
        for request in writing:
            request.unwritten -= 1
        read = costs.prefill_chunk - left
        seconds = read / costs.prefill_tokens_per_second
        seconds += costs.decode_seconds + costs.decode_seconds_per_reply * len(writing)
        done = [request.ticket for request in self._batch if not request.unwritten]
        self._batch = [request for request in self._batch if request.unwritten]
        self.read_tokens += read
        self.written_tokens += len(writing)
        self.busy_seconds += seconds
        return seconds, done


class PrefixCache:
    """A prefix cache with the granularity of messages; the least recently used entries are evicted.

    Args:
        capacity: maximum number of tokens.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._entries: OrderedDict[bytes, int] = OrderedDict()
        self._tokens = 0

    def unread(self, messages: Sequence[tuple[str, int]]) -> int:
        """The number of tokens of a request that are not cached; they are cached from now on.

        Args:
            messages: content and number of tokens of every message, in order.
        """
        digest, unread, is_known = hashlib.blake2b(digest_size=16), 0, True
        for content, tokens in messages:
            digest.update(f"{len(content)}\n{content}".encode())
            key = digest.digest()
            is_known = is_known and key in self._entries
            if is_known:
                self._entries.move_to_end(key)
                continue
            unread += tokens
            if key not in self._entries:
                self._entries[key] = tokens
                self._tokens += tokens
        while self._tokens > self._capacity:
            self._tokens -= self._entries.popitem(last=False)[1]
        return unread
