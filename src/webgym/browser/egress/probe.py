"""Asks for a page from outside all browsers, by the way that their connections take."""

from __future__ import annotations

import asyncio
import ssl
from typing import cast
from urllib.parse import urlsplit

from webgym.browser.egress.budget import Budget
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.dial import Dialer, NotConnected
from webgym.core.observation import Probed

_PORTS = {"http": 80, "https": 443}
_LINE_BYTES = 2**16


async def probe(dialer: Dialer, config: EgressConfig, url: str, seconds: float) -> Probed:
    """Ask a website for a page, with a budget of the probe's own.

    Args:
        dialer: opens the connection, under the same policy as any other.
        config: limits of the budget.
        url: address of the page.
        seconds: until the status of the answer has come.
    """
    try:
        async with asyncio.timeout(seconds):
            return await _ask(dialer, config, url)
    except TimeoutError:
        return Probed(f"{url} gave a probe no answer within {seconds:g} s")
    except NotConnected as failure:
        return Probed() if failure.reason == "too_many" else Probed(f"{url}: {failure.message}")
    except (OSError, ValueError) as error:
        return Probed(f"{url}: {type(error).__name__}")


class _Asking(asyncio.StreamReaderProtocol):
    transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is open."""
        self.transport = cast(asyncio.Transport, transport)  # uvloop's is not a subclass
        super().connection_made(transport)


async def _ask(dialer: Dialer, config: EgressConfig, url: str) -> Probed:
    parts = urlsplit(url)
    reader = asyncio.StreamReader(limit=_LINE_BYTES)
    protocol = _Asking(reader)
    host, port = parts.hostname or "", parts.port or _PORTS[parts.scheme]
    await dialer.dial(host, port, Budget(config), lambda: protocol)
    writer = asyncio.StreamWriter(protocol.transport, protocol, reader, asyncio.get_running_loop())
    try:
        if parts.scheme == "https":
            await writer.start_tls(_context(), server_hostname=host)
        path = f"{parts.path or '/'}{f'?{parts.query}' if parts.query else ''}"
        name = parts.netloc.rpartition("@")[2]
        writer.write(f"GET {path} HTTP/1.1\r\nHost: {name}\r\nConnection: close\r\n\r\n".encode())
        version, status, *_ = (await reader.readline()).split(maxsplit=2)
        if not version.startswith(b"HTTP/"):
            raise ValueError(version)
        return Probed(status=int(status))
    finally:
        writer.transport.abort()


def _context() -> ssl.SSLContext:
    """Whether a certificate is valid is no question of a website's being there."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context
