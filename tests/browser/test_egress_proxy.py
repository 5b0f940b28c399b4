"""The proxy over raw SOCKS: what clients, servers and the network between them can do to it.

Each test runs on both event loops that WebGym runs on, in a loop of its own, and ends by proving that the
proxy has kept nothing: no task, no connection, no descriptor.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import os
import random
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import uvloop
from aiodns.error import ARES_ESERVFAIL, DNSError

from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.hosts import Address
from webgym.browser.egress.proxy import Egress, ProxyListener
from webgym.browser.egress.resolver import Machine

from .canary import HERE, Names, canary

SECONDS = 10.0
MIB = 1024 * 1024

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


def scene(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """A test that is played on both kinds of event loops."""

    def play(new_loop: Callable[[], asyncio.AbstractEventLoop], **fixtures: Any) -> None:
        with asyncio.Runner(loop_factory=new_loop) as runner:
            runner.run(asyncio.wait_for(test(**fixtures), 60))

    plain = pytest.param(asyncio.new_event_loop, id="asyncio", marks=pytest.mark.slow)
    loops = [pytest.param(uvloop.new_event_loop, id="uvloop"), plain]
    parameters = inspect.signature(play).parameters["new_loop"], *inspect.signature(test).parameters.values()
    play.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    play.__name__, play.__doc__ = test.__name__, test.__doc__
    pytest.mark.parametrize("new_loop", loops)(play)
    return play


@asynccontextmanager
async def proxy(*allow: str, machine: Machine | None = None, **limits: Any) -> AsyncIterator[Egress]:
    """A proxy to this machine, which must be left as it was found."""
    egress = Egress(EgressConfig(allow=allow or (HERE,), **limits), machine or Names())
    async with egress:
        yield egress
    assert not egress.waiting
    assert not egress._connections.transports
    assert egress.load.open == 0


class Silent(Names):
    """Names of ``slow.test`` are never answered."""

    async def lookup(self, name: str) -> list[Address]:
        if name.endswith("slow.test"):
            self.asked.append(name)
            await asyncio.Event().wait()
        return await super().lookup(name)


async def until(what: Callable[[], object]) -> None:
    async with asyncio.timeout(SECONDS):
        while not what():
            await asyncio.sleep(0.005)


async def knock(egress: Egress | ProxyListener, say: bytes = b"") -> Streams:
    reader, writer = await asyncio.open_connection(HERE, egress.port)
    writer.write(say)
    return reader, writer


def request(host: str | bytes, port: int, command: int = 1) -> bytes:
    name = host.encode() if isinstance(host, str) else host
    return b"\5\1\0" + bytes((5, command, 0, 3, len(name))) + name + port.to_bytes(2, "big")


async def ask(egress: Egress | ProxyListener, host: str | bytes, port: int) -> tuple[int, Streams]:
    """The reply's code, and the connection."""
    streams = await knock(egress, request(host, port))
    said = await asyncio.wait_for(streams[0].readexactly(12), SECONDS)
    assert said[:2] == b"\5\0"
    return said[3], streams


async def hang_up(*all_streams: Streams) -> None:
    for _, writer in all_streams:
        writer.close()
        with contextlib.suppress(ConnectionError):
            await writer.wait_closed()


async def closed(streams: Streams) -> bytes:
    """What comes until the connection ends, one way or the other."""
    try:
        return await asyncio.wait_for(streams[0].read(), SECONDS)
    except ConnectionResetError:
        return b""
    finally:
        streams[1].close()


@asynccontextmanager
async def serve(
    handle: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]],
    host: str = HERE,
    port: int = 0,
) -> AsyncIterator[int]:
    tasks: set[asyncio.Task[None]] = set()

    async def guarded(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        tasks.add(task)
        # A cancelled handler that says so is an error in the streams of some Python releases.
        with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError, asyncio.CancelledError):
            await handle(reader, writer)
        writer.close()

    server = await asyncio.start_server(guarded, host, port)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(65536):
        writer.write(data)
        await writer.drain()


# --- the handshake --------------------------------------------------------------------------------------


@scene
async def test_bytes_come_through_as_they_are() -> None:
    sent = random.Random(1).randbytes(3 * MIB)
    async with serve(echo) as port, proxy() as egress:
        code, (reader, writer) = await ask(egress, HERE, port)
        assert code == 0
        writer.write(sent)
        assert await asyncio.wait_for(reader.readexactly(len(sent)), SECONDS) == sent
        load = egress.load
        assert (load.open, load.sent, load.received) == (1, len(sent), len(sent))
        assert load.results == {"connected": 1}
        writer.close()
        await until(lambda: egress.load.open == 0)


@scene
async def test_a_handshake_in_pieces_and_in_one_piece() -> None:
    async with serve(echo) as port, proxy() as egress:
        said = request(HERE, port)
        reader, writer = await knock(egress)
        for nth in range(len(said)):
            writer.write(said[nth : nth + 1])
            await writer.drain()
            await asyncio.sleep(0)
        assert (await asyncio.wait_for(reader.readexactly(12), SECONDS))[3] == 0
        writer.close()
        # What follows at once, before anybody has said that it may, is not lost.
        reader, writer = await knock(egress, said + b"early")
        assert (await asyncio.wait_for(reader.readexactly(17), SECONDS))[12:] == b"early"
        writer.close()


@pytest.mark.parametrize(
    "said",
    [
        b"GET / HTTP/1.1\r\n\r\n", b"CONNECT a:80 HTTP/1.1\r\n\r\n", b"\4\1\0\x50\x7f\0\0\1\0", b"\x16\3\1",
        b"\0", b"\5\1\0\4\1\0\1", b"\5\1\0\5\1\0\2abcdef", b"\5\1\0\5\1\0\3\2\xff\xfe\0\x50", b"\5\0" * 600,
        b"\5\1\0" + b"\5\1\0\3\5a.com\0\x50" + b"x" * 5000,
    ],
    ids=range(10),
)  # fmt: skip
@scene
async def test_what_is_no_socks_is_turned_away(said: bytes) -> None:
    async with proxy() as egress:
        answer = await closed(await knock(egress, said))
        assert answer in (b"", b"\5\0", b"\5\xff") or answer[:3] == b"\5\0\5"
        await until(lambda: not egress._connections.transports)


@scene
async def test_only_connections_without_authentication() -> None:
    async with proxy() as egress:
        assert await closed(await knock(egress, b"\5\1\2")) == b"\5\xff"
        for command in (2, 3, 0, 9):  # listening, UDP, and what there is not
            answer = await closed(await knock(egress, request(HERE, 80, command)))
            assert answer[:4] == b"\5\0\5\7"


@scene
async def test_addresses_in_binary_are_judged_as_well() -> None:
    async with serve(echo) as port, canary() as bird, proxy(f"{HERE}:{port}", ports=()) as egress:
        four, six = socket.inet_aton(HERE), socket.inet_pton(socket.AF_INET6, f"::ffff:{HERE}")
        for kind, raw in ((1, four), (4, six)):
            for where, code in ((port, 0), (bird.port, 2)):
                said = b"\5\1\0\5\1\0" + bytes((kind,)) + raw + where.to_bytes(2, "big")
                reader, writer = await knock(egress, said)
                assert (await asyncio.wait_for(reader.readexactly(12), SECONDS))[3] == code
                writer.close()
        assert not bird.visits


@scene
async def test_a_client_that_says_nothing_is_dropped_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.browser.egress.proxy.HANDSHAKE_SECONDS", 0.05)
    async with proxy() as egress:
        for said in (b"", b"\5", b"\5\1\0", b"\5\1\0\5\1"):
            assert await closed(await knock(egress, said)) in (b"", b"\5\0")
        await until(lambda: not egress._connections.transports)


# --- why there is no connection -------------------------------------------------------------------------


def free_port() -> int:
    with socket.create_server((HERE, 0)) as listener:
        port: int = listener.getsockname()[1]
        return port


@scene
async def test_each_failure_has_its_reason() -> None:
    class Failing(Names):
        async def lookup(self, name: str) -> list[Address]:
            if name == "broken.test":
                raise DNSError(ARES_ESERVFAIL, "try again")
            return await super().lookup(name)

        def is_online(self) -> bool:
            return True

    machine = Failing({"inside.test": ["10.0.0.1"]})
    async with proxy("gone.test=nowhere", HERE, machine=machine) as egress:
        expected = {
            ("none.test", 80): "no_such_name",
            ("gone.test", 80): "no_such_name",
            ("broken.test", 80): "dns_failed",
            (HERE, free_port()): "refused",
            ("inside.test", 80): "forbidden",
            ("8.8.8.8", 25): "forbidden",
            ("a%b", 80): "malformed",
        }
        for (host, port), why in expected.items():
            code, streams = await ask(egress, host, port)
            assert code != 0
            await closed(streams)
            failure = egress.failure(f"http://{host}:{port}/x?y#z")
            assert failure is not None, host
            assert failure.reason == why
        assert sum(egress.load.results.values()) == len(expected)
        assert egress.failure("http://other.test/") is None
        assert egress.failure("http://[::1/") is None


@scene
async def test_a_server_that_does_not_answer_is_given_up() -> None:
    # A listener whose queue is full takes no further connection, and says nothing.
    with socket.socket() as full, contextlib.ExitStack() as stack:
        full.bind((HERE, 0))
        full.listen(0)
        port = full.getsockname()[1]
        for _ in range(4):
            filler = stack.enter_context(socket.socket())
            filler.setblocking(False)
            filler.connect_ex((HERE, port))
        async with proxy(connect_seconds=0.2) as egress:
            code, streams = await ask(egress, HERE, port)
            assert code == 1
            await closed(streams)
            failure = egress.failure(f"http://{HERE}:{port}")
            assert failure is not None
            assert failure.reason == "timed_out"


@scene
async def test_the_next_address_is_tried() -> None:
    machine = Names({"two.test": ["127.0.0.9", HERE]})
    async with serve(echo) as port, proxy("two.test", machine=machine) as egress:
        code, (_, writer) = await ask(egress, "two.test", port)
        assert code == 0
        writer.close()


@scene
async def test_each_connection_asks_once_and_goes_where_the_answer_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A second question could be answered otherwise than the first, which was checked."""
    monkeypatch.setattr("webgym.browser.egress.resolver.CACHE_SECONDS", 0.0)
    monkeypatch.setattr("webgym.browser.egress.dial.CACHE_SECONDS", 0.0)
    machine = Names({"once.test": [["127.0.0.2"], [HERE]]})
    async with canary() as bird, proxy("127.0.0.2", machine=machine, ports=()) as egress:
        async with serve(echo, "127.0.0.2", bird.port):
            code, (_, writer) = await ask(egress, "once.test", bird.port)
            assert (code, machine.asked) == (0, ["once.test"])
            writer.close()
            code, streams = await ask(egress, "once.test", bird.port)
            assert (code, machine.asked) == (2, ["once.test"] * 2)
            await closed(streams)
        assert not bird.visits


@scene
async def test_politeness_spares_what_a_rule_allows() -> None:
    async with serve(echo) as port, proxy(burst=1, rate=0.001, wait_seconds=0) as egress:
        for _ in range(3):
            code, (_, writer) = await ask(egress, HERE, port)
            assert code == 0
            writer.close()
        dial = egress._dialer
        assert dial._politeness.delay("8.8.8.8", asyncio.get_running_loop().time()) == 0
        code, streams = await ask(egress, "8.8.8.8", 80)
        assert code == 2
        await closed(streams)
        assert egress.load.results == {"connected": 3, "too_many": 1}


@pytest.mark.parametrize("host", [HERE, "127.0.0.2", "localhost", "::ffff:127.0.0.1", "0.0.0.0", "::1"])
@scene
async def test_it_is_not_led_to_itself(host: str) -> None:
    async with proxy("*") as egress:
        code, streams = await ask(egress, host, egress.port)
        assert code == 2
        await closed(streams)


# --- streams that end, or do not ------------------------------------------------------------------------


@scene
async def test_a_frozen_reader_holds_up_the_server_and_costs_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """It reads nothing for as long as it likes; then it gets everything."""
    monkeypatch.setattr("webgym.browser.egress.splice.BUFFER_BYTES", 65536)
    total = 64 * MIB
    written = 0

    async def flood(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal written
        while written < total:
            writer.write(bytes(65536))
            await writer.drain()
            written += 65536

    async with serve(flood) as port, proxy() as egress:
        code, streams = await ask(egress, HERE, port)
        assert code == 0
        streams[1].transport.pause_reading()  # type: ignore[attr-defined]
        before = -1
        while written != before:  # until nothing moves any more
            before = written
            await asyncio.sleep(0.2)
        assert written < total // 2, "the rest waits at the server"
        held = [one.get_write_buffer_size() for one in egress._connections.transports]
        assert max(held) < MIB
        streams[1].transport.resume_reading()  # type: ignore[attr-defined]
        got = 0
        while data := await asyncio.wait_for(streams[0].read(MIB), SECONDS):
            got += len(data)
        assert got == total
        streams[1].close()


@scene
async def test_a_server_that_reads_nothing_holds_up_the_browser_and_is_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("webgym.browser.egress.splice.BUFFER_BYTES", 65536)
    monkeypatch.setattr("webgym.browser.egress.splice.KEEPALIVE_SECONDS", 1)

    async def deaf(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.transport.pause_reading()  # type: ignore[attr-defined]
        await asyncio.Event().wait()

    async with serve(deaf) as port, proxy(dead_seconds=1) as egress:
        _, (_, writer) = await ask(egress, HERE, port)
        writer.write(bytes(64 * MIB))
        await until(lambda: egress.load.sent)
        await until(lambda: egress.load.open == 0)
        assert egress.load.sent < 32 * MIB, "the rest waited at the browser"
        writer.transport.abort()


@scene
async def test_a_server_may_close_one_direction() -> None:
    heard = asyncio.Event()

    async def half(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"bye")
        writer.write_eof()
        assert await reader.readexactly(4) == b"more"
        heard.set()

    async with serve(half) as port, proxy() as egress:
        _, (reader, writer) = await ask(egress, HERE, port)
        assert await asyncio.wait_for(reader.read(), SECONDS) == b"bye"
        writer.write(b"more")
        await asyncio.wait_for(heard.wait(), SECONDS)
        writer.close()
        await until(lambda: egress.load.open == 0)


@scene
async def test_a_browser_that_goes_takes_the_connection_with_it() -> None:
    ended = asyncio.Event()

    async def last(reader: asyncio.StreamReader, _: asyncio.StreamWriter) -> None:
        assert await reader.read() == b"last words"
        ended.set()

    async with serve(last) as port, proxy() as egress:
        _, (_, writer) = await ask(egress, HERE, port)
        writer.write(b"last words")
        await writer.drain()
        writer.close()
        await asyncio.wait_for(ended.wait(), SECONDS)
        await until(lambda: not egress._connections.transports)


@scene
async def test_a_reset_is_passed_on_as_a_reset() -> None:
    async def rude(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readexactly(1)
        raw = writer.get_extra_info("socket")
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")

    async with serve(rude) as port, proxy() as egress:
        _, (reader, writer) = await ask(egress, HERE, port)
        writer.write(b"x")
        with pytest.raises(ConnectionResetError):
            await asyncio.wait_for(reader.read(), SECONDS)
        writer.close()


@scene
async def test_what_a_server_says_before_it_goes_arrives() -> None:
    """Also if it says so and goes in the very moment in which it is connected to."""

    async def brief(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"x" * 100_000)

    async with serve(brief) as port, proxy() as egress:
        for _ in range(30):
            code, streams = await ask(egress, HERE, port)
            assert code == 0
            assert len(await closed(streams)) == 100_000
        await until(lambda: not egress._connections.transports)


# --- many, and the end ----------------------------------------------------------------------------------


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@scene
async def test_many_connections_come_and_go_and_leave_nothing() -> None:
    dice = random.Random(7)

    async def visit(egress: Egress, port: int) -> None:
        code, (reader, writer) = await ask(egress, HERE, port)
        assert code == 0
        writer.write(b"hello")
        assert await asyncio.wait_for(reader.readexactly(5), SECONDS) == b"hello"
        if dice.random() < 0.3:
            writer.transport.abort()
        writer.close()

    async with serve(echo) as port, proxy() as egress:
        await visit(egress, port)  # what a loop opens once stays open
        await until(lambda: egress.load.open == 0)
        before = descriptors()
        for _ in range(4):
            await asyncio.gather(*(visit(egress, port) for _ in range(75)))
        await until(lambda: not egress._connections.transports)
        assert egress.load.results == {"connected": 301}
        await until(lambda: descriptors() <= before)


@scene
async def test_a_page_whose_names_are_never_answered_holds_up_no_other_session() -> None:
    async with serve(echo) as port, proxy("*", machine=Silent({"here.test": [HERE]})) as egress:
        listener = await egress.open_listener()
        asking = [request(f"{nth}.domain-{nth % 50}.slow.test", 80) for nth in range(200)]
        greedy = [await knock(listener, asked) for asked in asking]
        most = egress.config.session_lookups
        await until(lambda: egress.load.results["too_many"] == len(asking) - most)
        await until(lambda: egress.waiting == most)  # the last one that was refused is told so first
        neighbour = await egress.open_listener()
        said, one = await ask(neighbour, "here.test", port)
        assert said == 0
        listener.renew()  # the page is gone, and with it all that it waits for
        await until(lambda: not egress.waiting)
        said, other = await ask(listener, "here.test", port)
        assert said == 0, "the next session has a whole budget"
        await hang_up(*greedy, one, other)


@scene
async def test_what_a_session_has_open_is_cut_and_what_it_repeats_at_once() -> None:
    async with serve(echo) as port, proxy("*", machine=Silent({"here.test": [HERE]})) as egress:
        listener, neighbour = await egress.open_listener(), await egress.open_listener()
        for is_same_session, is_repeated in ((True, True), (True, False), (False, True)):
            _, one = await ask(listener, "here.test", port)
            opening = await knock(listener, request("a.slow.test", 80))
            _, other = await ask(neighbour, "here.test", port)
            await until(lambda: egress.waiting)
            listener.cut(partial(bool, is_repeated))
            assert await closed(one) == b""
            assert b"\5\0\0" not in await closed(opening)
            if not is_same_session:
                listener.renew()
            _, again = await ask(listener, "here.test", port)
            await asyncio.sleep(0.7)
            is_cut = is_same_session and is_repeated
            for streams, is_open in ((again, not is_cut), (other, True)):
                streams[1].write(b"x")
                assert (await streams[0].read(1) == b"x") is is_open
            await hang_up(again, other)


@scene
async def test_a_session_has_so_many_connections_names_and_bytes() -> None:
    limits = {"session_connections": 3, "session_names": 2, "session_bytes": 100_000}
    names = {f"{name}.test": [HERE] for name in "abc"}
    async with serve(echo) as port, proxy("*", machine=Names(names), **limits) as egress:
        listener = await egress.open_listener()
        first = [await ask(listener, name, port) for name in ("a.test", "b.test", "b.test")]
        assert [said for said, _ in first] == [0, 0, 0]
        said, fourth = await ask(listener, "a.test", port)
        assert said == 2, "a fourth at once"
        listener.renew()
        second = [await ask(listener, name, port) for name in ("a.test", "b.test", "c.test", "b.test")]
        assert [said for said, _ in second] == [0, 0, 2, 0], "a third name"
        listener.renew()
        _, (reader, writer) = await ask(listener, "a.test", port)
        writer.write(b"x" * 150_000)
        assert len(await closed((reader, writer))) < 100_000
        said, after = await ask(listener, "a.test", port)
        assert said == 2
        assert egress.load.open == len(first) + len(second) - 1
        await hang_up(fourth, after, *(streams for _, streams in (*first, *second)))


@scene
async def test_browsers_that_go_in_the_middle_leave_nothing() -> None:
    machine = Silent()
    with socket.create_server((HERE, 0), backlog=0) as full:
        port = full.getsockname()[1]
        async with proxy("slow.test", HERE, machine=machine) as egress:
            waiting = [await knock(egress, request("slow.test", 80)) for _ in range(5)]
            waiting += [await knock(egress, request(HERE, port)) for _ in range(5)]
            await until(lambda: machine.asked and egress.waiting >= 5)
            for _, writer in waiting:
                writer.transport.abort()
            await until(lambda: not egress.waiting and not egress._connections.transports)
            assert egress.load.results["abandoned"] >= 5
            # Nobody waits for it: not asked any more, and forgotten a turn of the loop later.
            await until(lambda: not egress._dialer._resolver._lookups)


@scene
async def test_stopped_it_ends_everything_at_once() -> None:
    async with serve(echo) as port:
        egress = Egress(EgressConfig(allow=(HERE,)), Names())
        await egress.stop()  # before it has started: nothing to do
        await egress.start()
        standing = [(await ask(egress, HERE, port))[1] for _ in range(5)]
        begun = await knock(egress, b"\5")
        await until(lambda: egress.load.open == 5)
        await egress.stop()
        await egress.stop()
        for streams in (*standing, begun):
            assert await closed(streams) == b""
        await until(lambda: not egress._connections.transports)
        assert not egress.waiting


OFFLINE = """
import asyncio
from webgym.browser.egress.proxy import Egress
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.dial import NotConnected

async def main():
    async with Egress(EgressConfig(allow=("*",))) as egress:
        for host in ("example.com", "8.8.8.8", "2606:4700::1"):
            try:
                await egress.connect(host, 80, egress.main.budget)
            except NotConnected as failure:
                print(failure.reason)

asyncio.run(main())
"""


def test_a_machine_without_a_network_says_so() -> None:
    """In a network namespace of its own, where there is no way out."""
    alone = ["unshare", "--user", "--map-root-user", "--net"]
    if subprocess.run([*alone, "true"], capture_output=True, check=False).returncode:
        pytest.skip("this machine lets nobody make a network namespace")
    source = Path(__file__).parents[2] / "src"
    done = subprocess.run(
        [*alone, sys.executable, "-c", OFFLINE],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        env={**os.environ, "PYTHONPATH": str(source)},
    )
    assert done.stdout.split() == ["offline"] * 3
