"""The HTTP application with the paths, the API key and the error format of the authors' master server."""

from __future__ import annotations

import hmac
import logging
import math
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager, closing
from dataclasses import dataclass
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from webgym.compat.commands import MARKS, BadCommand, Json, parse_command, picture
from webgym.compat.instances import VIEWPORT, Instance, Instances, NoInstance
from webgym.core.errors import (
    NoCapacity,
    PageError,
    ServerUnreachable,
    TooManySessions,
    Unauthorized,
    WebGymError,
)
from webgym.server.client import BrowserClient
from webgym.server.config import ClientLimits, ServerConfig
from webgym.server.http import while_connected
from webgym.server.listening import listen, serving, url_of
from webgym.server.messages import HEALTHY
from webgym.server.operations import JSON, PNG

log = logging.getLogger(__name__)

KEY_HEADER = "x-api-key"

WAITING = 1024
"""Most callers of ``/get`` that wait for a slot at once."""

LIFETIME_MINUTES = 60.0
"""Lifetime of an instance whose ``lifetime_mins`` is missing or 0."""

LONGEST_MINUTES = 240.0
"""Longest lifetime that a client may request. A session does not last longer either."""


class BadRequest(WebGymError):
    """A parameter is missing or cannot be read."""

    code = "compat_bad_request"


class NoNode(WebGymError):
    """A request names a node that is not behind this layer."""

    code = "compat_no_node"


_STATUS_OF: dict[type[WebGymError], int] = {
    Unauthorized: 401,
    BadRequest: 422,
    BadCommand: 400,
    NoNode: 400,
    NoInstance: 400,
    NoCapacity: 503,
    TooManySessions: 503,
    ServerUnreachable: 503,
    WebGymError: 500,
}
"""HTTP status by error class; the first class of an error's MRO that is in the table decides. The authors'
server answers most errors with 500."""


def create_compat_app(instances: Instances, key: str, *, body_bytes: int) -> Starlette:
    """The ASGI application.

    Args:
        instances: the instances, entered by the caller.
        key: the API key, required as ``x-api-key``.
        body_bytes: largest request body.
    """
    layer = _Layer(instances, key, body_bytes)
    routes: list[tuple[str, str, Callable[[Request], Awaitable[Response]]]] = [
        ("POST", "/get", layer.get),
        ("POST", "/reset", layer.reset),
        ("GET", "/probe", layer.probe),
        ("GET", "/metadata", layer.metadata),
        ("GET", "/screenshot", layer.screenshot),
        ("POST", "/execute", layer.execute),
        ("GET", "/info", layer.info),
    ]
    return Starlette(
        routes=[Route(path, layer.endpoint(work), methods=[method]) for method, path, work in routes],
        exception_handlers={HTTPException: _http_error},
    )


async def _http_error(_: Request, error: Exception) -> Response:
    """A path or method that does not exist."""
    assert isinstance(error, HTTPException)
    return _error(error.detail, error.status_code)


def _error(message: str, status: int) -> Response:
    """An error reply. The authors' clients read the text; some read ``detail``, some ``message``."""
    return _json({"status": "error", "message": message, "detail": message}, status)


def _json(content: Any, status: int = 200) -> Response:
    return Response(msgspec.json.encode(content), status_code=status, media_type=JSON)


class _Layer:
    def __init__(self, instances: Instances, key: str, body_bytes: int) -> None:
        self._instances = instances
        self._client = instances.client
        self._key = key.encode()
        self._body_bytes = body_bytes
        self._node = instances.client.base_url

    def endpoint(
        self, work: Callable[[Request], Awaitable[Response]]
    ) -> Callable[[Request], Awaitable[Response]]:
        """The request handler of one path: ``work`` with authentication and error handling."""

        async def serve(request: Request) -> Response:
            try:
                self._authenticate(request)
                return await work(request)
            except ClientDisconnect:
                return Response(status_code=499)
            except WebGymError as error:
                status = next(_STATUS_OF[cls] for cls in type(error).__mro__ if cls in _STATUS_OF)
                return _error(str(error), status)
            except Exception as error:
                log.exception("%s failed with an internal error", request.url.path)
                return _error(f"internal error in the server: {error!r}", 500)

        return serve

    def _authenticate(self, request: Request) -> None:
        given = request.headers.get(KEY_HEADER)
        if given is None:
            raise Unauthorized("the API key is missing", hint=f"send it as {KEY_HEADER}")
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self._key):
            raise Unauthorized("the API key is wrong")

    # --- instances ----------------------------------------------------------------------------------

    async def get(self, request: Request) -> Response:
        """Create an instance."""
        text = request.query_params.get("lifetime_mins", "")
        try:
            minutes = float(text or 0) or LIFETIME_MINUTES
        except ValueError:
            minutes = math.nan
        if not minutes > 0:
            raise BadRequest(f'lifetime_mins is a number of minutes, not "{text[:40]}"')
        if minutes > LONGEST_MINUTES:
            raise BadRequest(f"lifetime_mins may be {LONGEST_MINUTES:g} at most, not {minutes:g}")

        async def undo(instance: Instance) -> None:
            self._instances.end(instance)

        instance = await while_connected(request, self._instances.create(minutes), undo)
        return _json({"instance_id": instance.id, "node": self._node})

    async def reset(self, request: Request) -> Response:
        """Release an instance's browser; the id can be used again, with a fresh one."""
        await self._instances.reset(self._instance_id(request.query_params))
        return _json({"status": "success"})

    async def probe(self, request: Request) -> Response:
        """Whether an instance lives."""
        instance = self._instances.find(self._instance_id(request.query_params))
        if instance.session is not None:  # a probe does not wait for a running call
            await instance.session.heartbeat()
        elif instance.failure:
            return _error(f"the instance's browser is gone: {instance.failure}", 500)
        return _json({"status": "success", "message": "the instance lives"})

    async def metadata(self, request: Request) -> Response:
        """The viewport, pixels."""
        self._instances.find(self._instance_id(request.query_params))
        width, height = VIEWPORT
        return _json({"width": width, "height": height})

    async def screenshot(self, request: Request) -> Response:
        """The viewport, PNG."""
        mode = request.query_params.get("interaction_mode", MARKS)
        instance_id = self._instance_id(request.query_params)
        async with self._instances.using(instance_id) as (instance, session):
            return Response(await picture(instance, session, mode), media_type=PNG)

    async def execute(self, request: Request) -> Response:
        """Carry out one command."""
        body = await self._body(request)
        instance_id = self._instance_id(body)
        commands = {name: value for name, value in body.items() if name not in {"instance_id", "node"}}
        command = parse_command(commands)
        try:
            async with self._instances.using(instance_id) as (instance, session):
                return _json(await command.run(instance, session))
        except PageError as error:
            return _error(f"{command.name} was not carried out: {error.message}", 500)

    def _instance_id(self, parameters: Any) -> str:
        """The instance id in a request, whose node must be this one."""
        for name in ("instance_id", "node"):
            if not isinstance(parameters.get(name), str):
                raise BadRequest(f"{name} is missing")
        if parameters["node"].rstrip("/") != self._node:
            raise NoNode(f"node {parameters['node'][:80]} is not found", hint="take it from /get or /info")
        return str(parameters["instance_id"])

    async def _body(self, request: Request) -> dict[str, Any]:
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > self._body_bytes:
                raise BadRequest(f"the request is larger than {self._body_bytes} bytes")
        try:
            return msgspec.json.decode(bytes(body), type=dict[str, Any])
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            raise BadRequest(f"the body is not a JSON object: {error}") from None

    # --- state --------------------------------------------------------------------------------------

    async def info(self, _: Request) -> Response:
        """The server behind this layer, as one node."""
        return _json({"nodes": [await self._describe_node()]})

    async def _describe_node(self) -> Json:
        node: Json = {"url": self._node, "hash": self._node, "healthy": False, "capacity": 0, "available": 0}
        try:
            health, pressure = await self._client.health(), await self._client.pressure()
        except ServerUnreachable as error:
            log.warning("the server behind the compatibility layer cannot be reached: %s", error)
            return node | {"instances": []}
        slots = pressure.slots
        return node | {
            "healthy": health.status == HEALTHY,
            "capacity": slots.total,
            "available": max(0, slots.total - slots.leased - slots.waiting),
            "instances": self._instances.held,
        }


@dataclass(frozen=True)
class RunningCompat:
    """A running compatibility layer.

    Attributes:
        url: its base URL.
        key: the API key.
        instances: its instances.
    """

    url: str
    key: str
    instances: Instances


@asynccontextmanager
async def running_compat(
    server_url: str,
    token: str,
    *,
    listening: ServerConfig,
    key: str | None = None,
    listener: socket.socket | None = None,
) -> AsyncIterator[RunningCompat]:
    """Serve the authors' API during the block, in front of a WebGym server.

    Args:
        server_url, token: URL and token of the worker or gateway behind the layer.
        listening: where the layer listens, and the limits of its HTTP server.
        key: the API key; by default the token.
        listener: the socket, if it is open already. It is closed at the end.

    Raises:
        ConfigError: the address cannot be listened on.
    """
    key = key or token
    limits = ClientLimits(allocate=WAITING, release=WAITING, wait_seconds=listening.allocate_seconds)
    async with AsyncExitStack() as stack:
        listener = stack.enter_context(closing(listener or listen(listening)))
        client = await stack.enter_async_context(BrowserClient(server_url, token=token, limits=limits))
        instances = await stack.enter_async_context(Instances(client))
        app = create_compat_app(instances, key, body_bytes=listening.body_bytes)
        await stack.enter_async_context(serving(app, listener, listening))
        yield RunningCompat(url_of(listener), key, instances)
