"""A click lands where the model pointed, whatever became of the picture on its way to the model.

The model here sees nothing but what its endpoint received: it decodes the picture, checks that its processor
would leave it as it is, finds the one target, 8x8 CSS pixels, and names the middle in whole numbers of its
own grid. The page counts hits and misses.
"""

from __future__ import annotations

import base64
import io
from collections.abc import AsyncIterator, Awaitable, Callable
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np
import pytest
from PIL import Image
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from tests.agent.shop import task
from tests.browser.conftest import Site, serving
from tests.llm.endpoint import Endpoint, serve

from webgym.agent.agent import Agent
from webgym.agent.computer_use import from_arguments
from webgym.agent.config import AgentConfig
from webgym.agent.formats import render_reply
from webgym.agent.image_sizing import Size
from webgym.agent.openai_policy import OpenAIPolicy
from webgym.agent.profiles import all_profiles, choose_profile
from webgym.browser.aim import point_of
from webgym.browser.config import BrowserConfig
from webgym.core.action import LeftClick, Navigate, Target
from webgym.core.observation import scaled
from webgym.llm.config import ChatConfig
from webgym.server.client import BrowserClient, Session
from webgym.server.config import ServerConfig
from webgym.server.messages import SessionOptions
from webgym.server.worker import running_server

TARGET = 8

Shares: TypeAlias = tuple[float, ...]
HitAll: TypeAlias = Callable[..., Awaitable[None]]

PAGE = """<!doctype html><title>0 0</title><style>
body {{ margin: 0; background: #fff; overflow: hidden }}
#t {{ position: absolute; width: {side}px; height: {side}px; background: #000 }}
</style><div id=t></div><script>
const places = {places}; let hits = 0, misses = 0;
const show = () => {{ [t.style.left, t.style.top] = places[hits % places.length].map((v) => v + 'px'); }};
onclick = (event) => {{
  if (event.target === t) {{ hits++; show(); }} else misses++;
  document.title = hits + ' ' + misses;
}};
show();
</script>"""


class Sharp(Endpoint):
    """A model with good eyes and whole numbers."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.sizes: set[tuple[int, int]] = set()

    async def do_sharp(self, request: Request) -> Response:
        body = await request.json()
        profile = next(each for each in all_profiles().values() if each.fits(body["model"]))
        url = body["messages"][-1]["content"][1]["image_url"]["url"]
        picture = Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))
        assert profile.pictures.size(picture.size) == picture.size
        self.sizes.add(picture.size)
        ink = 255.0 - np.asarray(picture.convert("L"), dtype=float)
        ink[ink < 16] = 0
        across, down = ink.sum(axis=0), ink.sum(axis=1)
        middle = [float((line * (np.arange(line.size) + 0.5)).sum() / line.sum()) for line in (across, down)]
        screen = profile.screen(picture.size)
        point = [round(at / side * end) for at, side, end in zip(middle, picture.size, screen, strict=True)]
        call = LeftClick(Target(coordinate=(0, 0)))
        said = render_reply(call, "memory", description="Hit it").replace("[0, 0]", str(point))
        return JSONResponse(self.completion(message={"role": "assistant", "content": said}))


@pytest.fixture
async def endpoint(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Sharp]:
    monkeypatch.setattr("tests.llm.endpoint.Endpoint", Sharp)
    async with serve() as endpoint:
        assert isinstance(endpoint, Sharp)
        yield endpoint


@pytest.fixture
async def site() -> AsyncIterator[Site]:
    async with serving() as site:
        yield site


@pytest.fixture
async def client() -> AsyncIterator[BrowserClient]:
    config = ServerConfig(slots=1, browser=BrowserConfig().allowing("127.0.0.1"))
    async with running_server(config) as server, BrowserClient(server.url, token=server.token) as client:
        yield client


def places(viewport: Size, shares: Shares) -> list[tuple[int, int]]:
    """All over the viewport: its corners, its edges, and between, at odd places."""
    across, down = ([round(share * (side - TARGET)) for share in shares] for side in viewport)
    return [(left, top) for left in across for top in down]


async def shoot(session: Session, agent: Agent, url: str, count: int) -> str:
    view = await session.step(Navigate(url))
    conversation = agent.begin(task(), 0, count)
    for _ in range(count):
        step = await conversation.turn(view.observation, view.image, 0)
        assert isinstance(step.action, LeftClick)
        view = await session.step(step.action)
    return view.observation.title


@pytest.fixture
def hit_all(client: BrowserClient, site: Site, endpoint: Sharp) -> HitAll:
    async def hit(viewport: Size, model: str, side: int | None, shares: Shares, scale: float = 1.0) -> None:
        targets = places(viewport, shares)
        where: Any = [list(place) for place in targets]
        page = HTMLResponse(PAGE.format(side=TARGET, places=where))

        async def answer(_: Request) -> Response:
            return page

        url = site.on("/targets", answer)
        chat = ChatConfig(base_url=endpoint.url("sharp"), model=model)
        config = AgentConfig(rounds=0, image_max_side=side, mode="coordinates")
        session = await client.open(SessionOptions(viewport=viewport, capture_scale=scale))
        async with Agent(OpenAIPolicy(chat), config) as agent:
            assert await shoot(session, agent, url, len(targets)) == f"{len(targets)} 0"
            assert endpoint.sizes == {agent.profile.picture_size(scaled(viewport, scale), side)}
        await session.close()

    return hit


VIEWPORTS = [(1280, 768), (768, 1280)]
FAMILIES = [("qwen3-vl", None), ("qwen3-vl", 640), ("qwen2.5-vl", None), ("qwen2.5-vl", 900), ("gpt-5", 1000)]


@pytest.mark.browser
@pytest.mark.parametrize(
    ("viewport", "model", "max_side", "scale"),
    [
        (VIEWPORTS[0], "qwen3-vl", None, 1.0),
        (VIEWPORTS[1], "qwen2.5-vl", 900, 1.0),
        (VIEWPORTS[0], "gpt-5", None, 0.5),
    ],
)
async def test_corners_and_middle_are_hit(
    hit_all: HitAll, viewport: Size, model: str, max_side: int | None, scale: float
) -> None:
    await hit_all(viewport, model, max_side, (0, 0.493, 1), scale)


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.parametrize("viewport", VIEWPORTS)
@pytest.mark.parametrize(("model", "max_side"), FAMILIES)
async def test_every_target_is_hit(hit_all: HitAll, viewport: Size, model: str, max_side: int | None) -> None:
    await hit_all(viewport, model, max_side, (0, 0.001, 0.334, 0.507, 1))


@pytest.mark.parametrize("viewport", VIEWPORTS)
@pytest.mark.parametrize(("model", "max_side"), FAMILIES)
def test_whole_numbers_reach_every_place(viewport: Size, model: str, max_side: int | None) -> None:
    """Wherever a target stands, to the pixel, there are whole numbers that hit it near its middle."""
    profile = choose_profile(None, model)
    sent = profile.picture_size(viewport, max_side)
    screen = profile.screen(sent)
    page: Any = SimpleNamespace(options=SimpleNamespace(viewport=viewport))
    for place in range(max(viewport) - TARGET + 1):
        corner = [min(place, side - TARGET) for side in viewport]
        middle = [(start + TARGET / 2) / side for start, side in zip(corner, viewport, strict=True)]
        stated = [round(at * end) for at, end in zip(middle, screen, strict=True)]
        action = from_arguments({"action": "left_click", "coordinate": stated}, "coordinates", screen)
        assert isinstance(action, LeftClick)
        hit = point_of(page, action.target)
        assert all(start + 2 < at < start + TARGET - 2 for start, at in zip(corner, hit, strict=True))


def test_the_far_edge_is_inside() -> None:
    page: Any = SimpleNamespace(options=SimpleNamespace(viewport=(1280, 768)))
    assert point_of(page, Target(coordinate=(1000, 1000))) == (1279, 767)
    assert point_of(page, Target(coordinate=(0, 0))) == (0, 0)
