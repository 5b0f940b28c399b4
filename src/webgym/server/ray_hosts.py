"""Workers on the nodes of a Ray cluster.

Every node gets one actor, bound to it, which holds the node's CPUs in Ray's books and starts our worker
processes. The actors are the gateway's own: Ray ends them when it goes, however it goes, and with the actor
its worker processes end.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import sys
import threading
from collections.abc import AsyncIterator, Callable, Collection, Mapping
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from webgym.core.errors import ConfigError, ServerError, ServerUnreachable
from webgym.server.child import DetachedChild, read_report
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig, usable_cores
from webgym.server.workers import Host, Started, share_of, split

if TYPE_CHECKING:
    from types import ModuleType

log = logging.getLogger(__name__)

_CALLS_AT_ONCE = 64
"""Of one actor: one start or stop for every worker of its node."""


class NodeActor:
    """What runs on a node, in a process of Ray's. Its calls come in threads."""

    def __init__(self) -> None:
        self._children: dict[str, DetachedChild] = {}
        self._lock = threading.Lock()

    def answer(self) -> None:
        """Say nothing, which says that the actor is up."""

    def start(self, name: str, config: str, stop_seconds: float) -> bytes:
        """Start a worker, and return what it says when it is up."""
        child = DetachedChild(config, stop_seconds)
        with self._lock:
            self._children[name] = child
        return child.report()

    def stop(self, name: str) -> None:
        """End a worker."""
        with self._lock:
            child = self._children.pop(name, None)
        if child is not None:
            child.stop()


class RayHost:
    """One node.

    Args:
        node: what Ray says of it.
        server: what a worker is to be, made for this machine.
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

    @property
    def id(self) -> str:
        """Ray's."""
        return str(self._node["NodeID"])

    @property
    def shares(self) -> tuple[ServerConfig, ...]:
        """As many workers as its CPUs are worth."""
        cpus = _cpus(self._node)
        slots = self._cluster.slots_per_node or max(1, int(cpus * self._cluster.slots_per_cpu))
        counts = split(slots, cpus, self._config)
        own = self._server.model_copy(update={"host": self._node["NodeManagerAddress"]})
        return tuple(
            share_of(own, count, cpus / len(counts), share=count / slots, of_cores=usable_cores())
            for count in counts
        )

    async def start(self, config: ServerConfig) -> Started:
        """By the node's actor, as soon as it is up."""
        if self._actor is None:
            self._actor = self._new_actor()
        try:
            # Not before it is up: a call that is given up here would still be carried out there.
            await self._actor.answer.remote()
            said = await self._actor.start.remote(
                config.name, config.model_dump_json(), self._config.stop_seconds
            )
        except self._ray.exceptions.ActorDiedError as error:
            self._actor = None
            raise ServerError(f"the actor at {self._place} is gone: {_brief(error)}") from None
        except self._ray.exceptions.RayError as error:
            raise ServerError(f"the actor at {self._place} does not answer: {_brief(error)}") from None
        return read_report(said)

    async def stop(self, name: str) -> None:
        """By the node's actor; if that is gone, the worker is."""
        if self._actor is None:
            return
        try:
            async with asyncio.timeout(2 * self._config.stop_seconds):
                await self._actor.stop.remote(name)
        except (self._ray.exceptions.RayError, TimeoutError) as error:
            log.warning("worker %s at %s ended with its actor: %s", name, self._place, _brief(error))

    @property
    def _place(self) -> str:
        return str(self._node["NodeManagerAddress"])

    def _new_actor(self) -> Any:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        reserved = self._cluster.cpus_per_node
        return (
            self._ray.remote(NodeActor)
            .options(
                num_cpus=_cpus(self._node) if reserved is None else reserved,
                max_restarts=-1,
                max_concurrency=_CALLS_AT_ONCE,
                scheduling_strategy=NodeAffinitySchedulingStrategy(node_id=self.id, soft=False),
            )
            .remote()
        )


class RayHosts:
    """The nodes of a cluster. Get them from :func:`ray_hosts`."""

    def __init__(
        self, ray: ModuleType, server: ServerConfig, config: GatewayConfig, cluster: RayConfig
    ) -> None:
        self._ray = ray
        self._server = server
        self._config = config
        self._cluster = cluster
        self._known: dict[str, RayHost] = {}

    async def changes(self) -> AsyncIterator[Collection[Host]]:
        """Looks again and again."""
        is_first = True
        while True:
            nodes = {node["NodeID"]: node for node in await self._look()}
            if is_first or nodes.keys() != self._known.keys():
                self._known = {
                    name: self._known.get(name)
                    or RayHost(self._ray, node, self._server, self._config, self._cluster)
                    for name, node in nodes.items()
                }
                yield tuple(self._known.values())
            is_first = False
            await asyncio.sleep(self._cluster.discover_seconds)

    async def _look(self) -> list[dict[str, Any]]:
        """The nodes that are alive and for us."""
        wanted = self._cluster.node_resource
        return [
            node
            for node in await asyncio.to_thread(self._ray.nodes)
            if node["Alive"] and _cpus(node) and (wanted is None or node["Resources"].get(wanted))
        ]


def _cpus(node: Mapping[str, Any]) -> float:
    return float(node["Resources"].get("CPU", 0))


def _brief(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


async def _in_daemon_thread(work: Callable[[], None]) -> None:
    """Do blocking work that cannot be cut short, in a thread that keeps no process from ending."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def tell(error: BaseException | None) -> None:
        if done.cancelled():
            return
        if error is None:
            done.set_result(None)
        else:
            done.set_exception(error)

    def run() -> None:
        error: BaseException | None = None
        try:
            work()
        except BaseException as raised:
            error = raised
        with contextlib.suppress(RuntimeError):  # the loop has ended without us
            loop.call_soon_threadsafe(tell, error)

    threading.Thread(target=run, name="connect-to-ray", daemon=True).start()
    await done


@asynccontextmanager
async def ray_hosts(
    server: ServerConfig, config: GatewayConfig, cluster: RayConfig
) -> AsyncIterator[RayHosts]:
    """Be a driver of a Ray cluster for the length of the block.

    Args:
        server: what a worker is to be, made for this machine.

    Raises:
        ConfigError: Ray is not installed.
        ServerUnreachable: no cluster answers.
    """
    try:
        import ray
    except ImportError:
        raise ConfigError(
            "Ray is not installed", hint=f'{sys.executable} -m pip install "webgym-rl[ray]"'
        ) from None

    def connect() -> None:
        # Not in the main thread, so that Ray leaves our signal handlers alone.
        ray.init(address=cluster.address, namespace=cluster.namespace, logging_level=logging.ERROR)

    try:
        async with asyncio.timeout(cluster.connect_seconds):
            await _in_daemon_thread(connect)
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        why = _brief(error) if str(error) else f"nothing within {cluster.connect_seconds:g} s"
        raise ServerUnreachable(
            f"no Ray cluster answers at {cluster.address}: {why}",
            hint="start the gateway on a node of the cluster: `ray start --address=HEAD:6379 --num-cpus=0`",
        ) from None
    try:
        yield RayHosts(ray, server, config, cluster)
    finally:
        await asyncio.to_thread(ray.shutdown)
