"""A server in a process of its own, as users have it: what is measured shares nothing with who measures."""

from __future__ import annotations

import asyncio
import logging
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec

from webgym.core.errors import ServerUnreachable
from webgym.server import ServerConfig, running_server


class Address(msgspec.Struct, frozen=True):
    """Of a server, and which process it is."""

    url: str
    token: str
    pid: int


_STOP_SECONDS = 60.0


@asynccontextmanager
async def server_apart(config: ServerConfig) -> AsyncIterator[Address]:
    """Run a server in a process of its own for the length of the block."""
    process = await asyncio.create_subprocess_exec(sys.executable, "-m", __name__, stdin=PIPE, stdout=PIPE)
    try:
        yield await _address(process, config)
    finally:
        assert process.stdin is not None
        process.stdin.close()  # the end of its input is its end
        try:
            async with asyncio.timeout(_STOP_SECONDS):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()


async def _address(process: Process, config: ServerConfig) -> Address:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(config.model_dump_json().encode() + b"\n")
    line = await process.stdout.readline()
    if not line:
        raise ServerUnreachable(
            "the server that was to be measured did not come up", hint="see `webgym doctor`"
        )
    said = msgspec.json.decode(line, type=dict[str, str])
    return Address(said["url"], said["token"], process.pid)


async def _serve() -> None:
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    config = ServerConfig.model_validate_json(await reader.readline())
    async with running_server(config) as server:
        print(msgspec.json.encode({"url": server.url, "token": server.token}).decode(), flush=True)
        await reader.read()  # until its end


if __name__ == "__main__":
    import uvloop

    logging.basicConfig(level=logging.ERROR, format="%(levelname)s %(message)s")
    uvloop.run(_serve())
