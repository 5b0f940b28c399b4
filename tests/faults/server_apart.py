"""A server as a process of its own, which tests stop and kill: ``python server_apart.py SETTINGS``.

Says its address and its token, a line each, and serves until it is ended.
"""

from __future__ import annotations

import asyncio
import sys

import uvloop

from webgym.server.config import ServerConfig
from webgym.server.worker import running_server


async def main() -> None:
    async with running_server(ServerConfig.model_validate_json(sys.argv[1])) as server:
        print(server.url, server.token, sep="\n", flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    uvloop.run(main())
