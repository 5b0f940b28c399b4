"""Upstream proxies: whose turn it is, what goes through them, and what does not."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import ssl
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, Literal

import pytest
import trustme
from aiohttp import web
from pydantic import ValidationError

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress import upstream
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress, ProxyListener
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate
from webgym.core.errors import ConfigError

from .canary import HERE, Names
from .test_egress_proxy import SECONDS, ask, closed, echo, hang_up, scene, serve, until
from .upstream_proxy import NAME, PASSWORD, UpstreamProxy, upstream_proxy

KINDS = pytest.mark.parametrize("kind", ["http", "socks5"])
Kind = Literal["http", "socks5"]


@pytest.fixture(autouse=True)
def credentials(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UPSTREAM", f"{NAME}:{PASSWORD}")


@asynccontextmanager
async def through(
    *proxies: UpstreamProxy, names: dict[str, list[str]] | None = None, **more: Any
) -> AsyncIterator[Egress]:
    """A way out through these proxies, called ``p0``, ``p1`` and so on. It must be left as it was found."""
    settings = more.pop("settings", {})
    named = {f"p{nth}": proxy.settings(**settings) for nth, proxy in enumerate(proxies)}
    config = EgressConfig.model_validate({"upstream": named, "ports": (), **more})
    async with Egress(config, Names(names)) as egress:
        yield egress
    assert not egress._connections.transports


@asynccontextmanager
async def ways_to(host: str, *kinds: Kind, **more: Any) -> AsyncIterator[tuple[Egress, list[UpstreamProxy]]]:
    """A way out through a proxy of each kind, which reach an echo by this name; and the proxies."""
    async with AsyncExitStack() as stack:
        places = {host: await stack.enter_async_context(serve(echo))}
        proxies = [await stack.enter_async_context(upstream_proxy(kind, places)) for kind in kinds]
        yield await stack.enter_async_context(through(*proxies, **more)), proxies


async def told(egress: Egress | ProxyListener, host: str = "shop.example", port: int = 443) -> int:
    """The reply's code."""
    code, streams = await ask(egress, host, port)
    await hang_up(streams)
    return code


@KINDS
@scene
async def test_bytes_come_through_under_the_sessions_own_name(
    kind: Kind, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "login"
    file.write_text(f"{NAME}-{{session}}:{PASSWORD}\n")
    async with ways_to("shop.example", kind, settings={"credentials": str(file)}) as (egress, [proxy]):
        for _ in range(2):
            code, (reader, writer) = await ask(egress, "shop.example", 443)
            assert code == 0
            writer.write(b"through")
            assert await asyncio.wait_for(reader.readexactly(7), SECONDS) == b"through"
            await hang_up((reader, writer))
        egress.main.renew()  # the next session
        assert await told(egress) == 0
        users = [user for user, *_ in proxy.asked]
        assert users[0] == users[1] != users[2]
        assert all(user.startswith(f"{NAME}-") and "{" not in user for user in users)
        assert egress.load.routes == {"p0": {"connected": 3}}
        assert not egress._dialer._machine.asked  # type: ignore[attr-defined]


@KINDS
@scene
async def test_sessions_take_turns_and_keep_their_proxy(kind: Kind) -> None:
    async with ways_to("shop.example", kind, kind) as (egress, [one, other]):
        for expected in ((2, 0), (2, 2), (4, 2)):
            await told(egress)
            await told(egress)
            assert (len(one.asked), len(other.asked)) == expected
            egress.main.renew()


@KINDS
@pytest.mark.parametrize("fault", ["hangs_up", "password", "gone"])
@scene
async def test_one_that_fails_is_left_out_and_tried_again(kind: Kind, fault: str) -> None:
    async with ways_to("shop.example", kind, kind) as (egress, [one, other]):
        real = egress._dialer.upstreams._by_name["p0"]
        if fault == "gone":
            real.port = 1
        else:
            setattr(one, fault, "another" if fault == "password" else True)
        for _ in range(3):  # the first finds out, the others do not ask it
            assert await told(egress) == 0
            egress.main.renew()
        assert len(other.asked) == 3
        assert egress.load.routes == {"p1": {"connected": 3}}
        one.hangs_up, one.password, real.port = False, PASSWORD, one.port
        real.rests_until -= upstream.REST_SECONDS[0]  # a while later
        assert await told(egress) == 0
        assert len(one.asked) == 1


@KINDS
@scene
async def test_a_session_that_has_begun_with_a_proxy_fails_with_it(kind: Kind) -> None:
    async with ways_to("shop.example", kind, kind) as (egress, [one, other]):
        _, streams = await ask(egress, "shop.example", 443)
        one.cut()
        assert await closed(streams) == b""
        one.password = "another"
        assert await told(egress) != 0
        failure = egress.failure("https://shop.example/")
        assert failure is not None
        assert failure.reason == "upstream"
        assert "the upstream proxy p0 refuses the user name and password" in failure.message
        assert PASSWORD not in failure.message
        assert not other.asked
        probed = await egress.main.probe("https://shop.example/", SECONDS)
        assert probed.is_route
        assert await told(egress) != 0
        egress.main.renew()
        assert await told(egress) == 0  # by the other


@KINDS
@scene
async def test_a_host_that_the_proxy_does_not_reach_is_not_its_failure(kind: Kind) -> None:
    async with ways_to("shop.example", kind) as (egress, _):
        health = egress._dialer.upstreams._by_name["p0"]
        for host in ("a.example", "b.example", "a.example"):
            assert await told(egress, host) != 0
            failure = egress.failure(f"https://{host}/")
            assert failure is not None
            assert failure.reason == "unreached"
            assert "net::" not in failure.message
        assert not health.rests_until
        assert not (await egress.main.probe("https://a.example/", SECONDS)).is_route
        await told(egress, "c.example")  # a third one: it reaches nothing
        assert health.rests_until
        assert await told(egress) == 0  # which is tried all the same, as there is no other
        assert not health.rests_until


PRIVATE = ["localhost", "a.localhost", "printer", "nas.local", "db.internal", "x.home.arpa", "wiki.corp"]
PRIVATE += ["10.0.0.1", "127.0.0.1", "169.254.169.254", "192.168.1.1", "2130706433", "0x7f.1"]


@KINDS
@scene
async def test_private_names_and_addresses_do_not_go_upstream(kind: Kind) -> None:
    async with upstream_proxy(kind, {}) as proxy, through(proxy, ports=(443,)) as egress:
        for host in PRIVATE:
            assert await told(egress, host) == 2, host
        assert await told(egress, "shop.example", 22) == 2
        assert not proxy.asked
        assert await told(egress, "93.184.215.14") != 2
        assert proxy.asked == [(NAME, "93.184.215.14", 443)]


@KINDS
@scene
async def test_a_proxy_may_get_checked_addresses_alone(kind: Kind) -> None:
    names = {"inside.example": ["10.0.0.7"], "shop.example": ["93.184.215.14"]}
    way = ways_to("93.184.215.14", kind, names=names, settings={"resolve": "here"})
    async with way as (egress, [proxy]):
        assert await told(egress, "inside.example") == 2
        assert await told(egress, "shop.example") == 0
        assert proxy.asked == [(NAME, "93.184.215.14", 443)]


@scene
async def test_hosts_have_routes_of_their_own() -> None:
    async with AsyncExitStack() as stack:
        port = await stack.enter_async_context(serve(echo))
        places = {"shop.example": port, "forum.example": port}
        one = await stack.enter_async_context(upstream_proxy("http", places))
        other = await stack.enter_async_context(upstream_proxy("socks5", places))
        allow = (HERE, f"offline.test={HERE}:{port}")
        routes = (f"{HERE}=direct", "forum.example:443=p1", "*.example=p0", "shop.example=p0")
        egress = await stack.enter_async_context(through(one, other, allow=allow, routes=routes))
        for host, port_there in (("forum.example", 443), ("shop.example", 443), (HERE, port)):
            assert await told(egress, host, port_there) == 0
        assert await told(egress, "offline.test", 80) == 0
        assert (other.asked, one.asked) == (
            [(NAME, "forum.example", 443)],
            [(NAME, "shop.example", 443)],
        )
        assert {name: sum(by.values()) for name, by in egress.load.routes.items()} == {
            "p0": 1, "p1": 1, "direct": 2,
        }  # fmt: skip
        assert egress.main.route_to("https://forum.example/") == "p1"
        assert egress.main.route_to("http://offline.test/") == "direct"


def test_settings_are_read_at_once_and_name_no_password(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refused(**settings: Any) -> str:
        with pytest.raises(ValidationError) as error:
            EgressConfig.model_validate(settings)
        return error.value.errors()[0]["msg"]

    def of(address: str) -> dict[str, Any]:
        return {"p": {"address": address}}

    assert "credentials" in (said := refused(upstream=of("http://ann:s3cret@host:1")))
    assert "s3cret" not in said
    assert "no proxy's address" in refused(upstream=of("https://host:1"))
    assert "'q' is not among" in refused(upstream=of("http://host:1"), routes=("a.example=q",))
    assert "'direct' cannot" in refused(upstream={"direct": {"address": "http://host:1"}})
    monkeypatch.setenv("UPSTREAM", "nothing")
    for credentials in ("$UPSTREAM", "$UNSET", str(tmp_path / "none")):
        each = {"address": "http://host:1", "credentials": credentials}
        with pytest.raises(ConfigError, match="the upstream proxy p"):
            Egress(EgressConfig.model_validate({"upstream": {"p": each}}))


# --- a browser ------------------------------------------------------------------------------------------

PAGE = """<title>waits</title><script>
const socket = new WebSocket(`wss://${location.host}/socket`);
socket.onopen = () => socket.send('hello');
socket.onmessage = async ({ data }) => document.title = `${data} ${await (await fetch('/say')).text()}`;
</script>"""


@asynccontextmanager
async def shop(certificate: trustme.LeafCert) -> AsyncIterator[int]:
    """A website with TLS and a WebSocket; its port."""

    async def socket(request: web.Request) -> web.StreamResponse:
        answer = web.WebSocketResponse()
        await answer.prepare(request)
        async for message in answer:
            await answer.send_str(message.data)
        return answer

    async def page(_: web.Request) -> web.Response:
        return web.Response(text=PAGE, content_type="text/html")

    async def say(_: web.Request) -> web.Response:
        return web.Response(text="world")

    app = web.Application()
    app.add_routes([web.get("/", page), web.get("/say", say), web.get("/socket", socket)])
    runner = web.AppRunner(app, shutdown_timeout=0.1)
    await runner.setup()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    certificate.configure_cert(context)
    site = web.TCPSite(runner, HERE, 0, ssl_context=context)
    await site.start()
    try:
        yield runner.addresses[0][1]
    finally:
        await runner.cleanup()


H2 = """
const { readFileSync } = require('fs');
const [key, cert] = process.argv.slice(1).map((file) => readFileSync(file));
const server = require('http2').createSecureServer({ key, cert }, (request, response) =>
  response.end(`<title>HTTP/${request.httpVersion}</title>`));
server.listen(0, '127.0.0.1', () => console.log(server.address().port));
"""


@asynccontextmanager
async def second_http(certificate: trustme.LeafCert, folder: Path) -> AsyncIterator[int | None]:
    """A website of HTTP/2; its port. ``None`` on a machine without Node.js."""
    node = shutil.which("node")
    if node is None:
        yield None
        return
    files = folder / "key.pem", folder / "cert.pem"
    certificate.private_key_pem.write_to_path(files[0])
    certificate.cert_chain_pems[0].write_to_path(files[1])
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(node, "-e", H2, *map(str, files), stdout=pipe)
    assert process.stdout is not None
    try:
        yield int(await process.stdout.readline())
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


@pytest.mark.browser
@pytest.mark.asyncio(loop_scope="package")
@KINDS
async def test_a_browser_goes_through(
    kind: Kind, executable: Path, profiles: ProfileRoot, tmp_path: Path
) -> None:
    certificate = trustme.CA().issue_cert("shop.example", "fast.example")
    identity = {"ignore_tls_errors": ("shop.example", "fast.example")}
    async with AsyncExitStack() as stack:
        places = {"shop.example": await stack.enter_async_context(shop(certificate))}
        fast = await stack.enter_async_context(second_http(certificate, tmp_path))
        proxy = await stack.enter_async_context(upstream_proxy(kind, places))
        egress = await stack.enter_async_context(through(proxy))
        slot = Slot(BrowserConfig(), executable, profiles, egress)
        stack.push_async_callback(slot.stop)
        await slot.open(PageOptions(identity=identity))
        look = await slot.step(Navigate("https://shop.example/"))
        assert (look.observation.title, look.observation.route) == ("hello world", "p0")
        if fast is not None:
            proxy.places = {**places, "fast.example": fast}
            look = await slot.step(Navigate("https://fast.example/"))
            assert look.observation.title == "HTTP/2.0"
        assert {host for _, host, _ in proxy.asked} <= {"shop.example", "fast.example"}
        proxy.cut()
        proxy.hangs_up = True
        look = await slot.step(Navigate("https://shop.example/say"))
        assert [(fault.kind, fault.is_typed) for fault in look.observation.faults] == [("route", True)]
        assert "the upstream proxy p0 hung up" in look.observation.faults[0].why
        await until(lambda: egress.load.routes["p0"].get("upstream"))
