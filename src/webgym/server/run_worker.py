"""Runs one worker in this process: for tests, for the demo, and inside ``webgym serve``."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path

from webgym.browser.find import find_browser
from webgym.server.app import create_app
from webgym.server.config import ServerConfig
from webgym.server.listening import is_wildcard, listen, serving, url_of
from webgym.server.service import Service
from webgym.server.tokens import Tokens

TOKEN_BYTES = 32
_INSTANCE_BYTES = 8


class RunningServer:
    """A running worker.

    Attributes:
        url: its base URL.
        token: the bearer token.
        service: its service.
        instance: id of this run of the server.
    """

    def __init__(self, url: str, token: str, service: Service, instance: str) -> None:
        self.url = url
        self.token = token
        self.service = service
        self.instance = instance


async def _find_executable(explicit: Path | None) -> Path:
    return (await asyncio.to_thread(find_browser, explicit)).path


def new_instance() -> str:
    """A unique id for a run of a server."""
    return secrets.token_hex(_INSTANCE_BYTES)


@asynccontextmanager
async def running_server(config: ServerConfig | None = None) -> AsyncIterator[RunningServer]:
    """Serve during the block; afterwards no browser is left.

    Args:
        config: the settings; by default loopback, a free port, a random token.

    Raises:
        BrowserNotFound, BrowserLaunchFailed: no browser can be started.
        ConfigError: the address cannot be listened on.
    """
    config = config or ServerConfig()
    token = config.token or secrets.token_urlsafe(TOKEN_BYTES)
    tokens = Tokens(token, config.tokens_file)
    instance = new_instance()
    executable = await _find_executable(config.browser.executable)
    with closing(listen(config)) as listener:
        url = url_of(listener)
        async with Service(config, executable) as service:
            endpoint = "" if is_wildcard(config.host) else url
            app = create_app(service, tokens, instance=instance, endpoint=endpoint)
            async with tokens.watching_file(), serving(app, listener, config):
                try:
                    yield RunningServer(url, token, service, instance)
                finally:
                    service.feed.close()  # the streams of subscribers never end by themselves
