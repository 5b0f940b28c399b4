"""Every limit of the server and of its client, with its unit and its reason."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from webgym.browser.config import BrowserConfig
from webgym.core.calls import BROWSER_CALLS
from webgym.settings import Settings


def usable_cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))


Port = Annotated[int, Field(gt=0, le=65535)]


Queues: TypeAlias = Literal["per_operation", "global"]
"""How calls wait for a run permit."""


class Admission(Settings):
    """How many slots run at once, and whose turn it is when more want to.

    Only running slots use the processors: the others are stopped. Acting is partly waiting for the page,
    so a few slots per core keep it busy; more only make each other slower.
    """

    queues: Queues = "per_operation"
    """How calls wait. ``per_operation``: each type of operation has its own queue, and they take turns by
    service time (paper §4). ``global``: one queue for all, first come, first served; the paper's baseline."""

    fewest: int = Field(default_factory=lambda: 2 * usable_cores(), gt=0)
    """Slots that may run at once on saturated processors."""

    most: int = Field(default_factory=lambda: 24 * usable_cores(), gt=0)
    """Slots that may run at once when the processors have time to spare: all wait for slow websites."""

    step: int = Field(default_factory=usable_cores, gt=0)
    """Permits more or fewer after a measurement."""

    measure_seconds: float = Field(default=0.2, gt=0)
    """Between two measurements, while anybody waits. The kernel counts in hundredths of a second."""

    spare_below: float = Field(default=0.9, gt=0, le=1)
    """Busy share of the processors below which more slots may run."""

    saturated_above: float = Field(default=0.96, gt=0, le=1)
    """Busy share above which fewer may."""


class ServerConfig(Settings):
    """A server: where it listens, how much it holds, how long it waits."""

    host: str = "127.0.0.1"
    """Address to listen on. Whoever reaches it and has the token can drive browsers."""

    port: int = Field(default=0, ge=0, le=65535)
    """Port to listen on; 0 takes a free one."""

    ports: tuple[Port, Port] | None = None
    """First and last of those of which a free one is taken instead, where a firewall must know them."""

    token: str | None = Field(default=None, min_length=16, repr=False)
    """Bearer token of every call but ``/healthz``; ``None`` makes a random one."""

    tokens_file: Path | None = None
    """File of other callers: a name and a token on each line. Read again when it changes.

    Workers read it too, so on a cluster it must be on every node.
    """

    audit_file: Path | None = None
    """File to which the gateway appends a JSON line when a session is opened, by whom, and when it ends."""

    name: str = Field(default="", pattern=r"^[a-z0-9]{0,32}$")
    """Of one worker among others: its session ids begin with it, which is how a gateway finds it."""

    slots: int = Field(default_factory=lambda: 4 * usable_cores(), gt=0)
    """Sessions at the same time; with Ray, on each node. A slot takes 75-100 MB, and CPU only while its page
    works."""

    parallel_launches: int = Field(default_factory=usable_cores, gt=0)
    """Browsers that come up at once: a launch costs about a second of CPU."""

    relaunch_seconds: tuple[float, float] = (0.5, 30.0)
    """First and longest pause before a browser that did not come up is tried again."""

    sweep_seconds: float = Field(default=30.0, gt=0)
    """Between two looks for what dead servers left in the temporary folder. One that ends badly after the
    last start of another is not found otherwise. A look costs a lock per living server."""

    allocate_seconds: float = Field(default=60.0, ge=0)
    """Seconds that a caller waits for a free slot before it is refused with ``no_capacity``."""

    waiting: int = Field(default=4096, ge=0)
    """Callers who may wait in that line, each with a connection of its own; more are sent away with
    ``too_many_waiting`` (429)."""

    ttl_seconds: float = Field(default=60.0, gt=0)
    """Seconds after which a session that is not renewed is closed, unless its holder asked otherwise."""

    lease_look_seconds: float = Field(default=1.0, gt=0)
    """Between two looks at the leases. Time in which the server itself stood still, this and more, does not
    count against a lease: no heartbeat could be heard."""

    longest_ttl_seconds: float = Field(default=600.0, gt=0)
    """The most that a holder may ask for."""

    session_seconds: float = Field(default=4 * 3600.0, gt=0)
    """Longest life of a session, however often it is renewed."""

    sessions_per_client: int | None = Field(default=None, gt=0)
    """Most sessions that one client may hold or wait for; by default there is no limit.

    A client is identified by the name of its token, else by the name that it gives, or by its address.
    """

    body_bytes: int = Field(default=1024 * 1024, gt=0)
    """Largest request body."""

    head_bytes: int = Field(default=32 * 1024, gt=0)
    """Largest request line and headers together. Ours take about 400 bytes."""

    receive_seconds: float = Field(default=30.0, gt=0)
    """From a connection, or the first byte of a request, until the request is whole. Whoever lets it trickle
    is cut off."""

    connections: int = Field(default=8192, gt=0)
    """Connections at once; more are closed as they come. A session has one or two."""

    pixels: int = Field(default=3840 * 2160, gt=0)
    """Largest viewport, width times height."""

    keep_alive_seconds: int = Field(default=75, gt=0)
    """Idle connections are kept for longer than a model thinks, and longer than clients keep them."""

    dead_peer_seconds: float = Field(default=20.0, gt=0)
    """A connection whose other end answers nothing, not even the kernel's probes, for so long is closed."""

    beat_seconds: float = Field(default=1.0, gt=0)
    """Whoever watches the server hears from it at least so often."""

    shutdown_seconds: int = Field(default=5, gt=0)
    """Calls in flight get so long to end when the server is told to stop."""

    admission: Admission = Field(default_factory=Admission)
    browser: BrowserConfig = Field(default_factory=BrowserConfig)


class GatewayConfig(Settings):
    """A gateway: how many workers it keeps up, and how it knows that one is gone."""

    workers: int | None = Field(default=None, gt=0)
    """Worker processes that share a machine's slots; by default one for every 4 cores
    (``cores_per_worker``)."""

    cores_per_worker: int = Field(default=4, gt=0)
    """One process of ours keeps about so many cores busy with browsers."""

    worker_host: str = "127.0.0.1"
    """Address on which workers listen. Clients that can reach it connect directly instead of through the
    gateway."""

    worker_ports: tuple[Port, Port] | None = None
    """First and last port on which workers listen, for firewalls; by default any free port.

    There must be as many as a machine has workers, and some more.
    """

    start_seconds: float = Field(default=90.0, gt=0)
    """From starting a worker until its first browser is up."""

    stop_seconds: float = Field(default=15.0, gt=0)
    """From telling a worker to end until it is killed. It ends calls and browsers in that time."""

    restart_seconds: tuple[float, float] = (0.5, 30.0)
    """First and longest pause before a worker that ended or did not come up is started again."""

    settled_seconds: float = Field(default=60.0, gt=0)
    """A worker that lived for so long is started again after the first pause."""

    silent_seconds: float = Field(default=15.0, gt=0)
    """A worker that is not heard of for so long is gone, and ended. Several beats of the worker's."""

    connect_seconds: float = Field(default=3.0, gt=0)
    """Until a connection to a worker is up."""

    answer_seconds: float = Field(default=5.0, gt=0)
    """Until a worker has said how it is. Calls of sessions have no deadline but the worker's own."""

    idle_seconds: float = Field(default=30.0, gt=0)
    """Idle connections to workers are dropped before the worker drops them."""

    dead_peer_seconds: float = Field(default=15.0, gt=0)
    """A worker whose machine answers nothing, not even the kernel's probes, for so long is gone."""


class RayConfig(Settings):
    """Workers on the nodes of a Ray cluster: which nodes, and how much of each."""

    address: str = "auto"
    """Run the workers on the nodes of the Ray cluster at this address; ``auto`` for the cluster of this
    machine."""

    namespace: str = "webgym"
    """Ray's namespace for our actors."""

    slots_per_cpu: float = Field(default=4.0, gt=0)
    """Sessions for each CPU that a node has in Ray's resources, where the number of slots is not given."""

    slots_per_node: int | None = Field(default=None, gt=0)
    """Sessions at once on each node, whatever it has."""

    cpus_per_node: float | None = Field(default=None, ge=0)
    """CPUs to reserve on each node; by default all of them, so that Ray places nothing else there."""

    node_resource: str | None = None
    """Use only nodes that have this custom resource, for clusters that do other work too."""

    connect_seconds: float = Field(default=15.0, gt=0)
    """Until the cluster has taken us in. Ray itself would try for ever."""

    place_seconds: float = Field(default=30.0, gt=0)
    """Until our actor is up on a node. One that is not finds the node's CPUs taken: we say so, and go on
    trying."""

    discover_seconds: float = Field(default=2.0, gt=0)
    """Between two looks at which nodes there are: Ray tells nobody by itself."""


class ClientLimits(Settings):
    """How much a client asks for at once, and how long it waits.

    Each type of operation has a pool of its own, so that a burst of one never holds up another (paper
    §4; the sizes of the pools are those of paper appendix F).
    """

    navigate: int = Field(default=256, gt=0)
    execute: int = Field(default=256, gt=0)
    screenshot: int = Field(default=256, gt=0)
    metadata: int = Field(default=256, gt=0)
    allocate: int = Field(default=4, gt=0)
    release: int = Field(default=4, gt=0)

    connect_seconds: float = Field(default=10.0, gt=0)
    """Until a connection is up."""

    reply_seconds: float = Field(default=120.0, gt=0)
    """Until a call is answered, without the time for which a session's call waits in the server's queues.
    Longer than the server's own deadlines, and than its line for a free slot."""

    release_seconds: float = Field(default=10.0, gt=0)
    """Until a session is given back. The lease runs out by itself, so nobody waits for long."""

    keep_alive_seconds: float = Field(default=30.0, gt=0)
    """Idle connections are dropped before the server drops them."""

    direct: bool = True
    """Go straight to the worker that holds a session, where it can be reached."""

    direct_seconds: float = Field(default=2.0, gt=0)
    """A worker that does not answer in this time is reached through the address that is known."""

    dead_peer_seconds: float = Field(default=20.0, gt=0)
    """A server that answers nothing, not even the kernel's probes, for so long is taken for dead."""

    heartbeat_share: float = Field(default=0.3, gt=0, lt=1)
    """A session that made no call for this share of its lease's time to live is renewed."""

    pictures: int = Field(default=2, gt=0)
    """Pictures kept per session, so that one that did not change is not sent again."""

    @property
    def calls(self) -> dict[str, int]:
        """The sizes of the pools, by type of operation."""
        return {name: getattr(self, name) for name in BROWSER_CALLS}
