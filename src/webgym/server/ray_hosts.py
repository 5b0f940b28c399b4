"""Workers on the nodes of a Ray cluster.

Every node gets one actor, bound to it, which holds the node's CPUs in Ray's books and starts our worker
processes. The actors are the gateway's own: Ray ends them when it goes, however it goes, and with the actor
its worker processes end.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import sys
import threading
from collections.abc import AsyncIterator, Callable, Collection, Mapping
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from webgym.core.errors import ConfigError, ServerError, ServerUnreachable
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig, usable_cores
from webgym.server.fleet import Host, Started, share_of, split
from webgym.server.subprocess_worker import read_report

if TYPE_CHECKING:
    from types import ModuleType

    from webgym.server.subprocess_worker import DetachedChild

log = logging.getLogger(__name__)

T = TypeVar("T")

_PACKAGE = "webgym-rl"

_BE_A_NODE = "start the gateway on a node of the cluster: `ray start --address=HEAD:6379 --num-cpus=0`"
_SAME_VERSIONS = "every node and the gateway need the same Ray and the same Python"

_CALLS_AT_ONCE = 64
"""Of one actor: one start or stop for every worker of its node."""


def _node_actor() -> type:
    """What runs on a node, in a process of Ray's. Its calls come in threads.

    A function's class travels to the node as it is, and looks for our package when it is called. One that is
    looked up there would end with its actor, loudly, where the package is missing.
    """

    class NodeActor:
        def __init__(self) -> None:
            self._children: dict[str, DetachedChild] = {}
            self._lock = threading.Lock()

        def version(self) -> str:
            """Of our package on this node. That it is said at all says that the actor is up."""
            from importlib.metadata import version

            return version("webgym-rl")

        def start(self, name: str, config: str, stop_seconds: float) -> bytes:
            """Start a worker, and return what it says when it is up."""
            from webgym.server.subprocess_worker import DetachedChild

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

    return NodeActor


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
        self._making = asyncio.Lock()
        self._asked_for: set[str] = set()

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
        where = {"host": self.place, "ports": self._config.worker_ports}
        own = self._server.model_copy(update=where)
        return tuple(
            share_of(own, count, cpus / len(counts), share=count / slots, of_cores=usable_cores())
            for count in counts
        )

    @property
    def place(self) -> str:
        """Its address."""
        return str(self._node["NodeManagerAddress"])

    async def start(self, config: ServerConfig) -> Started:
        """By the node's actor, as soon as it is up."""
        try:
            # Not before it is up: a call that is given up here would still be carried out there.
            actor = await self._actor_that_is_up()
            self._asked_for.add(config.name)
            said = await actor.start.remote(config.name, config.model_dump_json(), self._config.stop_seconds)
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
        return read_report(said)

    async def stop(self, name: str) -> None:
        """By the node's actor; if that is gone, the worker is."""
        if name not in self._asked_for:
            return
        self._asked_for.remove(name)
        if self._actor is None:
            return
        try:
            async with asyncio.timeout(2 * self._config.stop_seconds):
                await self._actor.stop.remote(name)
        except self._ray.exceptions.RayError as error:
            log.warning("worker %s at %s ended with its actor: %s", name, self.place, _last_line(error))
        except TimeoutError:
            log.warning("worker %s: the actor at %s does not say that it ended", name, self.place)

    async def _actor_that_is_up(self) -> Any:
        """The node's one actor.

        Raises:
            ServerError: Ray does not place it, or it is none of ours.
        """
        async with self._making:
            if self._actor is None:
                self._actor = await _in_thread(self._new_actor)
        try:
            async with asyncio.timeout(self._cluster.place_seconds):
                theirs = await self._actor.version.remote()
        except TimeoutError:
            raise ServerError(
                f"Ray has not placed our actor at {self.place} within {self._cluster.place_seconds:g} s",
                hint="others hold its CPUs, see `ray status`; --ray-cpus reserves fewer",
            ) from None
        if theirs != (ours := version(_PACKAGE)):
            raise ServerError(
                f"{self.place} has {_PACKAGE} {theirs} installed, and we are {ours}",
                hint="install the same on every node",
            )
        return self._actor

    def _new_actor(self) -> Any:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        reserved = self._cluster.cpus_per_node
        return (
            self._ray.remote(_node_actor())
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
            for node in await _in_thread(self._ray.nodes)
            if node["Alive"] and _cpus(node) and (wanted is None or node["Resources"].get(wanted))
        ]


def _cpus(node: Mapping[str, Any]) -> float:
    return float(node["Resources"].get("CPU", 0))


def _last_line(error: BaseException) -> str:
    """Of what Ray says of an error: the first lines say where, the last says what."""
    return (str(error).strip().splitlines() or [type(error).__name__])[-1].strip()


async def _in_thread(work: Callable[[], T]) -> T:
    """Do blocking work that cannot be cut short, in a thread that keeps no process from ending.

    Whatever asks the cluster's head blocks for as long as the head does not answer.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[T] = loop.create_future()

    def tell(result: T | None, error: BaseException | None) -> None:
        if done.cancelled():
            return
        if error is None:
            done.set_result(result)  # type: ignore[arg-type]  # there is one where there is no error
        else:
            done.set_exception(error)

    def run() -> None:
        result, error = None, None
        try:
            result = work()
        except BaseException as raised:
            error = raised
        with contextlib.suppress(RuntimeError):  # the loop has ended without us
            loop.call_soon_threadsafe(tell, result, error)

    threading.Thread(target=run, name="asks-ray", daemon=True).start()
    return await done


async def _knock(address: str) -> None:
    """See whether anybody listens there. Ray itself would try for long, and complain meanwhile.

    Raises:
        OSError: nobody does.
    """
    try:
        parts = urlsplit(f"//{address}")
        host, port = parts.hostname, parts.port
    except ValueError:
        return  # Ray knows what to say
    if host and port:
        _, writer = await asyncio.open_connection(host, port)
        writer.close()


def _take_back_sigterm() -> None:
    """Put the handler in place again that was there before Ray's own, which prints what nobody asked for."""
    handler = signal.getsignal(signal.SIGTERM)
    if handler is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)


@asynccontextmanager
async def ray_hosts(
    server: ServerConfig, config: GatewayConfig, cluster: RayConfig
) -> AsyncIterator[RayHosts]:
    """Be a driver of a Ray cluster for the length of the block.

    Args:
        server: what a worker is to be, made for this machine.

    Raises:
        ConfigError: Ray is not installed, or the address is not one of a cluster.
        ServerUnreachable: no cluster answers.
    """
    if "://" in cluster.address:
        raise ConfigError(
            f"{cluster.address} is not the address of a cluster's head",
            hint="say `auto` or HOST:PORT; the gateway runs on a node of the cluster",
        )
    try:
        import ray
    except ImportError:
        raise ConfigError(
            "Ray is not installed", hint=f'{sys.executable} -m pip install "{_PACKAGE}[ray]"'
        ) from None

    def connect() -> None:
        # Not in the main thread, so that Ray leaves our signal handlers alone.
        ray.init(address=cluster.address, namespace=cluster.namespace, logging_level=logging.ERROR)

    try:
        async with asyncio.timeout(cluster.connect_seconds):
            await _knock(cluster.address)
            await _in_thread(connect)
    except (OSError, RuntimeError, ValueError, TimeoutError) as error:
        why = " ".join(str(error).split()) or f"nothing within {cluster.connect_seconds:g} s"
        raise ServerUnreachable(
            f"no Ray cluster takes us in at {cluster.address}: {why}",
            hint=_SAME_VERSIONS if "Version mismatch" in why else _BE_A_NODE,
        ) from None
    _take_back_sigterm()
    try:
        yield RayHosts(ray, server, config, cluster)
    finally:
        try:
            async with asyncio.timeout(config.stop_seconds):
                await _in_thread(ray.shutdown)
        except TimeoutError:
            log.warning("the Ray cluster does not answer; it will notice that we are gone")
