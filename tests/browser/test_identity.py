"""A browser says the same of itself in pages, frames, workers and requests; and what a session may pass."""

from __future__ import annotations

import base64
import io
import json
from typing import Any

import pytest
from PIL import Image
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from webgym.browser.config import PageOptions
from webgym.core.action import Wait
from webgym.core.errors import ConfigError
from webgym.core.identity import Identity, credentials_of

from .conftest import Open, Site, Tab
from .test_web import certified, raw, says

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

READ = """
(async (where) => {
  const hints = navigator.userAgentData;
  const told = {
    agent: navigator.userAgent, languages: navigator.languages.join(), platform: navigator.platform,
    brands: hints?.brands.map(({ brand, version }) => `${brand} ${version}`).join(),
    full: (await hints?.getHighEntropyValues(['fullVersionList']))?.fullVersionList.map(String).length,
    zone: Intl.DateTimeFormat().resolvedOptions().timeZone, number: (1234.5).toLocaleString(),
  };
  await fetch('/said?' + where, { method: 'POST', body: JSON.stringify(told) });
})"""
PLACES = {"page", "frame", "worker", "shared", "service"}
SENT = ("user-agent", "accept-language", "x-visit")


async def told_everywhere(site: Site, tab: Tab) -> tuple[dict[str, dict[str, Any]], list[dict[str, str]]]:
    """What scripts read in each kind of place, and what each request said."""
    read: dict[str, dict[str, Any]] = {}
    sent: list[dict[str, str]] = []

    def serve(path: str, kind: str, body: str) -> None:
        async def answer(request: Request) -> Response:
            sent.append({name: request.headers.get(name, "") for name in SENT})
            return Response(body, media_type=kind)

        site.on(path, answer)

    async def said(request: Request) -> Response:
        sent.append({name: request.headers.get(name, "") for name in SENT})
        read[request.url.query] = json.loads(await request.body())
        return Response("ok")

    site.on("/said", said)
    for path, where in {"/w.js": "worker", "/s.js": "shared", "/sw.js": "service"}.items():
        serve(path, "text/javascript", f"{READ}('{where}')")
    serve("/frame", "text/html", f"<script>{READ}('frame')</script>")
    frame = site.url("/frame").replace("127.0.0.1", "localhost")
    start = f"{READ}('page'); new Worker('/w.js'); new SharedWorker('/s.js');"
    start += "navigator.serviceWorker.register('/sw.js')"
    serve("/identity", "text/html", f"<iframe src='{frame}'></iframe><script>{start}</script>")
    await tab.goto(site.url("/identity"))
    for _ in range(40):
        if set(read) == PLACES:
            break
        await tab.step(Wait(0.5))
    assert set(read) == PLACES
    return read, sent


async def test_a_desktop_is_consistent(site: Site, new_tab: Tab) -> None:
    read, sent = await told_everywhere(site, new_tab)
    assert len({json.dumps(told) for told in read.values()}) == 1, read
    assert "Chrome/" in read["page"]["agent"]
    assert "Chromium" in read["page"]["brands"]
    assert "Headless" not in json.dumps([read, sent])
    assert read["page"]["languages"] == "en-US,en"
    assert {one["user-agent"] for one in sent} == {read["page"]["agent"]}


async def test_an_identity_of_ones_own_is_consistent(site: Site, open_tab: Open) -> None:
    wanted = {
        "languages": ("de-CH", "de"),
        "time_zone": "Asia/Tokyo",
        "locale": "de-DE",
        "contact": "+https://lab.example/bot",
    }
    own = {"headers": {"x-visit": "study"}, "color_scheme": "dark", "webdriver": False, "place": (52.5, 13.4)}
    own["device_scale"] = 2
    tab = await open_tab(identity=wanted | own)
    read, sent = await told_everywhere(site, tab)
    assert len({json.dumps(told) for told in read.values()}) == 1, read
    told = read["page"]
    assert (told["languages"], told["zone"], told["number"]) == ("de-CH,de", "Asia/Tokyo", "1.234,5")
    assert told["agent"].endswith("(+https://lab.example/bot)")
    assert {one["user-agent"] for one in sent} == {told["agent"]}
    assert {one["accept-language"].partition(",")[0] for one in sent} == {"de-CH"}
    asks = (
        "navigator.geolocation.getCurrentPosition(({ coords }) => document.title = [coords.latitude,"
        "matchMedia('(prefers-color-scheme: dark)').matches, navigator.webdriver, devicePixelRatio])"
    )
    look = await tab.goto(site.page(f"<script>{asks}</script>"))
    assert look.observation.title == "52.5,true,false,2"
    assert Image.open(io.BytesIO(look.image)).size == look.observation.viewport
    await tab.slot.close()
    launches = tab.slot.launches
    await tab.slot.open(PageOptions(identity=wanted | own))
    assert tab.slot.launches == launches, "the same identity again needs no other browser"


async def test_the_shell_says_what_it_is(site: Site, open_tab: Open) -> None:
    tab = await open_tab(identity={"profile": "shell"})
    look = await tab.goto(site.page("<script>document.title = navigator.userAgent</script>"))
    assert ("Headless" in look.observation.title) == ("headless" in str(tab.slot.executable))


def members(site: Site) -> str:
    wanted = f"Basic {base64.b64encode(b'ann:pa:ss').decode()}"

    async def answer(request: Request) -> Response:
        if request.headers.get("authorization") == wanted:
            return HTMLResponse("<p>Inside")
        return HTMLResponse("<p>Who?", 401, {"www-authenticate": 'Basic realm="members"'})

    return site.on("/members", answer)


async def test_credentials_are_for_their_origin_alone(site: Site, open_tab: Open) -> None:
    url = members(site)
    tab = await open_tab(credentials={site.url(""): "ann:pa:ss"})
    await tab.goto(url)
    assert (tab.text, tab.notices) == (["Inside"], [])
    await tab.goto(url.replace("127.0.0.1", "localhost"))
    assert tab.text == ["Who?"]


async def test_wrong_credentials_are_tried_once(site: Site, open_tab: Open) -> None:
    tab = await open_tab(credentials={site.url(""): "ann:wrong"})
    await tab.goto(members(site))
    assert tab.text == ["Who?"]
    assert "password" in tab.notices[0][1]
    assert site.hits.count("/members") == 2


async def test_certificates_of_some_hosts_are_not_checked(site: Site, open_tab: Open) -> None:
    page = says(b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 5\r\n\r\n<p>hi")
    tab = await open_tab(identity={"ignore_tls_errors": ("127.0.0.1",)})
    async with raw(page, certified("lab.test")) as place:
        await tab.goto(f"https://{place}/")
        assert tab.text == ["hi"]
        await tab.goto(f"https://{place.replace('127.0.0.1', 'localhost')}/")
        assert "net::ERR_CERT" in tab.notices[0][1]


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"time_zone": "Mars/Base"}, "time zone"),
        ({"languages": ("english!",)}, "language tag"),
        ({"headers": {"User-Agent": "x"}}, "cannot be set here"),
        ({"contact": "a\nb"}, "printable"),
        ({"credentials": {"https://a.example": "$LAB"}}, "a setting of a run"),
        ({"nonsense": 1}, "identity.nonsense"),
    ],
)
async def test_what_is_no_identity_is_refused(fields: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        PageOptions(identity=fields)


async def test_credentials_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    identity = Identity(credentials={"https://a.example/": "$LAB"})
    with pytest.raises(ConfigError, match="LAB holds no NAME:PASSWORD for https"):
        credentials_of(identity)
    monkeypatch.setenv("LAB", "ann:pass")
    assert credentials_of(identity) == {"https://a.example": "ann:pass"}
    with pytest.raises(ValueError, match="environment variable"):
        Identity(credentials={"https://a.example": "ann:pass"})
