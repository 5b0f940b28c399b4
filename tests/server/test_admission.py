"""Run permits and queues on their own, without a browser."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from webgym.server.admission import Gatekeeper
from webgym.server.config import Admission
from webgym.server.operations import QueueName
from webgym.server.saturation import Processors

FEW = Admission(fewest=2, most=6, step=1, measure_seconds=0.01)


class Machine(Processors):
    """Processors whose load the test decides."""

    def __init__(self, share: float) -> None:
        super().__init__()
        self.share = share

    def busy(self) -> float:
        return self.share


class Calls:
    """Calls that hold their permit until they are let go."""

    def __init__(self, gate: Gatekeeper) -> None:
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
async def keeper(config: Admission, busy: float = 1.0) -> AsyncIterator[Gatekeeper]:
    gate = Gatekeeper(config, Machine(busy))
    try:
        yield gate
    finally:
        await gate.stop()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(5):
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
    order = await _burst(FEW.model_copy(update={"order": "global"}))
    assert order == "n" * 20 + "s" * 3


async def test_more_run_while_the_processors_have_time_to_spare() -> None:
    async with keeper(FEW, busy=0.1) as gate, asyncio.TaskGroup() as group:
        calls = Calls(gate)
        for number in range(10):
            group.create_task(calls.one("execute", str(number)))
        await until(lambda: gate.permits.running == FEW.most)
        assert gate.load["execute"].waiting == 10 - FEW.most
        calls.let_go()


async def test_fewer_run_once_the_processors_are_saturated() -> None:
    machine = Machine(0.1)
    gate = Gatekeeper(FEW, machine)
    async with asyncio.TaskGroup() as group:
        calls = Calls(gate)
        for number in range(10):
            group.create_task(calls.one("execute", str(number)))
        await until(lambda: gate.permits.limit == FEW.most)
        machine.share = 1.0
        await until(lambda: gate.permits.limit == FEW.fewest)
        calls.let_go()
    await gate.stop()


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


async def test_the_share_of_busy_processors_is_measured() -> None:
    processors = Processors()

    def spin(seconds: float) -> float:
        end = asyncio.get_running_loop().time() + seconds
        while asyncio.get_running_loop().time() < end:
            pass
        return processors.busy()

    busy = spin(0.3)
    cores = len(processors.ours)
    assert 0.5 / cores <= busy <= 1.0
