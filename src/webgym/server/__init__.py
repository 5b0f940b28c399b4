"""Many browser slots behind one address.

operations.py  the one table of operations: routing, the OpenAPI document and the client follow it
messages.py    what travels between client and server
client.py      BrowserClient and Session: what the collector uses
config.py      ServerConfig, ClientLimits: every limit, with its unit and its reason
app.py         HTTP: authentication, limits, decoding, errors
service.py     what each operation does
leases.py      who may use which slot, and until when
pool.py        slots: brought up, lent, cleaned, replaced
admission.py   run permits, and a queue of its own for each type of operation
metrics.py     what Prometheus sees
worker.py      running a server, in this process
"""

from __future__ import annotations

from webgym.browser.config import BrowserConfig, Cookie
from webgym.server.client import BrowserClient, Session
from webgym.server.config import ClientLimits, ServerConfig
from webgym.server.messages import ServerInfo, SessionOptions, View
from webgym.server.worker import RunningServer, running_server

__all__ = [
    "BrowserClient",
    "BrowserConfig",
    "ClientLimits",
    "Cookie",
    "RunningServer",
    "ServerConfig",
    "ServerInfo",
    "Session",
    "SessionOptions",
    "View",
    "running_server",
]
