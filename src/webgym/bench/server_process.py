"""A browser server in a separate process, so that the benchmark does not share its event loop."""

from __future__ import annotations

import asyncio
import logging
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager

import msgspec

from webgym.core.errors import ServerUnreachable
from webgym.server.config import GatewayConfig, ServerConfig
from webgym.server.gateway import RunningGateway, running_gateway
from webgym.server.worker import RunningServer, running_server


class ServerAddress(msgspec.Struct, frozen=True):
    """The address of a server.

    Attributes:
        url: its base URL.
        token: of every call.
        pid: its process id.
    """

    url: str
    token: str
    pid: int


_STOP_SECONDS = 60.0


class _Settings(msgspec.Struct, frozen=True):
    """Both as JSON. Without a fleet, the server is a single worker."""

    config: str
    fleet: str | None


@asynccontextmanager
async def server_process(config: ServerConfig) -> AsyncIterator[ServerAddress]:
    """Run a server in a separate process until the block ends."""
    process, address = await start_server(config)
    try:
        yield address
    finally:
        await stop_server(process)


async def start_server(
    config: ServerConfig, fleet: GatewayConfig | None = None, log: int | None = None
) -> tuple[Process, ServerAddress]:
    """Start a server in a separate process.

    Args:
        config: of the server.
        fleet: of a gateway; without it, the server is a single worker.
        log: file descriptor of its log; ``None`` for our stderr.

    Raises:
        ServerUnreachable: it does not start.
    """
    settings = _Settings(config.model_dump_json(), fleet.model_dump_json() if fleet else None)
    command = (sys.executable, "-m", __name__)
    process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, stderr=log)
    try:
        return process, await _configure(process, settings)
    except BaseException:
        await stop_server(process)
        raise


async def stop_server(process: Process) -> None:
    """Stop a server and wait until its process has ended."""
    assert process.stdin is not None
    process.stdin.close()  # the server stops at the end of its input
    try:
        async with asyncio.timeout(_STOP_SECONDS):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()


async def _configure(process: Process, settings: _Settings) -> ServerAddress:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(msgspec.json.encode(settings) + b"\n")
    line = await process.stdout.readline()
    if not line:
        raise ServerUnreachable("the server did not start", hint="see `webgym doctor`")
    reply = msgspec.json.decode(line, type=dict[str, str])
    return ServerAddress(reply["url"], reply["token"], process.pid)


async def _serve() -> None:
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    settings = msgspec.json.decode(await reader.readline(), type=_Settings)
    config = ServerConfig.model_validate_json(settings.config)
    running: AbstractAsyncContextManager[RunningServer | RunningGateway] = (
        running_server(config)
        if settings.fleet is None
        else running_gateway(config, GatewayConfig.model_validate_json(settings.fleet))
    )
    async with running as server:
        print(msgspec.json.encode({"url": server.url, "token": server.token}).decode(), flush=True)
        await reader.read()  # until the end of the input


if __name__ == "__main__":
    import uvloop

    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    uvloop.run(_serve())
