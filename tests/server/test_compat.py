"""The authors' HTTP API, driven as their client drives it: every path and every command, on real pages."""

from __future__ import annotations

import asyncio
import contextlib
import io
import socket
from collections.abc import AsyncIterator, Callable
from typing import Any

import httpx
import pytest
import pytest_asyncio
from PIL import Image

from webgym.compat.app import RunningCompat, running_compat
from webgym.compat.commands import COMMANDS
from webgym.server.config import ClientLimits, ServerConfig
from webgym.server.worker import RunningServer

from .conftest import PAGES, Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]

Json = dict[str, Any]

KEY = "a-key-of-theirs"
WAIT_SECONDS = 60.0

PAGES["/compat/board"] = """
<title>Board</title>
<meta name=description content="A board">
<script type="application/ld+json">{"@type": "Thing"}</script>
<style>body { margin: 0; font: 16px monospace } * { box-sizing: border-box }
  #menu ul { display: none; margin: 0 } #menu:hover ul { display: block }
  #menu, #box, form { position: absolute; width: 300px; overflow: auto }
  #menu { left: 0; top: 0; height: 100px } #box { left: 400px; top: 0; height: 200px }
  form { left: 800px; top: 0 } pre { position: absolute; top: 300px; left: 0 }
  #end { position: absolute; top: 4000px }</style>
<div id=menu><button onclick="log('menu clicked')">Menu</button><ul><li>Hidden entry</ul></div>
<div id=box tabindex=0 aria-label=Box><div style="height:2000px;width:900px">scrolled</div></div>
<form action=/compat/sent><input name=q aria-label=Query value=old>
  <select name=colour aria-label=Colour><option>Red<option>Green</select></form>
<pre id=out></pre>
<button id=end onclick="log('end clicked')">End</button>
<script>
  const log = (text) => { out.textContent += text + '\\n'; };
  box.addEventListener('scroll', () => log(`box ${box.scrollLeft} ${box.scrollTop}`));
  addEventListener('scroll', () => log(`page ${scrollY}`));
  addEventListener('keydown', (e) => log(`key ${e.ctrlKey ? 'ctrl-' : ''}${e.key}`));
  document.querySelector('select').addEventListener('change', (e) => log(`chose ${e.target.value}`));
  document.querySelector('input').addEventListener('input', (e) => log(`typed ${e.target.value}`));
</script>
"""
PAGES["/compat/sent"] = "<title>Sent</title><script>document.write(location.search)</script>"
PAGES["/compat/cookie"] = (
    "<title>Cookie</title><script>document.write('was: ' + document.cookie);document.cookie = 'a=1'</script>"
)
PAGES["/compat/tabs"] = "<title>Tabs</title><a href=/next>Next</a>"


class Theirs:
    """Their client's calls, as it sends them."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self.http = http

    async def get(self, lifetime_mins: float = 120) -> Json:
        response = await self.http.post("/get", params={"lifetime_mins": lifetime_mins})
        assert response.status_code == 200, response.text
        instance: Json = response.json()
        assert set(instance) == {"instance_id", "node"}
        return instance

    async def reset(self, instance: Json) -> httpx.Response:
        return await self.http.post("/reset", params=instance)

    async def screenshot(self, instance: Json, mode: str = "set_of_marks") -> httpx.Response:
        return await self.http.get("/screenshot", params=dict(instance, interaction_mode=mode))

    async def execute(self, instance: Json, command: Json) -> httpx.Response:
        return await self.http.post("/execute", json=dict(command, **instance))

    async def do(self, instance: Json, command: Json) -> Json:
        response = await self.execute(instance, command)
        assert response.status_code == 200, response.text
        told: Json = response.json()
        return told

    async def visit(self, instance: Json, url: str) -> None:
        assert await self.do(instance, {"visit_page": {"url": url}}) == {"status": "success"}

    async def text(self, instance: Json) -> list[str]:
        told = await self.do(instance, {"get_webpage_text": {"n_lines": 100}})
        return str(told["text"]).split("\n")

    async def title(self, instance: Json) -> str:
        return str((await self.do(instance, {"get_page_metadata": {}}))["title"])

    async def id_of(self, instance: Json, name: str) -> str:
        rects = await self.do(instance, {"get_interactive_rects": {}})
        found = [key for key, one in rects.items() if one["aria_name"] == name]
        assert found, f"no {name!r} in {rects}"
        return found[0]

    async def node(self) -> Json:
        [node] = (await self.http.get("/info")).json()["nodes"]
        assert set(node) == {"url", "hash", "healthy", "capacity", "available", "instances"}
        return dict(node)


@contextlib.asynccontextmanager
async def a_layer(url: str, token: str) -> AsyncIterator[tuple[RunningCompat, Theirs]]:
    """A layer without a key of its own, and a client."""
    async with (
        running_compat(url, token, listening=ServerConfig()) as layer,
        httpx.AsyncClient(
            base_url=layer.url, headers={"x-api-key": token}, trust_env=False, timeout=60
        ) as http,
    ):
        yield layer, Theirs(http)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def compat(server: RunningServer) -> AsyncIterator[RunningCompat]:
    async with running_compat(server.url, server.token, listening=ServerConfig(), key=KEY) as layer:
        yield layer


@pytest_asyncio.fixture(loop_scope="module")
async def theirs(compat: RunningCompat, server: RunningServer) -> AsyncIterator[Theirs]:
    """A client; afterwards nothing is held any more, neither here nor on the server."""
    headers = {"x-api-key": KEY}
    async with httpx.AsyncClient(
        base_url=compat.url, headers=headers, trust_env=False, verify=False, timeout=60
    ) as http:
        client = Theirs(http)
        yield client
        for instance_id in (await client.node())["instances"]:
            await client.reset({"instance_id": instance_id, "node": (await client.node())["url"]})
        await until(lambda: len(server.service.leases) == 0)


@pytest_asyncio.fixture(loop_scope="module")
async def instance(theirs: Theirs) -> Json:
    return await theirs.get()


@pytest_asyncio.fixture(loop_scope="module")
async def board(theirs: Theirs, instance: Json, site: Site) -> Json:
    await theirs.visit(instance, site.url("/compat/board"))
    return instance


async def until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(WAIT_SECONDS):
        while not holds():
            await asyncio.sleep(0.02)


def picture(response: httpx.Response) -> Image.Image:
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == "image/png"
    image = Image.open(io.BytesIO(response.content))
    assert (image.format, image.size) == ("PNG", (1280, 768))
    return image


def refusal(response: httpx.Response) -> tuple[int, str]:
    told = response.json()
    assert told["status"] == "error"
    assert told["message"] == told["detail"]
    return response.status_code, told["message"]


# --- the key, and what is no request ------------------------------------------------------------------

PATHS = [
    ("POST", "/get"),
    ("POST", "/reset"),
    ("GET", "/probe"),
    ("GET", "/metadata"),
    ("GET", "/screenshot"),
    ("POST", "/execute"),
    ("GET", "/info"),
]


@pytest.mark.parametrize(("method", "path"), PATHS)
async def test_nothing_is_done_without_the_key(compat: RunningCompat, method: str, path: str) -> None:
    async with httpx.AsyncClient(base_url=compat.url, trust_env=False, timeout=60) as http:
        assert refusal(await http.request(method, path)) == (
            401,
            "the API key is missing (send it as x-api-key)",
        )
        for wrong in (b"", b"default_key", KEY.encode() + b"x", "ü".encode()):
            response = await http.request(method, path, headers={b"x-api-key": wrong})
            assert refusal(response) == (401, "the API key is wrong")


async def test_the_servers_token_is_the_key_where_no_other_is_given(server: RunningServer) -> None:
    async with a_layer(server.url, server.token) as (_, theirs):
        assert (await theirs.http.get("/info")).status_code == 200


@pytest.mark.parametrize(("method", "path"), [*PATHS[1:5], ("POST", "/execute")])
@pytest.mark.parametrize("missing", ["instance_id", "node"])
async def test_what_is_missing_is_named(theirs: Theirs, method: str, path: str, missing: str) -> None:
    given = {"instance_id": "x", "node": (await theirs.node())["url"]}
    del given[missing]
    body = {"json": {"back": {}, **given}} if path == "/execute" else {"params": given}
    status, message = refusal(await theirs.http.request(method, path, **body))  # type: ignore[arg-type]
    assert (status, message) == (422, f"{missing} is missing")


@pytest.mark.parametrize(("method", "path"), PATHS[1:6])
async def test_unknown_instances_and_nodes(theirs: Theirs, method: str, path: str) -> None:
    async def ask(instance_id: str, node: str) -> tuple[int, str]:
        given = {"instance_id": instance_id, "node": node}
        body = {"json": {"back": {}, **given}} if path == "/execute" else {"params": given}
        return refusal(await theirs.http.request(method, path, **body))

    node = (await theirs.node())["url"]
    status, message = await ask("00000000-0000-0000-0000-000000000000", node)
    assert status == 400
    assert "instance not found" in message, "their client takes these words for: given back already"
    status, message = await ask("x", "http://another:8000")
    assert (status, "http://another:8000 is not found" in message) == (400, True)


@pytest.mark.parametrize(
    "body", [b"", b"{", b"[]", b"\xff\xfe", b"1", b'{"back":' + b"[" * 100_000, b"x" * 2_000_000]
)
async def test_broken_bodies(theirs: Theirs, body: bytes) -> None:
    status, _ = refusal(await theirs.http.post("/execute", content=body))
    assert status == 422


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ({}, "exactly one command, not 0"),
        ({"back": {}, "tab_and_enter": {}}, "exactly one command, not 2 (back, tab_and_enter)"),
        ({"fly": {}}, 'unsupported command "fly"'),
        ({"visit_page": {}}, "url"),
        ({"visit_page": "http://x"}, "object"),
        ({"click_coords": {"x": 5}}, "`y`"),
        ({"click_coords": {"x": "left", "y": 1}}, "$.x"),
        ({"click_coords": {"x": 1281, "y": 1}}, "outside of the 1280x768 viewport"),
        ({"click_coords": {"x": -1, "y": 1}}, "outside of the 1280x768 viewport"),
        ({"click_id": {"id": "first"}}, "ids are numbers"),
        ({"keypress": {"keys": ["Hyper"]}}, 'no key "Hyper"'),
        ({"keypress": {"keys": []}}, "no key"),
        ({"scroll_id": {"id": "1", "direction": "sideways"}}, '"sideways"'),
        ({"hover_and_scroll_coords": {"x": 1, "y": 1, "direction": "left"}}, '"left"'),
        ({"sleep": {"duration": -1}}, "seconds"),
        ({"page_down": {"amount": "inf"}}, "pixels"),
    ],
)
async def test_commands_that_are_none(theirs: Theirs, command: Json, said: str) -> None:
    instance = {"instance_id": "x", "node": (await theirs.node())["url"]}
    status, message = refusal(await theirs.execute(instance, command))
    assert status == 400
    assert said in message, "looked at before the instance is"


async def test_unknown_paths_and_methods(theirs: Theirs) -> None:
    assert refusal(await theirs.http.get("/nothing")) == (404, "Not Found")
    assert refusal(await theirs.http.get("/get")) == (405, "Method Not Allowed")


# --- an episode ---------------------------------------------------------------------------------------


async def test_an_episode_with_marks(theirs: Theirs, site: Site) -> None:
    async with asyncio.timeout(WAIT_SECONDS):  # an earlier browser may still be cleaned
        while (before := await theirs.node())["available"] < 2:
            await asyncio.sleep(0.02)
    assert (before["healthy"], before["capacity"], before["instances"]) == (True, 2, [])
    instance = await theirs.get(45)
    node = await theirs.node()
    assert node["instances"] == [instance["instance_id"]]
    assert (node["available"], node["hash"]) == (before["available"] - 1, instance["node"])
    size = await theirs.http.get("/metadata", params=instance)
    assert size.json() == {"width": 1280, "height": 768}
    probe = await theirs.http.get("/probe", params=instance)
    assert (probe.status_code, probe.json()["status"]) == (200, "success")
    assert await theirs.do(instance, {"get_page_metadata": {}}) == {
        "title": "Unknown Page",
        "url": "about:blank",
    }
    assert "error" in await theirs.do(instance, {"get_screenshot_info": {}})

    await theirs.visit(instance, site.url())
    told = await theirs.do(instance, {"get_page_metadata": {}})
    assert (told["title"], told["url"]) == ("Home", site.url())
    plain = picture(await theirs.screenshot(instance, "coordinates"))
    marked = picture(await theirs.http.get("/screenshot", params=instance))
    assert plain.tobytes() != marked.tobytes(), "marks are the default"

    seen = await theirs.do(instance, {"get_screenshot_info": {}})
    regions = [seen["interactive_regions"][seen["id_mapping"][one]] for one in seen["visible_rects"]]
    assert [(one["tag_name"], one["aria_name"]) for one in regions] == [
        ("a", "Next"),
        ("input, type=text", "Name"),
    ]
    next_id = seen["visible_rects"][0]
    assert await theirs.do(instance, {"click_id": {"id": next_id}}) == {"status": "success"}
    assert "Next page" in await theirs.text(instance)
    await theirs.do(instance, {"back": {}})
    assert await theirs.title(instance) == "Home"

    assert (await theirs.reset(instance)).json() == {"status": "success"}
    async with asyncio.timeout(WAIT_SECONDS):  # the browser is cleaned after the answer
        while (after := await theirs.node()) != before:
            assert after["instances"] == []


async def test_a_reset_gives_a_fresh_page(theirs: Theirs, instance: Json, site: Site) -> None:
    for _ in range(2):
        await theirs.visit(instance, site.url("/compat/cookie"))
    assert await theirs.text(instance) == ["was: a=1"]
    for _ in range(2):
        assert (await theirs.reset(instance)).status_code == 200
    assert (await theirs.http.get("/probe", params=instance)).status_code == 200
    assert (await theirs.node())["instances"] == [], "what is reset holds no browser"
    assert "error" in await theirs.do(instance, {"get_screenshot_info": {}})
    await theirs.visit(instance, site.url("/compat/cookie"))
    assert await theirs.text(instance) == ["was:"]


async def test_instances_share_nothing_and_there_are_only_so_many(
    theirs: Theirs, site: Site, compat: RunningCompat, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = await asyncio.gather(theirs.get(), theirs.get())
    assert one["instance_id"] != two["instance_id"]
    await asyncio.gather(*(theirs.visit(each, site.url("/counter")) for each in (one, two)))
    click = {"click_coords": {"x": 20, "y": 20}}
    await asyncio.gather(*(theirs.do(one, click) for _ in range(3)), theirs.do(two, click))
    assert [await theirs.title(one), await theirs.title(two)] == ["3", "1"]
    with monkeypatch.context() as patch:
        patch.setattr(compat.instances.client, "limits", ClientLimits(wait_seconds=0.1))
        full = await theirs.http.post("/get")
    assert refusal(full)[0] == 503
    await theirs.reset(one)
    await theirs.get()


# --- commands -----------------------------------------------------------------------------------------

BOARD = [
    ({"click_coords": {"x": 20, "y": 10}}, "menu clicked"),
    ({"click_coords": {"x": "20", "y": "10.5"}}, "menu clicked"),
    ({"click_id": {"id": "End"}}, "end clicked"),
    ({"hover_coords": {"x": 20, "y": 10}}, "Hidden entry"),
    ({"hover_id": {"id": "Menu"}}, "Hidden entry"),
    ({"hover_and_scroll_coords": {"x": 500, "y": 100, "direction": "DOWN"}}, "box 0 160"),
    ({"scroll_coords": {"x": 500, "y": 100, "direction": "down"}}, "box 0 160"),
    ({"hover_and_scroll_coords": {"x": 500, "y": 600}}, "page 100"),
    ({"scroll_id": {"id": "Box", "direction": "down"}}, "box 0 200"),
    ({"scroll_id": {"id": "Box", "direction": "right"}}, "box 300 0"),
    ({"select_option": {"id": "Green"}}, "chose Green"),
    ({"page_down": {}}, "page 200"),
    ({"page_down": {"amount": 350}}, "page 350"),
    ({"page_down": {"full_page": True}}, "page 718"),
    ({"keypress": {"keys": ["ctrl", "b"]}}, "key ctrl-b"),
    ({"keypress": {"keys": ["Control+b"]}}, "key ctrl-b"),
    ({"keypress": {"keys": ["ArrowLeft"]}}, "key ArrowLeft"),
    ({"keypress": {"keys": ["enter"]}}, "key Enter"),
    ({"fill_coords": {"x": 830, "y": 10, "value": " new", "press_enter": False}}, "typed old new"),
    (
        {"fill_coords": {"x": 830, "y": 10, "value": "x", "press_enter": False, "delete_existing": True}},
        "typed x",
    ),
    (
        {"fill_id": {"id": "Query", "value": "new", "press_enter": True, "delete_existing": True}},
        "?q=new&colour=Red",
    ),
    ({"fill_id": {"id": "Query", "value": "er"}}, "?q=older&colour=Red"),
    ({"fill_coords": {"x": 830, "y": 10, "value": "er"}}, "?q=older&colour=Red"),
]


@pytest.mark.parametrize(("command", "seen"), BOARD, ids=lambda given: str(given)[:60])
async def test_what_a_command_does_to_a_page(theirs: Theirs, board: Json, command: Json, seen: str) -> None:
    [(name, given)] = command.items()
    if "id" in given:
        given = {**given, "id": await theirs.id_of(board, given["id"])}
    assert await theirs.do(board, {name: given}) == {"status": "success"}
    assert seen in await theirs.text(board)


async def test_up_is_the_way_back(theirs: Theirs, board: Json) -> None:
    for command in ("page_down", "page_up"):
        await theirs.do(board, {command: {"full_page": True}})
    await theirs.do(board, {"page_down": {"amount": 500}})
    await theirs.do(board, {"page_up": {}})
    assert (await theirs.text(board))[-1] != ""
    pages = [line for line in await theirs.text(board) if line.startswith("page ")]
    assert [pages[0], pages[-1]] == ["page 718", "page 300"]
    assert "page 0" in pages


async def test_tab_and_enter(theirs: Theirs, instance: Json, site: Site) -> None:
    await theirs.visit(instance, site.url("/compat/tabs"))
    assert await theirs.do(instance, {"tab_and_enter": {}}) == {"status": "success"}
    assert await theirs.title(instance) == "Next"
    await theirs.do(instance, {"back": None})
    assert await theirs.title(instance) == "Tabs"


async def test_sleeping_lets_the_page_go_on(theirs: Theirs, board: Json, site: Site) -> None:
    PAGES["/compat/late"] = (
        "<title>0</title><script>setTimeout(() => { document.title = 'late' }, 900)</script>"
    )
    await theirs.visit(board, site.url("/compat/late"))
    assert await theirs.do(board, {"sleep": {"duration": 1.0}}) == {"status": "success"}
    assert await theirs.title(board) == "late"


async def test_what_a_page_tells(theirs: Theirs, board: Json, site: Site) -> None:
    told = await theirs.do(board, {"get_page_metadata": {}})
    assert told == {
        "title": "Board",
        "url": site.url("/compat/board"),
        "meta_tags": {"description": "A board"},
        "jsonld": {"@type": "Thing"},
    }
    everything = await theirs.do(board, {"get_webpage_text": {}})
    few = await theirs.do(board, {"get_webpage_text": {"n_lines": 1}})
    assert set(everything) == set(few) == {"text"}
    assert (few["text"], "scrolled" in everything["text"]) == ("Menu", True)


@pytest.mark.parametrize("data", ["no json", "[" * 100_000, '{"name":'])
async def test_linked_data_that_is_none_is_told_as_it_is(
    theirs: Theirs, instance: Json, site: Site, data: str
) -> None:
    PAGES["/compat/linked"] = f"<title>L</title><script type=application/ld+json>{data}</script>"
    await theirs.visit(instance, site.url("/compat/linked"))
    assert (await theirs.do(instance, {"get_page_metadata": {}}))["jsonld"] == data


async def test_rects_and_what_a_picture_showed(theirs: Theirs, board: Json) -> None:
    assert await theirs.do(board, {"screenshot": {"interaction_mode": "set_of_marks"}}) == {
        "status": "screenshot_taken"
    }
    shown = await theirs.do(board, {"get_screenshot_info": {}})
    assert set(shown) == {"visible_rects", "rects_above", "rects_below", "interactive_regions", "id_mapping"}
    rects = await theirs.do(board, {"get_interactive_rects": {}})
    assert rects == shown["interactive_regions"]
    names = {key: one["aria_name"] for key, one in rects.items()}
    visible = [names[shown["id_mapping"][key]] for key in shown["visible_rects"]]
    assert visible == ["Menu", "Box", "Query", "Colour", "Red", "Green"]
    assert [names[key] for key in shown["rects_below"]] == ["End"]
    menu = next(one for one in rects.values() if one["aria_name"] == "Menu")
    assert set(menu) == {"tag_name", "role", "aria_name", "v_scrollable", "rects"}
    [rect] = menu["rects"]
    assert (rect["x"], rect["y"], rect["left"], rect["top"]) == (0, 0, 0, 0)
    assert (rect["right"], rect["bottom"]) == (rect["width"], rect["height"])
    assert next(one for one in rects.values() if one["aria_name"] == "Box")["v_scrollable"]
    await theirs.do(board, {"page_down": {"amount": 3600}})
    await theirs.screenshot(board)
    shown = await theirs.do(board, {"get_screenshot_info": {}})
    assert [names[key] for key in shown["visible_rects"] if names[key] == "End"] == ["End"]
    assert "Menu" in [names[key] for key in shown["rects_above"]]


async def test_no_command_is_left_out() -> None:
    issue = (
        "visit_page back click_coords click_id fill_coords fill_id select_option hover_id hover_coords "
        "hover_and_scroll_coords scroll_id page_up page_down keypress sleep tab_and_enter get_webpage_text "
        "get_page_metadata get_interactive_rects get_screenshot_info screenshot"
    )
    assert set(issue.split()) <= set(COMMANDS)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ({"visit_page": {"url": "http://no-such-host.invalid/"}}, "no-such-host"),
        ({"visit_page": {"url": "file:///etc/passwd"}}, "http"),
        ({"click_id": {"id": "4711"}}, "4711"),
        ({"click_id": {"id": 4711}}, "4711"),
        ({"fill_id": {"id": "4711", "value": "x"}}, "4711"),
        ({"select_option": {"id": "4711"}}, "4711"),
        ({"hover_id": {"id": "4711"}}, "4711"),
        ({"scroll_id": {"id": "4711", "direction": "up"}}, "4711"),
    ],
)
async def test_what_a_page_refuses_is_an_error(theirs: Theirs, board: Json, command: Json, said: str) -> None:
    status, message = refusal(await theirs.execute(board, command))
    assert status == 500
    assert said in message
    assert (await theirs.http.get("/probe", params=board)).status_code == 200, "and the instance lives on"


async def test_going_back_at_the_beginning_is_no_error(theirs: Theirs, instance: Json) -> None:
    assert await theirs.do(instance, {"back": {}}) == {"status": "success"}


# --- the end of instances -----------------------------------------------------------------------------


@pytest.mark.parametrize("given", ["x", "-5", "nan", "100000"])
async def test_lifetimes_that_make_no_sense(theirs: Theirs, given: str) -> None:
    assert refusal(await theirs.http.post("/get", params={"lifetime_mins": given}))[0] == 422


async def test_an_instance_ends_with_its_lifetime(
    theirs: Theirs, site: Site, server: RunningServer, compat: RunningCompat
) -> None:
    busy, reset = await theirs.get(0.02), await theirs.get(0.02)
    await theirs.reset(reset)
    working = asyncio.create_task(theirs.execute(busy, {"sleep": {"duration": 30}}))
    status, message = refusal(await working)
    assert (status, "instance not found" in message) == (400, True), "a call that runs is cut off"
    for instance in (busy, reset):
        async with asyncio.timeout(WAIT_SECONDS):
            while (await theirs.http.get("/metadata", params=instance)).status_code == 200:
                await asyncio.sleep(0.02)
        assert refusal(await theirs.execute(instance, {"back": {}}))[0] == 400
        assert refusal(await theirs.reset(instance))[0] == 400
    await until(lambda: len(server.service.leases) == 0)
    assert compat.instances.held == []


async def test_an_instance_used_again_after_its_reset_is_taken_back_when_idle(
    server: RunningServer, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.compat.instances.RESET_IDLE_SECONDS", 0.3)
    async with a_layer(server.url, server.token) as (layer, theirs):
        instance, other = await theirs.get(), await theirs.get()
        await theirs.reset(instance)
        await theirs.visit(instance, site.url())
        await until(lambda: layer.instances.held == [other["instance_id"]])
        assert refusal(await theirs.execute(instance, {"back": {}}))[0] == 400
    await until(lambda: len(server.service.leases) == 0)


async def test_only_so_many_instances_are_remembered(
    server: RunningServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.compat.instances.INSTANCES", 2)
    async with a_layer(server.url, server.token) as (_, theirs):
        first = await theirs.get()
        await theirs.reset(first)
        second, _ = await theirs.get(), await theirs.get()
        assert refusal(await theirs.reset(first))[0] == 400
        assert (await theirs.reset(second)).status_code == 200


async def test_a_reset_refuses_the_calls_in_line(
    theirs: Theirs, instance: Json, compat: RunningCompat
) -> None:
    turn = compat.instances.find(instance["instance_id"]).turn
    running = asyncio.create_task(theirs.execute(instance, {"sleep": {"duration": 30}}))
    await until(turn.locked)
    waiting = asyncio.create_task(theirs.execute(instance, {"back": {}}))
    await until(lambda: bool(turn._waiters))
    probe = await theirs.http.get("/probe", params=instance)
    assert probe.status_code == 200, "a probe does not stand in line"
    assert (await theirs.reset(instance)).status_code == 200
    for call in (running, waiting):
        status, message = refusal(await call)
        assert (status, "not found" in message) == (400, True)
    assert await theirs.title(instance) == "Unknown Page"


async def test_a_browser_that_dies(theirs: Theirs, board: Json, server: RunningServer) -> None:
    lease = next(iter(server.service.leases._leases.values()))
    assert lease.slot.process is not None
    await lease.slot.process.kill()
    status, message = refusal(await theirs.execute(board, {"back": {}}))
    assert status == 500
    assert "browser" in message
    assert refusal(await theirs.screenshot(board))[0] == 500
    assert refusal(await theirs.http.get("/probe", params=board))[0] == 500
    assert (await theirs.reset(board)).status_code == 200
    assert await theirs.title(board) == "Unknown Page"


async def test_a_caller_who_leaves_the_line_gets_nothing(
    theirs: Theirs, compat: RunningCompat, server: RunningServer
) -> None:
    one, two = await theirs.get(), await theirs.get()
    port = int(compat.url.rsplit(":", 1)[1])
    _, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(
        b"POST /get HTTP/1.1\r\nhost: x\r\nx-api-key: " + KEY.encode() + b"\r\ncontent-length: 0\r\n\r\n"
    )
    await writer.drain()
    await until(lambda: server.service.pool.load.waiting == 1)
    writer.close()
    await writer.wait_closed()
    await until(lambda: server.service.pool.load.waiting == 0)
    for instance in (one, two):
        await theirs.reset(instance)
    assert compat.instances.held == []


async def test_a_server_that_is_away() -> None:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as listener:
        port = listener.getsockname()[1]
    async with a_layer(f"http://127.0.0.1:{port}", KEY) as (_, theirs):
        node = await theirs.node()
        assert (node["healthy"], node["capacity"], node["instances"]) == (False, 0, [])
        assert refusal(await theirs.http.post("/get"))[0] == 503
