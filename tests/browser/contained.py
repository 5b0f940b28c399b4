"""Serve one session and say, in JSON, what the system says about the browser's processes.

Started by ``test_sandbox.py`` as a process of its own, as another user, behind filters of system calls.

    python contained.py auto|on EXECUTABLE
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from pathlib import Path

from webgym.browser.config import BrowserConfig
from webgym.core.errors import WebGymError
from webgym.server.client import BrowserClient
from webgym.server.config import ServerConfig
from webgym.server.worker import running_server


def look_at(pid: int) -> dict[str, str]:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    status = {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}
    try:
        user = str(Path(f"/proc/{pid}/ns/user").readlink())
    except PermissionError:  # only with the set-uid helper: not ours to look into
        user = "hidden"
    command = Path(f"/proc/{pid}/cmdline").read_bytes()
    kind = "renderer" if b"--type=renderer" in command else "other"
    return {"kind": kind, "user": user, **status}


async def main(sandbox: str, executable: str) -> dict[str, object]:
    browser = BrowserConfig.model_validate({"sandbox": sandbox, "executable": executable})
    async with (
        running_server(ServerConfig(slots=1, browser=browser)) as server,
        BrowserClient(server.url, token=server.token) as client,
    ):
        info = await client.info()
        session = await client.open()
        view = await session.step()
        [slot] = server.service.pool.slots
        assert slot.process is not None
        group = slot.process
        seen = {pid: look_at(pid) for pid in group.processes()}
        await session.close()
    return {
        "info": {"sandboxed": info.sandboxed, "reason": info.sandbox_reason},
        "picture": view.image[:4].decode("latin-1"),
        "own": look_at(os.getpid()),
        "processes": seen,
        "left": group.processes(),
    }


if __name__ == "__main__":
    try:
        print(json.dumps(asyncio.run(main(*sys.argv[1:]))))
    except WebGymError as error:
        print(json.dumps({"error": error.code, "message": error.message, "hint": error.hint}))
