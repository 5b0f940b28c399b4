"""The one table of operations. Routing, the OpenAPI document and the client all follow it."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import msgspec

from webgym.browser.document import Document, ReadRequest
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

QueueName: TypeAlias = Literal["navigate", "execute", "screenshot", "metadata", "allocate", "release"]
QUEUES: tuple[QueueName, ...] = ("navigate", "execute", "screenshot", "metadata", "allocate", "release")

JSON = "application/json"
MSGPACK = "application/msgpack"
PNG = "image/png"
TEXT = "text/plain; version=0.0.4"
LINES = "application/x-ndjson"


class Operation(msgspec.Struct, frozen=True):
    """One thing that a server does.

    Attributes:
        name: also the method of the service that does it.
        request, reply: shapes of the bodies; ``None`` for an empty body or one that is no struct.
        queue: whose turn it waits for; ``None`` for what costs nothing. A step waits for two: that of
            its action, then that of the screenshot.
        media: of the reply.
        is_open: needs no token.
        has_lease: names a session and proves to hold it.
        is_repeatable: does no harm if it is carried out twice.
    """

    name: str
    method: Literal["GET", "POST", "DELETE"]
    path: str
    summary: str
    request: type[msgspec.Struct] | None = None
    reply: type[msgspec.Struct] | None = None
    queue: QueueName | None = None
    media: str = JSON
    is_open: bool = False
    is_repeatable: bool = False

    @property
    def has_lease(self) -> bool:
        """Whether the caller must hold the session that the path names."""
        return "{id}" in self.path


# fmt: off
# A table: how to ask, then what goes in and what comes out.
ALLOCATE = Operation("allocate", "POST", "/v1/sessions",
    "Lease a browser with a fresh, blank page", request=SessionOptions, reply=SessionGrant, queue="allocate")
STEP = Operation("step", "POST", "/v1/sessions/{id}/step",
    "Act, wait until the page is quiet, and look, in one round trip",
    request=StepRequest, reply=StepReply, queue="execute", media=MSGPACK)
NAVIGATE = Operation("navigate", "POST", "/v1/sessions/{id}/navigate",
    "Open a URL and wait until the page is quiet",
    request=NavigateRequest, reply=PageMetadata, queue="navigate")
EXECUTE = Operation("execute", "POST", "/v1/sessions/{id}/execute",
    "Carry an action out and wait until the page is quiet",
    request=ExecuteRequest, reply=PageMetadata, queue="execute")
SCREENSHOT = Operation("screenshot", "POST", "/v1/sessions/{id}/screenshot",
    "The bare viewport as it is now", queue="screenshot", media=PNG, is_repeatable=True)
METADATA = Operation("metadata", "POST", "/v1/sessions/{id}/metadata",
    "Address, title, status and scroll position", reply=PageMetadata, queue="metadata", is_repeatable=True)
READ = Operation("read", "POST", "/v1/sessions/{id}/read",
    "What the whole document holds: text, elements, metadata",
    request=ReadRequest, reply=Document, queue="metadata", is_repeatable=True)
HEARTBEAT = Operation("heartbeat", "POST", "/v1/sessions/{id}/heartbeat",
    "Renew the lease", reply=Renewed, is_repeatable=True)
RELEASE = Operation("release", "DELETE", "/v1/sessions/{id}",
    "End the session; everything in it is thrown away", reply=Closed, queue="release", is_repeatable=True)
HEALTH = Operation("health", "GET", "/healthz", "Whether sessions can be had", reply=Health, is_open=True)
INFO = Operation("info", "GET", "/v1/info", "What this server is", reply=ServerInfo)
PRESSURE = Operation("pressure", "GET", "/pressure", "Load per operation type, and the slots", reply=Pressure)
METRICS = Operation("metrics", "GET", "/metrics", "The same and more, for Prometheus", media=TEXT)
WATCH = Operation("watch", "GET", "/v1/watch",
    "The slots and the living sessions, a line of JSON whenever they change", reply=Watched, media=LINES)
OPENAPI = Operation("openapi", "GET", "/openapi.json", "This document")

OPERATIONS: tuple[Operation, ...] = (
    ALLOCATE, STEP, NAVIGATE, EXECUTE, SCREENSHOT, METADATA, READ, HEARTBEAT, RELEASE, HEALTH, INFO,
    PRESSURE, METRICS, WATCH, OPENAPI,
)
# fmt: on


def openapi(version: str) -> dict[str, Any]:
    """The OpenAPI 3.1 document of all operations."""
    shapes: set[type[msgspec.Struct]] = {ErrorReply}
    for operation in OPERATIONS:
        shapes.update(shape for shape in (operation.request, operation.reply) if shape is not None)
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


def _describe(operation: Operation) -> dict[str, Any]:
    body = _ref(operation.reply) if operation.reply else {}
    described: dict[str, Any] = {
        "operationId": operation.name,
        "summary": operation.summary,
        "responses": {
            "200": {"description": "Done", "content": {operation.media: {"schema": body}}},
            "default": {"description": "A typed error", "content": {JSON: {"schema": _ref(ErrorReply)}}},
        },
        "security": [] if operation.is_open else [{"token": []}],
    }
    if operation.request is not None:
        described["requestBody"] = {"required": True, "content": {JSON: {"schema": _ref(operation.request)}}}
    if operation is ALLOCATE:
        described["parameters"] = [
            {"name": CLIENT_HEADER, "in": "header", "required": False, "schema": {"type": "string"}}
        ]
    if operation.has_lease:
        described["parameters"] = [
            {"name": "id", "in": "path", "required": True, "schema": {"type": "string"}},
            {"name": SECRET_HEADER, "in": "header", "required": True, "schema": {"type": "string"}},
            {"name": GENERATION_HEADER, "in": "header", "required": True, "schema": {"type": "integer"}},
        ]
    return described
