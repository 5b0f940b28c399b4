"""``webgym serve``: a browser server as a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.core.errors import ConfigError

if TYPE_CHECKING:
    from webgym.server import GatewayConfig, RayConfig, ServerConfig, ServerInfo

TOKEN = "WEBGYM_TOKEN"  # noqa: S105 - a variable's name
_TOKEN_BYTES = 32


def command(
    host: str = typer.Option("127.0.0.1", "--host", help="Address to listen on."),
    port: int = typer.Option(8700, "--port", min=0, max=65535, help="Port; 0 takes a free one."),
    slots: int | None = typer.Option(
        None,
        "--slots",
        min=1,
        help="Sessions at the same time; with --ray, on each node.",
        show_default="4 per core",
    ),
    workers: int | None = typer.Option(
        None,
        "--workers",
        min=1,
        help="Worker processes that share the slots; with --ray, on each node.",
        show_default="1 per 4 cores",
    ),
    worker_host: str = typer.Option(
        "127.0.0.1",
        "--worker-host",
        help="Address where workers listen. One that clients reach saves them the way through the gateway.",
    ),
    worker_ports: str | None = typer.Option(
        None,
        "--worker-ports",
        metavar="FIRST-LAST",
        help="Ports of which workers take one each, for a firewall to let through.",
        show_default="any that is free",
    ),
    sessions_per_client: int | None = typer.Option(
        None, "--sessions-per-client", min=1, help="Most sessions of one client.", show_default="no limit"
    ),
    token_file: Path | None = typer.Option(
        None, "--token-file", help="Where the token is; made, for your eyes only, if it is not there."
    ),
    tokens: Path | None = typer.Option(
        None,
        "--tokens",
        metavar="FILE",
        help="Others who may call: a line each of a name and a token. Read again when it changes.",
    ),
    audit: Path | None = typer.Option(
        None, "--audit", metavar="FILE", help="Write down who opened which session, and when it ended."
    ),
    browser: Path | None = typer.Option(
        None, "--browser", help="Chromium to run.", show_default="the first that is found"
    ),
    allow_host: list[str] = typer.Option(
        [],
        "--allow-host",
        metavar="PATTERN[=HOST:PORT]",
        help="Let pages connect to a name, address or network that is otherwise refused, or lead a name"
        " elsewhere: intranet.example, 10.0.0.0/8, *.webgym.test=127.0.0.1:8123. May be repeated.",
    ),
    cgroup: Path | None = typer.Option(
        None,
        "--cgroup",
        metavar="FOLDER",
        help="A cgroup (version 2) to divide: each browser gets one in it, bounded by the kernel.",
    ),
    sandbox: str = typer.Option("auto", "--sandbox", help="auto, on or off."),
    ttl: float = typer.Option(60.0, "--ttl", help="Seconds after which an unrenewed session is taken back."),
    queues: str = typer.Option(
        "per_operation",
        "--queues",
        help="per_operation: each type of call has its own queue; global: one for all, to compare with.",
    ),
    wait: float = typer.Option(60.0, "--wait", min=0, help="Seconds that a caller waits for a free slot."),
    ray: str | None = typer.Option(
        None,
        "--ray",
        metavar="ADDRESS",
        help="Run the workers on the nodes of this Ray cluster, e.g. auto or 10.0.0.1:6379.",
    ),
    slots_per_cpu: float = typer.Option(
        4.0, "--slots-per-cpu", help="With --ray: sessions for each CPU of a node, where --slots is not said."
    ),
    ray_cpus: float | None = typer.Option(
        None, "--ray-cpus", min=0, help="With --ray: CPUs to reserve on each node.", show_default="all"
    ),
    ray_resource: str | None = typer.Option(
        None, "--ray-resource", metavar="NAME", help="With --ray: only nodes with this custom resource."
    ),
    compat: bool = typer.Option(
        False, "--compat", help="Speak the HTTP API of the WebGym authors' server too."
    ),
    compat_port: int = typer.Option(7000, "--compat-port", min=0, max=65535, help="Port for that."),
    compat_key_file: Path | None = typer.Option(
        None, "--compat-key-file", help="Where its API key is, made like the token.", show_default="the token"
    ),
) -> None:
    """Start a browser server: a gateway and its workers, here or on the nodes of a Ray cluster.

    SIGTERM or Ctrl-C stops it and every browser of it.

    The token is taken from --token-file, or from WEBGYM_TOKEN, or made up and printed once.
    """
    import logging
    import os
    import sys

    import uvloop

    from webgym.server import GatewayConfig, RayConfig, ServerConfig
    from webgym.server.listening import open_as_many_files_as_may_be
    from webgym.settings import validated, without_none

    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    token = _token_in(token_file) if token_file else os.environ.get(TOKEN)
    settings = {
        "host": host,
        "port": port,
        "slots": slots,
        "token": token,
        "tokens_file": tokens and tokens.absolute(),
        "audit_file": audit,
        "ttl_seconds": ttl,
        "allocate_seconds": wait,
        "sessions_per_client": sessions_per_client,
        "admission": {"queues": queues},
        "browser": {
            "executable": browser,
            "egress": {"allow": allow_host},
            "sandbox": sandbox,
            "cgroup": cgroup,
        },
    }
    config = validated(ServerConfig, without_none(settings))
    ports = None if worker_ports is None else worker_ports.split("-")
    fleet = validated(GatewayConfig, {"workers": workers, "worker_host": worker_host, "worker_ports": ports})
    cluster = None
    if ray is not None:
        nodes = {
            "address": ray,
            "slots_per_cpu": slots_per_cpu,
            "slots_per_node": slots,
            "cpus_per_node": ray_cpus,
            "node_resource": ray_resource,
        }
        cluster = validated(RayConfig, nodes)
    where = f"in {token_file}" if token_file else f"in {TOKEN}" if token else ""
    beside = config.model_copy(update={"port": compat_port}) if compat else None
    key = _token_in(compat_key_file) if compat_key_file else None
    open_as_many_files_as_may_be()
    uvloop.run(_serve(config, fleet, cluster, where, beside, key))
    if cluster is not None:
        # All is done. Where the cluster's head is gone, Ray would hang or crash with the interpreter.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


async def _serve(
    config: ServerConfig,
    fleet: GatewayConfig,
    cluster: RayConfig | None,
    token_is: str,
    compat: ServerConfig | None,
    key: str | None,
) -> None:
    import asyncio
    import signal
    from contextlib import AsyncExitStack

    from webgym.server import running_gateway
    from webgym.server.compat import running_compat

    serving = asyncio.current_task()
    assert serving is not None
    told = asyncio.Event()

    def stop() -> None:
        if not told.is_set():  # once: whoever is impatient must not cut the end short
            told.set()
            serving.cancel()

    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop)
    try:
        async with AsyncExitStack() as stack:
            server = await stack.enter_async_context(running_gateway(config, fleet, cluster))
            gateway = server.gateway
            _say(server.url, token_is or server.token, await gateway.info(), gateway.fleet.wanted)
            if compat is not None:
                layer = running_compat(server.url, server.token, listening=compat, key=key)
                print(f"compat   {(await stack.enter_async_context(layer)).url}", flush=True)
            await asyncio.Event().wait()
    except asyncio.CancelledError:
        if not told.is_set():
            raise


def _say(url: str, token: str, info: ServerInfo, wanted: int) -> None:
    up = len(info.workers)
    more = wanted > up
    print(f"server   {url}")
    print(f"token    {token}")
    print(f"slots    {info.slots}{' so far' if more else ''}")
    print(
        f"workers  {up}{f' of {wanted}' if more else ''}{'' if wanted else ': no node has CPUs for us yet'}"
    )
    print(f"browser  {f'{info.browser} ({info.executable})' if up else 'not known yet'}")
    sandbox = "on" if info.sandboxed else f"OFF: {info.sandbox_reason}"
    print(f"sandbox  {sandbox if up else 'not known yet'}", flush=True)


def _token_in(path: Path) -> str:
    """The token that a file holds; a file that is not there gets a fresh one."""
    import os
    import secrets

    try:
        if path.exists():
            return path.read_text().strip()
        token = secrets.token_urlsafe(_TOKEN_BYTES)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(f"{token}\n")
    except OSError as error:
        raise ConfigError(f"the token file {path} cannot be used: {error.strerror}") from error
    return token
