"""``webgym serve``: start a browser server."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.cli._fields import Given, Option, Options, takes
from webgym.core.errors import ConfigError
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig

if TYPE_CHECKING:
    from webgym.server.messages import ServerInfo

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
        None,
        "--token-file",
        help="File that contains the token; created, readable by you only, if it does not exist.",
    ),
    compat: bool = typer.Option(
        False, "--compat", help="Also serve the HTTP API of the WebGym authors' server."
    ),
    compat_port: int = typer.Option(
        7000, "--compat-port", min=0, max=65535, help="Port of the API of --compat."
    ),
    compat_key_file: Path | None = typer.Option(
        None,
        "--compat-key-file",
        help="File that contains the API key of --compat; created if it does not exist.",
        show_default="the token",
    ),
) -> None:
    """Start a browser server: a gateway and its workers, here or on the nodes of a Ray cluster.

    SIGTERM or Ctrl-C stops it and all of its browsers.

    The token is read from --token-file or WEBGYM_TOKEN; without either, a random one is printed once.
    """
    import logging
    import os
    import sys

    import uvloop

    from webgym.core.settings import validated
    from webgym.server.callers import check_token
    from webgym.server.listening import raise_open_files_limit

    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    token = _read_or_create_token(token_file) if token_file else os.environ.get(TOKEN)
    if token and not token_file:
        check_token(token, TOKEN)
    if "tokens_file" in server:
        server["tokens_file"] = server["tokens_file"].absolute()
    config = validated(ServerConfig, {"port": _PORT} | server | ({"token": token} if token else {}))
    fleet = validated(GatewayConfig, gateway)
    cluster = None
    if "address" in ray:
        cluster = validated(RayConfig, ray | {"slots_per_node": server.get("slots")})
    token_source = f"in {token_file}" if token_file else f"in {TOKEN}" if token else ""
    compat_config = config.model_copy(update={"port": compat_port}) if compat else None
    # The authors' clients may have a short one.
    key = _read_or_create_token(compat_key_file, shortest=1) if compat_key_file else None
    raise_open_files_limit()
    uvloop.run(_serve(config, fleet, cluster, token_source, compat_config, key))
    if cluster is not None:
        # If the cluster's head is gone, Ray hangs or crashes when the interpreter exits.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


async def _serve(
    config: ServerConfig,
    fleet: GatewayConfig,
    cluster: RayConfig | None,
    token_source: str,
    compat: ServerConfig | None,
    key: str | None,
) -> None:
    import asyncio
    import signal
    from contextlib import AsyncExitStack, closing

    from webgym.compat.app import running_compat
    from webgym.server.gateway import running_gateway
    from webgym.server.listening import listen

    serving = asyncio.current_task()
    assert serving is not None
    stopping = asyncio.Event()

    def stop() -> None:
        if not stopping.is_set():  # only once: a second signal must not interrupt the shutdown
            stopping.set()
            serving.cancel()

    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop)
    try:
        async with AsyncExitStack() as stack:
            if compat is not None:  # before any browser starts
                listener = stack.enter_context(closing(listen(compat, "--compat-port")))
            server = await stack.enter_async_context(running_gateway(config, fleet, cluster))
            gateway = server.gateway
            _print_server(
                server.url, token_source or server.token, await gateway.info(), gateway.fleet.wanted
            )
            if compat is not None:
                layer = running_compat(server.url, server.token, listening=compat, key=key, listener=listener)
                print(f"compat   {(await stack.enter_async_context(layer)).url}", flush=True)
            await asyncio.Event().wait()
    except asyncio.CancelledError:
        if not stopping.is_set():
            raise


def _print_server(url: str, token: str, info: ServerInfo, wanted: int) -> None:
    running = len(info.workers)
    more = wanted > running
    print(f"server   {url}")
    print(f"token    {token}")
    print(f"slots    {info.slots}{' so far' if more else ''}")
    print(f"workers  {running}{f' of {wanted}' if more else ''}{'' if wanted else ': no node has CPUs yet'}")
    print(f"browser  {f'{info.browser} ({info.executable})' if running else 'not known yet'}")
    for line in info.without:
        print(f"remote   without {line}")
    sandbox = "on" if info.sandboxed else f"OFF: {info.sandbox_reason}"
    print(f"sandbox  {sandbox if running else 'not known yet'}", flush=True)


def _read_or_create_token(path: Path, shortest: int | None = None) -> str:
    """Read the token in a file; if there is no such file, create it with a random token.

    Raises:
        ConfigError: the file cannot be read or created, or does not contain a token of that length.
    """
    import os
    import secrets

    from webgym.server.callers import SHORTEST, check_token

    try:
        if path.exists():
            token = path.read_text(errors="replace").strip()
            check_token(token, str(path), shortest or SHORTEST)
            return token
        token = secrets.token_urlsafe(_TOKEN_BYTES)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(f"{token}\n")
    except OSError as error:
        raise ConfigError(f"cannot read or create the token file {path}: {error.strerror}") from error
    return token
