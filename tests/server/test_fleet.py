"""Keeping workers running, whatever a start or a stop raises: with stand-ins for the processes."""

from __future__ import annotations

import asyncio
import errno
import os
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager

import pytest

from webgym.core.errors import ServerError
from webgym.server.callers import Audit
from webgym.server.config import GatewayConfig, ServerConfig
from webgym.server.fleet import Fleet, Host, Started, Worker
from webgym.server.gateway import Gateway, _running_fleet
from webgym.server.messages import ServerInfo, SlotLoad, Watched

TOKEN = "a-token-for-tests-only"
_CONFIG = GatewayConfig(restart_seconds=(0.01, 0.01), silent_seconds=0.2, answer_seconds=0.1)


def _no_process() -> OSError:
    return OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))


class Machine:
    """A machine of two workers, on which starting and stopping may fail."""

    id = place = "a machine"
    shares = (ServerConfig(slots=1), ServerConfig(slots=1))

    def __init__(self) -> None:
        self.fails_to_start: Callable[[], Exception] | None = None
        self.fails_to_stop: Callable[[], Exception] | None = None
        self.failed = 0
        self.stops: dict[str, bool] = {}

    async def start(self, config: ServerConfig) -> Started:
        if self.fails_to_start is not None:
            self.failed += 1
            raise self.fails_to_start()
        return Started("http://127.0.0.1:1", "", ServerInfo("", 1, "", "", sandboxed=True, sandbox_reason=""))

    async def stop(self, name: str, *, at_once: bool) -> None:
        self.stops[name] = at_once
        if self.fails_to_stop is not None:
            raise self.fails_to_stop()

    async def changes(self) -> AsyncIterator[Collection[Host]]:
        yield (self,)
        await asyncio.Event().wait()


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> dict[str, asyncio.Event]:
    """Ends the workers of these names. They report once, and nothing answers at their address."""
    ends: dict[str, asyncio.Event] = {}

    async def watch(worker: Worker, _: float) -> AsyncIterator[Watched]:
        end = ends.setdefault(worker.name, asyncio.Event())
        yield Watched(0, 0, SlotLoad(1, 1, 0, 0, 0), (), is_healthy=True)
        await end.wait()
        raise TimeoutError

    monkeypatch.setattr(Worker, "watch", watch)
    return ends


@asynccontextmanager
async def _kept(machine: Machine) -> AsyncIterator[Fleet]:
    fleet = Fleet(machine, _CONFIG, TOKEN, lambda _: None)
    keeping = asyncio.create_task(fleet.run())
    try:
        if machine.fails_to_start is None:
            await _until(fleet, "w1", "w2")
        yield fleet
        assert not keeping.done(), keeping
    finally:
        keeping.cancel()
        async with asyncio.timeout(100):
            await asyncio.wait({keeping})


async def _until(fleet: Fleet, *names: str) -> None:
    async with asyncio.timeout(100):
        while set(fleet.workers) != set(names):
            await asyncio.sleep(0.005)


async def test_a_start_that_the_system_refuses_is_tried_again_and_costs_no_other_worker(
    ends: dict[str, asyncio.Event],
) -> None:
    machine = Machine()
    async with _kept(machine) as fleet:
        machine.fails_to_start = _no_process
        ends["w1"].set()
        async with asyncio.timeout(100):
            while machine.failed < 2:
                await asyncio.sleep(0.005)
        assert set(fleet.workers) == {"w2"}
        machine.fails_to_start = None
        await _until(fleet, "w2", f"w{3 + machine.failed}")


async def test_a_worker_that_is_not_stopped_in_order_is_started_again(ends: dict[str, asyncio.Event]) -> None:
    machine = Machine()
    async with _kept(machine) as fleet:
        machine.fails_to_stop = _no_process
        ends["w1"].set()
        await _until(fleet, "w2", "w3")


async def test_a_worker_that_is_lost_is_killed_and_others_stop_in_order(
    ends: dict[str, asyncio.Event],
) -> None:
    machine = Machine()
    async with _kept(machine) as fleet:
        ends["w1"].set()
        await _until(fleet, "w2", "w3")
    assert machine.stops == {"w1": True, "w2": False, "w3": False}


async def test_where_no_process_can_be_had_it_is_said_as_an_error_of_ours() -> None:
    machine = Machine()
    machine.fails_to_start = _no_process
    async with _kept(machine) as fleet:
        with pytest.raises(ServerError, match="a worker did not start: BlockingIOError"):
            await fleet.ready()


async def test_a_gateway_that_keeps_no_worker_running_any_more_ends(
    ends: dict[str, asyncio.Event],
) -> None:
    gateway = Gateway(ServerConfig(), _CONFIG, Machine(), TOKEN, Audit())

    async def serve() -> None:
        async with asyncio.timeout(100), _running_fleet(gateway):
            await _until(gateway.fleet, "w1", "w2")
            gateway.fleet._on_change = lambda _: 1 / 0  # type: ignore[assignment]
            ends["w1"].set()
            await asyncio.Event().wait()

    with pytest.raises(ServerError, match="ended all workers"):
        await serve()
