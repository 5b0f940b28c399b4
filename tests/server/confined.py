"""Be a Ray node and a gateway on it, serve one session, and say in JSON how confined all that was.

Started by ``tests/test_container.py`` as a process of its own, as another user, behind a filter of system
calls: what a pod of ``deploy/kuberay.yaml`` does.

    python confined.py EXECUTABLE
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from pathlib import Path
from typing import Any

import psutil
from ray.cluster_utils import Cluster

from webgym.browser.config import BrowserConfig
from webgym.server.client import BrowserClient
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig
from webgym.server.gateway import running_gateway

MARK = "WEBGYM_TEST_MARK"
KINDS = ("raylet", "ray::NodeActor", "webgym.server.subprocess_worker", "--type=renderer")


def statuses() -> dict[str, dict[str, str]]:
    """What the kernel says of one process of each kind that we started."""
    found = {}
    for process in psutil.process_iter():
        try:
            if process.pid == os.getpid() or process.environ().get(MARK) != os.environ[MARK]:
                continue
            words = " ".join(process.cmdline())
            lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
        except (psutil.AccessDenied, psutil.NoSuchProcess, FileNotFoundError, ProcessLookupError):
            continue
        for kind in KINDS:
            if kind in words:
                found[kind] = {
                    name: value.strip() for name, _, value in (one.partition(":") for one in lines)
                }
    return found


async def main(address: str, executable: str) -> dict[str, Any]:
    config = ServerConfig(slots=1, browser=BrowserConfig(executable=Path(executable)))
    async with (
        running_gateway(config, GatewayConfig(), RayConfig(address=address)) as gateway,
        BrowserClient(gateway.url, token=gateway.token) as client,
    ):
        info = await client.info()
        session = await client.open()
        view = await session.step()
        seen = statuses()
        await session.close()
    return {
        "info": {"sandboxed": info.sandboxed, "reason": info.sandbox_reason},
        "picture": view.image[:4].decode("latin-1"),
        "filters": {kind: one["Seccomp"] for kind, one in seen.items()},
        "capabilities": {kind: one["CapEff"] for kind, one in seen.items()},
    }


if __name__ == "__main__":
    os.environ[MARK] = f"confined-{os.getpid()}"
    head = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": 80 * 2**20}
    cluster: Any = Cluster(initialize_head=True, head_node_args=head)
    try:
        print(json.dumps(asyncio.run(main(cluster.address, sys.argv[1]))))
    finally:
        cluster.shutdown()
