"""Workers on the nodes of a real Ray cluster, all of them on this machine, with a gateway as a process."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psutil
import pytest
import pytest_asyncio
from tests.conftest import Commands, wait_until
from tests.documented import documented

from webgym.core.errors import ConfigError, ServerUnreachable, WebGymError, WorkerLost
from webgym.server.client import BrowserClient, Session
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig
from webgym.server.gateway import running_gateway

from .conftest import TOKEN, Site, quick

if find_spec("ray") is None:  # importing it takes every process that collects the tests a third of a second
    pytest.skip("ray is not installed", allow_module_level=True)

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(1200)]

MIB = 2**20
SLOWEST_START = 500.0
"""Until what was started is there, seconds: tells what hangs from what is slow. Two nodes take 16 alone,
over 150 beside eight busy processes."""


class Nodes:
    """A cluster whose head takes no work, and nodes with one CPU each."""

    def __init__(self) -> None:
        from ray.cluster_utils import Cluster

        # Without the processes that look after logs and sizes of clusters.
        head = {"num_cpus": 0, "include_dashboard": False, "no_monitor": True, "include_log_monitor": False}
        head |= {"object_store_memory": 80 * MIB}
        self._on_sigterm = signal.getsignal(signal.SIGTERM)  # Ray puts its own in its place
        self._cluster: Any = Cluster(initialize_head=True, head_node_args=head)
        self.address: str = self._cluster.address

    def add(self, **settings: Any) -> Any:
        return self._cluster.add_node(num_cpus=1, object_store_memory=80 * MIB, **settings)

    def kill(self, node: Any) -> None:
        """Pull the plug."""
        self._cluster.remove_node(node, allow_graceful=False)

    def end(self) -> None:
        folder = self._cluster.head_node.get_session_dir_path()
        self._cluster.shutdown()
        signal.signal(signal.SIGTERM, self._on_sigterm)
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def scratch() -> Iterator[Path]:
    """Logs, and everything that the browsers write; Ray's sockets too, so its path has to be short."""
    with tempfile.TemporaryDirectory(prefix="webgym-ray-", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


@pytest.fixture(scope="module")
def commands(scratch: Path) -> Commands:
    return Commands(scratch)


@pytest.fixture(scope="module")
def nodes(commands: Commands, scratch: Path) -> Iterator[Nodes]:
    """Two nodes; what they start can be told by its environment."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WEBGYM_TEST_MARK", commands.mark)
        patch.setenv("TMPDIR", str(scratch))
        made = Nodes()
        made.add()
        made.add()
        yield made
        commands.end()  # before the ground goes from under them
        made.end()


class Gateway:
    """``webgym serve --ray`` as a process."""

    def __init__(self, commands: Commands, nodes: Nodes) -> None:
        self._commands = commands
        self.process = commands.start(
            *documented(
                "webgym serve --ray auto --host 0.0.0.0 --slots-per-cpu 8 --worker-ports 20000-20099"
            ),
            *("--ray", nodes.address, "--host", "127.0.0.1", "--port", 0, "--slots", 1),
            *("--allow-host", "127.0.0.1", f"allocate_seconds={SLOWEST_START}"),
            WEBGYM_TOKEN=TOKEN,
        )  # fmt: skip
        wait_until(lambda: "\nsandbox " in self.said or self.process.poll() is not None, SLOWEST_START)
        found = re.search(r"server +(\S+)", self.said)
        assert found, self.said
        self.url = found[1]

    @property
    def said(self) -> str:
        return self._commands.output(self.process)


@pytest.fixture(scope="module")
def gateway(commands: Commands, nodes: Nodes) -> Gateway:
    return Gateway(commands, nodes)


@pytest_asyncio.fixture(loop_scope="module")
async def client(gateway: Gateway) -> AsyncIterator[BrowserClient]:
    async with BrowserClient(gateway.url, token=TOKEN, limits=quick(wait_seconds=SLOWEST_START)) as client:
        yield client


async def until(holds: Callable[[], Awaitable[bool]], seconds: float = SLOWEST_START) -> None:
    async with asyncio.timeout(seconds):
        while not await holds():
            await asyncio.sleep(0.1)


async def until_free(client: BrowserClient, slots: int) -> None:
    """Wait until so many slots are there, all free."""

    async def are_free() -> bool:
        load = (await client.pressure()).slots
        return (load.total, load.free) == (slots, slots)

    await until(are_free)


def marked(commands: Commands, pattern: str) -> list[psutil.Process]:
    """Living processes of this cluster whose command line matches."""
    found = []
    for process in psutil.process_iter(["cmdline", "status"]):
        try:
            if (
                process.info["status"] != psutil.STATUS_ZOMBIE
                and re.search(pattern, " ".join(process.info["cmdline"] or ()))
                and process.environ().get("WEBGYM_TEST_MARK") == commands.mark
            ):
                found.append(process)
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
    return found


OURS = r"webgym\.server\.subprocess_worker|chrom"


async def losses(sessions: list[Session]) -> list[WebGymError | None]:
    """What the holders are told, session by session."""

    async def ask(session: Session) -> WebGymError | None:
        try:
            await session.metadata()
        except WebGymError as error:
            return error
        return None

    return list(await asyncio.gather(*(ask(session) for session in sessions)))


async def until_one_is_lost(sessions: list[Session]) -> list[Session]:
    """The sessions that are left; the lost one's holder was told in so many words."""

    async def is_one_lost() -> bool:
        return any(await losses(sessions))

    await until(is_one_lost)
    told = await losses(sessions)
    [lost] = [error for error in told if error]
    assert isinstance(lost, WorkerLost)
    return [session for session, error in zip(sessions, told, strict=True) if not error]


async def test_a_worker_on_every_node(site: Site, client: BrowserClient) -> None:
    await until_free(client, 2)
    assert len({worker.url for worker in (await client.info()).workers}) == 2
    sessions = [await client.open() for _ in range(2)]
    for session in sessions:
        assert session.is_direct, "a node's address is reached from here"
        assert (await session.navigate(site.url())).title == "Home"


async def test_nodes_come_and_go(site: Site, client: BrowserClient, nodes: Nodes) -> None:
    """A node that joins serves those who wait; one that dies costs its own session alone."""
    await until_free(client, 2)
    sessions = [await client.open() for _ in range(2)]
    waiting = asyncio.create_task(client.open())
    node = nodes.add()
    try:
        sessions.append(await waiting)
        for session in sessions:
            await session.navigate(site.url())
    finally:
        nodes.kill(node)  # the next tests count on two
    left = await until_one_is_lost(sessions)
    for session in left:
        assert (await session.metadata()).title == "Home"
        await session.close()
    await until_free(client, 2)


async def test_a_killed_actor_costs_its_session_and_comes_back(
    site: Site, client: BrowserClient, commands: Commands
) -> None:
    await until_free(client, 2)
    sessions = [await client.open() for _ in range(2)]
    actor = marked(commands, "ray::NodeActor")[0]
    actor.kill()
    [left] = await until_one_is_lost(sessions)
    assert (await left.navigate(site.url())).title == "Home"
    await left.close()
    await until_free(client, 2)
    assert actor.pid not in [each.pid for each in marked(commands, "ray::NodeActor")]


async def refusal(address: str, **settings: Any) -> WebGymError:
    """Why a second gateway, in this process, does not come up."""
    handler = signal.getsignal(signal.SIGTERM)
    config, cluster = ServerConfig(slots=1, token=TOKEN), RayConfig(address=address, **settings)
    with pytest.raises(WebGymError) as caught:
        async with running_gateway(config, GatewayConfig(), cluster):
            raise AssertionError
    assert signal.getsignal(signal.SIGTERM) is handler
    return caught.value


async def test_a_node_whose_cpus_are_taken(client: BrowserClient, nodes: Nodes) -> None:
    await until_free(client, 2)  # so the other gateway's actors are there
    told = ""

    async def is_placed_nowhere() -> bool:  # Ray may list a node that died a moment ago as alive
        nonlocal told
        error = await refusal(nodes.address)
        told = error.hint
        return bool(re.fullmatch("1 CPUs are wanted at .*, and 0 are free", error.message))

    await until(is_placed_nowhere)
    assert "--ray-cpus" in told


async def test_a_node_without_our_package(nodes: Nodes, scratch: Path) -> None:
    """One where another package, or an old version of ours, has the name."""
    (scratch / "other" / "webgym").mkdir(parents=True)
    (scratch / "other" / "webgym" / "__init__.py").touch()
    node = nodes.add(resources={"bare": 1}, env_vars={"PYTHONPATH": str(scratch / "other")})
    error = await refusal(nodes.address, node_resource="bare", cpus_per_node=0)
    nodes.kill(node)
    assert error.message.endswith("No module named 'webgym.server'")
    assert "installed there" in error.hint


async def test_a_killed_gateway_leaves_nothing_on_the_nodes(
    site: Site, gateway: Gateway, commands: Commands, nodes: Nodes, scratch: Path
) -> None:
    async with BrowserClient(gateway.url, token=TOKEN, limits=quick(wait_seconds=SLOWEST_START)) as client:
        await until_free(client, 2)
        sessions = [await client.open() for _ in range(2)]
        await asyncio.gather(*(session.navigate(site.url()) for session in sessions))
        assert marked(commands, OURS)
        os.kill(gateway.process.pid, signal.SIGKILL)
        await asyncio.to_thread(wait_until, lambda: not marked(commands, OURS), SLOWEST_START)
        assert list((scratch / f"webgym-{os.getuid()}").iterdir()) == []
        assert {type(error) for error in await losses(sessions)} == {ServerUnreachable}
    again = await asyncio.to_thread(Gateway, commands, nodes)
    async with BrowserClient(again.url, token=TOKEN, limits=quick(wait_seconds=SLOWEST_START)) as client:
        await until_free(client, 2)
        assert (await (await client.open()).navigate(site.url())).title == "Home"
    again.process.terminate()
    assert await asyncio.to_thread(again.process.wait, SLOWEST_START) == 0
    assert not marked(commands, OURS)
    assert "SIGTERM" not in again.said, "Ray's own words are not for our users"


async def test_rays_own_parser_takes_the_pages_commands() -> None:
    from ray.scripts.scripts import start

    head = documented("ray start --head --port=6379 --num-cpus=0")
    node = documented("ray start --address=HEAD:6379 --object-store-memory=100000000")
    for words in (head, node):
        start.make_context("start", words[1:])


@pytest.mark.parametrize("address", ["nonsense", "127.0.0.1:1"])
async def test_where_there_is_no_cluster_it_is_said(address: str) -> None:
    config, fleet = ServerConfig(slots=1, token=TOKEN), GatewayConfig()
    with pytest.raises(ServerUnreachable, match=f"cannot connect to a Ray cluster at {address}"):
        async with running_gateway(config, fleet, RayConfig(address=address)):
            raise AssertionError


async def test_a_client_connection_of_rays_is_refused() -> None:
    with pytest.raises(ConfigError, match="not the address of a cluster's head"):
        async with running_gateway(ServerConfig(), GatewayConfig(), RayConfig(address="ray://head:10001")):
            raise AssertionError


async def test_where_there_is_no_ray_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigError, match="pip install"):
        async with running_gateway(ServerConfig(slots=1), GatewayConfig(), RayConfig()):
            raise AssertionError
