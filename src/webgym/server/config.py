"""Settings of the server and of its client: their limits, with units and reasons."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from webgym.browser.config import BrowserConfig
from webgym.core.calls import BROWSER_CALLS
from webgym.core.settings import Settings


def usable_cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))


Port = Annotated[int, Field(gt=0, le=65535)]


Queues: TypeAlias = Literal["per_operation", "global"]
"""How calls wait for a run permit."""


class Admission(Settings):
    """How many slots run at once, and in which order calls get to run.

    Only running slots use the processors: the others are stopped. An action partly waits for the page, so a
    few slots per core keep it busy; with more, they only slow each other down.
    """

    queues: Queues = "per_operation"
    """How calls wait. ``per_operation``: a queue for each type of operation, served fairly by service time
    (paper §4). ``global``: one queue for all, first come, first served; the paper's baseline."""

    fewest: int = Field(default_factory=lambda: 2 * usable_cores(), gt=0)
    """Slots that may run at once on saturated processors."""

    most: int = Field(default_factory=lambda: 24 * usable_cores(), gt=0)
    """Slots that may run at once when the processors are not fully used, because pages wait for websites."""

    step: int = Field(default_factory=usable_cores, gt=0)
    """Change of the number of running slots after a measurement."""


class ServerConfig(Settings):
    """A server: where it listens, its capacity, its deadlines."""

    host: str = "127.0.0.1"
    """Address to listen on. Anyone who can reach it and has the token can control browsers."""

    port: int = Field(default=0, ge=0, le=65535)
    """Port to listen on; 0 for any free port."""

    ports: tuple[Port, Port] | None = None
    """First and last of a range from which to use a free port instead, for firewalls."""

    token: str | None = Field(default=None, min_length=16, repr=False)
    """Bearer token of every call except ``/healthz``; ``None`` generates a random one."""

    tokens_file: Path | None = None
    """File of other callers: a name and a token on each line. Read again when it changes.

    Workers read it too, so on a cluster it must be on every node.
    """

    audit_file: Path | None = None
    """File to which the gateway appends a JSON line when a session is opened, by whom, and when it ends."""

    name: str = Field(default="", pattern=r"^[a-z0-9]{0,32}$")
    """Name of one worker among others: its session ids begin with it, so that the gateway finds it."""

    slots: int = Field(default_factory=lambda: 4 * usable_cores(), gt=0)
    """Concurrent sessions; with Ray, on each node. A slot takes 75-100 MB, and CPU only while its page is
    active."""

    parallel_launches: int = Field(default_factory=usable_cores, gt=0)
    """Browsers that start at once: a launch costs about a second of CPU."""

    relaunch_seconds: tuple[float, float] = (0.5, 30.0)
    """First and longest pause before a browser that did not start is tried again."""

    allocate_seconds: float = Field(default=60.0, ge=0)
    """Seconds that a caller waits for a free slot before it is refused with ``no_capacity``. Clients may wait
    for less: ours for 120 s, ``limits.wait_seconds``."""

    waiting: int = Field(default=4096, ge=0)
    """Callers that may wait for a slot, each with a connection of its own; more are refused with
    ``too_many_waiting`` (429)."""

    ttl_seconds: float = Field(default=60.0, gt=0)
    """Seconds after which a session that is not renewed is closed, unless its client requested another
    time."""

    longest_ttl_seconds: float = Field(default=600.0, gt=0)
    """Longest time to live that a client may request."""

    session_seconds: float = Field(default=4 * 3600.0, gt=0)
    """Longest duration of a session, however often it is renewed."""

    sessions_per_client: int | None = Field(default=None, gt=0)
    """Most sessions that one client may hold or wait for; by default there is no limit.

    A client is identified by the name of its token, else by the name that it gives, or by its address.
    """

    body_bytes: int = Field(default=1024 * 1024, gt=0)
    """Largest request body."""

    head_bytes: int = Field(default=32 * 1024, gt=0)
    """Largest request line and headers together. Those of WebGym's client take about 400 bytes."""

    receive_seconds: float = Field(default=30.0, gt=0)
    """From a connection, or the first byte of a request, until the request is complete; then the connection
    is closed."""

    connections: int = Field(default=8192, gt=0)
    """Concurrent connections; further ones are closed at once. A session has one or two."""

    pixels: int = Field(default=3840 * 2160, gt=0)
    """Largest viewport, width times height."""

    keep_alive_seconds: int = Field(default=75, gt=0)
    """How long idle connections are kept: longer than a model thinks, and longer than clients keep them."""

    dead_peer_seconds: float = Field(default=20.0, gt=0)
    """Time after which a connection is closed whose peer does not even answer TCP keepalive probes."""

    beat_seconds: float = Field(default=1.0, gt=0)
    """Longest interval between two reports to subscribers of the server's state."""

    admission: Admission = Field(default_factory=Admission)
    """How many slots run at once, and in which order calls get to run."""

    browser: BrowserConfig = Field(default_factory=BrowserConfig)
    """How browsers are started and pages observed."""


class GatewayConfig(Settings):
    """A gateway: how many workers it runs, and how it detects that one is gone."""

    workers: int | None = Field(default=None, gt=0)
    """Worker processes that share a machine's slots; by default one for every 4
    cores."""

    worker_host: str = "127.0.0.1"
    """Address on which workers listen. Clients that can reach it connect directly instead of through the
    gateway."""

    worker_ports: tuple[Port, Port] | None = None
    """First and last port on which workers listen, for firewalls; by default any free port.

    The range must be larger than the number of workers of a machine.
    """

    stop_seconds: float = Field(default=15.0, gt=0)
    """From stopping a worker until it is killed. It ends calls and browsers in that time."""

    restart_seconds: tuple[float, float] = (0.5, 30.0)
    """First and longest pause before a worker that ended or did not start is started again."""

    silent_seconds: float = Field(default=15.0, gt=0)
    """Time without a report after which a worker is queried; it is killed if it does not answer within
    ``answer_seconds``. Longer than several intervals of its reports."""

    connect_seconds: float = Field(default=3.0, gt=0)
    """Connecting to a worker."""

    answer_seconds: float = Field(default=5.0, gt=0)
    """A worker's answer to a query of its state. Calls of sessions have only the worker's own deadlines."""

    idle_seconds: float = Field(default=30.0, gt=0)
    """How long idle connections to workers are kept: shorter than the worker keeps them."""

    dead_peer_seconds: float = Field(default=15.0, gt=0)
    """Time after which a worker counts as gone whose machine does not even answer TCP keepalive probes."""


class RayConfig(Settings):
    """Workers on the nodes of a Ray cluster: which nodes, and how much of each."""

    address: str = "auto"
    """Run the workers on the nodes of the Ray cluster at this address; ``auto`` for the cluster of this
    machine."""

    slots_per_cpu: float = Field(default=4.0, gt=0)
    """Sessions for each CPU that a node has in Ray's resources, where the number of slots is not given."""

    slots_per_node: int | None = Field(default=None, gt=0)
    """Sessions at once on each node, whatever it has."""

    cpus_per_node: float | None = Field(default=None, ge=0)
    """CPUs to reserve on each node; by default all of them, so that Ray places nothing else there."""

    node_resource: str | None = None
    """Use only nodes that have this custom resource, for clusters that do other work too."""

    connect_seconds: float = Field(default=15.0, gt=0)
    """Connecting to the cluster. Ray itself would try forever."""


class ClientLimits(Settings):
    """A client's limits on concurrent calls, and its deadlines.

    Each type of operation has a limit of its own, so that a burst of one does not delay the others (paper §4;
    the limits are those of paper appendix F).
    """

    navigate: int = Field(default=256, gt=0)
    """Concurrent navigations."""

    execute: int = Field(default=256, gt=0)
    """Concurrent actions."""

    screenshot: int = Field(default=256, gt=0)
    """Concurrent observations without an action."""

    metadata: int = Field(default=256, gt=0)
    """Concurrent queries of a page's URL and title."""

    allocate: int = Field(default=4, gt=0)
    """Sessions that are opened at once."""

    release: int = Field(default=4, gt=0)
    """Sessions that are released at once."""

    connect_seconds: float = Field(default=10.0, gt=0)
    """Opening a connection."""

    reply_seconds: float = Field(default=120.0, gt=0)
    """Until a call is answered, without the time that it waits in the server's queues. Longer than the
    server's own deadlines."""

    wait_seconds: float = Field(default=120.0, ge=0)
    """Longest wait for a free slot. The server is told, and refuses with ``no_capacity`` then, or earlier if
    its own limit is shorter."""

    keep_alive_seconds: float = Field(default=30.0, gt=0)
    """How long idle connections are kept: shorter than the server keeps them."""

    direct: bool = True
    """Connect directly to the worker that holds a session, if it can be reached."""

    dead_peer_seconds: float = Field(default=20.0, gt=0)
    """Time after which a server counts as dead that does not even answer TCP keepalive probes."""

    pictures: int = Field(default=2, gt=0)
    """Screenshots kept per session, so that an unchanged one is not sent again."""

    @property
    def calls(self) -> dict[str, int]:
        """The limits on concurrent calls, by type of operation."""
        return {name: getattr(self, name) for name in BROWSER_CALLS}
