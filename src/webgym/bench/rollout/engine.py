"""How long an inference server takes: continuous batching, iteration by iteration. It computes nothing.

An iteration writes one token of every reply in the batch and reads a chunk of the requests that came last
(chunked prefill), as vLLM and its like do. A request that begins like an earlier one is not read again as far
as both agree (prefix cache).
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
    """One GPU. Whoever drives it waits as long as each iteration says.

    Args:
        costs: its speeds; the same figures that the simulation takes.
    """

    def __init__(self, costs: Costs) -> None:
        self.read_tokens = self.written_tokens = 0
        self.busy_seconds = 0.0
        self._costs = costs
        self._waiting: deque[_Request[T]] = deque()
        self._batch: list[_Request[T]] = []

    @property
    def requests(self) -> int:
        """In the batch or waiting for a place in it."""
        return len(self._waiting) + len(self._batch)

    def submit(self, prompt_tokens: int, reply_tokens: int, ticket: T) -> None:
        """A request arrives.

        Args:
            prompt_tokens: that must be read.
            reply_tokens: that its reply will have, at least 1.
            ticket: given back by the iteration that completes the reply.
        """
        self._waiting.append(_Request(max(1, prompt_tokens), max(1, reply_tokens), ticket))

    def iterate(self) -> tuple[float, list[T]]:
        """One iteration: how long it takes, and the requests whose replies are then complete."""
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
    """Which beginnings of requests have been read, by message; the oldest are forgotten.

    Args:
        capacity: tokens that it holds.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._held: OrderedDict[bytes, int] = OrderedDict()
        self._tokens = 0

    def unread(self, messages: Sequence[tuple[str, int]]) -> int:
        """How many tokens of a request must be read; it is in the cache from then on.

        Args:
            messages: content and tokens of each, in order.
        """
        digest, unread, is_known = hashlib.blake2b(digest_size=16), 0, True
        for content, tokens in messages:
            digest.update(f"{len(content)}\n{content}".encode())
            key = digest.digest()
            is_known = is_known and key in self._held
            if is_known:
                self._held.move_to_end(key)
                continue
            unread += tokens
            if key not in self._held:
                self._held[key] = tokens
                self._tokens += tokens
        while self._tokens > self._capacity:
            self._tokens -= self._held.popitem(last=False)[1]
        return unread
