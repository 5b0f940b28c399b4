"""HTTP in front of a service. Every route comes from the table of operations."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.requests import Request

from webgym.core.errors import Unauthorized
from webgym.server.http import HttpFrontend, application, decode, while_connected
from webgym.server.messages import GENERATION_HEADER, SECRET_HEADER, SessionGrant, SessionOptions
from webgym.server.operations import ALLOCATE, OPERATIONS, Operation
from webgym.server.quota import Quota, client_of
from webgym.server.service import Service
from webgym.server.tokens import OWN, Tokens


def create_app(service: Service, tokens: Tokens, *, instance: str = "", endpoint: str = "") -> Starlette:
    """The ASGI application of one service.

    Args:
        tokens: who may make calls that are not open.
        instance: which run of the server this is.
        endpoint: its base URL, as others may reach it; empty if unknown.
    """
    calls = _Calls(service, tokens, instance, endpoint)
    return application({operation: calls.endpoint(operation) for operation in OPERATIONS})


class _Calls:
    def __init__(self, service: Service, tokens: Tokens, instance: str, endpoint: str) -> None:
        self._service = service
        self._front = HttpFrontend(tokens, service.config.body_bytes, instance, service.observed)
        self._address = endpoint
        self._quota = Quota(service.config.sessions_per_client)
        service.on_end = self._quota.ended

    def endpoint(self, operation: Operation) -> Callable[[Request], Awaitable[Any]]:
        """What serves one operation's route."""

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
        if self._service.config.name and request.state.caller != OWN:
            raise Unauthorized(
                "a worker opens sessions for its gateway alone, which counts them", hint="ask the gateway"
            )
        client = client_of(request)
        with self._quota.asking(client):
            grant = await while_connected(request, self._service.allocate(options), self._undo)
            self._quota.granted(client, grant.session_id)
            if grant.session_id not in self._service.leases:  # it ran out before this was written down
                self._quota.ended(grant.session_id)
        return msgspec.structs.replace(grant, endpoint=self._address, instance=self._front.instance)

    async def _undo(self, grant: SessionGrant) -> None:
        leases = self._service.leases
        await leases.end(leases.check(grant.session_id, grant.secret, str(grant.generation)))
