"""The messages between client and server."""

from __future__ import annotations

import msgspec

from webgym.browser.config import PageOptions
from webgym.browser.gestures import AnyAction
from webgym.core.errors import ProtocolError, WebGymError, error_from_code
from webgym.core.observation import Notice, Observation

SECRET_HEADER = "x-webgym-secret"  # noqa: S105
GENERATION_HEADER = "x-webgym-generation"
CLIENT_HEADER = "x-webgym-client"
INSTANCE_HEADER = "x-webgym-instance"
"""With every answer to ``/healthz``: which run of a server it is. No two runs share one."""


class SessionOptions(PageOptions, frozen=True, omit_defaults=True):
    """Options of a session: its page and its lease.

    Attributes:
        ttl_seconds: how long the lease lasts without a call or heartbeat; ``None`` takes the server's.
    """

    ttl_seconds: float | None = None


class SessionGrant(msgspec.Struct, frozen=True):
    """A lease. All three of id, secret and generation come back with every call.

    Attributes:
        generation: counts the leases of the server; a call of an earlier holder is refused by it.
        endpoint: base URL of the server that holds the session, for callers who can reach it; empty if
            it has none that would mean the same elsewhere. The address that was asked always serves too.
        ttl_seconds: as granted.
        instance: what ``/healthz`` at the endpoint says about itself (:data:`INSTANCE_HEADER`).
    """

    session_id: str
    secret: str
    generation: int
    endpoint: str
    ttl_seconds: float
    instance: str = ""


class StepRequest(msgspec.Struct, frozen=True, omit_defaults=True):
    """Act, then look.

    Attributes:
        action: ``None`` only looks.
        have: names of the pictures that the caller has: such a one is not sent again.
    """

    action: AnyAction | None = None
    have: tuple[str, ...] = ()


class StepReply(msgspec.Struct, frozen=True, omit_defaults=True):
    """What the page shows.

    Attributes:
        image: PNG, or JPEG if the session wants that; ``None`` if the caller has it.
    """

    observation: Observation
    image: bytes | None = None


class View(msgspec.Struct, frozen=True):
    """An observation together with its screenshot.

    Attributes:
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
    """Where the page is. See :class:`~webgym.core.observation.Observation` for the fields.

    Attributes:
        settled: why the wait for a quiet page ended, after the last action.
        notices: what happened since the last action began; the next observation says it too.
    """

    url: str
    title: str
    viewport: tuple[int, int]
    status: int | None = None
    scroll: tuple[float, float] = (0.0, 0.0)
    settled: str = ""
    notices: tuple[Notice, ...] = ()


class Renewed(msgspec.Struct, frozen=True):
    """A lease's new remaining time.

    Attributes:
        queued_seconds: how long the session's call, or its last one, has waited for its turns so far.
    """

    ttl_seconds: float
    queued_seconds: float = 0.0


class Closed(msgspec.Struct, frozen=True):
    """The session is over."""

    session_id: str


HEALTHY = "ok"
UNHEALTHY_STATUS = 503


class Health(msgspec.Struct, frozen=True):
    """Whether sessions can be had: ``ok`` with HTTP 200, or why not with 503."""

    status: str


class QueueLoad(msgspec.Struct, frozen=True):
    """One operation type's calls: how many run and wait now, and have run; how long those that came so far
    have waited for a turn and been served, all in all, milliseconds."""

    running: int
    waiting: int
    done: int
    waited_milliseconds: int = 0
    served_milliseconds: int = 0


class PermitLoad(msgspec.Struct, frozen=True):
    """Slots that may run at once, those that do, and the busy share of the processors (0 to 1, as last
    measured, which happens while calls wait)."""

    limit: int
    running: int
    busy: float


class SlotLoad(msgspec.Struct, frozen=True):
    """The slots, by what they are doing, and how many callers wait for one."""

    total: int
    free: int
    leased: int
    preparing: int
    waiting: int


class Pressure(msgspec.Struct, frozen=True):
    """Load at this moment."""

    operations: dict[str, QueueLoad]
    permits: PermitLoad
    slots: SlotLoad


class Watched(msgspec.Struct, frozen=True):
    """A worker's state, reported to its gateway whenever it changes.

    Attributes:
        asked: calls for a session that have arrived so far, answered or not.
        granted: generation of the newest lease.
        sessions: ids of the living leases.
        is_healthy: whether any browser comes up.
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


class ServerInfo(msgspec.Struct, frozen=True):
    """Facts about a server.

    Attributes:
        browser: product and version, as Chromium tells it.
        sandboxed: whether Chromium's sandbox is on.
        sandbox_reason: why not.
        workers: of a gateway.
    """

    version: str
    slots: int
    browser: str
    executable: str
    sandboxed: bool
    sandbox_reason: str
    viewport: tuple[int, int] = (1280, 768)
    workers: tuple[WorkerInfo, ...] = ()


class ErrorBody(msgspec.Struct, frozen=True):
    """A typed error: its class (core/errors.py), what happened, what to do."""

    code: str
    message: str
    hint: str = ""


class ErrorReply(msgspec.Struct, frozen=True):
    """Every reply that is not a 2xx."""

    error: ErrorBody


def error_of(body: bytes, status: int, host: str) -> WebGymError:
    """The error that a reply is, as it was raised on the other side."""
    try:
        error = msgspec.json.decode(body, type=ErrorReply).error
    except (msgspec.MsgspecError, ValueError):
        return ProtocolError(
            f"{host} answered {status} with no typed error",
            hint="is this the address of a WebGym server?",
        )
    return error_from_code(error.code, error.message, error.hint)
