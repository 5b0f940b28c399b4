"""A server of OpenEnv whose sessions are browsers, and an episode of its client.

uvicorn openenv_server:app
python openenv_server.py http://127.0.0.1:8000
"""

from __future__ import annotations

import asyncio
import sys

from webgym.integrations.openenv import WebGymAction, WebGymClient, create_app

app = create_app("offline-small-v2", size=4)  # no browser starts before the first episode


async def main(url: str) -> float | None:
    """Its reward; none if it has none."""
    async with WebGymClient(base_url=url) as env:
        result = await env.reset()
        print(result.observation.instruction, result.observation.mime_type)
        await env.step(WebGymAction(action={"name": "scroll", "direction": "down"}))
        result = await env.step(WebGymAction(action={"name": "answer", "text": "no idea"}))
    print(f"{result.observation.outcome}: reward {result.reward}")
    return result.reward


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
