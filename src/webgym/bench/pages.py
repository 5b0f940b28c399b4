"""The pages of the benchmarks, and a minimal server for them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

_HOST = "bench.webgym.test"
_STYLE = "body{font:16px/1.5 sans-serif;margin:2rem auto;width:60rem}p{margin:.6rem 0}"
_TEXT = "".join(
    f"<p>Paragraph {number}: the ferry leaves at eight, and whoever is late takes the bridge. "
    f"<a href='#{number}'>More about it</a> <button type=button>Keep {number}</button></p>"
    for number in range(150)
)
_BUSY = """
<style>
@keyframes turn { to { transform: rotate(360deg) } }
.turning { width: 80px; height: 80px; background: crimson; animation: turn 1s linear infinite }
</style>
<div class=turning></div><canvas width=600 height=300></canvas><p id=clock></p>
<script>
const pen = document.querySelector('canvas').getContext('2d');
let frames = 0;
(function draw() {
  frames++;
  pen.fillStyle = `hsl(${frames % 360} 80% 50%)`;
  pen.fillRect((frames * 7) % 600, (frames * 5) % 300, 60, 60);
  requestAnimationFrame(draw);
})();
setInterval(() => {
  let sum = 0;
  for (let i = 0; i < 200000; i++) sum += i;
  document.getElementById('clock').textContent = `${new Date().toISOString()} ${sum}`;
}, 50);
</script>
"""

PAGES = {"static": _TEXT, "busy": _BUSY + _TEXT}
"""HTML by name: a long page of text and links, and the same with an animation, a canvas and a timer."""


def document(name: str) -> bytes:
    """The HTML document of one of :data:`PAGES`."""
    head = f"<!doctype html><meta charset=utf-8><title>{name}</title><style>{_STYLE}</style>"
    return (head + PAGES[name]).encode()


class PageServer:
    """The address of the pages.

    Args:
        port: of their server, on the loopback address.
    """

    def __init__(self, port: int) -> None:
        self.origin = f"http://{_HOST}"
        self.rule = f"{_HOST}=127.0.0.1:{port}"
        """The rule of the egress policy that lets browsers reach them."""

    def url(self, name: str) -> str:
        """The URL of one of :data:`PAGES`."""
        return f"{self.origin}/{name}"


async def _answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    try:
        while head := await reader.readuntil(b"\r\n\r\n"):
            name = head.split(b" ", 2)[1].decode("ascii", "replace").strip("/").partition("?")[0]
            body, status = (document(name), "200 OK") if name in PAGES else (b"", "404 Not Found")
            head_out = f"HTTP/1.1 {status}\r\ncontent-type: text/html\r\ncontent-length: {len(body)}\r\n\r\n"
            writer.write(head_out.encode() + body)
            await writer.drain()
    except (asyncio.IncompleteReadError, asyncio.LimitOverrunError, ConnectionError):
        return  # the client disconnected, or does not speak HTTP
    finally:
        writer.close()


@asynccontextmanager
async def serving_pages() -> AsyncIterator[PageServer]:
    """Serve the pages on the loopback address until the block ends."""
    server = await asyncio.start_server(_answer, "127.0.0.1", 0)
    try:
        yield PageServer(server.sockets[0].getsockname()[1])
    finally:
        server.close()
