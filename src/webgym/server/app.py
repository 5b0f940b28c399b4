"""HTTP in front of a service: authentication, limits, decoding, typed errors.

Every route comes from the table of operations.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import time
from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from webgym.core.errors import (
    BrowserError,
    BrowserTimeout,
    LeaseLost,
    NoCapacity,
    ProtocolError,
    Unauthorized,
    WebGymError,
)
from webgym.server.messages import (
    GENERATION_HEADER,
    SECRET_HEADER,
    ErrorBody,
    ErrorReply,
    SessionGrant,
    SessionOptions,
)
from webgym.server.operations import ALLOCATE, JSON, MSGPACK, OPERATIONS, Operation
from webgym.server.service import Service

log = logging.getLogger(__name__)

_STATUS_OF: dict[type[WebGymError], int] = {
    Unauthorized: 401,
    LeaseLost: 410,
    NoCapacity: 503,
    ProtocolError: 400,
    BrowserTimeout: 504,
    BrowserError: 502,
    WebGymError: 500,
}
"""The first class of an error's ancestry that stands here decides."""


class _TooLarge(ProtocolError):
    """A request body over the limit."""


def create_app(service: Service, token: str) -> Starlette:
    """The ASGI application of one service.

    Args:
        token: bearer token of every call that is not open.
    """
    front = _Front(service, token)
    return Starlette(
        routes=[
            Route(operation.path, front.endpoint(operation), methods=[operation.method])
            for operation in OPERATIONS
        ],
        exception_handlers={HTTPException: _http_error},
    )


async def _http_error(_: Request, error: Exception) -> Response:
    """A path or method that does not exist."""
    assert isinstance(error, HTTPException)
    return _error_response(ProtocolError(error.detail, hint="see /openapi.json"), error.status_code)


class _Front:
    def __init__(self, service: Service, token: str) -> None:
        self._service = service
        self._authorization = f"Bearer {token}".encode()

    def endpoint(self, operation: Operation) -> Callable[[Request], Awaitable[Response]]:
        """What serves one operation's route."""
        metrics = self._service.observed
        seconds = metrics.seconds.labels(operation.name)

        async def serve(request: Request) -> Response:
            start = time.perf_counter()
            try:
                return _response(operation, await self._serve(operation, request))
            except WebGymError as error:
                metrics.errors.labels(operation.name, error.code).inc()
                return _error_response(error)
            except ClientDisconnect:
                return Response(status_code=499)
            except Exception as error:
                log.exception("%s failed by our own mistake", operation.name)
                metrics.errors.labels(operation.name, "internal").inc()
                return _error_response(WebGymError(f"the server made a mistake: {error!r}"))
            finally:
                seconds.observe(time.perf_counter() - start)

        return serve

    async def _serve(self, operation: Operation, request: Request) -> Any:
        if not operation.is_open:
            self._authenticate(request)
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
            arguments.append(await self._decode(request, operation.request))
        if operation is ALLOCATE:
            return await self._allocate(request, arguments[0])
        return await getattr(self._service, operation.name)(*arguments)

    def _authenticate(self, request: Request) -> None:
        given = request.headers.get("authorization", "").encode("utf-8", "replace")
        if not hmac.compare_digest(given, self._authorization):
            raise Unauthorized("the token is wrong or missing", hint="`webgym serve` says where its token is")

    async def _decode(self, request: Request, shape: type[msgspec.Struct]) -> msgspec.Struct:
        limit = self._service.config.body_bytes
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > limit:
                raise _TooLarge(f"the request is larger than {limit} bytes")
        try:
            return msgspec.json.decode(bytes(body) or b"{}", type=shape)
        except (msgspec.MsgspecError, ValueError, UnicodeError) as error:
            raise ProtocolError(f"the request is not understood: {error}", hint="see /openapi.json") from None

    async def _allocate(self, request: Request, options: SessionOptions) -> SessionGrant:
        """Stand in line for a caller only as long as the caller is there."""
        work = asyncio.create_task(self._service.allocate(options))
        gone = asyncio.create_task(_disconnected(request))
        try:
            await asyncio.wait({work, gone}, return_when=asyncio.FIRST_COMPLETED)
            if gone.done():
                work.cancel()
                await asyncio.wait({work})
                if not work.cancelled() and work.exception() is None:
                    await self._undo(work.result())
                raise ClientDisconnect
            grant = work.result()
        finally:
            gone.cancel()
            if not work.done():
                work.cancel()
            await asyncio.wait({gone, work})
        endpoint = f"{request.url.scheme}://{request.url.netloc}/v1/sessions/{grant.session_id}"
        return msgspec.structs.replace(grant, endpoint=endpoint)

    async def _undo(self, grant: SessionGrant) -> None:
        leases = self._service.leases
        await leases.end(leases.check(grant.session_id, grant.secret, str(grant.generation)))


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


def _response(operation: Operation, result: Any) -> Response:
    if isinstance(result, bytes):
        return Response(result, media_type=operation.media)
    if operation.media == MSGPACK:
        return Response(msgspec.msgpack.encode(result), media_type=MSGPACK)
    return Response(msgspec.json.encode(result), media_type=JSON)


def _error_response(error: WebGymError, status: int | None = None) -> Response:
    if status is None:
        status = 413 if isinstance(error, _TooLarge) else _status_of(type(error))
    # An error that is ours alone travels as the public class that it belongs to.
    public = next(cls for cls in type(error).__mro__ if cls.__module__ == WebGymError.__module__)
    code = getattr(public, "code", WebGymError.code)
    body = ErrorReply(ErrorBody(code, error.message, error.hint))
    headers = {"www-authenticate": "Bearer"} if status == 401 else None
    return Response(msgspec.json.encode(body), status_code=status, media_type=JSON, headers=headers)


def _status_of(cls: type[WebGymError]) -> int:
    return next(_STATUS_OF[ancestor] for ancestor in cls.__mro__ if ancestor in _STATUS_OF)
