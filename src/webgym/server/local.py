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
        server: the settings of its workers together.
        config: how workers are started and stopped.
    """

    id = "here"
    place = "this machine"

    def __init__(self, server: ServerConfig, config: GatewayConfig) -> None:
        self._server = server
        self._config = config
        self._children: dict[str, Child] = {}

    @property
    def shares(self) -> tuple[ServerConfig, ...]:
        """The settings of its workers: the configured number, or by the number of processors."""
        cores = usable_cores()
        machine = self._server.model_copy(
            update={"host": self._config.worker_host, "ports": self._config.worker_ports}
        )
        slots = split(machine.slots, cores, self._config)
        return tuple(
            share_of(machine, count, cores / len(slots), share=count / machine.slots, of_cores=cores)
            for count in slots
        )

    async def start(self, config: ServerConfig) -> Started:
        """Start a worker process."""
        child, started = await start_child(config, self._config.stop_seconds)
        self._children[config.name] = child
        return started

    async def stop(self, name: str, *, at_once: bool) -> None:
        """Stop the process, and kill it if it does not end in time."""
        child = self._children.pop(name, None)
        if child is not None:
            await child.stop(0.0 if at_once else self._config.stop_seconds)


class LocalHosts:
    """This machine as the only host."""

    def __init__(self, server: ServerConfig, config: GatewayConfig) -> None:
        self._host = LocalHost(server, config)

    async def changes(self) -> AsyncIterator[Collection[Host]]:
        """Yields this machine once."""
        yield (self._host,)
        await asyncio.Event().wait()
