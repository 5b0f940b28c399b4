"""Pages for the person at this machine: on loopback, under loopback names, and nothing else."""

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
from starlette.responses import HTMLResponse, Response

from webgym.core.errors import ConfigError

LOOPBACK: Final = "127.0.0.1"
"""The only address served: what is shown holds hidden truth. From elsewhere, come through a tunnel."""
SAFE: Final[Mapping[str, str]] = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "X-Frame-Options": "DENY",
}
_NO_FRAME: Final = "frame-ancestors 'none'"
"""In a frame of another site, a click of a person's could be made to hit a button. Not in the documents' own
policy: browsers heed it as a header alone, and complain about it elsewhere."""
ONLY_LOCAL_NAMES: Final = Middleware(TrustedHostMiddleware, allowed_hosts=[LOOPBACK, "localhost"])
"""So that no website can reach the pages by a name of its own."""


def page_reply(text: str, policy: str) -> Response:
    """A document with its policy."""
    headers = {**SAFE, "Content-Security-Policy": f"{policy}; {_NO_FRAME}"}
    return HTMLResponse(text, headers=headers)


def json_reply(value: Any) -> Response:
    """Anything that msgspec encodes, as an answer."""
    return Response(msgspec.json.encode(value), media_type="application/json", headers=SAFE)


class _Server(uvicorn.Server):
    """Lets streams without an end know that the server is to end: it would wait for them."""

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
        app: to serve.
        port: to listen on; 0 takes a free one.
        ready: is told the address as soon as it can be opened.
        closing: is set when streams are to end.

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
            # uvicorn leaves the loop watching a socket whose number the next one will have.
            if server.started:
                server.force_exit = True
                await server.shutdown(sockets=[listener])
            raise
