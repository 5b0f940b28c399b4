"""The common part of worker and gateway: authentication, limits, decoding, typed errors, streams of state."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from functools import partial
from typing import Any, TypeVar

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from webgym.core.errors import (
    BrowserError,
    BrowserTimeout,
    LeaseLost,
    NoCapacity,
    ProtocolError,
    ServerUnreachable,
    TooManySessions,
    TooManyWaiting,
    Unauthorized,
    WebGymError,
)
from webgym.server.callers import Tokens
from webgym.server.messages import (
    HEALTHY,
    INSTANCE_HEADER,
    UNHEALTHY_STATUS,
    ErrorBody,
    ErrorReply,
    Health,
    Watched,
)
from webgym.server.metrics import CallMetrics
from webgym.server.operations import JSON, MSGPACK, OPERATIONS, Operation

log = logging.getLogger(__name__)

T = TypeVar("T")

_JPEG_BEGINS = b"\xff\xd8\xff"

_STATUS_OF: dict[type[WebGymError], int] = {
    Unauthorized: 401,
    LeaseLost: 410,
    TooManySessions: 429,
    TooManyWaiting: 429,
    NoCapacity: 503,
    ServerUnreachable: 502,
    ProtocolError: 400,
    BrowserTimeout: 504,
    BrowserError: 502,
    WebGymError: 500,
}
"""HTTP status by error class; the first class of an error's MRO that is in the table decides."""

_HEADERS_OF = {401: {"www-authenticate": "Bearer"}, 429: {"retry-after": "5"}}


class _TooLarge(ProtocolError):
    """A request body over the limit."""


class HttpFrontend:
    """Handles the HTTP side of one server's operations.

    Args:
        tokens: valid tokens, for operations that are not open.
        body_bytes: largest request body.
        instance: id of this run of the server.
        metrics: records times and errors.
    """

    def __init__(self, tokens: Tokens, body_bytes: int, instance: str, metrics: CallMetrics) -> None:
        self._tokens = tokens
        self._body_bytes = body_bytes
        self.instance = instance
        self._metrics = metrics

    def application(self, work: Callable[[Operation[Any], Request], Awaitable[Any]]) -> Starlette:
        """The application with the routes of all operations, which ``work`` carries out. Any other path is an
        error, never redirected."""
        routes = [
            Route(
                operation.path, self.endpoint(operation, partial(work, operation)), methods=[operation.method]
            )
            for operation in OPERATIONS
        ]
        app = Starlette(routes=routes, exception_handlers={HTTPException: _http_error})
        app.router.redirect_slashes = False
        return app

    def endpoint(
        self, operation: Operation[Any], work: Callable[[Request], Awaitable[Any]]
    ) -> Callable[[Request], Awaitable[Response]]:
        """The request handler of one operation: ``work`` with authentication, metrics and error handling."""
        seconds = self._metrics.seconds.labels(operation.name)
        errors = self._metrics.errors

        async def serve(request: Request) -> Response:
            start = time.perf_counter()
            try:
                self.admit(operation, request)
                return self._response(operation, await work(request))
            except WebGymError as error:
                errors.labels(operation.name, error.code).inc()
                return error_response(error)
            except ClientDisconnect:
                return Response(status_code=499)
            except asyncio.CancelledError:  # the call did not end within the shutdown time
                errors.labels(operation.name, ServerUnreachable.code).inc()
                return error_response(ServerUnreachable("the server stopped before the call had ended"))
            except Exception as error:
                log.exception("%s failed with an internal error", operation.name)
                errors.labels(operation.name, "internal").inc()
                return error_response(WebGymError(f"internal error in the server: {error!r}"))
            finally:
                seconds.observe(time.perf_counter() - start)

        return serve

    def admit(self, operation: Operation[Any], request: Request) -> None:
        """Authenticate a caller, and set ``request.state.caller`` to the name of its token.

        Raises:
            Unauthorized: the operation is not open and the caller has no valid token.
        """
        request.state.caller = self._tokens.name_of(request.headers.get("authorization", ""))
        if not operation.is_open and request.state.caller is None:
            raise Unauthorized(
                "the token is invalid or missing", hint="`webgym serve` says where its token is"
            )

    async def body(self, request: Request) -> bytes:
        """A request's complete body.

        Raises:
            ProtocolError: it is larger than the limit.
        """
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > self._body_bytes:
                raise _TooLarge(f"the request is larger than {self._body_bytes} bytes")
        return bytes(body)

    def _response(self, operation: Operation[Any], result: Any) -> Response:
        if isinstance(result, Response):
            return result
        if isinstance(result, bytes):
            is_jpeg = result.startswith(_JPEG_BEGINS)  # the session chose it
            return Response(result, media_type="image/jpeg" if is_jpeg else operation.media)
        if isinstance(result, AsyncIterator):
            return StreamingResponse(result, media_type=operation.media)
        if operation.media == MSGPACK:
            return Response(msgspec.msgpack.encode(result), media_type=MSGPACK)
        response = Response(msgspec.json.encode(result), media_type=JSON)
        if isinstance(result, Health):
            response.headers[INSTANCE_HEADER] = self.instance
            response.status_code = 200 if result.status == HEALTHY else UNHEALTHY_STATUS
        return response


def decode(body: bytes, shape: type[msgspec.Struct]) -> Any:
    """Decode a request's body.

    Raises:
        ProtocolError: it does not have the required form.
    """
    try:
        return msgspec.json.decode(body or b"{}", type=shape)
    except (msgspec.MsgspecError, ValueError, UnicodeError, RecursionError) as error:
        raise ProtocolError(f"the request is invalid: {error}", hint="see /openapi.json") from None


async def while_connected(
    request: Request, work: Coroutine[Any, Any, T], undo: Callable[[T], Awaitable[object]]
) -> T:
    """Do the work while the caller is connected.

    Args:
        request: the request.
        work: the work, which is cancelled if the caller disconnects.
        undo: called with its result if it finished all the same.

    Raises:
        ClientDisconnect: the caller disconnected.
    """
    task = asyncio.create_task(work)
    disconnect = asyncio.create_task(_disconnected(request))
    try:
        await asyncio.wait({task, disconnect}, return_when=asyncio.FIRST_COMPLETED)
        if not disconnect.done():
            return task.result()
        task.cancel()
        await asyncio.wait({task})
        if not task.cancelled() and task.exception() is None:
            await undo(task.result())
        raise ClientDisconnect
    finally:
        disconnect.cancel()
        if not task.done():
            task.cancel()
        await asyncio.wait({disconnect, task})


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def _http_error(_: Request, error: Exception) -> Response:
    """A path or method that does not exist."""
    assert isinstance(error, HTTPException)
    return error_response(ProtocolError(error.detail, hint="see /openapi.json"), error.status_code)


def error_response(error: WebGymError, status: int | None = None) -> Response:
    """The HTTP response for a typed error."""
    if status is None:
        known = (_STATUS_OF[ancestor] for ancestor in type(error).__mro__ if ancestor in _STATUS_OF)
        status = 413 if isinstance(error, _TooLarge) else next(known)
    # An error class that is private to a module is sent as its public base class.
    public = next(cls for cls in type(error).__mro__ if cls.__module__ == WebGymError.__module__)
    code = getattr(public, "code", WebGymError.code)
    body = ErrorReply(ErrorBody(code, error.message, error.hint))
    headers = _HEADERS_OF.get(status)
    return Response(msgspec.json.encode(body), status_code=status, media_type=JSON, headers=headers)


class Feed:
    """The subscribers of one server.

    A line contains the state at the time of writing, so a slow subscriber misses intermediate states but
    never the last.

    Args:
        read: returns the current state.
        beat_seconds: longest time without a line. A subscriber without one for longer knows that the server
            is gone.
    """

    def __init__(self, read: Callable[[], Watched], beat_seconds: float) -> None:
        self._read = read
        self._beat_seconds = beat_seconds
        self._watchers: set[asyncio.Event] = set()
        self._is_closed = False

    def changed(self) -> None:
        """Announce that the state may have changed."""
        for watcher in self._watchers:
            watcher.set()

    def close(self) -> None:
        """End every subscriber's stream."""
        self._is_closed = True
        self.changed()

    async def lines(self) -> AsyncIterator[bytes]:
        """One subscriber's stream, beginning with the current state."""
        change = asyncio.Event()
        self._watchers.add(change)
        try:
            while not self._is_closed:
                change.clear()
                yield msgspec.json.encode(self._read()) + b"\n"
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(self._beat_seconds):
                        await change.wait()
        finally:
            self._watchers.discard(change)
