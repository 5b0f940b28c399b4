"""A timing model of an inference server with continuous batching. It computes no replies.

An iteration generates one token of every reply in the batch, and prefills a chunk of newer requests (chunked
prefill), as vLLM does. The common prefix of a request and earlier ones is not prefilled again (prefix cache).
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from webgym.simulate.config import Costs

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
