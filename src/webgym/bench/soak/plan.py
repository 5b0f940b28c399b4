"""The plan of ``webgym bench soak``, and the limits of the server under test."""

from __future__ import annotations

from pathlib import Path

import msgspec

from webgym.browser.config import BrowserConfig
from webgym.server.config import ClientLimits, GatewayConfig, ServerConfig

_MIB = 1024 * 1024


class SoakPlan(msgspec.Struct, frozen=True, kw_only=True):
    """The size of the benchmark.

    Attributes:
        seconds: duration of clients and faults.
        seed: of all random choices. Their effects depend on timing.
        clients: number of parallel clients.
        slots: number of slots of all workers together; with fewer slots than clients, some always wait.
        workers: number of worker processes behind the gateway.
        faults: mean number of faults per minute.
        hostile: share of the pages that are hostile.
        disk_bytes: size of the browsers' disk, if one can be mounted.
        episodes: number of episodes after which a browser is replaced.
    """

    seconds: float = 300.0
    seed: int = 0
    clients: int = 10
    slots: int = 6
    workers: int = 2
    faults: float = 20.0
    hostile: float = 0.25
    disk_bytes: int = 768 * _MIB
    episodes: int = 20

    def server(self, temporary_root: Path, executable: Path | None) -> ServerConfig:
        """Settings of the server, with limits so tight that faults reach them soon."""
        browser = BrowserConfig(
            executable=executable,
            temporary_root=temporary_root,
            execute_seconds=3,
            navigate_seconds=6,
            settle_seconds=3,
            screenshot_seconds=6,
            slot_bytes=500 * _MIB,
            recycle_episodes=self.episodes,
        )
        return ServerConfig(
            slots=self.slots,
            allocate_seconds=20,
            relaunch_seconds=(0.2, 2.0),
            receive_seconds=2,
            dead_peer_seconds=5,
            keep_alive_seconds=5,
            beat_seconds=0.5,
            browser=browser.allowing("127.0.0.1"),
        )

    def fleet(self) -> GatewayConfig:
        """Settings of the gateway, which soon gives up a worker that does not respond."""
        return GatewayConfig(
            workers=self.workers,
            stop_seconds=5,
            restart_seconds=(0.2, 2.0),
            silent_seconds=6,
            answer_seconds=3,
            idle_seconds=3,
            dead_peer_seconds=5,
        )

    def client(self, *, direct: bool) -> ClientLimits:
        """Limits of clients. A call without a reply within them is an error, so no call hangs.

        Args:
            direct: whether clients call workers directly.
        """
        return ClientLimits(
            direct=direct,
            allocate=self.clients,
            release=self.clients,
            reply_seconds=60,
            connect_seconds=5,
            keep_alive_seconds=3,
            dead_peer_seconds=5,
        )
