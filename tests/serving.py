"""Small applications on a free port of this machine, for the length of a block."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager
from typing import TypeVar

import uvicorn
from starlette.types import ASGIApp

from webgym.server.listening import QuietServer

T = TypeVar("T")


@contextlib.asynccontextmanager
async def serving(make: Callable[[int], T], app_of: Callable[[T], ASGIApp]) -> AsyncIterator[T]:
    """Serve the application of what is made with the port's number."""
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as listener:
        made = make(listener.getsockname()[1])
        config = uvicorn.Config(
            app_of(made),
            lifespan="off",
            log_config=None,
            ws="none",
            timeout_graceful_shutdown=1,
            timeout_keep_alive=60,  # or a busy client's next request meets a connection that is being closed
        )
        server = QuietServer(config)
        task = asyncio.create_task(server.serve(sockets=[listener]))
        try:
            yield made
        finally:
            server.should_exit = True
            await task


@contextlib.asynccontextmanager
async def serving_sockets(app: ASGIApp) -> AsyncIterator[str]:
    """Serve an application that speaks WebSockets, too; its URL."""
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as listener:
        server = QuietServer(uvicorn.Config(app, lifespan="on", log_config=None, timeout_graceful_shutdown=1))
        task = asyncio.create_task(server.serve(sockets=[listener]))
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            server.should_exit = True
            await task


@contextlib.contextmanager
def beside(context: AbstractAsyncContextManager[T]) -> Iterator[T]:
    """Hold what is asynchronous in a thread of its own, while this one runs a command."""
    started: Future[tuple[T, asyncio.AbstractEventLoop, asyncio.Event]] = Future()

    async def hold() -> None:
        over = asyncio.Event()
        async with context as made:
            started.set_result((made, asyncio.get_running_loop(), over))
            await over.wait()

    def run() -> None:
        try:
            asyncio.run(hold())
        except BaseException as error:
            if started.done():
                raise
            started.set_exception(error)

    thread = threading.Thread(target=run)
    thread.start()
    made, loop, over = started.result()
    try:
        yield made
    finally:
        loop.call_soon_threadsafe(over.set)
        thread.join()
