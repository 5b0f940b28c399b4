"""Running a server in this process: for tests, for the demo, and for ``webgym serve``."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import uvicorn

from webgym.browser.find import find_browser
from webgym.core.errors import ConfigError
from webgym.server.app import create_app
from webgym.server.config import ServerConfig
from webgym.server.service import Service

_TOKEN_BYTES = 32
_BACKLOG = 2048


class RunningServer:
    """A server that takes calls.

    Attributes:
        url: its base URL.
        token: the bearer token.
        service: what is behind it.
    """

    def __init__(self, url: str, token: str, service: Service) -> None:
        self.url = url
        self.token = token
        self.service = service


class _Quiet(uvicorn.Server):
    """A server whose signals are its owner's business."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave the process's signal handlers alone."""
        yield


def _listen(config: ServerConfig) -> socket.socket:
    family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((config.host, config.port))
        listener.listen(_BACKLOG)  # from here on callers wait rather than be refused
    except OSError as error:
        listener.close()
        raise ConfigError(
            f"{config.host}:{config.port} cannot be listened on: {error.strerror}",
            hint="choose another --port, or 0 for a free one",
        ) from error
    return listener


async def _find_executable(explicit: Path | None) -> Path:
    return (await asyncio.to_thread(find_browser, explicit)).path


@asynccontextmanager
async def running_server(config: ServerConfig | None = None) -> AsyncIterator[RunningServer]:
    """Serve for the length of the block; afterwards no browser is left.

    Raises:
        BrowserNotFound, BrowserLaunchFailed: there is no browser to serve.
        ConfigError: the address cannot be listened on.
    """
    config = config or ServerConfig()
    token = config.token or secrets.token_urlsafe(_TOKEN_BYTES)
    executable = await _find_executable(config.browser.executable)
    with contextlib.closing(_listen(config)) as listener:
        async with Service(config, executable) as service:
            server = _Quiet(
                uvicorn.Config(
                    create_app(service, token),
                    lifespan="off",
                    log_config=None,
                    access_log=False,
                    server_header=False,
                    ws="none",
                    timeout_keep_alive=config.keep_alive_seconds,
                    timeout_graceful_shutdown=config.shutdown_seconds,
                )
            )
            host, port = listener.getsockname()[:2]
            url = f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
            serving = asyncio.create_task(server.serve(sockets=[listener]))
            try:
                yield RunningServer(url, token, service)
            finally:
                server.should_exit = True
                await serving
