"""The ASGI application that serves the offline web, a context manager that runs it, and a client of it.

Requests are routed by their ``Host`` header: a website's hostname is answered by the website, any other by a
small administration API with a token, which returns a website's state for a visitor. Browsers are directed
here by rules of the egress policy, so pages have plain URLs on port 80.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import os
import secrets
import socket
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final, Self

import aiohttp
import uvicorn
from starlette.formparsers import MultiPartException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.types import Message, Receive, Scope, Send

from webgym.core.errors import ConfigError, SitesError
from webgym.offline import latency
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.offline.website import TOP_LEVEL_DOMAIN, Visit, Website
from webgym.server.listening import QuietServer

VISITOR_COOKIE = "webgym_visitor"
_SERVED_COOKIE: Final = "webgym_served"
"""What a browser that a website has served sends: without the visitor's state, this was lost."""
ASSETS = Path(__file__).parent / "assets"
ASSET_TYPES = {".css": "text/css; charset=utf-8", ".js": "text/javascript; charset=utf-8"}


_LARGEST_FORM: Final = 2**20
"""Most bytes of the body of a form."""


class SitesApp:
    """The ASGI application.

    Args:
        web: the websites.
        config: latency and the slow websites' delay.
        token: of the administration API.

    Attributes:
        is_closing: once it is set, simulated latency ends, as the server waits for all answers.
    """

    def __init__(self, web: OfflineWeb, config: SitesConfig, token: str) -> None:
        self.web = web
        self.config = config
        self.is_closing = asyncio.Event()
        self.visitors = Visitors()
        self._token = token
        self._requests: Counter[tuple[str, str]] = Counter()
        self._assets = {
            path.name: (path.read_bytes(), ASSET_TYPES[path.suffix]) for path in sorted(ASSETS.iterdir())
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI entry point."""
        if scope["type"] != "http":
            return
        request = Request(scope, receive)
        host = (request.url.hostname or "").lower()
        try:
            if host.endswith(f".{TOP_LEVEL_DOMAIN}"):
                response = await self._website(request, host)
            else:
                response = self._administration(request)
        except ClientDisconnect:
            return  # the browser disconnected before its form was read
        await response(scope, receive, send)

    async def _website(self, request: Request, host: str) -> Response:
        site = self.web.website(host)
        if site is None:
            return PlainTextResponse("There is no website at this address.", status_code=404)
        if request.url.path.startswith("/assets/"):
            return self._asset(request.url.path.removeprefix("/assets/"))
        await self._simulate_latency(site, request.url.path)
        visitor = request.cookies.get(VISITOR_COOKIE)
        visitor_id = visitor or secrets.token_hex(8)
        try:
            visit = await self._visit(request, visitor_id, site)
        except (MultiPartException, _TooLarge) as error:
            status = 413 if isinstance(error, _TooLarge) else 400
            return PlainTextResponse("The form cannot be read.", status_code=status)
        page = site.handle(visit)
        response = Response(page.body, page.status, media_type=page.media_type)
        if page.location is not None:
            response.headers["location"] = page.location
        if page.media_type == "image/svg+xml":
            response.headers["cache-control"] = "max-age=3600"
        if visitor is None:
            response.set_cookie(VISITOR_COOKIE, visitor_id, samesite="lax", httponly=True)
        if _SERVED_COOKIE not in request.cookies:
            response.set_cookie(_SERVED_COOKIE, "1", samesite="lax", httponly=True)
        return response

    async def _visit(self, request: Request, visitor: str, site: Website) -> Visit:
        pairs = request.query_params.multi_items()
        form: list[tuple[str, str]] = []
        if request.method == "POST":
            form = [
                (key, str(value)) for key, value in (await (await _bounded(request)).form()).multi_items()
            ]
        lists: dict[str, list[str]] = {}
        for key, value in (*pairs, *form):
            lists.setdefault(key, []).append(value)
        return Visit(
            method="GET" if request.method == "HEAD" else request.method,
            path=request.url.path,
            query=dict(pairs),
            lists=lists,
            form=dict(form),
            state=self.visitors.state(visitor, site.host, was_served=_SERVED_COOKIE in request.cookies),
        )

    async def _simulate_latency(self, site: Website, path: str) -> None:
        self._requests[site.host, path] += 1
        config, nth = self.config, self._requests[site.host, path]
        seconds = latency.seconds(
            self.web.seed,
            site.host,
            path,
            nth,
            config.latency,
            sigma=config.latency_sigma,
            longest=config.latency_longest,
        )
        if site.behaviour == "slow" and not path.startswith("/picture/"):
            seconds += self.config.slow_seconds
        if seconds:
            with suppress(TimeoutError):
                await asyncio.wait_for(self.is_closing.wait(), seconds)

    def _asset(self, name: str) -> Response:
        if name not in self._assets:
            return PlainTextResponse("No such file.", status_code=404)
        body, media_type = self._assets[name]
        return Response(body, media_type=media_type, headers={"cache-control": "max-age=3600"})

    def _administration(self, request: Request) -> Response:
        token = request.headers.get("authorization", "").removeprefix("Bearer ")
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return JSONResponse({"error": "the token is wrong or missing"}, status_code=401)
        match request.url.path.strip("/").split("/"):
            case ["websites"]:
                return JSONResponse(self._directory())
            case ["visitors", visitor, host]:
                return self._state(visitor, host)
            case _:
                return JSONResponse({"error": "no such address"}, status_code=404)

    def _directory(self) -> list[dict[str, str]]:
        return [
            {
                "host": host,
                "brand": spec.brand,
                "family": spec.family.family,
                "split": spec.split,
                "digest": spec.digest,
            }
            for host, spec in self.web.specs.items()
        ]

    def _state(self, visitor: str, host: str) -> Response:
        site = self.web.website(host)
        state: dict[str, Any] | None = self.visitors.known(visitor, host)
        if site is None or state is None or site.behaviour == "forgets":
            return JSONResponse({"error": f"{host} has no such visitor"}, status_code=404)
        return JSONResponse(site.report(state))


class _TooLarge(Exception):
    """The body of a form is larger than :data:`_LARGEST_FORM`."""


async def _bounded(request: Request) -> Request:
    """The request with its body read.

    Raises:
        _TooLarge: the body is too large; the rest is not read.
    """
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > _LARGEST_FORM:
            raise _TooLarge

    async def receive() -> Message:
        return {"type": "http.request", "body": bytes(body), "more_body": False}

    return Request(request.scope, receive)


@dataclass(frozen=True)
class RunningSites:
    """The offline web, being served.

    Attributes:
        web: its websites.
        address: ``host:port`` of the server.
        token: of the administration API.
    """

    web: OfflineWeb
    address: str
    token: str

    @property
    def url(self) -> str:
        """Base URL of the administration."""
        return f"http://{self.address}"

    @property
    def allowed_hosts(self) -> list[str]:
        """The rules of the egress policy that direct browsers to this server."""
        return self.web.allowed_hosts(self.address)


@asynccontextmanager
async def serving(config: SitesConfig, web: OfflineWeb | None = None) -> AsyncIterator[RunningSites]:
    """Serve the offline web in this process until the block ends.

    Args:
        config: settings of the server.
        web: its websites; ``None`` makes them from ``config``.

    Raises:
        ConfigError: the address cannot be listened on.
    """
    web = web or OfflineWeb(config.seed, per_family=config.per_family, collection=config.collection)
    token = config.token.get_secret_value() if config.token else secrets.token_urlsafe(24)
    try:
        listener = socket.create_server((config.host, config.port))  # from now on, clients wait
    except OSError as error:
        raise ConfigError(
            f"cannot listen on {config.host}:{config.port}: {os.strerror(error.errno or 0)}",
            hint="choose another port, or 0 for a free one",
        ) from error
    app = SitesApp(web, config, token)
    server = QuietServer(
        uvicorn.Config(
            app,
            log_level="error",
            access_log=False,
            lifespan="off",
            date_header=False,
            server_header=False,
            timeout_keep_alive=config.keep_alive_seconds,
            timeout_graceful_shutdown=1,
        )
    )
    running = asyncio.create_task(server.serve(sockets=[listener]))
    try:
        host, port = listener.getsockname()[:2]
        yield RunningSites(web, f"{host}:{port}", token)
    finally:
        app.is_closing.set()
        server.should_exit = True
        await running
        listener.close()


REMEMBERED = 50_000
"""Most visitor states that are kept; the least recently used are dropped first. A state is about 1 kB."""


class Visitors:
    """Stores the state per visitor and website.

    A visitor is identified by a cookie. The collector sets it for each attempt, so that it can request the
    state afterwards; a browser without it gets a random one. A state that is lost, by a restart or as the
    least recently used one, begins again, and is not reported: what the visitor did before is missing in it.
    """

    def __init__(self) -> None:
        self._states: OrderedDict[tuple[str, str], dict[str, Any]] = OrderedDict()
        self._incomplete: set[tuple[str, str]] = set()

    def state(self, visitor: str, host: str, *, was_served: bool = False) -> dict[str, Any]:
        """The state, created if there is none; the caller may modify it.

        Args:
            visitor: the visitor.
            host: the website.
            was_served: whether the website has served the visitor before.
        """
        key = (visitor, host)
        if was_served and key not in self._states:
            self._incomplete.add(key)
        state = self._states.setdefault(key, {})
        self._states.move_to_end(key)
        if len(self._states) > REMEMBERED:
            self._incomplete.discard(self._states.popitem(last=False)[0])
        return state

    def known(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a visitor, or ``None`` if there is none, or a part of it was lost."""
        key = (visitor, host)
        return None if key in self._incomplete else self._states.get(key)


ANSWER_SECONDS = 30.0
"""Longest time for a response of the administration API."""


class SitesClient:
    """A client of the administration API of a running offline web.

    Args:
        url: base URL of the administration API.
        token: its token.
    """

    def __init__(self, url: str, token: str) -> None:
        self.url = url.rstrip("/")
        headers = {"authorization": f"Bearer {token}"}
        timeout = aiohttp.ClientTimeout(total=ANSWER_SECONDS)
        self._http = aiohttp.ClientSession(headers=headers, timeout=timeout)

    def visitor_cookie(self, visitor: str) -> tuple[str, str, str]:
        """Name, value and domain of the cookie that identifies a browser as this visitor."""
        return VISITOR_COOKIE, visitor, f".{TOP_LEVEL_DOMAIN}"

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a website for a visitor; ``None`` if it has no such visitor.

        Raises:
            SitesError: the offline web does not respond, or responds with an error.
        """
        status, content = await self._get(f"/visitors/{visitor}/{host}")
        if status == HTTPStatus.NOT_FOUND:
            return None
        state: dict[str, Any] = self._json(status, content)
        return state

    async def websites(self) -> list[dict[str, str]]:
        """The websites: ``host``, ``brand``, ``family``, ``split`` and ``digest`` of each.

        Raises:
            SitesError: the offline web does not respond, or responds with an error.
        """
        websites: list[dict[str, str]] = self._json(*await self._get("/websites"))
        return websites

    async def _get(self, path: str) -> tuple[int, bytes]:
        """Status and content of a response."""
        try:
            async with self._http.get(self.url + path, allow_redirects=False) as response:
                return response.status, await response.read()
        except (aiohttp.ClientError, OSError, ValueError) as error:
            raise SitesError(
                f"the offline web at {self.url} does not respond: {type(error).__name__}",
                hint="start it with webgym sites serve",
            ) from error

    def _json(self, status: int, content: bytes) -> Any:
        if status == HTTPStatus.UNAUTHORIZED:
            raise SitesError(
                "the offline web refused the token", hint="give the token that it was started with"
            )
        if status != HTTPStatus.OK:
            raise SitesError(f"the offline web at {self.url} responded with status {status}")
        return json.loads(content)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._http.close()
