"""What failed is said in the next observation: a real browser fails, and the next request says so."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
from starlette.requests import Request
from starlette.responses import Response
from tests.agent.shop import task
from tests.agent.test_agent import Parrot
from tests.agent.test_context import said
from tests.browser.conftest import Site, serving

from webgym.agent.agent import Agent
from webgym.agent.prompts import render_reply
from webgym.browser.config import BrowserConfig
from webgym.core.action import Action, Answer, LeftClick, Navigate, Target
from webgym.server.client import BrowserClient, Session
from webgym.server.config import ServerConfig
from webgym.server.messages import SessionOptions
from webgym.server.run_worker import running_server

pytestmark = pytest.mark.browser


@pytest.fixture
async def site() -> AsyncIterator[Site]:
    async with serving() as site:
        yield site


@pytest.fixture
async def session() -> AsyncIterator[Session]:
    config = ServerConfig(slots=1, browser=BrowserConfig().allowing("127.0.0.1"))
    async with running_server(config) as server, BrowserClient(server.url, token=server.token) as client:
        session = await client.open(SessionOptions())
        yield session
        await session.close()


def reply(action: Action) -> str:
    return render_reply(action, "memory", description="Do it")


async def test_what_failed_is_said_in_the_next_request(session: Session, site: Site) -> None:
    async def file(_: Request) -> Response:
        headers = {"Content-Disposition": 'attachment; filename="prices.zip"'}
        return Response(b"PK", media_type="application/zip", headers=headers)

    link = f"<a href={site.on('/prices', file)} style='position:fixed;inset:0'>Prices</a>"
    page = site.page(f"<title>Shop</title>{link}")
    middle = Target(coordinate=(500, 500))
    policy = Parrot(
        reply(LeftClick(middle)),  # downloads
        "I shall click the button.",  # means nothing
        reply(Navigate("http://127.0.0.1:1/")),  # nobody is there
        reply(Navigate(page)),
        reply(LeftClick(Target(coordinate=(0, 0)))),
        reply(Answer("done")),
    )
    agent = Agent(policy)
    view = await session.step(Navigate(page))
    conversation = agent.begin(task(), 0, 15)
    for _ in range(6):
        step = await conversation.turn(view.observation, view.image, 0)
        if not isinstance(step.action, Answer):
            view = await session.step(step.action)
    told = [said(turn.messages[-1]) for turn in policy.turns]
    assert "Note:" not in told[0]
    assert "Note: A download was refused; files cannot be downloaded" in told[1]
    assert "prices.zip" in told[1]
    assert (
        "Note: Your last reply held no action, so nothing was done: the reply holds no tool_call tag"
        in told[2]
    )
    assert "The screen is the same" not in told[2]
    assert "Note: The page could not be opened: http://127.0.0.1:1/" in told[3]
    assert "Note: The page could not be opened" not in told[4]
    assert "'Shop'" in told[4]
    assert "Note: The screen is the same as before your last action." in told[5]
