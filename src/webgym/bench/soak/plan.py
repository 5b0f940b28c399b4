"""How long, how many, and the limits of the server under test."""

from __future__ import annotations

from pathlib import Path

import msgspec

from webgym.browser.config import BrowserConfig
from webgym.server.config import ClientLimits, GatewayConfig, ServerConfig

_MIB = 1024 * 1024


class SoakPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What is done.

    Attributes:
        seconds: how long clients come and faults happen.
        seed: of all choices. What a choice meets is up to timing.
        clients: at work at once.
        slots: of all workers together; with fewer than clients, some always wait.
        workers: processes behind the gateway.
        faults: per minute, on average.
        hostile: share of the pages that mean harm.
        disk_bytes: of the browsers' own disk, where one can be mounted.
        episodes: that one browser serves.
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
        """Limits so tight that every fault runs into one soon."""
        browser = BrowserConfig(
            executable=executable,
            temporary_root=temporary_root,
            execute_seconds=3,
            navigate_seconds=6,
            settle_seconds=3,
            screenshot_seconds=6,
            close_seconds=3,
            slot_bytes=500 * _MIB,
            memory_look_seconds=0.1,
            recycle_episodes=self.episodes,
        )
        return ServerConfig(
            slots=self.slots,
            allocate_seconds=20,
            relaunch_seconds=(0.2, 2.0),
            sweep_seconds=2,
            receive_seconds=2,
            dead_peer_seconds=5,
            keep_alive_seconds=5,
            beat_seconds=0.5,
            browser=browser.allowing("127.0.0.1"),
        )

    def fleet(self) -> GatewayConfig:
        """A worker that is silent is soon given up."""
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
        """No call may hang: one that has no answer by then is an error like any other."""
        return ClientLimits(
            direct=direct,
            allocate=self.clients,
            release=self.clients,
            reply_seconds=60,
            connect_seconds=5,
            keep_alive_seconds=3,
            dead_peer_seconds=5,
        )
