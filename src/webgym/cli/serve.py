"""``webgym serve``: a browser server as a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from webgym.core.errors import ConfigError

if TYPE_CHECKING:
    from webgym.server import RunningServer, ServerConfig

TOKEN = "WEBGYM_TOKEN"  # noqa: S105 - a variable's name
_TOKEN_BYTES = 32


def command(
    host: str = typer.Option("127.0.0.1", "--host", help="Address to listen on."),
    port: int = typer.Option(8700, "--port", min=0, max=65535, help="Port; 0 takes a free one."),
    slots: int | None = typer.Option(
        None, "--slots", min=1, help="Sessions at the same time.", show_default="4 per core"
    ),
    token_file: Path | None = typer.Option(
        None, "--token-file", help="Where the token is; made, for your eyes only, if it is not there."
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
    sandbox: str = typer.Option("auto", "--sandbox", help="auto, on or off."),
    ttl: float = typer.Option(60.0, "--ttl", help="Seconds after which an unrenewed session is taken back."),
    wait: float = typer.Option(60.0, "--wait", min=0, help="Seconds that a caller waits for a free slot."),
) -> None:
    """Start a browser server; SIGTERM or Ctrl-C stops it and every browser of it.

    The token is taken from --token-file, or from WEBGYM_TOKEN, or made up and printed once.
    """
    import logging
    import os

    import uvloop
    from pydantic import ValidationError

    from webgym.server import ServerConfig

    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    token = _token_in(token_file) if token_file else os.environ.get(TOKEN)
    settings = {
        "host": host,
        "port": port,
        "slots": slots,
        "token": token,
        "ttl_seconds": ttl,
        "allocate_seconds": wait,
        "browser": {"executable": browser, "egress": {"allow": allow_host}, "sandbox": sandbox},
    }
    try:
        config = ServerConfig.model_validate(
            {key: value for key, value in settings.items() if value is not None}
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    where = f"in {token_file}" if token_file else f"in {TOKEN}" if token else ""
    uvloop.run(_serve(config, where))


async def _serve(config: ServerConfig, token_is: str) -> None:
    import asyncio
    import signal

    from webgym.server import running_server

    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    async with running_server(config) as server:
        _say(config, server, token_is)
        await stop.wait()


def _say(config: ServerConfig, server: RunningServer, token_is: str) -> None:
    pool = server.service.pool
    sandbox = "on" if pool.sandbox.on else f"OFF: {pool.sandbox.reason}"
    print(f"server   {server.url}")
    print(f"token    {token_is or server.token}")
    print(f"slots    {config.slots}")
    print(f"browser  {pool.browser} ({pool.executable})")
    print(f"sandbox  {sandbox}", flush=True)


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
