"""Sessions over HTTP: the main path, leases, capacity."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import signal
import time

import httpx
import pytest

from webgym.browser.config import BrowserConfig
from webgym.browser.isolated_worlds import ADDRESS_CHARACTERS
from webgym.core.action import GoBack, LeftClick, Navigate, Press, Scroll, Target, Type, Upload
from webgym.core.errors import BrowserCrashed, LeaseLost, NoCapacity, ProtocolError
from webgym.core.task import Attachment
from webgym.server.admission import AdmissionController
from webgym.server.client import BrowserClient, Session
from webgym.server.config import Admission, ServerConfig
from webgym.server.messages import GENERATION_HEADER, SECRET_HEADER, SessionOptions, StepRequest
from webgym.server.operations import STEP
from webgym.server.worker import RunningServer, running_server

from .conftest import LOCAL, TOKEN, Site, quick

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


async def test_a_whole_session(site: Site, client: BrowserClient) -> None:
    session = await client.open(SessionOptions(mode="marks", text=True))
    view = await session.step(Navigate(site.url()))
    assert view.observation.title == "Home"
    assert view.observation.status == 200
    assert view.observation.mode == "marks"
    assert view.observation.screenshot == hashlib.sha256(view.image).hexdigest()
    assert "Welcome" in (view.observation.text or "")
    [link] = [element for element in view.observation.elements or () if element.role == "link"]
    view = await session.step(LeftClick(Target(element=link.number)))
    assert view.observation.url == site.url("/next")
    view = await session.step(GoBack())
    view = await session.step(Scroll("down"))
    assert view.observation.scroll[0] > 0
    turns = {"queued", "queued_screenshot"}
    assert set(view.observation.milliseconds) == {"execute", "settle", "metadata", "screenshot"} | turns
    await session.close()
    await session.close()
    with pytest.raises(LeaseLost):
        await session.step()


async def test_extended_actions_and_files_travel(site: Site, client: BrowserClient) -> None:
    files = (Attachment("photo.png", data=bytes(range(256))),)
    session = await client.open(SessionOptions(mode="marks", files=files))
    view = await session.step(Navigate(site.url("/file")))
    [field] = view.observation.elements or ()
    view = await session.step(Upload(Target(element=field.number), ("photo.png",)))
    assert view.observation.title == "photo.png"
    view = await session.step(Press(("Bogus",)))
    assert [notice.kind for notice in view.observation.notices] == ["action_failed"]
    await session.close()


async def test_the_parts_of_a_step_on_their_own(site: Site, session: Session) -> None:
    told = await session.navigate(site.url())
    assert (told.title, told.status, told.settled) == ("Home", 200, "quiet")
    told = await session.execute(Type(Target(coordinate=(5, 5)), "nothing there"))
    assert told.title == "Home"
    assert (await session.metadata()).url == site.url()
    assert (await session.screenshot()).startswith(b"\x89PNG")
    assert (await session.heartbeat()).ttl_seconds == pytest.approx(60, abs=1)
    view = await session.step()
    assert [notice.kind for notice in view.observation.notices] == ["action_failed"], "kept for the next look"


async def test_an_unchanged_picture_is_sent_once(site: Site, session: Session, server: RunningServer) -> None:
    await session.step(Navigate(site.url()))
    first = await session.step()
    second = await session.step()
    assert second.image is first.image
    grant = session.grant
    headers = {"authorization": f"Bearer {TOKEN}", SECRET_HEADER: grant.secret, GENERATION_HEADER: "1"}
    headers[GENERATION_HEADER] = str(grant.generation)
    async with httpx.AsyncClient(headers=headers, trust_env=False, timeout=60) as http:
        url = f"{server.url}/v1/sessions/{session.id}/step"
        whole = await http.post(url, json={})
        known = await http.post(url, json={"have": [first.observation.screenshot]})
    assert len(whole.content) - len(known.content) >= len(first.image)


async def test_pictures_are_jpeg_where_that_is_asked_for(
    site: Site, client: BrowserClient, server: RunningServer
) -> None:
    session = await client.open(SessionOptions(jpeg_quality=60))
    view = await session.step(Navigate(site.url()))
    assert view.image.startswith(b"\xff\xd8\xff")
    assert view.observation.screenshot == hashlib.sha256(view.image).hexdigest()
    assert (await session.step()).observation.screenshot == view.observation.screenshot, "nothing changed"
    headers = {"authorization": f"Bearer {TOKEN}", SECRET_HEADER: session.grant.secret}
    headers[GENERATION_HEADER] = str(session.grant.generation)
    async with httpx.AsyncClient(headers=headers, trust_env=False, timeout=60) as http:
        bare = await http.post(f"{server.url}/v1/sessions/{session.id}/screenshot")
    assert bare.headers["content-type"] == "image/jpeg"
    await session.close()


@pytest.mark.parametrize(
    "options",
    [
        *(SessionOptions(jpeg_quality=quality) for quality in (0, 101, -1)),
        *(SessionOptions(capture_scale=scale) for scale in (0.2, 1.1)),
    ],
)
async def test_an_impossible_picture(client: BrowserClient, options: SessionOptions) -> None:
    with pytest.raises(ProtocolError):
        await client.open(options)


async def test_sessions_share_no_state_and_calls_do_not_overlap(site: Site, client: BrowserClient) -> None:
    one, two = await asyncio.gather(client.open(), client.open())
    await asyncio.gather(one.navigate(site.url("/counter")), two.navigate(site.url("/counter")))
    click = LeftClick(Target(coordinate=(20, 20)))
    await asyncio.gather(*(one.execute(click) for _ in range(4)), two.execute(click))
    assert [(await one.metadata()).title, (await two.metadata()).title] == ["4", "1"]
    await asyncio.gather(one.close(), two.close())


async def test_when_all_slots_are_taken(client: BrowserClient) -> None:
    sessions = [await client.open() for _ in range(2)]
    with pytest.raises(NoCapacity, match="2 slots"):
        await client.open(SessionOptions(wait_seconds=0.1))
    waiting = asyncio.create_task(client.open())
    while not (await client.pressure()).slots.waiting:
        await asyncio.sleep(0.01)
    await sessions[0].close()
    third = await waiting
    await asyncio.gather(sessions[1].close(), third.close())


async def test_a_caller_that_leaves_the_line_takes_no_slot(
    client: BrowserClient, server: RunningServer
) -> None:
    sessions = [await client.open() for _ in range(2)]
    waiting = asyncio.create_task(client.open())
    while not (await client.pressure()).slots.waiting:
        await asyncio.sleep(0.01)
    waiting.cancel()
    while (await client.pressure()).slots.waiting:
        await asyncio.sleep(0.01)
    await asyncio.gather(*(session.close() for session in sessions))
    while (await client.pressure()).slots.free < 2:
        await asyncio.sleep(0.01)
    assert len(server.service.leases) == 0


async def test_an_old_holder_cannot_touch_its_successor(site: Site, client: BrowserClient) -> None:
    other = await client.open()  # so that both below get the same slot
    old = await client.open()
    stale = old.grant
    await old.close()
    new = await client.open()
    await new.navigate(site.url())
    assert new.grant.generation > stale.generation
    forged = [
        stale,
        type(stale)(new.id, stale.secret, new.grant.generation, "", 60),
        type(stale)(new.id, new.grant.secret, stale.generation, "", 60),
        type(stale)(new.id, "", new.grant.generation, "", 60),
        type(stale)("nobody", new.grant.secret, new.grant.generation, "", 60),
    ]
    for grant in forged:
        with pytest.raises(LeaseLost):
            await client.call(STEP, StepRequest(Navigate(site.url("/next"))), grant=grant)
    assert (await new.metadata()).url == site.url()
    await asyncio.gather(other.close(), new.close())


async def test_a_client_gone_without_goodbye_loses_its_lease(site: Site, client: BrowserClient) -> None:
    session = await client.open(SessionOptions(ttl_seconds=0.3))
    with contextlib.suppress(LeaseLost):  # on a busy machine it was not renewed in time
        await session.navigate(site.url())
    await session.abandon()  # the client is dead
    async with asyncio.timeout(100):
        while (await client.pressure()).slots.free < 2:
            await asyncio.sleep(0.02)
    with pytest.raises(LeaseLost):
        await session.metadata()


async def test_an_endless_address_is_not_opened(site: Site, client: BrowserClient) -> None:
    session = await client.open()
    most = BrowserConfig().url_length
    longest = site.url() + "?" + "x" * (most - len(site.url()) - 1)
    shown = longest[:ADDRESS_CHARACTERS]
    assert (await session.navigate(longest)).url == shown
    refused = await session.navigate(longest + "x")
    assert refused.url == shown
    [told] = [notice.text for notice in refused.notices if notice.kind == "navigation_failed"]
    assert f"{most + 1} characters" in told
    await session.close()


async def test_nobody_holds_a_lease_for_longer_than_he_may(client: BrowserClient) -> None:
    session = await client.open(SessionOptions(ttl_seconds=1e9))
    assert session.grant.ttl_seconds == ServerConfig().longest_ttl_seconds
    await session.close()


async def test_a_thinking_model_keeps_its_lease(site: Site, client: BrowserClient) -> None:
    session = await client.open(SessionOptions(ttl_seconds=1))
    await session.navigate(site.url())
    await asyncio.sleep(1.5)  # the model thinks
    assert (await session.metadata()).title == "Home"
    await session.close()


async def test_a_holder_can_ask_how_long_its_call_waits(
    session: Session, server: RunningServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = AdmissionController(Admission(fewest=1, most=1))
    monkeypatch.setattr(server.service, "gate", gate)
    async with asyncio.timeout(60):
        async with gate.permit("navigate"):
            step = asyncio.create_task(session.step())
            while not (waited := (await session.heartbeat()).queued_seconds):
                await asyncio.sleep(0.01)
        told = (await step).observation.milliseconds["queued"]
    assert waited * 1000 <= told == pytest.approx((await session.heartbeat()).queued_seconds * 1000)
    await gate.stop()


async def test_what_a_look_waits_and_takes_is_not_its_actions(
    site: Site, client: BrowserClient, server: RunningServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = await client.open()
    gate = AdmissionController(Admission(fewest=1, most=1))
    monkeypatch.setattr(server.service, "gate", gate)
    async with asyncio.timeout(60):
        started = time.monotonic()
        step = asyncio.create_task(session.step(Navigate(site.url())))
        while not gate.permits.running:
            await asyncio.sleep(0.001)
        async with gate.permit("execute"):  # between acting and looking
            while (waited := (await session.heartbeat()).queued_seconds) < 0.3:
                await asyncio.sleep(0.01)
        seen = (await step).observation
    took = time.monotonic() - started
    assert seen.seconds("queued") < waited <= seen.seconds("queued_screenshot")
    assert seen.own_seconds == pytest.approx(seen.seconds("navigate", "settle", "metadata", "screenshot"))
    loads = {kind: queue.load for kind, queue in client.calls.items()}
    assert [loads[kind].done for kind in ("navigate", "execute", "screenshot", "metadata")] == [1, 0, 1, 1]
    assert loads["screenshot"].waited_seconds == pytest.approx(seen.seconds("queued_screenshot"), abs=1e-5)
    assert loads["screenshot"].served_seconds == pytest.approx(seen.seconds("screenshot"), abs=1e-5)
    assert loads["metadata"].served_seconds == pytest.approx(seen.seconds("metadata"), abs=1e-5)
    unqueued = took - seen.seconds("queued_screenshot")
    assert seen.seconds("navigate", "settle") < loads["navigate"].served_seconds < unqueued
    await session.close()
    await gate.stop()


async def test_a_session_is_closed_while_it_works(site: Site, client: BrowserClient) -> None:
    session = await client.open()
    working = asyncio.create_task(session.navigate(site.url("/held")))
    while not (await client.pressure()).operations["navigate"].running:
        await asyncio.sleep(0.01)
    await session.close()
    with pytest.raises(LeaseLost):
        await working
    async with asyncio.timeout(100):
        while (await client.pressure()).slots.free < 2:
            await asyncio.sleep(0.01)


async def test_a_killed_browser_is_told_and_replaced(
    site: Site, client: BrowserClient, server: RunningServer
) -> None:
    session = await client.open()
    await session.navigate(site.url())
    [slot] = [slot for slot in server.service.pool.slots if slot.is_open]
    assert slot.process is not None
    working = asyncio.create_task(session.navigate(site.url("/held")))
    while not (await client.pressure()).operations["navigate"].running:
        await asyncio.sleep(0.01)
    os.killpg(slot.process.pid, signal.SIGKILL)
    with pytest.raises(BrowserCrashed):
        await working
    with pytest.raises(LeaseLost):
        await session.metadata()
    both = [await client.open() for _ in range(2)]
    for again in both:
        assert (await again.navigate(site.url())).title == "Home"
    await asyncio.gather(*(again.close() for again in both))


async def test_a_browser_that_died_in_line_is_not_handed_out(
    site: Site, client: BrowserClient, server: RunningServer
) -> None:
    for slot in server.service.pool.slots:
        assert slot.process is not None
        os.killpg(slot.process.pid, signal.SIGKILL)
    async with asyncio.timeout(100):
        while any(slot.is_up for slot in server.service.pool.slots):
            await asyncio.sleep(0.01)
    session = await client.open()
    assert (await session.navigate(site.url())).title == "Home"
    await session.close()


@pytest.mark.parametrize("viewport", [(0, 100), (100_000, 100_000), (-5, 5)])
async def test_an_impossible_viewport(client: BrowserClient, viewport: tuple[int, int]) -> None:
    with pytest.raises(ProtocolError):
        await client.open(SessionOptions(viewport=viewport))
    async with asyncio.timeout(100):  # an earlier session's slot may still be cleaned
        while (await client.pressure()).slots.leased:
            await asyncio.sleep(0.01)


async def test_pages_are_kept_from_this_machine(site: Site, session: Session) -> None:
    """The rule that lets these tests' website be opened is for one address; the next one is refused."""
    view = await session.step(Navigate(site.url().replace("127.0.0.1", "127.0.0.2")))
    [notice] = view.observation.notices
    assert notice.kind == "navigation_failed"
    assert notice.text.endswith("refused by the egress policy: 127.0.0.2 is a loopback address")


async def test_a_session_does_not_live_for_ever(site: Site) -> None:
    async with (
        running_server(ServerConfig(slots=1, token=TOKEN, session_seconds=0.5, browser=LOCAL)) as server,
        BrowserClient(server.url, token=TOKEN, limits=quick()) as client,
    ):
        session = await client.open()
        with contextlib.suppress(LeaseLost):  # on a busy machine its life is over here
            await session.navigate(site.url())
        async with asyncio.timeout(100):
            while True:
                try:
                    await session.heartbeat()
                except LeaseLost:
                    break
                await asyncio.sleep(0.02)
