"""Pages that mean harm. Each is told to the agent, who can go on, or ends its session in a typed way."""

from __future__ import annotations

import pytest

from webgym.core.action import Navigate
from webgym.core.errors import BrowserCrashed, BrowserError, BrowserTimeout
from webgym.server.client import Session

from .conftest import CLICK, Around

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="session")]

slow = pytest.mark.slow


async def told(session: Session, url: str) -> set[str]:
    """Kinds of notices after opening a page, clicking on it, and looking once more."""
    kinds: set[str] = set()
    for action in (Navigate(url), CLICK, None):
        view = await session.step(action)
        kinds |= {notice.kind for notice in view.observation.notices}
    return kinds


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/loop/load", "still_loading"),
        pytest.param("/loop/click", "still_loading", marks=slow),
        pytest.param("/loop/frame", "still_loading", marks=slow),
        pytest.param("/loop/observer", "still_loading", marks=slow),
        pytest.param("/loop/observer/click", "still_loading", marks=slow),
        pytest.param("/loop/observer/timer", "still_loading", marks=slow),
        pytest.param("/loop/interval", "still_loading", marks=slow),
        pytest.param("/loop/worker", None, marks=slow),
        ("/loop/beforeunload", None),
        pytest.param("/loop/history", None, marks=slow),
        ("/dialogs/alert", "dialog"),
        pytest.param("/dialogs/confirm", "dialog", marks=slow),
        pytest.param("/dialogs/prompt", "dialog", marks=slow),
        pytest.param("/dialogs/timer", "dialog", marks=slow),
        pytest.param("/dialogs/beforeunload", None, marks=slow),
        ("/dialogs/huge", "dialog"),
        pytest.param("/dom/frames", None, marks=slow),
        pytest.param("/dom/links", None, marks=slow),
        ("/windows", "popup"),
        pytest.param("/downloads", "download_refused", marks=slow),
    ],
)
async def test_the_agent_is_told_and_can_leave(fault: Around, path: str, kind: str | None) -> None:
    async with fault() as bench:
        session, slot = await bench.open("")
        process = slot.process
        kinds = await told(session, bench.pages + path)
        assert kind is None or kind in kinds
        assert (await session.step(Navigate(bench.pages + "/"))).observation.title == "calm"
        assert slot.process is process
        await session.close()


@pytest.mark.parametrize(
    "path",
    [
        "/dom/deep",
        pytest.param("/dom/endless", marks=slow),
        pytest.param("/loop/unload", marks=slow),
        pytest.param("/loop/reload", marks=slow),
        pytest.param("/loop/microtask", marks=slow),
    ],
)
async def test_the_agent_can_leave_or_the_session_ends_in_a_typed_way(fault: Around, path: str) -> None:
    async with fault() as bench:
        session, _ = await bench.open("")
        ended: BrowserError | None = None
        try:
            await told(session, bench.pages + path)
            await session.step(Navigate(bench.pages + "/"))
        except (BrowserCrashed, BrowserTimeout) as error:
            ended = error
        assert ended is None or ended.hint
        await session.close()
