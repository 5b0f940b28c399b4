"""The simulated resources: processors with queues, and GPUs with continuous batching."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Generator
from heapq import heappop, heappush
from typing import Any, TypeAlias

import simpy

from webgym.simulate.config import Costs, Queues

Process: TypeAlias = Generator[simpy.Event, Any, None]


class Processors:
    """Processors, each of which runs one operation at a time.

    With a queue per operation, the queues share the processors' time equally: the next operation is from the
    queue with the least service time so far (start-time fair queueing). A queue that was empty starts at the
    level of the others, so that it neither accumulates credit nor is disadvantaged.
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
        """Wait for a processor and use it for ``seconds``."""
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
        """Number of processors in use."""
        return self._count - self._free


class Inference:
    """A fluid model of GPUs that serve the policy with continuous batching.

    Requests are spread evenly. After the prefill of a request, its reply is decoded at the speed of the
    batch: an iteration takes ``decode_seconds``, ``decode_seconds_per_reply`` for each reply, and more if it
    includes a prefill chunk of another request.
    """

    def __init__(self, env: simpy.Environment, gpus: float, costs: Costs) -> None:
        self.work_seconds = 0.0
        """GPU seconds that all work so far would have taken at full batches."""
        self._env = env
        self._gpus, self._pace = (
            max(1.0, gpus),
            min(1.0, gpus),
        )  # a fraction of a GPU is modelled as a slower GPU
        self._costs = costs
        self._reading = 0
        self._prefill_queue = simpy.Resource(env)
        self._writing: list[tuple[float, int, simpy.Event]] = []
        self._waiting: deque[tuple[float, simpy.Event]] = deque()
        self._written = 0.0
        """Tokens that a reply would have by now if it had been decoded since the start of the simulation."""
        self._since = 0.0
        self._changes = 0

    def reply(self, tokens: float) -> Process:
        """Wait until a reply with ``tokens`` tokens is complete."""
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
        """Number of requests that are being processed or wait."""
        return self._reading + len(self._writing) + len(self._waiting)

    def _iteration(self, replies: float) -> float:
        return self._costs.decode_seconds + self._costs.decode_seconds_per_reply * replies

    def _chunk_seconds(self) -> float:
        return self._costs.prefill_chunk / self._costs.prefill_tokens_per_second

    def _read(self, prompt: int) -> Process:
        """Prefill a request: each takes the time of a single GPU; all GPUs together set the throughput."""
        self._change_reading(1)
        with self._prefill_queue.request() as place:
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
        """Tokens per second of each reply."""
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
        """Schedule the completion of the next reply; later changes invalidate it."""
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
