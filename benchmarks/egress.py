"""CPU time of the proxy per megabyte and per connection, without browsers.

    python benchmarks/egress.py

A child process acts as both browsers and servers, on the loopback address. Only the CPU time of the process
of the proxy is measured, so other load on the machine has little effect.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import socket
import threading
import time
from multiprocessing.connection import Connection

import uvloop

from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress

HERE = "127.0.0.1"
MIB = 1024 * 1024
DOWNLOADS = 8
EACH = 128 * MIB
CONNECTIONS = 3000
REQUEST = b"GET / HTTP/1.1\r\n\r\n"


def connect(proxy: int, server: int) -> socket.socket:
    """Connect to a server through the proxy."""
    raw = socket.create_connection((HERE, proxy))
    raw.sendall(b"\5\1\0")
    raw.recv(2)
    raw.sendall(bytes((5, 1, 0, 3, len(HERE))) + HERE.encode() + server.to_bytes(2, "big"))
    assert raw.recv(10)[1] == 0
    return raw


def serve(listener: socket.socket, size: int) -> None:
    """Respond to every request with ``size`` bytes."""
    while True:
        raw, _ = listener.accept()
        threading.Thread(target=answer, args=(raw, size), daemon=True).start()


def answer(raw: socket.socket, size: int) -> None:
    """Respond to one request, and close the connection."""
    with raw:
        raw.recv(65536)
        chunk = bytes(min(size, 65536))
        for _ in range(size // len(chunk)):
            raw.sendall(chunk)


def drain(raw: socket.socket) -> None:
    """Send a request, and read the response."""
    with raw:
        raw.sendall(REQUEST)
        while raw.recv(MIB):
            pass


def play(pipe: Connection) -> None:
    """Act as browsers and servers: a few downloads, then many small pages."""
    proxy = pipe.recv()
    for size, count, at_once in ((EACH, DOWNLOADS, DOWNLOADS), (2048, CONNECTIONS, 1)):
        with socket.create_server((HERE, 0), backlog=128) as listener:
            server = listener.getsockname()[1]
            threading.Thread(target=serve, args=(listener, size), daemon=True).start()
            pipe.send("ready")
            pipe.recv()
            for _ in range(count // at_once):
                threads = [
                    threading.Thread(target=drain, args=(connect(proxy, server),)) for _ in range(at_once)
                ]
                for thread in threads:
                    thread.start()
                for thread in threads:
                    thread.join()
            pipe.send("done")
            pipe.recv()


async def measure(pipe: Connection) -> None:
    """Measure, and print both results."""
    async with Egress(EgressConfig(allow=(HERE,))) as egress:
        pipe.send(egress.port)
        spent = []
        for _ in range(2):
            await asyncio.to_thread(pipe.recv)
            before = time.process_time()
            pipe.send("go")
            await asyncio.to_thread(pipe.recv)
            spent.append(time.process_time() - before)
            pipe.send("next")
    print(f"{spent[0] * 1000 / (DOWNLOADS * EACH / MIB):.2f} ms of CPU per MiB")
    print(f"{spent[1] * 1000 / CONNECTIONS:.2f} ms of CPU per connection that carries a small page")


def main() -> None:
    """Start the child process, and measure."""
    ours, theirs = multiprocessing.Pipe()
    child = multiprocessing.get_context("spawn").Process(target=play, args=(theirs,))
    child.start()
    try:
        uvloop.run(measure(ours))
        child.join(10)
    finally:
        child.terminate()


if __name__ == "__main__":
    main()
