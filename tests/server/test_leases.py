"""Leases on their own, without a browser."""

from __future__ import annotations

import asyncio
import hmac
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry
from starlette.requests import Request

from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.errors import LeaseLost, Unauthorized
from webgym.server.callers import Tokens
from webgym.server.http import HttpFrontend
from webgym.server.leases import Leases
from webgym.server.metrics import CallMetrics
from webgym.server.operations import INFO


def idle_slot() -> Slot:
    return Slot(BrowserConfig(), Path("/bin/false"), ProfileRoot(), Egress())


class Taken:
    def __init__(self) -> None:
        self.slots: list[Slot] = []

    async def __call__(self, slot: Slot) -> None:
        self.slots.append(slot)


async def test_the_reaper_takes_back_what_is_not_renewed() -> None:
    taken = Taken()
    leases = Leases(taken)
    leases.start()
    slot = idle_slot()
    lease = leases.grant(slot, 0.05, 60)
    async with asyncio.timeout(2):
        while not taken.slots:
            await asyncio.sleep(0.005)
    assert taken.slots == [slot]
    with pytest.raises(LeaseLost):
        leases.check(lease.id, lease.secret, "1")
    assert (len(leases), leases.expired) == (0, 1)
    await leases.stop()


async def test_a_working_lease_is_not_reaped() -> None:
    taken = Taken()
    leases = Leases(taken)
    leases.start()
    lease = leases.grant(idle_slot(), 0.05, 60)

    async def work() -> str:
        await asyncio.sleep(0.3)
        return "done"

    assert await lease.run(work) == "done"
    assert taken.slots == []
    await leases.stop()
    assert len(taken.slots) == 1


async def test_ending_a_lease_cuts_its_call_off_and_refuses_those_in_line() -> None:
    taken = Taken()
    leases = Leases(taken)
    lease = leases.grant(idle_slot(), 60, 60)
    touched: list[str] = []

    async def work() -> None:
        touched.append("begun")
        await asyncio.Event().wait()

    calls = [asyncio.create_task(lease.run(work)) for _ in range(3)]
    while not touched:
        await asyncio.sleep(0)
    await leases.end(lease)
    results = await asyncio.gather(*calls, return_exceptions=True)
    assert all(isinstance(result, LeaseLost) for result in results)
    assert touched == ["begun"]
    assert len(taken.slots) == 1


async def test_a_lost_caller_does_not_undo_an_ending() -> None:
    gone = asyncio.Event()

    async def slow(_: Slot) -> None:
        await asyncio.sleep(0.05)
        gone.set()

    leases = Leases(slow)
    lease = leases.grant(idle_slot(), 60, 60)
    ending = asyncio.create_task(leases.end(lease))
    await asyncio.sleep(0)
    ending.cancel()
    async with asyncio.timeout(2):
        await gone.wait()
    await leases.stop()


async def test_generations_count_up() -> None:
    leases = Leases(Taken(), "w7")
    one, two = idle_slot(), idle_slot()
    granted = [leases.grant(slot, 60, 60) for slot in (one, one, two)]
    assert [lease.generation for lease in granted] == [1, 2, 3]
    assert all(lease.id.startswith("w7-") for lease in granted)
    await leases.stop()


async def test_a_session_ends_on_time_even_while_it_works() -> None:
    """Its life is shorter than its time to live, and a call runs."""
    taken = Taken()
    leases = Leases(taken)
    leases.start()
    lease = leases.grant(idle_slot(), 60, 0.1)

    async def work() -> None:
        await asyncio.Event().wait()

    async with asyncio.timeout(100):
        with pytest.raises(LeaseLost):
            await lease.run(work)
        while not taken.slots:
            await asyncio.sleep(0.005)
    await leases.stop()


async def test_what_goes_wrong_with_taking_back_is_said(caplog: pytest.LogCaptureFixture) -> None:
    async def fails(_: Slot) -> None:
        raise ValueError("no such thing")

    leases = Leases(fails)
    await leases.end(leases.grant(idle_slot(), 60, 60))
    await leases.stop()
    assert "no such thing" in caplog.text


async def test_secrets_are_compared_in_constant_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """And there is no other comparison that they meet first."""
    compared: list[object] = []

    def never(one: bytes, other: bytes) -> bool:
        compared.append((one, other))
        return False

    leases = Leases(Taken())
    lease = leases.grant(idle_slot(), 60, 60)
    front = HttpFrontend(Tokens("a-token-for-tests-only"), 100, "", CallMetrics(CollectorRegistry()))
    header = [(b"authorization", b"Bearer a-token-for-tests-only")]
    request = Request({"type": "http", "headers": header})
    front.admit(INFO, request)
    monkeypatch.setattr(hmac, "compare_digest", never)
    with pytest.raises(LeaseLost):
        leases.check(lease.id, lease.secret, "1")
    with pytest.raises(Unauthorized):
        front.admit(INFO, request)
    assert compared == [(lease.secret.encode(), lease.secret.encode()), (header[0][1], header[0][1])]
    await leases.stop()


async def test_a_renewal_does_not_outlast_the_session() -> None:
    leases = Leases(Taken())
    lease = leases.grant(idle_slot(), 60, 10)
    assert lease.renew() == pytest.approx(10, abs=1)
    await leases.stop()
