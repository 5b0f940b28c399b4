"""The messages between client and server."""

from __future__ import annotations

import msgspec

from webgym.browser.config import PageOptions
from webgym.browser.gestures import AnyAction
from webgym.core.errors import ProtocolError, ServerUnreachable, WebGymError, error_from_code
from webgym.core.observation import Notice, Observation

SECRET_HEADER = "x-webgym-secret"  # noqa: S105
GENERATION_HEADER = "x-webgym-generation"
CLIENT_HEADER = "x-webgym-client"
INSTANCE_HEADER = "x-webgym-instance"
"""Header of every answer to ``/healthz``: the id of this run of the server, which is unique."""
_OF_PROXIES = frozenset({502, 503, 504})
"""Statuses with which a proxy says that the server behind it does not answer."""


class SessionOptions(PageOptions, frozen=True, omit_defaults=True):
    """Options of a session: its page and its lease.

    Attributes:
        ttl_seconds: how long the lease lasts without a call or heartbeat; ``None`` for the server's default.
        wait_seconds: longest wait for a free slot, if that is less than the server's own limit.
    """

    ttl_seconds: float | None = None
    wait_seconds: float | None = None

    def wait_at_most(self, seconds: float) -> float:
        """Longest wait for a free slot on a server with this limit."""
        return seconds if self.wait_seconds is None else max(0.0, min(seconds, self.wait_seconds))


class SessionGrant(msgspec.Struct, frozen=True):
    """A lease. Every call must contain its id, secret and generation.

    Attributes:
        session_id: id of the session.
        secret: proves that a caller holds the lease.
        generation: number of the lease on its server, by which calls of earlier holders are refused.
        endpoint: base URL of the worker that holds the session, for callers that can reach it; empty if it
            has no address that is valid on other machines. The address that was called can always be used
            too.
        ttl_seconds: granted time to live.
        instance: value of :data:`INSTANCE_HEADER` at the endpoint.
    """

    session_id: str
    secret: str
    generation: int
    endpoint: str
    ttl_seconds: float
    instance: str = ""


class StepRequest(msgspec.Struct, frozen=True, omit_defaults=True):
    """Carry out an action, and observe the page.

    Attributes:
        action: the action; ``None`` to only observe.
        have: names of the screenshots that the caller has, which are not sent again.
    """

    action: AnyAction | None = None
    have: tuple[str, ...] = ()


class StepReply(msgspec.Struct, frozen=True, omit_defaults=True):
    """The observation after a step.

    Attributes:
        observation: the observation.
        image: PNG, or JPEG if the session's options say so; ``None`` if the caller has it.
    """

    observation: Observation
    image: bytes | None = None


class View(msgspec.Struct, frozen=True):
    """An observation together with its screenshot.

    Attributes:
        observation: the state of the page.
        image: PNG (or JPEG); its SHA-256 is ``observation.screenshot``.
    """

    observation: Observation
    image: bytes


class NavigateRequest(msgspec.Struct, frozen=True):
    """Open this URL."""

    url: str


class ExecuteRequest(msgspec.Struct, frozen=True):
    """Carry out this action."""

    action: AnyAction


class PageMetadata(msgspec.Struct, frozen=True, omit_defaults=True):
    """The state of a page. See :class:`~webgym.core.observation.Observation` for the fields.

    Attributes:
        settled: why the wait for a quiet page ended, after the last action.
        notices: notices since the last action began, which the next observation contains too.
    """

    url: str
    title: str
    viewport: tuple[int, int]
    status: int | None = None
    scroll: tuple[float, float] = (0.0, 0.0)
    settled: str = ""
    notices: tuple[Notice, ...] = ()


class Renewed(msgspec.Struct, frozen=True):
    """The reply to a heartbeat.

    Attributes:
        ttl_seconds: remaining time of the lease.
        queued_seconds: how long the session's current or last call has waited in the server's queues.
    """

    ttl_seconds: float
    queued_seconds: float = 0.0


class Closed(msgspec.Struct, frozen=True):
    """The session is over."""

    session_id: str


HEALTHY = "ok"
UNHEALTHY_STATUS = 503


class Health(msgspec.Struct, frozen=True):
    """Whether sessions can be opened: ``ok`` with HTTP 200, or why not with 503."""

    status: str


class QueueLoad(msgspec.Struct, frozen=True):
    """The load of one type of operation.

    Attributes:
        running, waiting: number of calls at this moment.
        done: number of finished calls.
        waited_milliseconds, served_milliseconds: total waiting and service time so far.
    """

    running: int
    waiting: int
    done: int
    waited_milliseconds: int = 0
    served_milliseconds: int = 0


class PermitLoad(msgspec.Struct, frozen=True):
    """The run permits.

    Attributes:
        limit: number of slots that may run at once.
        running: number of slots that run.
        busy: busy share of the processors, 0 to 1, at the last measurement, which happens while calls wait.
    """

    limit: int
    running: int
    busy: float


class SlotLoad(msgspec.Struct, frozen=True):
    """Number of slots by state, and number of callers that wait for one."""

    total: int
    free: int
    leased: int
    preparing: int
    waiting: int


class Pressure(msgspec.Struct, frozen=True):
    """The load of a server at this moment."""

    operations: dict[str, QueueLoad]
    permits: PermitLoad
    slots: SlotLoad


class Watched(msgspec.Struct, frozen=True):
    """A worker's state, reported to its gateway whenever it changes.

    Attributes:
        asked: number of allocate calls received so far, answered or not.
        granted: generation of the newest lease.
        slots: the slots by state.
        sessions: ids of the open leases.
        is_healthy: whether at least one slot works.
    """

    asked: int
    granted: int
    slots: SlotLoad
    sessions: tuple[str, ...]
    is_healthy: bool


class WorkerInfo(msgspec.Struct, frozen=True):
    """One worker behind a gateway."""

    name: str
    url: str
    slots: int


class EgressInfo(msgspec.Struct, frozen=True):
    """What pages may connect to: see :class:`webgym.browser.egress.config.EgressConfig`."""

    allow: tuple[str, ...]
    ports: tuple[int, ...]
    rate: float
    upstream: tuple[str, ...] = ()


class ServerInfo(msgspec.Struct, frozen=True):
    """Information about a server.

    Attributes:
        version: version of WebGym.
        slots: number of slots.
        browser: product and version of Chromium.
        executable: path of Chromium.
        sandboxed: whether Chromium's sandbox is on.
        sandbox_reason: why it is off or incomplete.
        viewport: default viewport, CSS pixels.
        workers: a gateway's workers.
        egress: what pages may connect to; ``None`` from servers of older versions. The rate is of all workers
            together.
        without: what does not hold because the browser is a remote one, a line each.
    """

    version: str
    slots: int
    browser: str
    executable: str
    sandboxed: bool
    sandbox_reason: str
    viewport: tuple[int, int] = (1280, 768)
    workers: tuple[WorkerInfo, ...] = ()
    egress: EgressInfo | None = None
    without: tuple[str, ...] = ()


class ErrorBody(msgspec.Struct, frozen=True):
    """A typed error: the code of its class (core/errors.py), the message, the hint."""

    code: str
    message: str
    hint: str = ""


class ErrorReply(msgspec.Struct, frozen=True):
    """The body of every reply whose status is not 2xx."""

    error: ErrorBody


def error_of(body: bytes, status: int, host: str) -> WebGymError:
    """The error in an HTTP reply, as it was raised on the server."""
    try:
        error = msgspec.json.decode(body, type=ErrorReply).error
    except (msgspec.MsgspecError, ValueError):
        untyped = f"{host} answered {status} with no typed error"
        if status in _OF_PROXIES:
            return ServerUnreachable(untyped, hint="does the server behind this proxy run?")
        return ProtocolError(untyped, hint="is this the address of a WebGym server?")
    return error_from_code(error.code, error.message, error.hint)
