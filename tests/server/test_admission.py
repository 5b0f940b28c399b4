"""Run permits and queues on their own, without a browser."""

from __future__ import annotations

import asyncio
import errno
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, contextmanager
from typing import Any, TypeVar

import pytest

from webgym.server.admission import AdmissionController, Processors
from webgym.server.config import Admission
from webgym.server.operations import QueueName

FEW = Admission(fewest=2, most=6, step=1)


@pytest.fixture(autouse=True)
def _measured_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.server.admission.MEASURE_SECONDS", 0.01)


class Machine(Processors):
    """Processors whose load the test decides."""

    def __init__(self, share: float) -> None:
        super().__init__()
        self.share = share

    def busy(self) -> float:
        return self.share


class Calls:
    """Calls that hold their permit until they are let go."""

    def __init__(self, gate: AdmissionController) -> None:
        self.gate = gate
        self.order: list[str] = []
        self._release = asyncio.Event()

    async def one(self, queue: QueueName, name: str) -> None:
        async with self.gate.permit(queue):
            self.order.append(name)
            await self._release.wait()

    def let_go(self) -> None:
        self._release.set()


@asynccontextmanager
async def ten_calls(gate: AdmissionController) -> AsyncIterator[None]:
    """Ten calls, which hold their permits until the block ends."""
    calls = Calls(gate)
    async with asyncio.TaskGroup() as group:
        for number in range(10):
            group.create_task(calls.one("execute", str(number)))
        yield
        calls.let_go()


@asynccontextmanager
async def keeper(config: Admission, busy: float = 1.0) -> AsyncIterator[AdmissionController]:
    gate = AdmissionController(config, Machine(busy))
    try:
        yield gate
    finally:
        await gate.stop()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(100):
        while not condition():
            await asyncio.sleep(0.001)


async def test_permits_are_limited_and_each_queue_is_served_in_order() -> None:
    async with keeper(FEW) as gate, asyncio.TaskGroup() as group:
        calls = Calls(gate)
        tasks = [group.create_task(calls.one("execute", str(number))) for number in range(5)]
        await until(lambda: gate.load["execute"].waiting == 3)
        assert (gate.load["execute"].running, gate.permits.running) == (2, 2)
        tasks[3].cancel()
        await until(lambda: gate.load["execute"].waiting == 2)
        calls.let_go()
        await until(lambda: len(calls.order) == 4)
        assert calls.order == ["0", "1", "2", "4"]
    load = gate.load["execute"]
    assert (load.running, load.waiting, load.done, gate.permits.running) == (0, 0, 4, 0)


async def _burst(config: Admission) -> str:
    """Twenty navigations come before three screenshots; who was served, in order."""
    async with keeper(config) as gate, asyncio.TaskGroup() as group:
        calls = Calls(gate)
        for _ in range(20):
            group.create_task(calls.one("navigate", "n"))
        await until(lambda: gate.load["navigate"].waiting == 18)
        for _ in range(3):
            group.create_task(calls.one("screenshot", "s"))
        await until(lambda: gate.load["screenshot"].waiting == 3)
        calls.let_go()
        await until(lambda: len(calls.order) == 23)
    return "".join(calls.order)


async def test_a_burst_of_one_type_starves_no_other() -> None:
    order = await _burst(FEW)
    assert order.rindex("s") <= 8, order


async def test_one_line_for_all_serves_by_arrival() -> None:
    order = await _burst(FEW.model_copy(update={"queues": "global"}))
    assert order == "n" * 20 + "s" * 3


async def test_more_run_while_the_processors_have_time_to_spare() -> None:
    async with keeper(FEW, busy=0.1) as gate, ten_calls(gate):
        await until(lambda: gate.permits.running == FEW.most)
        assert gate.load["execute"].waiting == 10 - FEW.most


async def test_fewer_run_once_the_processors_are_saturated() -> None:
    machine = Machine(0.1)
    gate = AdmissionController(FEW, machine)
    async with ten_calls(gate):
        await until(lambda: gate.permits.limit == FEW.most)
        machine.share = 1.0
        await until(lambda: gate.permits.limit == FEW.fewest)
    await gate.stop()


async def test_a_load_that_cannot_be_read_for_a_while_is_measured_later(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    machine = Machine(0.1)
    failed = 0

    def no_file() -> float:
        nonlocal failed
        failed += 1
        raise OSError(errno.EMFILE, "no files")

    monkeypatch.setattr(machine, "busy", no_file)
    gate = AdmissionController(FEW, machine)
    async with ten_calls(gate):
        await until(lambda: failed >= 3)
        assert gate.permits.limit == FEW.fewest
        monkeypatch.undo()
        await until(lambda: gate.permits.limit == FEW.most)
    await gate.stop()
    assert caplog.text.count("no files") == 1


async def test_a_call_that_is_cancelled_as_its_turn_comes_leaves_no_permit_behind() -> None:
    async with keeper(Admission(fewest=1, most=1)) as gate:
        for _ in range(50):
            first, second = Calls(gate), Calls(gate)
            a = asyncio.create_task(first.one("execute", "a"))
            b = asyncio.create_task(second.one("metadata", "b"))
            await until(lambda: gate.load["metadata"].waiting == 1)
            first.let_go()
            await asyncio.sleep(0)
            b.cancel()
            await asyncio.gather(a, b, return_exceptions=True)
            assert gate.permits.running == 0


# --- service time, on a clock of the test's ---------------------------------------------------------

T = TypeVar("T")


class VirtualLoop(asyncio.SelectorEventLoop):
    """Time passes only when everybody waits for it."""

    def __init__(self) -> None:
        super().__init__()
        self._now = 0.0
        selector: Any = self._selector  # type: ignore[attr-defined]
        select = selector.select

        def jump(timeout: float | None = None) -> Any:
            self._now += timeout or 0.0
            return select(0)

        selector.select = jump

    def time(self) -> float:
        return self._now


def in_virtual_time(job: Coroutine[Any, Any, T]) -> T:
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(job)


NAVIGATION, SCREENSHOT = 1 / 60, 1 / 30
"""Seconds of the one processor in the paper's toy: 60 navigations a second, a screenshot twice as dear."""


async def _toy(queues: Any, seconds: int, *, in_whole_seconds: bool) -> list[tuple[int, int]]:
    """180 agents navigate at t = 0 and look when they are told that they are there. Navigations and
    screenshots that come back in each second.

    Args:
        in_whole_seconds: results are handed over once a second, as the paper counts them.
    """
    gate = AdmissionController(Admission(queues=queues, fewest=1, most=1), Machine(1.0))
    loop = asyncio.get_running_loop()
    back = [[0, 0] for _ in range(1000)]

    async def call(kind: int, queue: QueueName, takes: float) -> None:
        async with gate.permit(queue):
            await asyncio.sleep(takes)
        back[int(loop.time() - 1e-9)][kind] += 1

    async def agent() -> None:
        await call(0, "navigate", NAVIGATION)
        if in_whole_seconds:
            await asyncio.sleep(int(loop.time() - 1e-9) + 1 - loop.time())
        await call(1, "screenshot", SCREENSHOT)

    agents = [asyncio.create_task(agent()) for _ in range(180)]
    await asyncio.sleep(seconds + 1e-6)
    for task in agents:
        task.cancel()
    await asyncio.gather(*agents, return_exceptions=True)
    await gate.stop()
    assert gate.permits.running == 0
    return [(navigations, screenshots) for navigations, screenshots in back[:seconds]]


def test_the_papers_toy_with_one_queue_for_all_gives_the_gpu_nothing() -> None:
    assert in_virtual_time(_toy("global", 3, in_whole_seconds=True)) == [(60, 0), (60, 0), (60, 0)]
    assert in_virtual_time(_toy("global", 2, in_whole_seconds=False)) == [(60, 0), (60, 0)]


def test_the_papers_toy_with_a_queue_per_operation() -> None:
    back = in_virtual_time(_toy("per_operation", 3, in_whole_seconds=True))
    assert back == [(60, 0), (30, 15), (30, 15)]
    # Handed over at once, the halves of the processor are the same from the first navigation on.
    [*_, second] = in_virtual_time(_toy("per_operation", 2, in_whole_seconds=False))
    assert second in [(30, 15), (29, 15), (31, 15), (30, 14)]


def test_dear_calls_get_no_more_time_than_cheap_ones_and_idleness_earns_no_credit() -> None:
    async def both() -> tuple[dict[str, int], list[str]]:
        gate = AdmissionController(Admission(fewest=2, most=2), Machine(1.0))
        order: list[str] = []

        async def call(queue: QueueName, takes: float) -> None:
            async with gate.permit(queue):
                order.append(queue)
                await asyncio.sleep(takes)

        calls = [asyncio.create_task(call("navigate", 0.7)) for _ in range(100)]
        calls += [asyncio.create_task(call("metadata", 0.1)) for _ in range(700)]
        await asyncio.sleep(35)
        served = {name: load.served_milliseconds for name, load in gate.load.items()}
        began = len(order)  # screenshots were never asked for so far
        calls += [asyncio.create_task(call("screenshot", 0.1)) for _ in range(100)]
        await asyncio.sleep(3)
        for each in calls:
            each.cancel()
        await asyncio.gather(*calls, return_exceptions=True)
        await gate.stop()
        return served, order[began:]

    served, after = in_virtual_time(both())
    assert served["navigate"] == pytest.approx(served["metadata"], rel=0.05)
    # A third of 6 s of two permits: 20 calls of 0.1 s, not all that it could have had before.
    assert 15 <= after.count("screenshot") <= 25


def test_a_step_gives_its_place_back_between_acting_and_looking() -> None:
    """Stopped while somebody else has the place, and not for a moment if nobody wants it."""

    async def steps(others: int) -> tuple[list[str], float]:
        gate = AdmissionController(Admission(fewest=1, most=1), Machine(1.0))
        told: list[str] = []

        @contextmanager
        def stopped() -> Any:
            told.append("stopped")
            yield
            told.append("goes on")

        async def other() -> None:
            async with gate.permit("screenshot"):
                told.append("other")
                await asyncio.sleep(1)

        async def step() -> float:
            async with gate.permit("execute") as permit:
                await asyncio.sleep(1)
                await permit.exchange("screenshot", stopped)
                told.append("looks")
            return permit.waited

        stepping = asyncio.create_task(step())
        await asyncio.sleep(0.5)
        async with asyncio.TaskGroup() as group:
            for _ in range(others):
                group.create_task(other())
            waited = await stepping
        await gate.stop()
        assert gate.permits.running == 0
        assert (gate.load["execute"].done, gate.load["screenshot"].done) == (1, others + 1)
        return told, waited

    assert in_virtual_time(steps(0)) == (["looks"], 0.0)
    told, waited = in_virtual_time(steps(1))
    assert told == ["stopped", "other", "goes on", "looks"]
    assert waited == pytest.approx(1.0)


@pytest.mark.parametrize("cancelled_after", [0.5, 1.5, 2.5])
def test_a_step_that_is_cancelled_anywhere_leaves_no_permit_behind(cancelled_after: float) -> None:
    async def step() -> None:
        gate = AdmissionController(Admission(fewest=1, most=1), Machine(1.0))

        @contextmanager
        def stopped() -> Any:
            yield

        async def call(*, exchanged: bool) -> None:
            async with gate.permit("execute") as permit:
                await asyncio.sleep(1)
                if exchanged:
                    await permit.exchange("screenshot", stopped)
                    await asyncio.sleep(1)

        one = asyncio.create_task(call(exchanged=True))
        await asyncio.sleep(0)
        two = asyncio.create_task(call(exchanged=False))
        await asyncio.sleep(cancelled_after)
        one.cancel()
        await asyncio.gather(one, two, return_exceptions=True)
        await gate.stop()
        assert gate.permits.running == 0
        assert sum(load.running + load.waiting for load in gate.load.values()) == 0

    in_virtual_time(step())


async def test_the_share_of_busy_processors_is_measured() -> None:
    processors = Processors()

    def spin(seconds: float) -> float:
        end = asyncio.get_running_loop().time() + seconds
        while asyncio.get_running_loop().time() < end:
            pass
        return processors.busy()

    busy = spin(0.3)
    cores = len(processors.affinity)
    assert 0.5 / cores <= busy <= 1.0
