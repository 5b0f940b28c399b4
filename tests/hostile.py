"""Hostile pages, which try to crash or block their browser, its server or the machine.

For the soak and for the fault tests. Each page attacks when it is loaded, or when its only
button, which covers the page, is clicked.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from starlette.requests import Request
from starlette.responses import HTMLResponse, Response, StreamingResponse
from starlette.types import Receive, Scope, Send
from tests.serving import serving

_BUTTON = "<button style='position:fixed;inset:0;width:100%;height:100%'>Go</button>"
_CLICKED = _BUTTON + "<script>document.querySelector('button').onclick = () => {{ {} }}</script>"


def _at_load(script: str) -> str:
    return f"<p>before</p><script>{script}</script>"


def _when_clicked(script: str) -> str:
    return _CLICKED.format(script)


_JS_HEAP = "const all = []; for (;;) all.push(new Array(1 << 16).fill(Math.random()));"
_BUFFERS = (
    "const all = []; for (;;) { all.push(new ArrayBuffer(1 << 26)); new Uint8Array(all.at(-1)).fill(1); }"
)
_SOME = "globalThis.kept = new Uint8Array(200 << 20).fill(1);"
_SLOW_BUFFERS = (
    "const all = []; setInterval(() => {"
    " all.push(new ArrayBuffer(1 << 24)); new Uint8Array(all.at(-1)).fill(1); }, 20);"
)
_DEEP = (
    "let at = document.body;"
    " for (let i = 0; i < 200000; i++) at = at.appendChild(document.createElement('div')); at.append('deep');"
)
_MILLION = (
    "const all = document.createDocumentFragment();"
    " for (let i = 0; i < 1000000; i++) all.append(document.createElement('b')); document.body.append(all);"
)
_GIGABYTE = (
    "for (;;) { const one = document.createElement('p'); one.append('x'.repeat(1 << 20) + Math.random());"
    " document.body.append(one); }"
)
_NOISE = (
    "const canvas = document.createElement('canvas'); canvas.style = 'position:fixed;left:0;top:0';"
    " canvas.width = innerWidth; canvas.height = innerHeight; document.body.append(canvas);"
    " const paint = canvas.getContext('2d'), image = paint.createImageData(innerWidth, innerHeight);"
    " for (let i = 0; i < image.data.length; i++) image.data[i] = i % 4 == 3 ? 255 : Math.random() * 256;"
    " paint.putImageData(image, 0, 0);"
)
_OBSERVER = (
    "new MutationObserver(() => document.body.setAttribute('data-n', Math.random()))"
    ".observe(document.body, { attributes: true }); document.body.setAttribute('data-n', 0);"
)
_WORKER = "new Worker(URL.createObjectURL(new Blob(['for(;;);'])));"

PAGES: dict[str, str] = {
    # endless scripts
    "/loop/load": _at_load("for (;;);"),
    "/loop/click": _when_clicked("for (;;);"),
    "/loop/frame": "<p>before</p><iframe srcdoc='<script>for (;;);</script>'></iframe>",
    "/loop/worker": _at_load(_WORKER + _WORKER),
    "/loop/beforeunload": _at_load("onbeforeunload = () => { for (;;); }"),
    "/loop/unload": _at_load("onpagehide = onunload = () => { for (;;); }"),
    "/loop/microtask": _at_load("const again = () => Promise.resolve().then(again); again();"),
    "/loop/observer": _at_load(_OBSERVER),
    "/loop/observer/click": _when_clicked(_OBSERVER),
    "/loop/observer/timer": _at_load(f"setTimeout(() => {{ {_OBSERVER} }}, 300);"),
    "/loop/interval": _at_load("setInterval(() => { for (;;); }, 200);"),
    "/loop/reload": _at_load("location.reload();"),
    "/loop/history": _at_load("for (let i = 0; ; i++) history.pushState(i, '', '?' + i);"),
    # endless dialogs
    "/dialogs/alert": _at_load("for (;;) alert('again');"),
    "/dialogs/confirm": _at_load("while (confirm('sure?') || true);"),
    "/dialogs/prompt": _at_load("for (;;) prompt('name?', 'x');"),
    "/dialogs/timer": _at_load("setInterval(() => alert('tick'), 1);"),
    "/dialogs/beforeunload": _when_clicked("onbeforeunload = (event) => { event.preventDefault(); };"),
    "/dialogs/huge": _at_load("alert('x'.repeat(1 << 28));"),
    # memory
    "/memory/heap": _at_load(_JS_HEAP),
    "/memory/buffers": _at_load(_BUFFERS),
    "/memory/some": _at_load(_SOME),
    "/memory/click": _when_clicked(_SLOW_BUFFERS),
    "/memory/worker": _at_load(f"new Worker(URL.createObjectURL(new Blob([{_BUFFERS!r}])));"),
    "/memory/title": _at_load("document.title = 'x'.repeat(1 << 28);"),
    # pictures that do not compress
    "/noise": _at_load(_NOISE),
    # huge documents
    "/dom/gigabyte": _at_load(_GIGABYTE),
    "/dom/deep": _at_load(_DEEP),
    "/dom/million": _at_load(_MILLION),
    "/dom/links": _at_load("document.body.innerHTML = '<a href=#>a</a> '.repeat(20000);"),
    "/dom/frames": _at_load("setInterval(() => document.body.append(document.createElement('iframe')), 1);"),
    # endless windows and downloads
    "/windows": _at_load("setInterval(() => open('/?' + Math.random()), 5);"),
    "/downloads": _at_load("setInterval(() => { location = '/file'; }, 5);"),
}
"""The bodies of the hostile pages by path."""

_STREAM_PART = b"<p>" + b"x" * (1 << 16)


async def _endless() -> AsyncIterator[bytes]:
    yield b"<!doctype html><title>endless</title>"
    while True:
        yield _STREAM_PART
        await asyncio.sleep(0)  # let other tasks run, even if the reader is always ready


async def hostile_site(scope: Scope, receive: Receive, send: Send) -> None:
    """An ASGI application that serves :data:`PAGES`, and a document that never ends at ``/dom/endless``."""
    path = Request(scope).url.path
    response: Response
    if path == "/dom/endless":
        response = StreamingResponse(_endless(), media_type="text/html")
    elif path == "/file":
        response = Response(b"x" * 1024, headers={"content-disposition": "attachment; filename=x.bin"})
    elif path in PAGES:
        response = HTMLResponse(f"<!doctype html><meta charset=utf-8><title>{path}</title>{PAGES[path]}")
    else:
        response = HTMLResponse("<!doctype html><title>calm</title><p>calm</p>")
    await response(scope, receive, send)


@asynccontextmanager
async def serving_hostile_pages() -> AsyncIterator[str]:
    """Serve the hostile pages on the loopback address until the block ends.

    Yields:
        Their base URL.
    """
    async with serving(lambda port: f"http://127.0.0.1:{port}", lambda _: hostile_site) as url:
        yield url
