"""Small applications on a free port of this machine, for the length of a block."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable
from typing import TypeVar

import uvicorn
from starlette.types import ASGIApp

from webgym.server.listening import Quiet

T = TypeVar("T")


@contextlib.asynccontextmanager
async def serving(make: Callable[[int], T], app_of: Callable[[T], ASGIApp]) -> AsyncIterator[T]:
    """Serve the application of what is made with the port's number."""
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as listener:
        made = make(listener.getsockname()[1])
        config = uvicorn.Config(
            app_of(made), lifespan="off", log_config=None, ws="none", timeout_graceful_shutdown=1
        )
        server = Quiet(config)
        task = asyncio.create_task(server.serve(sockets=[listener]))
        try:
            yield made
        finally:
            server.should_exit = True
            await task
