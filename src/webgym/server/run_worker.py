"""Runs one worker in this process: for tests, for the demo, and inside ``webgym serve``.

The routes of its HTTP application come from the table of operations.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, closing
from pathlib import Path
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.requests import Request

from webgym.browser.find import find_browser
from webgym.core.errors import Unauthorized
from webgym.server.config import ServerConfig
from webgym.server.http import HttpFrontend, application, decode, while_connected
from webgym.server.listening import is_wildcard, listen, serving, url_of
from webgym.server.messages import GENERATION_HEADER, SECRET_HEADER, SessionGrant, SessionOptions
from webgym.server.operations import ALLOCATE, OPERATIONS, Operation
from webgym.server.quota import Quota, client_of
from webgym.server.service import Service
from webgym.server.tokens import SERVER_CALLER, Tokens

TOKEN_BYTES = 32
_INSTANCE_BYTES = 8


class RunningServer:
    """A running worker.

    Attributes:
        url: its base URL.
        token: the bearer token.
        service: its service.
        instance: id of this run of the server.
    """

    def __init__(self, url: str, token: str, service: Service, instance: str) -> None:
        self.url = url
        self.token = token
        self.service = service
        self.instance = instance


async def _find_executable(explicit: Path | None) -> Path:
    return (await asyncio.to_thread(find_browser, explicit)).path


def new_instance() -> str:
    """A unique id for a run of a server."""
    return secrets.token_hex(_INSTANCE_BYTES)


@asynccontextmanager
async def running_server(config: ServerConfig | None = None) -> AsyncIterator[RunningServer]:
    """Serve during the block; afterwards no browser is left.

    Args:
        config: the settings; by default loopback, a free port, a random token.

    Raises:
        BrowserNotFound, BrowserLaunchFailed: no browser can be started.
        ConfigError: the address cannot be listened on.
    """
    config = config or ServerConfig()
    token = config.token or secrets.token_urlsafe(TOKEN_BYTES)
    tokens = Tokens(token, config.tokens_file)
    instance = new_instance()
    executable = await _find_executable(config.browser.executable)
    with closing(listen(config)) as listener:
        url = url_of(listener)
        async with Service(config, executable) as service:
            endpoint = "" if is_wildcard(config.host) else url
            app = create_app(service, tokens, instance=instance, endpoint=endpoint)
            async with tokens.watching_file(), serving(app, listener, config):
                try:
                    yield RunningServer(url, token, service, instance)
                finally:
                    service.feed.close()  # the streams of subscribers never end by themselves


def create_app(service: Service, tokens: Tokens, *, instance: str = "", endpoint: str = "") -> Starlette:
    """The ASGI application of one service.

    Args:
        service: the service.
        tokens: valid tokens, for operations that are not open.
        instance: id of this run of the server.
        endpoint: its base URL for other machines; empty if unknown.
    """
    calls = _Calls(service, tokens, instance, endpoint)
    return application({operation: calls.endpoint(operation) for operation in OPERATIONS})


class _Calls:
    def __init__(self, service: Service, tokens: Tokens, instance: str, endpoint: str) -> None:
        self._service = service
        self._front = HttpFrontend(tokens, service.config.body_bytes, instance, service.observed)
        self._endpoint = endpoint
        self._quota = Quota(service.config.sessions_per_client)
        service.on_end = self._quota.ended

    def endpoint(self, operation: Operation) -> Callable[[Request], Awaitable[Any]]:
        """The request handler of one operation."""

        async def work(request: Request) -> Any:
            return await self._serve(operation, request)

        return self._front.endpoint(operation, work)

    async def _serve(self, operation: Operation, request: Request) -> Any:
        arguments: list[Any] = []
        if operation.has_lease:
            arguments.append(
                self._service.leases.check(
                    request.path_params["id"],
                    request.headers.get(SECRET_HEADER, ""),
                    request.headers.get(GENERATION_HEADER, ""),
                )
            )
        if operation.request is not None:
            arguments.append(decode(await self._front.body(request), operation.request))
        if operation is ALLOCATE:
            return await self._allocate(request, arguments[0])
        return await getattr(self._service, operation.name)(*arguments)

    async def _allocate(self, request: Request, options: SessionOptions) -> SessionGrant:
        if self._service.config.name and request.state.caller != SERVER_CALLER:
            raise Unauthorized(
                "a worker opens sessions only for its gateway, which counts them", hint="call the gateway"
            )
        client = client_of(request)
        with self._quota.requesting(client):
            grant = await while_connected(request, self._service.allocate(options), self._undo)
            self._quota.granted(client, grant.session_id)
            if grant.session_id not in self._service.leases:  # it has expired in the meantime
                self._quota.ended(grant.session_id)
        return msgspec.structs.replace(grant, endpoint=self._endpoint, instance=self._front.instance)

    async def _undo(self, grant: SessionGrant) -> None:
        leases = self._service.leases
        await leases.end(leases.check(grant.session_id, grant.secret, str(grant.generation)))
