"""Where servers listen, and where workers do when a firewall wants to know."""

from __future__ import annotations

import sys
from contextlib import closing

import pytest

from webgym.core.errors import ConfigError
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig
from webgym.server.listening import listen
from webgym.server.ray_hosts import RayHost
from webgym.server.subprocess_worker import LocalHost


def test_a_free_port_of_some() -> None:
    with closing(listen(ServerConfig())) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"none of the ports {port} to {port} .* in use"):
            listen(ServerConfig(ports=(port, port)))
        last = min(port + 20, 65535)
        with closing(listen(ServerConfig(ports=(port, last)))) as free:
            assert port < free.getsockname()[1] <= last
    with pytest.raises(ConfigError, match="9001 is above 9000"):
        listen(ServerConfig(ports=(9001, 9000)))


def test_workers_keep_to_their_ports_here_and_on_a_node() -> None:
    server, fleet = ServerConfig(slots=2, port=8700), GatewayConfig(workers=2, worker_ports=(9000, 9010))
    node = {"NodeManagerAddress": "10.0.0.7", "Resources": {"CPU": 2.0}}
    here, there = LocalHost(server, fleet), RayHost(sys, node, server, fleet, RayConfig())
    assert [(share.host, share.ports) for share in here.shares] == [("127.0.0.1", (9000, 9010))] * 2
    assert [(share.host, share.ports) for share in there.shares] == [("10.0.0.7", (9000, 9010))] * 2


def test_a_nodes_sessions_follow_its_cpus() -> None:
    node = {"NodeManagerAddress": "10.0.0.7", "Resources": {"CPU": 12.0}}
    fleet = GatewayConfig()
    by_cpus = RayHost(sys, node, ServerConfig(), fleet, RayConfig(slots_per_cpu=2.5))
    assert [share.slots for share in by_cpus.shares] == [10, 10, 10]
    assert [share.parallel_launches for share in by_cpus.shares] == [4, 4, 4]  # one for each core
    by_node = RayHost(sys, node, ServerConfig(), fleet, RayConfig(slots_per_node=7))
    assert [share.slots for share in by_node.shares] == [3, 2, 2]
