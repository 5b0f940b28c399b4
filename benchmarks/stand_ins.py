"""Stand-ins for a browser server and a model endpoint behind real HTTP, without browsers and model.

They cost little and have given response times, so that a collector can be measured and tested alone. The
pages of a session are numbered, and the bytes of a screenshot contain the number: the model reads it, and
answers on a given page.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any, Final

import msgspec
from aiohttp import web

from webgym.core.errors import LeaseLost, NoCapacity, WebGymError
from webgym.core.observation import Observation
from webgym.server.messages import (
    SECRET_HEADER,
    Closed,
    ErrorBody,
    ErrorReply,
    Health,
    Renewed,
    ServerInfo,
    SessionGrant,
    StepReply,
)
from webgym.server.operations import JSON, MSGPACK

TOKEN: Final = "a-token-of-stand-ins"
_PNG = b"\x89PNG\r\n\x1a\n"
_TTL_SECONDS = 60.0
_CALL = 'Action: go on\n<tool_call>\n{"name": "computer_use", "arguments": %s}\n</tool_call>'
_WAITS = _CALL % '{"action": "wait", "time": 1}'
_ANSWERS = _CALL % '{"action": "answer", "text": "it is"}'


class StandInBrowsers:
    """A browser server whose sessions show numbered pages, one after the other.

    Args:
        step_seconds: returns the time of the next step.
        queued_seconds: queueing time that is reported for each step, in addition to that.
        open_seconds: time to open a session, and to release it.

    Attributes:
        sessions: number of pages shown so far, by session.
        log: opened and closed sessions in order: ``("open" or "close", session)``.
        most: maximum number of parallel sessions so far.
        most_of: maximum number of parallel calls so far, by operation.
        opened: number of sessions opened so far.
        steps: number of steps so far.
        slots: number of sessions at once; more are refused.
        refuses: makes the answer to every request for a session; ``None`` opens one.
    """

    def __init__(
        self,
        step_seconds: Callable[[], float] = lambda: 0.0,
        queued_seconds: float = 0.0,
        open_seconds: float = 0.0,
    ) -> None:
        self.sessions: dict[str, int] = {}
        self.log: list[tuple[str, str]] = []
        self.most = self.opened = self.steps = 0
        self.slots = 10_000
        self.refuses: Callable[[], web.HTTPException] | None = None
        self.most_of: Counter[str] = Counter()
        self._running: Counter[str] = Counter()
        self._open_seconds = open_seconds
        self._step_seconds = step_seconds
        self._queued_seconds = queued_seconds

    def app(self) -> web.Application:
        """The application to serve."""
        app = web.Application()
        app.add_routes(
            [
                web.get("/healthz", _healthy),
                web.get("/v1/info", self._info),
                web.post("/v1/sessions", self._open),
                web.post("/v1/sessions/{id}/step", self._step),
                web.post("/v1/sessions/{id}/heartbeat", self._renew),
                web.delete("/v1/sessions/{id}", self._close),
            ]
        )
        return app

    async def _info(self, _: web.Request) -> web.Response:
        return _json(ServerInfo("0", self.slots, "none", "none", sandboxed=True, sandbox_reason=""))

    @asynccontextmanager
    async def _during(self, operation: str, seconds: float = 0.0) -> AsyncIterator[None]:
        """Count a call during the block, and for ``seconds`` after it."""
        self._running[operation] += 1
        self.most_of[operation] = max(self.most_of[operation], self._running[operation])
        try:
            yield
            if seconds:
                await asyncio.sleep(seconds)
        finally:
            self._running[operation] -= 1

    async def _open(self, _: web.Request) -> web.Response:
        if self.refuses is not None:
            raise self.refuses()
        if len(self.sessions) >= self.slots:
            raise refusal(NoCapacity("all slots are in use"))
        async with self._during("allocate", self._open_seconds):
            self.opened += 1
            name = f"s{self.opened}"
            self.sessions[name] = 0
            self.log.append(("open", name))
            self.most = max(self.most, len(self.sessions))
        return _json(SessionGrant(name, f"secret-{name}", 1, "", _TTL_SECONDS))

    def _named(self, request: web.Request) -> str:
        name = request.match_info["id"]
        if request.headers.get(SECRET_HEADER) != f"secret-{name}" or name not in self.sessions:
            raise refusal(LeaseLost("the session ended", hint="open a new one"))
        return name

    async def _step(self, request: web.Request) -> web.Response:
        name = self._named(request)
        async with self._during("execute" if self.sessions[name] else "navigate"):
            await asyncio.sleep(seconds := self._step_seconds())
            self._named(request)
        self.sessions[name] += 1
        self.steps += 1
        image = _PNG + b"page %d" % self.sessions[name]
        seen = Observation(
            hashlib.sha256(image).hexdigest(),
            f"http://stand-in.test/{self.sessions[name]}",
            "A page",
            (1280, 768),
            status=200,
            milliseconds={"execute": seconds * 1000, "queued": self._queued_seconds * 1000},
        )
        reply = msgspec.msgpack.encode(StepReply(seen, image))
        return web.Response(body=reply, content_type=MSGPACK)

    async def _renew(self, request: web.Request) -> web.Response:
        self._named(request)
        return _json(Renewed(_TTL_SECONDS, self._queued_seconds))

    async def _close(self, request: web.Request) -> web.Response:
        async with self._during("release", self._open_seconds):
            del self.sessions[name := self._named(request)]
        self.log.append(("close", name))
        return _json(Closed(name))


class StandInModel:
    """A model that waits on every page up to the one on which it answers.

    Args:
        steps: number of the page on which it answers.
        reply_seconds: returns the time of the next reply.

    Attributes:
        replies: number of replies so far.
        most: maximum number of parallel requests so far.
        name: of the model that replies name; ``None`` if they name none.
    """

    def __init__(self, steps: int = 3, reply_seconds: Callable[[], float] = lambda: 0.0) -> None:
        self.replies = self.most = self.running = 0
        self.name: str | None = None
        self._steps = steps
        self._reply_seconds = reply_seconds

    def app(self) -> web.Application:
        """The application to serve."""
        app = web.Application(client_max_size=2**24)
        app.add_routes([web.post("/v1/chat/completions", self._reply)])
        return app

    async def _reply(self, request: web.Request) -> web.Response:
        asked = await request.json()
        self.running += 1
        self.most = max(self.most, self.running)
        try:
            await asyncio.sleep(self._reply_seconds())
        finally:
            self.running -= 1
        self.replies += 1
        text = _ANSWERS if _page(asked["messages"]) >= self._steps else _WAITS
        message = {"role": "assistant", "content": text}
        choice = {"index": 0, "finish_reason": "stop", "message": message}
        usage = {"prompt_tokens": 1000, "completion_tokens": 50, "total_tokens": 1050}
        body = {"object": "chat.completion", "model": self.name, "choices": [choice], "usage": usage}
        return web.json_response(body)


def _page(messages: list[dict[str, Any]]) -> int:
    """The page number of the last screenshot of a request; 0 if it has none."""
    for message in reversed(messages):
        for part in reversed(message["content"] if isinstance(message["content"], list) else []):
            if part.get("type") == "image_url":
                data = base64.b64decode(part["image_url"]["url"].partition(",")[2])
                return int(data.removeprefix(_PNG).removeprefix(b"page ") or 0)
    return 0


async def _healthy(_: web.Request) -> web.Response:
    return _json(Health("ok"))


def _json(body: msgspec.Struct) -> web.Response:
    return web.Response(body=msgspec.json.encode(body), content_type=JSON)


def refusal(error: WebGymError) -> web.HTTPException:
    """The answer that raises this error at the client."""
    body = msgspec.json.encode(ErrorReply(ErrorBody(error.code, error.message, error.hint)))
    return web.HTTPGone(text=body.decode(), content_type=JSON)


@asynccontextmanager
async def serving_app(app: web.Application, port: int = 0) -> AsyncIterator[int]:
    """Serve an application on the loopback address until the block ends, which cuts off calls in flight.

    Args:
        app: the application.
        port: 0 for a free one.

    Yields:
        The port.
    """
    runner = web.AppRunner(app, shutdown_timeout=0.1, access_log=None, handler_cancellation=True)
    await runner.setup()
    try:
        site = web.TCPSite(runner, "127.0.0.1", port, reuse_address=True, backlog=2048)
        await site.start()
        yield int(runner.addresses[0][1])
    finally:
        await runner.cleanup()
