"""Simulates episodes that share browsers, processors and GPUs, under one of three schedules.

The simulated resources are processors with queues, and GPUs with continuous batching.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Generator
from heapq import heappop, heappush
from typing import Any, TypeAlias

import msgspec
import simpy

from webgym.simulate.config import Costs, Demand, Queues, System, Workload, demand, draw_steps


class Trace(msgspec.Struct, frozen=True):
    """Load over time, in equal intervals.

    Attributes:
        seconds: since the start.
        cpu: share of processors in use.
        policy: number of requests to the policy, including waiting ones.
    """

    seconds: list[float]
    cpu: list[float]
    policy: list[float]


class SimulationResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a simulation.

    Attributes:
        seconds: until the last verdict and the last update.
        steps: total number of steps.
        cut: number of trajectories that the straggler rule ended.
        cpu_seconds: processor time in use.
        gpu_seconds: GPU time for the same work at full batches.
        cpus, gpus: their numbers.
        steady: the steady part: from the time when as many episodes had ended as there are environments,
            until the last episode started; ``None`` if there is none.
        trace: if requested.
    """

    seconds: float
    steps: int
    cut: int
    cpu_seconds: float
    gpu_seconds: float
    cpus: int
    gpus: float
    steady: SimulationResult | None = None
    trace: Trace | None = None

    @property
    def rate(self) -> float:
        """Steps per second."""
        return self.steps / self.seconds

    @property
    def cpu(self) -> float:
        """Utilisation of the processors."""
        return self.cpu_seconds / (self.seconds * self.cpus)

    @property
    def gpu(self) -> float:
        """Utilisation of the GPUs, relative to full batches."""
        return self.gpu_seconds / (self.seconds * self.gpus)

    def until(self, later: SimulationResult) -> SimulationResult | None:
        """The difference to a later state of the same simulation; ``None`` if no time passed."""
        names = ("seconds", "steps", "cut", "cpu_seconds", "gpu_seconds")
        passed = {name: getattr(later, name) - getattr(self, name) for name in names}
        return msgspec.structs.replace(self, **passed) if passed["seconds"] > 0 else None


class _Run:
    def __init__(self, system: System, costs: Costs, workload: Workload) -> None:
        self.env = simpy.Environment()
        self.system, self.costs, self.workload = system, costs, workload
        self.total = workload.trajectories * system.iterations
        self.lengths = draw_steps(workload, self.total)
        self.cpus = Processors(self.env, system.cpus, system.queues)
        self.gpus = Inference(self.env, system.gpus, costs)
        self.judges = simpy.Resource(self.env, system.judges or system.sessions)
        self.remaining = iter(range(self.total))
        self.started = 0
        self.steps = 0
        self.cut = 0
        self.last_call: float | None = None
        self.ended = 0
        self.steady: list[SimulationResult] = []
        """States at the start and the end of the steady part."""
        self.per_iteration = [0] * system.iterations
        self.collected = [self.env.event() for _ in range(system.iterations)]
        self.published = [self.env.event() for _ in range(system.iterations)]

    # --- the parts of an episode ---------------------------------------------------------------------------

    def _take(self) -> int | None:
        number = next(self.remaining, None)
        if number is not None:
            self.started += 1
            if self.started == self.total:
                self.steady.append(self._current_result())
        return number

    def _begin(self, number: int) -> Process:
        """Wait for sufficiently recent weights and a new browser."""
        needed = number // self.workload.trajectories - 1 - self.system.staleness
        if needed >= 0:
            yield self.published[needed]
        yield from self.cpus.use("open", self.costs.open_cpu)

    def _observe(self, needs: Demand, step: int) -> Process:
        yield from self.cpus.use("act", needs.act_cpu[step])
        yield self.env.timeout(needs.page[step])
        yield from self.cpus.use("look", needs.look_cpu[step])

    def _end(self) -> None:
        self.ended += 1
        system = self.system
        if self.ended == system.sessions:
            self.steady.append(self._current_result())
        if self.last_call is None and self.ended >= system.straggler_share * self.total:
            self.last_call = self.env.now + system.straggler_seconds

    def _judge(self, number: int) -> Process:
        """Wait for a free judge; the verdict is then made while the browser takes the next task."""
        request = self.judges.request()
        yield request
        self.env.process(self._verdict(number, request))

    def _verdict(self, number: int, request: simpy.resources.resource.Request) -> Process:
        yield self.env.timeout(self.costs.judge_seconds)
        self.judges.release(request)
        iteration = number // self.workload.trajectories
        self.per_iteration[iteration] += 1
        if self.per_iteration[iteration] == self.workload.trajectories:
            self.collected[iteration].succeed()

    def _train(self) -> Process:
        for collected, published in zip(self.collected, self.published, strict=True):
            yield collected
            yield self.env.timeout(self.costs.train_seconds)
            published.succeed()

    # --- the schedules -------------------------------------------------------------------------------------

    def _episode(self, number: int) -> Process:
        yield from self._begin(number)
        needs = demand(self.workload, self.costs, number, int(self.lengths[number]))
        is_async = self.system.schedule == "async"
        for step in range(needs.steps):
            yield from self._observe(needs, step)
            if is_async and self.last_call is not None and self.env.now > self.last_call:
                self.cut += 1
                break
            yield from self.gpus.reply(needs.tokens[step])
            self.steps += 1
        self._end()
        yield from self._judge(number)

    def _environment(self) -> Process:
        while (number := self._take()) is not None:
            yield from self._episode(number)

    def _group(self, most: int) -> list[int]:
        numbers = (self._take() for _ in range(most))
        return [number for number in numbers if number is not None]

    def _episode_barrier(self) -> Process:
        while group := self._group(self.system.sessions):
            yield self.env.all_of([self.env.process(self._episode(number)) for number in group])

    def _step_barrier(self) -> Process:
        env, system = self.env, self.system
        playing: list[tuple[int, Demand, int]] = []
        while True:
            if system.refills or not playing:
                joining = self._group(system.sessions - len(playing))
                yield env.all_of([env.process(self._begin(number)) for number in joining])
                for number in joining:
                    needs = demand(self.workload, self.costs, number, int(self.lengths[number]))
                    playing.append((number, needs, 0))
            if not playing:
                return
            yield env.all_of([env.process(self._observe(needs, step)) for _, needs, step in playing])
            replies = (self.gpus.reply(needs.tokens[step]) for _, needs, step in playing)
            yield env.all_of([env.process(reply) for reply in replies])
            self.steps += len(playing)
            for number, needs, step in playing:
                if step + 1 == needs.steps:
                    self._end()
                    env.process(self._judge(number))
            playing = [(n, needs, step + 1) for n, needs, step in playing if step + 1 < needs.steps]

    def carry_out(self, trace_seconds: float | None) -> SimulationResult:
        env, system = self.env, self.system
        if system.schedule == "async":
            for _ in range(min(system.sessions, self.total)):
                env.process(self._environment())
        else:
            env.process(
                self._episode_barrier() if system.schedule == "episode_barrier" else self._step_barrier()
            )
        last = env.process(self._train())
        samples: list[tuple[float, float, float]] = []
        if trace_seconds is not None:
            env.process(self._watch(trace_seconds, samples, last))
        env.run(last)
        result = self._current_result()
        if len(self.steady) == 2:
            result = msgspec.structs.replace(result, steady=self.steady[0].until(self.steady[1]))
        if samples:
            result = msgspec.structs.replace(result, trace=Trace(*map(list, zip(*samples, strict=True))))
        return result

    def _current_result(self) -> SimulationResult:
        system = self.system
        return SimulationResult(
            seconds=self.env.now,
            steps=self.steps,
            cut=self.cut,
            cpu_seconds=self.cpus.busy_seconds,
            gpu_seconds=self.gpus.work_seconds,
            cpus=system.cpus,
            gpus=system.gpus,
        )

    def _watch(self, every: float, samples: list[tuple[float, float, float]], last: simpy.Event) -> Process:
        while not last.triggered:
            samples.append((self.env.now, self.cpus.busy / self.system.cpus, float(self.gpus.requests)))
            yield self.env.timeout(every)


def simulate(
    system: System, costs: Costs, workload: Workload, *, trace_seconds: float | None = None
) -> SimulationResult:
    """Simulate a workload.

    Args:
        system: the simulated system.
        costs: durations of operations.
        workload: the trajectories to collect.
        trace_seconds: interval of the trace's samples; ``None`` for no trace.
    """
    return _Run(system, costs, workload).carry_out(trace_seconds)


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
