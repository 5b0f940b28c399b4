"""``webgym serve``: a browser server as a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.cli._fields import Given, Option, Options, takes
from webgym.core.errors import ConfigError
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig

if TYPE_CHECKING:
    from webgym.server import ServerInfo

TOKEN = "WEBGYM_TOKEN"  # noqa: S105 - a variable's name
_TOKEN_BYTES = 32
_PORT = 8700


SERVER = Options(
    ServerConfig,
    {
        "--host": "host",
        "--port": Option("port", default=str(_PORT)),
        "--slots": Option("slots", default="4 per core"),
        "--sessions-per-client": "sessions_per_client",
        "--tokens": "tokens_file",
        "--audit": "audit_file",
        "--browser": "browser.executable",
        "--allow-host": Option("browser.egress.allow", metavar="PATTERN[:PORT][=TARGET]"),
        "--cgroup": "browser.cgroup",
        "--sandbox": "browser.sandbox",
        "--ttl": "ttl_seconds",
        "--queues": "admission.queues",
        "--wait": "allocate_seconds",
    },
)
GATEWAY = Options(
    GatewayConfig,
    {
        "--workers": "workers",
        "--worker-host": "worker_host",
        "--worker-ports": Option(
            "worker_ports", metavar="FIRST-LAST", parse=lambda ports: ports.split("-", maxsplit=1)
        ),
    },
)
RAY = Options(
    RayConfig,
    {
        "--ray": Option("address", default="without Ray, on this machine"),
        "--slots-per-cpu": "slots_per_cpu",
        "--ray-cpus": "cpus_per_node",
        "--ray-resource": "node_resource",
    },
    panel="Ray cluster",
)


@takes(server=SERVER, gateway=GATEWAY, ray=RAY)
def command(
    server: Given,
    gateway: Given,
    ray: Given,
    token_file: Path | None = typer.Option(
        None, "--token-file", help="File that holds the token; created, readable by you only, if missing."
    ),
    compat: bool = typer.Option(
        False, "--compat", help="Also serve the HTTP API of the WebGym authors' server."
    ),
    compat_port: int = typer.Option(7000, "--compat-port", min=0, max=65535, help="Port of that API."),
    compat_key_file: Path | None = typer.Option(
        None,
        "--compat-key-file",
        help="File that holds its API key, created like the token.",
        show_default="the token",
    ),
) -> None:
    """Start a browser server: a gateway and its workers, here or on the nodes of a Ray cluster.

    SIGTERM or Ctrl-C stops it and every browser of it.

    The token is read from --token-file or WEBGYM_TOKEN; without either, a random one is printed once.
    """
    import logging
    import os
    import sys

    import uvloop

    from webgym.server.listening import raise_open_files_limit
    from webgym.settings import validated

    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    token = _token_in(token_file) if token_file else os.environ.get(TOKEN)
    if "tokens_file" in server:
        server["tokens_file"] = server["tokens_file"].absolute()
    config = validated(ServerConfig, {"port": _PORT} | server | ({"token": token} if token else {}))
    fleet = validated(GatewayConfig, gateway)
    cluster = None
    if "address" in ray:
        cluster = validated(RayConfig, ray | {"slots_per_node": server.get("slots")})
    where = f"in {token_file}" if token_file else f"in {TOKEN}" if token else ""
    beside = config.model_copy(update={"port": compat_port}) if compat else None
    key = _token_in(compat_key_file) if compat_key_file else None
    raise_open_files_limit()
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
