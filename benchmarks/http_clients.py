"""CPU time of a client per call with a screenshot: aiohttp and httpx.

    python benchmarks/http_clients.py

The server is a separate process, and responds to a small POST with a body of the size of a screenshot. The
rounds alternate, so that other load affects both clients.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import resource
import socket
import statistics
from collections.abc import Awaitable, Callable

import aiohttp
import httpx
import uvicorn
import uvloop
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

SIZES = (1_000, 80_000, 400_000)
CALLS = 960
AT_ONCE = 32
ROUNDS = 3
BODY = b'{"action": null}'


def serve(listener: socket.socket) -> None:
    async def answer(request: Request) -> Response:
        return Response(bytes(int(request.query_params["size"])), media_type="application/msgpack")

    app = Starlette(routes=[Route("/", answer, methods=["POST"])])
    uvicorn.Server(uvicorn.Config(app, log_level="error", access_log=False)).run(sockets=[listener])


def cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


async def cost(call: Callable[[], Awaitable[bytes]], size: int) -> float:
    """CPU milliseconds per call."""

    async def some() -> None:
        for _ in range(CALLS // AT_ONCE):
            assert len(await call()) == size

    await call()
    start = cpu_seconds()
    await asyncio.gather(*(some() for _ in range(AT_ONCE)))
    return (cpu_seconds() - start) * 1000 / CALLS


async def measure(url: str) -> None:
    connector = aiohttp.TCPConnector(limit=0)
    limits = httpx.Limits(max_connections=None, max_keepalive_connections=None)
    async with (
        aiohttp.ClientSession(connector=connector) as lean,
        httpx.AsyncClient(limits=limits, trust_env=False) as usual,
    ):
        print(f"{'bytes':>8}  {'aiohttp, ms':>20}  {'httpx, ms':>20}  ratio")
        for size in SIZES:
            there = f"{url}/?size={size}"

            async def with_aiohttp(there: str = there) -> bytes:
                async with lean.post(there, data=BODY) as response:
                    return await response.read()

            async def with_httpx(there: str = there) -> bytes:
                return (await usual.post(there, content=BODY)).content

            rounds = [(await cost(with_aiohttp, size), await cost(with_httpx, size)) for _ in range(ROUNDS)]
            told = [
                f"{statistics.median(costs):.2f} ({min(costs):.2f}-{max(costs):.2f})"
                for costs in zip(*rounds, strict=True)
            ]
            ratio = statistics.median(other / ours for ours, other in rounds)
            print(f"{size:8}  {told[0]:>20}  {told[1]:>20}  {ratio:.1f}")


def main() -> None:
    listener = socket.create_server(("127.0.0.1", 0), backlog=AT_ONCE * 2)
    server = multiprocessing.get_context("fork").Process(target=serve, args=(listener,), daemon=True)
    server.start()
    try:
        uvloop.run(measure(f"http://127.0.0.1:{listener.getsockname()[1]}"))
    finally:
        server.kill()
        server.join()


if __name__ == "__main__":
    print(f"{os.cpu_count()} processors, {CALLS} calls per round, {AT_ONCE} at once, {ROUNDS} rounds")
    main()
