"""Workers as processes of this machine."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Collection

from webgym.server.config import GatewayConfig, ServerConfig, usable_cores
from webgym.server.fleet import Host, Started, share_of, split
from webgym.server.subprocess_worker import Child, start_child


class LocalHost:
    """This machine.

    Args:
        server: what its workers are together.
    """

    id = "here"
    place = "this machine"

    def __init__(self, server: ServerConfig, config: GatewayConfig) -> None:
        self._server = server
        self._config = config
        self._children: dict[str, Child] = {}

    @property
    def shares(self) -> tuple[ServerConfig, ...]:
        """As many as are asked for, or as there are processors for."""
        cores = usable_cores()
        own = self._server.model_copy(
            update={"host": self._config.worker_host, "ports": self._config.worker_ports}
        )
        slots = split(own.slots, cores, self._config)
        return tuple(
            share_of(own, count, cores / len(slots), share=count / own.slots, of_cores=cores)
            for count in slots
        )

    async def start(self, config: ServerConfig) -> Started:
        """A process."""
        child, started = await start_child(config, self._config.stop_seconds)
        self._children[config.name] = child
        return started

    async def stop(self, name: str) -> None:
        """Told first, then killed."""
        child = self._children.pop(name, None)
        if child is not None:
            await child.stop(self._config.stop_seconds)


class LocalHosts:
    """This machine alone."""

    def __init__(self, server: ServerConfig, config: GatewayConfig) -> None:
        self._host = LocalHost(server, config)

    async def changes(self) -> AsyncIterator[Collection[Host]]:
        """It is there, and stays."""
        yield (self._host,)
        await asyncio.Event().wait()
