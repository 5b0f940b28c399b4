"""A server in a process of its own, as users have it: what is measured shares nothing with who measures."""

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
from webgym.server.run_worker import RunningServer, running_server


class Address(msgspec.Struct, frozen=True):
    """Of a server, and which process it is."""

    url: str
    token: str
    pid: int


_STOP_SECONDS = 60.0


class _Settings(msgspec.Struct, frozen=True):
    """As JSON each. Without a fleet it is one worker alone."""

    config: str
    fleet: str | None


@asynccontextmanager
async def server_apart(config: ServerConfig) -> AsyncIterator[Address]:
    """Run a server in a process of its own for the length of the block."""
    process, address = await start_apart(config)
    try:
        yield address
    finally:
        await stop_apart(process)


async def start_apart(
    config: ServerConfig, fleet: GatewayConfig | None = None, log: int | None = None
) -> tuple[Process, Address]:
    """Start a server as a process of its own: one worker, or a gateway where there is a fleet.

    Args:
        log: descriptor that its log goes to; ``None`` for where ours goes.

    Raises:
        ServerUnreachable: it does not come up.
    """
    settings = _Settings(config.model_dump_json(), fleet.model_dump_json() if fleet else None)
    command = (sys.executable, "-m", __name__)
    process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, stderr=log)
    try:
        return process, await _address(process, settings)
    except BaseException:
        await stop_apart(process)
        raise


async def stop_apart(process: Process) -> None:
    """Tell it to end, and wait until it has."""
    assert process.stdin is not None
    process.stdin.close()  # the end of its input is its end
    try:
        async with asyncio.timeout(_STOP_SECONDS):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()


async def _address(process: Process, settings: _Settings) -> Address:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(msgspec.json.encode(settings) + b"\n")
    line = await process.stdout.readline()
    if not line:
        raise ServerUnreachable("the server did not come up", hint="see `webgym doctor`")
    said = msgspec.json.decode(line, type=dict[str, str])
    return Address(said["url"], said["token"], process.pid)


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
        await reader.read()  # until its end


if __name__ == "__main__":
    import uvloop

    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    uvloop.run(_serve())
