"""The two resources that everything waits for: processors with queues, and GPUs that batch."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Generator
from heapq import heappop, heappush
from typing import Any, TypeAlias

import simpy

from webgym.simulate.config import Costs, Queues

Process: TypeAlias = Generator[simpy.Event, Any, None]


class Processors:
    """So many processors, each of which does one operation at a time.

    With a queue per operation these share the processors by service time: the next operation is the one whose
    queue has had the least so far (start-time fair queueing). A queue that was empty starts where the others
    are, so it neither saves up turns nor waits for old ones.
    """

    def __init__(self, env: simpy.Environment, count: int, queues: Queues) -> None:
        self.busy_seconds = 0.0
        self._env = env
        self._count = self._free = count
        self._is_global = queues == "global"
        self._waiting: list[tuple[float, int, simpy.Event]] = []
        self._arrivals = 0
        self._now_served = 0.0
        self._served: dict[str, float] = defaultdict(float)

    def use(self, operation: str, seconds: float) -> Process:
        """Wait for a processor and keep it for so long."""
        env = self._env
        self._arrivals += 1
        rank = 0.0
        if not self._is_global:
            rank = max(self._now_served, self._served[operation])
            self._served[operation] = rank + seconds
        if self._free:
            self._free -= 1
            self._now_served = max(self._now_served, rank)
        else:
            turn = env.event()
            heappush(self._waiting, (rank, self._arrivals, turn))
            yield turn
        yield env.timeout(seconds)
        self.busy_seconds += seconds
        if self._waiting:
            self._now_served, _, turn = heappop(self._waiting)
            turn.succeed()
        else:
            self._free += 1

    @property
    def busy(self) -> int:
        """How many are at work."""
        return self._count - self._free


class Inference:
    """GPUs that write replies with continuous batching, as a fluid.

    Requests are spread evenly. A request is first read (prefill), then its reply is written at the speed of
    the batch: an iteration takes ``decode_seconds`` and some more per reply, and longer still where a chunk
    of another request is read in it.
    """

    def __init__(self, env: simpy.Environment, gpus: float, costs: Costs) -> None:
        self.work_seconds = 0.0
        """GPU seconds that everything so far would have taken at full batches."""
        self._env = env
        self._gpus, self._pace = max(1.0, gpus), min(1.0, gpus)  # a part of a GPU is a slower one
        self._costs = costs
        self._reading = 0
        self._line = simpy.Resource(env)
        self._writing: list[tuple[float, int, simpy.Event]] = []
        self._waiting: deque[tuple[float, simpy.Event]] = deque()
        self._written = 0.0
        """Tokens that a reply would have which is being written since the beginning."""
        self._since = 0.0
        self._changes = 0

    def reply(self, tokens: float) -> Process:
        """Wait until a reply of so many tokens is complete."""
        costs = self._costs
        prompt = costs.prompt_tokens
        self.work_seconds += prompt / costs.prefill_tokens_per_second
        self.work_seconds += tokens * self._iteration(costs.batch) / costs.batch
        yield from self._read(prompt)
        done = self._env.event()
        self._advance()
        if len(self._writing) < costs.batch * self._gpus:
            self._start(tokens, done)
        else:
            self._waiting.append((tokens, done))
        self._plan()
        yield done

    @property
    def requests(self) -> int:
        """Requests that are read or written, or wait for it."""
        return self._reading + len(self._writing) + len(self._waiting)

    def _iteration(self, replies: float) -> float:
        return self._costs.decode_seconds + self._costs.decode_seconds_per_reply * replies

    def _chunk_seconds(self) -> float:
        return self._costs.prefill_chunk / self._costs.prefill_tokens_per_second

    def _read(self, prompt: int) -> Process:
        """One request at a time and GPU: the line moves at the speed of all, a request at that of one."""
        self._change_reading(1)
        with self._line.request() as place:
            yield place
            iteration = self._iteration(len(self._writing) / self._gpus) + self._chunk_seconds()
            seconds = prompt / self._costs.prefill_chunk * iteration / self._pace
            yield self._env.timeout(seconds / self._gpus)
        if self._gpus > 1:
            yield self._env.timeout(seconds * (1 - 1 / self._gpus))
        self._change_reading(-1)

    def _change_reading(self, by: int) -> None:
        self._advance()
        self._reading += by
        self._plan()

    def _speed(self) -> float:
        """Tokens per second of every reply."""
        iteration = self._iteration(max(1.0, len(self._writing) / self._gpus))
        reading = min(1.0, self._reading / self._gpus)
        speed = (1 - reading) / iteration + reading / (iteration + self._chunk_seconds())
        return speed * self._pace

    def _advance(self) -> None:
        if self._writing:
            self._written += (self._env.now - self._since) * self._speed()
        self._since = self._env.now

    def _start(self, tokens: float, done: simpy.Event) -> None:
        self._changes += 1
        heappush(self._writing, (self._written + tokens, self._changes, done))

    def _plan(self) -> None:
        """Wake up when the next reply is complete, unless something changes before."""
        self._changes += 1
        if self._writing:
            seconds = max(0.0, self._writing[0][0] - self._written) / self._speed()
            wake = self._env.timeout(seconds, self._changes)
            assert wake.callbacks is not None
            wake.callbacks.append(self._finish)

    def _finish(self, wake: simpy.Event) -> None:
        if wake.value != self._changes:
            return
        self._advance()
        self._written, _, done = heappop(self._writing)
        done.succeed()
        if self._waiting:
            self._start(*self._waiting.popleft())
        self._plan()
