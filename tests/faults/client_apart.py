"""A client as a process of its own, which tests stop and kill: ``python client_apart.py URL TOKEN PAGE TTL``.

Opens a session on the page, says its id, and keeps it alive until it is ended.
"""

from __future__ import annotations

import asyncio
import sys

from webgym.core.action import Navigate
from webgym.server.client import BrowserClient
from webgym.server.messages import SessionOptions


async def main(url: str, token: str, page: str, ttl: str) -> None:
    async with BrowserClient(url, token=token) as client:
        session = await client.open(SessionOptions(ttl_seconds=float(ttl)))
        await session.step(Navigate(page))
        print(session.id, flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
