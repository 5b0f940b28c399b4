"""The table of operations, from which routing, the OpenAPI document and the client are derived."""

from __future__ import annotations

from typing import Any, Generic, Literal, TypeAlias, TypeVar

import msgspec

from webgym.browser.document import Document, ReadRequest
from webgym.core.observation import Probed
from webgym.core.storage import StorageState
from webgym.server.messages import (
    CLIENT_HEADER,
    GENERATION_HEADER,
    SECRET_HEADER,
    Closed,
    ErrorReply,
    ExecuteRequest,
    Health,
    NavigateRequest,
    PageMetadata,
    Pressure,
    Renewed,
    ServerInfo,
    SessionGrant,
    SessionOptions,
    StepReply,
    StepRequest,
    Watched,
)

Reply = TypeVar("Reply")
QueueName: TypeAlias = Literal["navigate", "execute", "screenshot", "metadata", "allocate", "release"]
QUEUES: tuple[QueueName, ...] = ("navigate", "execute", "screenshot", "metadata", "allocate", "release")

JSON = "application/json"
MSGPACK = "application/msgpack"
PNG = "image/png"
TEXT = "text/plain; version=0.0.4"
LINES = "application/x-ndjson"


class Operation(msgspec.Struct, Generic[Reply], frozen=True):
    """One operation of a server.

    Attributes:
        name: its name, also of the service's method that implements it.
        method, path: HTTP method and path.
        summary: one line for the OpenAPI document.
        reply: type of the reply's body; ``bytes`` for one that is not a struct.
        request: type of the request's body; ``None`` for an empty one.
        queue: the queue in which it waits for a run permit; ``None`` if it needs none. A step waits twice: in
            the queue of its action, then in that of screenshots.
        media: media type of the reply.
        is_open: whether it needs no token.
        is_repeatable: whether it may be carried out twice without harm.
    """

    name: str
    method: Literal["GET", "POST", "DELETE"]
    path: str
    summary: str
    reply: type[Reply]
    request: type[msgspec.Struct] | None = None
    queue: QueueName | None = None
    media: str = JSON
    is_open: bool = False
    is_repeatable: bool = False

    @property
    def has_lease(self) -> bool:
        """Whether the caller must hold the session that the path names."""
        return "{id}" in self.path


# fmt: off
# A table: name, method and path, summary, then request and reply.
ALLOCATE = Operation("allocate", "POST", "/v1/sessions",
    "Lease a browser with a fresh, blank page", request=SessionOptions, reply=SessionGrant, queue="allocate")
STEP = Operation("step", "POST", "/v1/sessions/{id}/step",
    "Carry out an action, wait until the page is quiet, and observe it",
    request=StepRequest, reply=StepReply, queue="execute", media=MSGPACK)
NAVIGATE = Operation("navigate", "POST", "/v1/sessions/{id}/navigate",
    "Open a URL and wait until the page is quiet",
    request=NavigateRequest, reply=PageMetadata, queue="navigate")
EXECUTE = Operation("execute", "POST", "/v1/sessions/{id}/execute",
    "Carry out an action and wait until the page is quiet",
    request=ExecuteRequest, reply=PageMetadata, queue="execute")
SCREENSHOT = Operation("screenshot", "POST", "/v1/sessions/{id}/screenshot",
    "A screenshot without marks and without waiting",
    reply=bytes, queue="screenshot", media=PNG, is_repeatable=True)
METADATA = Operation("metadata", "POST", "/v1/sessions/{id}/metadata",
    "URL, title, status and scroll position", reply=PageMetadata, queue="metadata", is_repeatable=True)
STORAGE = Operation("storage", "POST", "/v1/sessions/{id}/storage",
    "Cookies, local storage and IndexedDB of the session: whoever has them is signed in",
    reply=StorageState, queue="metadata", is_repeatable=True)
READ = Operation("read", "POST", "/v1/sessions/{id}/read",
    "Read the whole document: text, elements, metadata",
    request=ReadRequest, reply=Document, queue="metadata", is_repeatable=True)
PROBE = Operation("probe", "POST", "/v1/sessions/{id}/probe",
    "Ask for a page from outside the session, by the way that its connections take",
    request=NavigateRequest, reply=Probed, is_repeatable=True)
HEARTBEAT = Operation("heartbeat", "POST", "/v1/sessions/{id}/heartbeat",
    "Renew the lease", reply=Renewed, is_repeatable=True)
RELEASE = Operation("release", "DELETE", "/v1/sessions/{id}",
    "End the session and discard its state", reply=Closed, queue="release", is_repeatable=True)
HEALTH = Operation("health", "GET", "/healthz", "Whether sessions can be opened", reply=Health, is_open=True)
INFO = Operation("info", "GET", "/v1/info", "Information about this server", reply=ServerInfo)
PRESSURE = Operation("pressure", "GET", "/pressure", "Load per operation type, and the slots", reply=Pressure)
METRICS = Operation("metrics", "GET", "/metrics",
    "The same and more, for Prometheus", reply=bytes, media=TEXT)
WATCH = Operation("watch", "GET", "/v1/watch",
    "The slots and the living sessions, a line of JSON whenever they change", reply=Watched, media=LINES)
OPENAPI = Operation("openapi", "GET", "/openapi.json", "This document", reply=bytes)

OPERATIONS: tuple[Operation[Any], ...] = (
    ALLOCATE, STEP, NAVIGATE, EXECUTE, SCREENSHOT, METADATA, READ, STORAGE, PROBE, HEARTBEAT, RELEASE, HEALTH,
    INFO, PRESSURE, METRICS, WATCH, OPENAPI,
)
# fmt: on


def openapi(version: str) -> dict[str, Any]:
    """The OpenAPI 3.1 document of all operations."""
    shapes: set[type[msgspec.Struct]] = {ErrorReply}
    for operation in OPERATIONS:
        shapes.update(shape for shape in (operation.request, operation.reply) if shape not in (None, bytes))
    ordered = sorted(shapes, key=lambda shape: shape.__name__)
    _, components = msgspec.json.schema_components(ordered, ref_template="#/components/schemas/{name}")
    paths: dict[str, dict[str, Any]] = {}
    for operation in OPERATIONS:
        paths.setdefault(operation.path, {})[operation.method.lower()] = _describe(operation)
    return {
        "openapi": "3.1.0",
        "info": {"title": "WebGym browser server", "version": version, "license": {"name": "MIT"}},
        "paths": paths,
        "components": {
            "schemas": components,
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
    }


def _ref(shape: type[msgspec.Struct]) -> dict[str, str]:
    return {"$ref": f"#/components/schemas/{shape.__name__}"}


def _describe(operation: Operation[Any]) -> dict[str, Any]:
    body = {} if operation.reply is bytes else _ref(operation.reply)
    description: dict[str, Any] = {
        "operationId": operation.name,
        "summary": operation.summary,
        "responses": {
            "200": {"description": "Done", "content": {operation.media: {"schema": body}}},
            "default": {"description": "A typed error", "content": {JSON: {"schema": _ref(ErrorReply)}}},
        },
        "security": [] if operation.is_open else [{"token": []}],
    }
    if operation.request is not None:
        description["requestBody"] = {
            "required": True,
            "content": {JSON: {"schema": _ref(operation.request)}},
        }
    if operation is ALLOCATE:
        description["parameters"] = [
            {"name": CLIENT_HEADER, "in": "header", "required": False, "schema": {"type": "string"}}
        ]
    if operation.has_lease:
        description["parameters"] = [
            {"name": "id", "in": "path", "required": True, "schema": {"type": "string"}},
            {"name": SECRET_HEADER, "in": "header", "required": True, "schema": {"type": "string"}},
            {"name": GENERATION_HEADER, "in": "header", "required": True, "schema": {"type": "integer"}},
        ]
    return description
