"""Workers on the nodes of a Ray cluster.

Every node gets one actor, which reserves the node's CPUs in Ray and starts the worker processes. The actors
belong to the gateway: Ray ends them when the gateway ends, for any reason, and the worker processes end with
their actor.
"""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
import threading
from collections.abc import AsyncIterator, Collection, Mapping
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from webgym.core.background import in_daemon_thread
from webgym.core.errors import ConfigError, ServerError, ServerUnreachable
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig
from webgym.server.fleet import Host, Started, shares_of
from webgym.server.subprocess_worker import read_report

if TYPE_CHECKING:
    from types import ModuleType

    from webgym.server.subprocess_worker import WorkerProcess

log = logging.getLogger(__name__)

T = TypeVar("T")

_PACKAGE = "webgym-rl"

_NOT_A_NODE_HINT = "start the gateway on a node of the cluster: `ray start --address=HEAD:6379 --num-cpus=0`"
_VERSIONS_HINT = "every node and the gateway need the same Ray and the same Python"

_CPU_CHECKS, _CPU_CHECK_SECONDS = 10, 0.5
"""A gateway that has ended frees its CPUs a moment later, and a new node's are not reported at once."""

_CALLS_AT_ONCE = 64
"""Concurrent calls of one actor: one start or stop for every worker of its node."""

NAMESPACE = "webgym"
"""Ray's namespace for WebGym's actors."""

DISCOVER_SECONDS = 2.0
"""Interval at which the cluster's nodes are listed: Ray does not notify of changes."""


def _node_actor() -> type:
    """The class of the actor that runs on a node, in a process of Ray. Its methods are called in threads.

    A class defined in a function is sent to the node by value, and imports WebGym only when it is called. A
    class imported from a module would make the actor crash on a node without WebGym.
    """

    class NodeActor:
        def __init__(self) -> None:
            self._children: dict[str, WorkerProcess] = {}
            self._lock = threading.Lock()

        def version(self) -> str:
            """Version of WebGym on this node. An answer also shows that the actor is running."""
            from importlib.metadata import version

            return version("webgym-rl")

        def start(self, name: str, config: str, stop_seconds: float) -> bytes:
            """Start a worker, and return its report."""
            from webgym.server.config import ServerConfig
            from webgym.server.subprocess_worker import WorkerProcess

            child = WorkerProcess(ServerConfig.model_validate_json(config), stop_seconds, is_detached=True)
            with self._lock:
                self._children[name] = child
            return child.report()

        def stop(self, name: str, at_once: bool) -> None:
            """End a worker."""
            with self._lock:
                child = self._children.pop(name, None)
            if child is not None:
                child.stop(at_once=at_once)

    return NodeActor


class RayHost:
    """One node of a cluster.

    Args:
        ray: the module ``ray``, connected to the cluster.
        node: Ray's description of the node.
        server: the settings of a worker, for this machine.
        config: how workers are started and stopped.
        cluster: how much of a node to use.
    """

    def __init__(
        self,
        ray: ModuleType,
        node: Mapping[str, Any],
        server: ServerConfig,
        config: GatewayConfig,
        cluster: RayConfig,
    ) -> None:
        self._ray = ray
        self._node = node
        self._server = server
        self._config = config
        self._cluster = cluster
        self._actor: Any = None
        self._actor_lock = asyncio.Lock()
        self._started: set[str] = set()

    @property
    def id(self) -> str:
        """Ray's id of the node."""
        return str(self._node["NodeID"])

    @property
    def shares(self) -> tuple[ServerConfig, ...]:
        """The settings of its workers, by the number of its CPUs."""
        cpus = _cpus(self._node)
        slots = self._cluster.slots_per_node or max(1, int(cpus * self._cluster.slots_per_cpu))
        return shares_of(self._server, self._config, host=self.place, slots=slots, cores=cpus)

    @property
    def place(self) -> str:
        """The node's address."""
        return str(self._node["NodeManagerAddress"])

    async def start(self, config: ServerConfig) -> Started:
        """Start a worker by the node's actor."""
        try:
            # Only once the actor is running: a call cancelled here would still be carried out there.
            actor = await self._running_actor()
            self._started.add(config.name)
            report = await actor.start.remote(
                config.name, config.model_dump_json(), self._config.stop_seconds
            )
        except self._ray.exceptions.RayTaskError as error:
            raise ServerError(
                f"the actor at {self.place} cannot start a worker: {_last_line(error)}",
                hint=f"is {_PACKAGE} {version(_PACKAGE)} installed there, with all it needs?",
            ) from None
        except self._ray.exceptions.ActorDiedError as error:
            self._actor = None
            raise ServerError(f"the actor at {self.place} is gone: {_last_line(error)}") from None
        except self._ray.exceptions.RayError as error:
            raise ServerError(f"the actor at {self.place} does not answer: {_last_line(error)}") from None
        return read_report(report)

    async def stop(self, name: str, *, at_once: bool) -> None:
        """Stop a worker by the node's actor; if the actor is gone, so is the worker."""
        if name not in self._started:
            return
        self._started.remove(name)
        if self._actor is None:
            return
        try:
            async with asyncio.timeout(2 * self._config.stop_seconds):
                await self._actor.stop.remote(name, at_once)
        except self._ray.exceptions.RayError as error:
            log.warning("worker %s at %s ended with its actor: %s", name, self.place, _last_line(error))
        except TimeoutError:
            log.warning("worker %s: the actor at %s does not confirm that it ended", name, self.place)

    async def _running_actor(self) -> Any:
        """The node's actor, started if necessary.

        Raises:
            ServerError: the node's CPUs are in use, or it has another version of WebGym.
        """
        async with self._actor_lock:
            if self._actor is None:
                await self._check_free_cpus()
                self._actor = await in_daemon_thread(self._new_actor)
        node_version = await self._actor.version.remote()
        if node_version != (own_version := version(_PACKAGE)):
            raise ServerError(
                f"{self.place} has {_PACKAGE} {node_version} installed, but the gateway has {own_version}",
                hint="install the same version on every node",
            )
        return self._actor

    async def _check_free_cpus(self) -> None:
        """Check that Ray can start the actor: it would wait for the node's CPUs without end.

        Raises:
            ServerError: the CPUs are in use.
        """
        from ray._private.state import available_resources_per_node  # "for developers", and nothing else says

        for _ in range(_CPU_CHECKS):
            free = (await in_daemon_thread(available_resources_per_node)).get(self.id)
            if free is None or free.get("CPU", 0.0) >= self._reserved_cpus:
                return
            await asyncio.sleep(_CPU_CHECK_SECONDS)
        raise ServerError(
            f"{self._reserved_cpus:g} CPUs are wanted at {self.place}, and {free.get('CPU', 0.0):g} are free",
            hint="see `ray status`; --ray-cpus reserves fewer",
        )

    @property
    def _reserved_cpus(self) -> float:
        reserved = self._cluster.cpus_per_node
        return _cpus(self._node) if reserved is None else reserved

    def _new_actor(self) -> Any:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        return (
            self._ray.remote(_node_actor())
            .options(
                num_cpus=self._reserved_cpus,
                max_restarts=-1,
                max_concurrency=_CALLS_AT_ONCE,
                scheduling_strategy=NodeAffinitySchedulingStrategy(node_id=self.id, soft=False),
            )
            .remote()
        )


class RayHosts:
    """The nodes of a cluster. Created by :func:`ray_hosts`."""

    def __init__(
        self, ray: ModuleType, server: ServerConfig, config: GatewayConfig, cluster: RayConfig
    ) -> None:
        self._ray = ray
        self._server = server
        self._config = config
        self._cluster = cluster
        self._known: dict[str, RayHost] = {}

    async def changes(self) -> AsyncIterator[Collection[Host]]:
        """Lists the nodes at intervals, and yields them when they have changed."""
        is_first = True
        while True:
            nodes = {node["NodeID"]: node for node in await self._usable_nodes()}
            if is_first or nodes.keys() != self._known.keys():
                self._known = {
                    name: self._known.get(name)
                    or RayHost(self._ray, node, self._server, self._config, self._cluster)
                    for name, node in nodes.items()
                }
                yield tuple(self._known.values())
            is_first = False
            await asyncio.sleep(DISCOVER_SECONDS)

    async def _usable_nodes(self) -> list[dict[str, Any]]:
        """The nodes that are alive and may be used."""
        required = self._cluster.node_resource
        return [
            node
            for node in await in_daemon_thread(self._ray.nodes)
            if node["Alive"] and _cpus(node) and (required is None or node["Resources"].get(required))
        ]


def _cpus(node: Mapping[str, Any]) -> float:
    return float(node["Resources"].get("CPU", 0))


def _last_line(error: BaseException) -> str:
    """The last line of an error of Ray, which contains the message; the lines before say where."""
    return (str(error).strip().splitlines() or [type(error).__name__])[-1].strip()


async def _check_reachable(address: str) -> None:
    """Check that something listens at an address. Ray itself would try for long, and print warnings.

    Raises:
        OSError: nothing listens there.
    """
    try:
        parts = urlsplit(f"//{address}")
        host, port = parts.hostname, parts.port
    except ValueError:
        return  # Ray reports the invalid address
    if host and port:
        _, writer = await asyncio.open_connection(host, port)
        writer.close()


def _restore_sigterm_handler() -> None:
    """Restore the handler that was set before Ray's own, which prints messages."""
    handler = signal.getsignal(signal.SIGTERM)
    if handler is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)


@asynccontextmanager
async def ray_hosts(
    server: ServerConfig, config: GatewayConfig, cluster: RayConfig
) -> AsyncIterator[RayHosts]:
    """Connect to a Ray cluster as a driver during the block.

    Args:
        server: the settings of a worker, for this machine.
        config: how workers are started and stopped.
        cluster: the cluster, and how much of its nodes to use.

    Raises:
        ConfigError: Ray is not installed, or the address is not one of a cluster.
        ServerUnreachable: no cluster answers.
    """
    if "://" in cluster.address:
        raise ConfigError(
            f"{cluster.address} is not the address of a cluster's head",
            hint="use `auto` or HOST:PORT; the gateway runs on a node of the cluster",
        )
    try:
        import ray
    except ImportError:
        raise ConfigError(
            "Ray is not installed", hint=f'{sys.executable} -m pip install "{_PACKAGE}[ray]"'
        ) from None

    def connect() -> None:
        # Not in the main thread, so that Ray does not replace signal handlers.
        ray.init(address=cluster.address, namespace=NAMESPACE, logging_level=logging.ERROR)

    try:
        async with asyncio.timeout(cluster.connect_seconds):
            await _check_reachable(cluster.address)
            await in_daemon_thread(connect)
    except (OSError, RuntimeError, ValueError, TimeoutError) as error:
        why = " ".join(str(error).split()) or f"nothing within {cluster.connect_seconds:g} s"
        raise ServerUnreachable(
            f"cannot connect to a Ray cluster at {cluster.address}: {why}",
            hint=_VERSIONS_HINT if "Version mismatch" in why else _NOT_A_NODE_HINT,
        ) from None
    _restore_sigterm_handler()
    try:
        yield RayHosts(ray, server, config, cluster)
    finally:
        try:
            async with asyncio.timeout(config.stop_seconds):
                await in_daemon_thread(ray.shutdown)
        except TimeoutError:
            log.warning("the Ray cluster does not answer; it will notice that the gateway has ended")
