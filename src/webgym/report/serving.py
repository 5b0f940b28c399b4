"""Serving pages to the user of this machine only: on loopback, and under loopback host names."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.responses import HTMLResponse, PlainTextResponse, Response

from webgym.core.errors import ConfigError

LOOPBACK: Final = "127.0.0.1"
"""The only address that is served, because the pages contain hidden truths. Use a tunnel from elsewhere."""
SAFE: Final[Mapping[str, str]] = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "X-Frame-Options": "DENY",
}
_NO_FRAME: Final = "frame-ancestors 'none'"
"""Protects against clickjacking by another website's frame. Browsers accept it only as a header, so it is not
in the documents' own policy."""
ONLY_LOCAL_NAMES: Final = Middleware(TrustedHostMiddleware, allowed_hosts=[LOOPBACK, "localhost"])
"""Protects against DNS rebinding: a website cannot reach the pages under its own host name."""


def page_reply(text: str, policy: str) -> Response:
    """A reply with an HTML document and its Content-Security-Policy."""
    headers = {**SAFE, "Content-Security-Policy": f"{policy}; {_NO_FRAME}"}
    return HTMLResponse(text, headers=headers)


def json_reply(value: Any) -> Response:
    """A JSON reply with any value that msgspec can encode."""
    return Response(msgspec.json.encode(value), media_type="application/json", headers=SAFE)


def error_reply(text: str, status: int) -> Response:
    """A plain-text reply with an error message and an HTTP status."""
    return PlainTextResponse(text, status_code=status, headers=SAFE)


def row_range(params: Mapping[str, str], most: int) -> tuple[int, int] | None:
    """The parameters ``after`` and ``count`` of a request for rows, ``count`` limited to ``most``.

    ``None`` if they are not whole numbers; :data:`BAD_RANGE` is the reply.
    """
    after, count = params.get("after", "0"), params.get("count", "1")
    if not (after.isdecimal() and count.isdecimal() and len(after + count) < 18):
        return None
    return int(after), min(int(count), most)


BAD_RANGE: Final = "after and count must be whole numbers"


class _Server(uvicorn.Server):
    """Sets ``closing`` when it shuts down, so that endless streams end; it would wait for them otherwise."""

    def __init__(self, config: uvicorn.Config, closing: asyncio.Event) -> None:
        super().__init__(config)
        self._closing = closing

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._closing.set()
        await super().shutdown(sockets)


async def serve(
    app: Starlette, port: int, ready: Callable[[str], None], closing: asyncio.Event | None = None
) -> None:
    """Serve an application until cancelled or interrupted.

    Args:
        app: the application.
        port: to listen on; 0 takes a free one.
        ready: called with the address once it accepts connections.
        closing: is set when streams have to end.

    Raises:
        ConfigError: the port cannot be listened on.
    """
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((LOOPBACK, port))
        except OSError as error:
            raise ConfigError(
                f"cannot listen on {LOOPBACK}:{port}: {error.strerror}",
                hint="choose another port, or leave --port out for a free one",
            ) from error
        listener.listen()
        config = uvicorn.Config(app, log_level="warning", lifespan="off")
        server = _Server(config, closing or asyncio.Event())
        ready(f"http://{LOOPBACK}:{listener.getsockname()[1]}/")
        try:
            await server.serve(sockets=[listener])
        except asyncio.CancelledError:
            # Otherwise the event loop keeps watching the closed socket's number, which the next socket gets.
            if server.started:
                server.force_exit = True
                await server.shutdown(sockets=[listener])
            raise
