"""A real HTTP server that speaks the chat API, or misbehaves: the first part of the path says how."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from tests.serving import serving

from webgym.llm.config import ChatConfig, Retry

Answer = Callable[[Request], Coroutine[Any, Any, Response]]

HTML = "<!doctype html><html><body><h1>It works!</h1></body></html>"


def fixed(content: Any, status: int = 200, media: str = "application/json") -> Any:
    """A behaviour that always gives this response; content that is neither text nor bytes as JSON."""

    async def answer(_: Endpoint, request: Request) -> Response:
        body = content if isinstance(content, str | bytes) else json.dumps(content)
        return Response(body, status, media_type=media)

    return answer


def config(base_url: str, **changes: Any) -> ChatConfig:
    """Of a client that asks once."""
    settings: dict[str, Any] = {"base_url": base_url, "model": "tiny", "retry": Retry(tries=1)}
    return ChatConfig(**(settings | changes))


class Endpoint:
    """The server's address, and what it was asked."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.text = "Hello."
        self.texts: dict[str, str] = {}
        """In place of ``text`` for requests that contain the key."""
        self.model = "tiny-1"
        self.behaviour = "fine"
        """Of ``changing``."""
        self.requests: list[dict[str, Any]] = []
        self.headers: list[dict[str, str]] = []
        self.peers: set[int] = set()
        self.in_flight = 0
        self.most_in_flight = 0
        self.asked = asyncio.Event()
        self.hung_up = asyncio.Event()
        self.retry_after = "0"
        self.fails_left = 0
        self.allowed = 4
        self.turned_away = 0
        self.lock = asyncio.Lock()
        self.work_seconds = 0.01
        self.was_crowded = asyncio.Event()
        self.answered = 0
        self.times: list[float] = []
        self.replies: list[dict[str, Any]] = []
        self.refused_formats: set[str] = set()
        self.usage: dict[str, Any] = {"prompt_tokens": 12, "completion_tokens": 3, "total_tokens": 15}

    def url(self, behaviour: str = "fine") -> str:
        return f"http://127.0.0.1:{self.port}/{behaviour}/v1"

    async def answer(self, request: Request) -> Response:
        self.requests.append(await request.json())
        self.times.append(time.monotonic())
        self.headers.append(dict(request.headers))
        assert request.client is not None
        self.peers.add(request.client.port)
        self.in_flight += 1
        self.most_in_flight = max(self.most_in_flight, self.in_flight)
        self.asked.set()
        try:
            behaviour: Answer = getattr(self, f"do_{request.path_params['behaviour']}")
            return await behaviour(request)
        finally:
            self.in_flight -= 1

    def completion(self, **choice: Any) -> dict[str, Any]:
        asked = json.dumps(self.requests[-1]) if self.requests else ""
        text = next((text for key, text in self.texts.items() if key in asked), self.text)
        return {
            "id": "chatcmpl-1",
            "object": "chat.completion",
            "created": 1700000000,
            "model": self.model,
            "choices": [
                {
                    "index": 0,
                    "finish_reason": "stop",
                    "message": {"role": "assistant", "content": text},
                    **choice,
                }
            ],
            "usage": self.usage,
        }

    do_404 = fixed({"error": {"message": "no such model"}}, 404)
    do_500 = fixed("Internal Server Error", 500, "text/plain")
    do_400 = fixed({"error": {"message": "context length exceeded\nby a lot"}}, 400)
    do_401 = fixed({"error": {"message": "no key"}}, 401)
    do_html = fixed(HTML, media="text/html")
    do_list = fixed([1, 2, 3])
    do_nested = fixed('{"choices": ' + "[" * 200_000)
    do_empty = fixed({"choices": [], "error": {"message": "model is loading"}})
    do_surrogate = fixed('{"choices": [{"message": {"content": "\\ud800"}}]}')
    do_latin = fixed(b'{"choices": [{"message": {"content": "\xe9"}}]}')
    do_latin_500 = fixed(b'{"error": {"message": "\xe9"}}', 500)

    async def do_fine(self, request: Request) -> Response:
        return JSONResponse(self.completion())

    async def do_changing(self, request: Request) -> Response:
        answer: Answer = getattr(self, f"do_{self.behaviour}")
        return await answer(request)

    async def do_poisoned(self, request: Request) -> Response:
        """500 for one question alone."""
        is_poison = self.requests[-1]["messages"][-1]["content"] == "poison"
        return await (self.do_500(request) if is_poison else self.do_fine(request))

    async def do_slow(self, request: Request) -> Response:
        await asyncio.sleep(0.05)
        return JSONResponse(self.completion())

    async def do_limited(self, request: Request) -> Response:
        """429 for whoever comes while ``allowed`` others are served. Nobody is done before a refusal."""
        if self.in_flight - self.turned_away > self.allowed:
            self.was_crowded.set()
            self.turned_away += 1
            try:
                await asyncio.sleep(0.002)  # a refusal takes a round trip, too
            finally:
                self.turned_away -= 1
            return JSONResponse({"error": {"message": "too many requests"}}, 429)
        await self.was_crowded.wait()
        await asyncio.sleep(self.work_seconds)
        self.answered += 1
        return JSONResponse(self.completion())

    async def do_crowded(self, request: Request) -> Response:
        """One server that takes one after the other, however many queue up."""
        async with self.lock:
            await asyncio.sleep(self.work_seconds)
        return JSONResponse(self.completion())

    async def do_scripted(self, request: Request) -> Response:
        """The next of ``replies``, each a choice: ``{"message": ..., "finish_reason": ...}``."""
        form = self.requests[-1].get("response_format", {}).get("type", "text")
        if form in self.refused_formats:
            return JSONResponse({"error": {"message": f"response_format {form} is not supported"}}, 400)
        return JSONResponse(self.completion(**self.replies.pop(0)))

    async def do_numbered(self, request: Request) -> Response:
        """The last message, after a moment that is another for every request."""
        said = self.requests[-1]["messages"][-1]["content"]
        await asyncio.sleep(0.001 * (len(self.requests) % 7))
        return JSONResponse(self.completion(message={"content": said}))

    async def do_quota(self, request: Request) -> Response:
        error = {"message": "you exceeded your quota", "type": "insufficient_quota"}
        return JSONResponse({"error": error}, 429)

    async def do_silent(self, request: Request) -> Response:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        self.hung_up.set()
        return Response()

    async def do_silent_once(self, request: Request) -> Response:
        return await self.do_fine(request) if self.hung_up.is_set() else await self.do_silent(request)

    async def do_bare(self, request: Request) -> Response:
        return JSONResponse({"choices": [{"message": {"content": self.text}}]})

    async def do_flaky(self, request: Request) -> Response:
        if self.fails_left > 0:
            self.fails_left -= 1
            error = {"error": {"message": "slow down", "type": "rate_limit"}}
            return JSONResponse(error, 429, headers={"Retry-After": self.retry_after})
        return JSONResponse(self.completion())

    async def do_echo(self, request: Request) -> Response:
        message = f"Invalid API key provided: {request.headers['authorization'].removeprefix('Bearer ')}"
        return JSONResponse({"error": {"message": message}}, 401)

    async def do_echo_page(self, request: Request) -> Response:
        return HTMLResponse(f"<p>{request.headers['authorization']}")

    async def do_redirect(self, request: Request) -> Response:
        return Response(status_code=307, headers={"Location": self.url("fine")})

    async def do_plain(self, request: Request) -> Response:
        return Response(json.dumps(self.completion()), 200, media_type="text/plain")

    async def do_nothing(self, request: Request) -> Response:
        return Response(b"", 200)

    async def do_truncated(self, request: Request) -> Response:
        return Response(json.dumps(self.completion())[:-40], 200, media_type="application/json")

    async def do_number(self, request: Request) -> Response:
        return JSONResponse(self.completion(message={"content": 5}))

    async def do_broken_off(self, request: Request) -> Response:
        return JSONResponse(self.completion(finish_reason="error"))

    async def do_stream(self, request: Request) -> Response:
        return StreamingResponse(self._forever(b"data: {}\n\n"), media_type="text/event-stream")

    async def do_flood(self, request: Request) -> Response:
        return StreamingResponse(self._forever(b" " * 65536, pause=0), media_type="application/json")

    async def do_trickle(self, request: Request) -> Response:
        return StreamingResponse(self._forever(b" "), media_type="application/json")

    async def _forever(self, chunk: bytes, pause: float = 0.01) -> AsyncIterator[bytes]:
        while True:
            yield chunk
            await asyncio.sleep(pause)


def serve() -> AbstractAsyncContextManager[Endpoint]:
    return serving(
        Endpoint,
        lambda endpoint: Starlette(
            routes=[Route("/{behaviour}/v1/chat/completions", endpoint.answer, methods=["POST"])]
        ),
    )


@asynccontextmanager
async def serve_raw(answer: bytes, asked: list[bytes] | None = None) -> AsyncIterator[str]:
    """A server that sends these bytes to everybody who connects and hangs up; ``asked`` gets the requests'
    headers."""

    async def handle(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        headers = await reader.readuntil(b"\r\n\r\n")
        if asked is not None:
            asked.append(headers)
        writer.write(answer)
        await writer.drain()
        writer.close()
        await writer.wait_closed()

    server = await asyncio.start_server(handle, "127.0.0.1", 0)
    async with server:
        yield f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/v1"
