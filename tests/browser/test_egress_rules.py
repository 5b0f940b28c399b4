"""The rules of the way out, without a network: hosts, addresses, policy, politeness, names."""

from __future__ import annotations

import asyncio
import socket
from ipaddress import IPv4Address, IPv6Address, IPv6Network, ip_address
from typing import cast

import pytest
from aiodns import DNSResolver
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import ValidationError

from webgym.browser.egress.addresses import kind_of
from webgym.browser.egress.budget import Politeness
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.dial import Forbidden, Nowhere, Policy
from webgym.browser.egress.hosts import Address, read_host
from webgym.browser.egress.resolver import Machine, Resolver
from webgym.browser.egress.rules import Place

from .canary import Names

PUBLIC = IPv4Address("93.184.216.34")
NAT64 = IPv6Network("64:ff9b::/96")
V4 = st.ip_addresses(v=4)
V6 = st.ip_addresses(v=6)
NONE: frozenset[Address] = frozenset()


# --- hosts ----------------------------------------------------------------------------------------------


def number_of(value: int, base: str) -> str:
    return {"d": str(value), "o": f"0{value:o}", "x": f"0x{value:x}", "X": f"0X{value:X}"}[base]


@given(V4, st.integers(1, 4), st.lists(st.sampled_from("doxX"), min_size=4, max_size=4), st.booleans())
def test_every_spelling_of_an_address_means_it(
    address: IPv4Address, parts: int, bases: list[str], has_dot: bool
) -> None:
    whole = int(address)
    numbers = [whole >> 8 * (3 - nth) & 255 for nth in range(parts - 1)]
    numbers.append(whole & (1 << 8 * (5 - parts)) - 1)
    text = ".".join(number_of(number, base) for number, base in zip(numbers, bases, strict=False))
    assert read_host(text + "." * has_dot) == address


@given(V4)
def test_other_alphabets_digits_mean_the_same(address: IPv4Address) -> None:
    wide = str(address).translate({ord("0") + digit: ord("０") + digit for digit in range(10)})
    assert read_host(wide.replace(".", "。")) == address


@given(V6)
def test_an_ipv6_address_means_itself(address: IPv6Address) -> None:
    assume(address.scope_id is None)
    assert read_host(f"[{address}]") == read_host(address.exploded.upper()) == address


@pytest.mark.parametrize(
    "text",
    [
        "", ".", "..", "a..b", ".a", "1.2.3.4.5", "256.1.1.1", "1.2.3.256", "4294967296", "0x100000000", "09",
        "1.2.3.08", "foo.0x", "foo.1", "a b", "a/b", "a@b", "a%41", "fe80::1%eth0", "[::1", "::1]",
        "[1.2.3.4]", "[::1]x", "a\0b", "\n127.0.0.1", "127.0.0.1 ", "x" * 64, ".".join("abcdefgh" * 32),
        "пример", "1.2.3.4:80",
    ],
)  # fmt: skip
def test_what_is_no_host_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r".*"):
        read_host(text)


@given(st.text(max_size=40))
def test_whatever_arrives_is_a_host_or_refused(text: str) -> None:
    try:
        host = read_host(text)
    except ValueError:
        return
    assert read_host(str(host)) == host
    if isinstance(host, str):  # what the system's own reading of numbers would make an address of
        with pytest.raises(OSError, match=r".*"):
            socket.inet_aton(host)


# --- addresses ------------------------------------------------------------------------------------------

KINDS = {
    "private": "10.0.0.0 10.255.255.255 172.16.0.1 172.31.255.255 192.168.255.1 100.64.0.0 100.127.255.255 "
    "fc00::1 fdff::1 fec0::1 64:ff9b:1::1",
    "loopback": "127.0.0.0 127.0.0.1 127.255.255.255 ::1 ::ffff:127.0.0.1 64:ff9b::127.0.0.1",
    "link-local": "169.254.0.1 169.254.169.253 fe80::1 febf::1 ::ffff:169.254.1.1",
    "metadata": "169.254.169.254 169.254.170.2 168.63.129.16 100.100.100.200 192.0.0.192 fd00:ec2::254 "
    "fd20:ce::254 ::ffff:169.254.169.254 64:ff9b::a9fe:a9fe",
    "multicast": "224.0.0.1 239.255.255.255 ff02::1 ff0e::1",
    "unspecified": "0.0.0.0 0.1.2.3 :: ::ffff:0.0.0.0",
    "reserved": "192.0.0.1 192.0.2.1 198.51.100.1 203.0.113.1 192.88.99.1 198.18.0.1 198.19.255.255 "
    "240.0.0.1 255.255.255.255 ::127.0.0.1 2002:7f00:1:: 2001::1 2001:db8::1 3fff::1 100::1 4000::1 5f00::1",
    "public": "1.1.1.1 93.184.216.34 172.15.0.1 172.32.0.1 100.63.255.255 100.128.0.1 192.167.1.1 "
    "223.255.255.255 2606:4700::1 2a00:1450::1 64:ff9b::1.1.1.1 ::ffff:1.1.1.1",
}


@pytest.mark.parametrize("kind", KINDS)
def test_each_address_is_of_its_kind(kind: str) -> None:
    addresses = KINDS[kind].split()
    assert {one: kind_of(ip_address(one)) for one in addresses} == dict.fromkeys(addresses, kind)


@given(st.one_of(V4, V6))
def test_nothing_is_public_that_python_knows_to_be_special(address: IPv4Address | IPv6Address) -> None:
    """An opinion of another's: :mod:`ipaddress` keeps its own tables."""
    if kind_of(address) == "public":
        plain = address
        if isinstance(plain, IPv6Address):
            if plain in NAT64:
                plain = IPv4Address(int(plain) & 0xFFFFFFFF)
            elif plain.ipv4_mapped:
                plain = plain.ipv4_mapped
        assert not plain.is_private
        assert not plain.is_loopback
        assert not plain.is_link_local
        assert not plain.is_multicast
        assert not plain.is_unspecified
        assert not plain.is_reserved


@given(V4)
def test_what_stands_for_an_address_is_of_its_kind(address: IPv4Address) -> None:
    for prefix in ("::ffff:0:0", "64:ff9b::"):
        assert kind_of(IPv6Address(int(IPv6Address(prefix)) + int(address))) == kind_of(address)


# --- policy ---------------------------------------------------------------------------------------------


def policy(*allow: str, ports: tuple[int, ...] = (80, 443)) -> Policy:
    return Policy(EgressConfig(allow=allow, ports=ports))


def verdict(rules: Policy, host: str, port: int = 80, *addresses: str, own: frozenset[Address] = NONE) -> str:
    """Where it leads: ``no``, ``nowhere``, or the addresses, with a star where a rule allows them."""
    try:
        route = rules.route(read_host(host), port)
        found = [ip_address(one) for one in addresses]
        if not isinstance(route.place.host, str):
            found = [route.place.host]
        admitted = rules.admit(route, found, own)
    except Nowhere:
        return "nowhere"
    except Forbidden:
        return "no"
    return "*" * admitted.is_allowed + ",".join(map(str, admitted.addresses)) + f":{route.place.port}"


def test_by_default_the_public_web_and_nothing_else() -> None:
    rules = policy()
    assert verdict(rules, "a.test", 443, "1.1.1.1") == "1.1.1.1:443"
    assert verdict(rules, "1.1.1.1", 80) == "1.1.1.1:80"
    assert verdict(rules, "1.1.1.1", 22) == "no"
    assert verdict(rules, "127.1", 80) == "no"
    assert verdict(rules, "a.test", 80, "10.0.0.1") == "no"
    assert verdict(rules, "a.test", 80, "10.0.0.1", "1.1.1.1", "::1") == "1.1.1.1:80"
    assert verdict(rules, "a.test", 80, "1.1.1.1", own=frozenset({ip_address("1.1.1.1")})) == "no"
    assert verdict(policy(ports=()), "1.1.1.1", 22) == "1.1.1.1:22"


@given(st.lists(st.one_of(V4, V6), min_size=1, max_size=6), st.integers(1, 65535))
def test_without_rules_only_public_addresses_are_admitted(addresses: list[Address], port: int) -> None:
    rules = policy(ports=())
    route = rules.route("a.test", port)
    try:
        admitted = rules.admit(route, addresses, NONE)
    except Forbidden:
        assert all(kind_of(one) != "public" for one in addresses)
        return
    assert not admitted.is_allowed
    assert all(kind_of(one) == "public" for one in admitted.addresses)
    assert len(admitted.addresses) <= len(addresses)


def test_rules_allow_and_lead_elsewhere() -> None:
    rules = policy(
        "down.webgym.test=nowhere", "*.webgym.test=127.0.0.1:8123", "intranet.test", "10.0.0.0/8",
        "[::1]:9000", "192.168.1.5:8080", "shop.test:81=sites:80", "six.test=[::1]:80",
    )  # fmt: skip
    assert verdict(rules, "down.webgym.test") == "nowhere"
    assert verdict(rules, "Fernhill.WebGym.test.", 443) == "*127.0.0.1:8123"
    assert verdict(rules, "webgym.test", 80, "127.0.0.1") == "no"
    assert verdict(rules, "evilwebgym.test", 80, "127.0.0.1") == "no"
    assert verdict(rules, "intranet.test", 9999, "127.0.0.1", "1.1.1.1") == "*127.0.0.1,1.1.1.1:9999"
    assert verdict(rules, "a.test", 9999, "10.9.9.9", "127.0.0.1") == "*10.9.9.9:9999"
    assert verdict(rules, "10.1", 9999) == "*10.0.0.1:9999"
    assert verdict(rules, "::ffff:10.0.0.1", 9999) == "*10.0.0.1:9999"
    assert verdict(rules, "::1", 9000) == "*::1:9000"
    assert verdict(rules, "::1", 9001) == "no"
    assert verdict(rules, "192.168.1.5", 8080) == "*192.168.1.5:8080"
    assert verdict(rules, "a.test", 80, "192.168.1.5") == "no"
    assert rules.route("shop.test", 81).place == Place("sites", 80)
    assert verdict(rules, "shop.test", 80, "127.0.0.1") == "no"
    assert verdict(rules, "six.test") == "*::1:80"
    assert verdict(policy("*"), "a.test", 22, "127.0.0.1") == "*127.0.0.1:22"


def test_the_first_rule_that_matches_decides() -> None:
    config = EgressConfig(allow=("*.test=127.0.0.1:1",)).allowing("a.test=nowhere")
    assert verdict(Policy(config), "a.test") == "nowhere"
    assert verdict(Policy(config), "b.test") == "*127.0.0.1:1"


@pytest.mark.parametrize(
    "rule",
    [
        "", "=", "a.test=", "a.test=b.test", "a.test=127.0.0.1:0", "a.test=127.0.0.1:x", "a.test:99999",
        "10.0.0.0/8=1.1.1.1:80", "127.0.0.1=nowhere", "10.0.0.1/8", "*.10.0.0.1", "*a.test", "a.*",
        "http://a.test", "MAP * 127.0.0.1", "a.test=no where:80", "[::1", "a.test:80=b:80=c:80",
    ],
)  # fmt: skip
def test_what_is_no_rule_is_refused_at_once(rule: str) -> None:
    with pytest.raises(ValidationError, match="is not a rule"):
        EgressConfig(allow=(rule,))
    with pytest.raises(ValidationError, match="is not a rule"):
        EgressConfig().allowing(rule)


# --- politeness -----------------------------------------------------------------------------------------


@given(
    st.floats(0.5, 100),
    st.integers(1, 20),
    st.floats(0, 5),
    st.lists(st.floats(0, 0.2), min_size=1, max_size=200),
)
def test_never_more_than_the_burst_and_the_rate(
    rate: float, burst: int, wait: float, pauses: list[float]
) -> None:
    bucket, now, starts = Politeness(rate, burst, wait), 0.0, list[float]()
    for pause in pauses:
        now += pause
        delay = bucket.delay("a.test", now)
        if delay is not None:
            assert 0 <= delay <= wait + 1e-6
            starts.append(now + delay)
    for first in range(len(starts)):
        for last in range(first, len(starts)):
            assert last - first + 1 <= burst + (starts[last] - starts[first]) * rate + 1e-6


def test_hosts_do_not_pay_for_each_other_and_a_pause_is_enough() -> None:
    bucket = Politeness(rate=1, burst=2, wait_seconds=0.5)
    assert [bucket.delay("a.test", 0), bucket.delay("a.test", 0), bucket.delay("a.test", 0)] == [0, 0, None]
    assert bucket.delay("b.test", 0) == 0
    assert bucket.delay("a.test", 0.6) == pytest.approx(0.4)
    assert bucket.delay("a.test", 10) == 0


# --- names ----------------------------------------------------------------------------------------------


class Slow(Names):
    """Names of ``slow.test`` are answered when the test says so."""

    def __init__(self) -> None:
        super().__init__({"quick.test": ["1.1.1.1"]})
        self.release = asyncio.Event()
        self.given_up = 0

    async def lookup(self, name: str) -> list[Address]:
        if not name.endswith("slow.test"):
            return await super().lookup(name)
        self.asked.append(name)
        try:
            await self.release.wait()
        except asyncio.CancelledError:
            self.given_up += 1
            raise
        return [PUBLIC]


async def test_a_name_that_is_never_answered_is_given_up_and_asked_for_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("webgym.browser.egress.resolver.RESOLVE_SECONDS", 0.05)
    machine = Slow()
    resolver = Resolver(machine)
    both = await asyncio.gather(resolver.resolve("a.slow.test"), resolver.resolve("a.slow.test"))
    assert tuple(both) == ("dns_timed_out", "dns_timed_out")
    assert machine.asked == ["a.slow.test"]
    await asyncio.sleep(0)
    assert machine.given_up == 1
    assert not resolver._lookups
    await resolver.close()


async def test_a_lookup_lasts_as_long_as_somebody_waits_for_it() -> None:
    machine = Slow()
    resolver = Resolver(machine)
    one, other = (asyncio.create_task(resolver.resolve("a.slow.test")) for _ in range(2))
    await asyncio.sleep(0.01)
    one.cancel()
    await asyncio.sleep(0.01)
    assert machine.given_up == 0
    other.cancel()
    await asyncio.sleep(0.01)
    assert machine.given_up == 1
    again = asyncio.create_task(resolver.resolve("a.slow.test"))
    await asyncio.sleep(0.01)
    machine.release.set()
    assert await again == (PUBLIC,)
    await resolver.close()


class NameServer(asyncio.DatagramProtocol):
    """Answers A with 1.2.3.4 for ``here.test``, that there is none for ``none.test``, and nothing else."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        labels, at = [], 12
        while data[at]:
            labels.append(data[at + 1 : at + 1 + data[at]].decode())
            at += 1 + data[at]
        name, kind, question = ".".join(labels), data[at + 2], data[12 : at + 5]
        self.asked.append(name)
        if name not in ("here.test", "none.test"):
            return
        answer = b"\xc0\x0c\0\1\0\1\0\0\0\x3c\0\4\1\2\3\4" if (name, kind) == ("here.test", 1) else b""
        flags = b"\x81\x83" if name == "none.test" else b"\x81\x80"
        counts = b"\0\1" + (b"\0\1" if answer else b"\0\0") + b"\0\0\0\0"
        self._transport.sendto(data[:2] + flags + counts + question + answer, addr)


async def test_a_real_name_server_that_leaves_names_unanswered() -> None:
    loop = asyncio.get_running_loop()
    transport, server = await loop.create_datagram_endpoint(NameServer, local_addr=("127.0.0.1", 0))
    port = transport.get_extra_info("sockname")[1]
    machine = Machine(DNSResolver(["127.0.0.1"], udp_port=port, timeout=30, tries=1, domains=[]))
    resolver = Resolver(machine)
    slow = [asyncio.create_task(resolver.resolve(f"a.domain-{nth}.test")) for nth in range(100)]
    while len(set(server.asked)) < 100:
        await asyncio.sleep(0.005)
    assert await resolver.resolve("here.test") == (ip_address("1.2.3.4"),)
    assert await resolver.resolve("none.test") == "no_such_name"
    for task in slow:
        task.cancel()
    await asyncio.gather(*slow, return_exceptions=True)
    await resolver.close()
    transport.close()


async def test_answers_are_kept_for_a_while_and_failures_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = Names({"a.test": [["1.1.1.1"], ["2.2.2.2"]]})
    resolver = Resolver(machine)
    assert await resolver.resolve("a.test") == await resolver.resolve("a.test")
    monkeypatch.setattr("webgym.browser.egress.resolver.CACHE_SECONDS", 0.0)
    fresh = Resolver(machine)
    assert await fresh.resolve("a.test") == (ip_address("2.2.2.2"),)
    assert await resolver.resolve("none.test") == "no_such_name"
    await resolver.close()
    await fresh.close()


async def test_some_names_are_never_asked_for() -> None:
    machine = Names()
    resolver = Resolver(machine)
    for name in ("a.invalid", "printer.local", "x.onion"):
        assert await resolver.resolve(name) == "no_such_name"
    assert await resolver.resolve("deep.below.localhost") == (ip_address("127.0.0.1"), ip_address("::1"))
    assert machine.asked == ["localhost"], "a name below it cannot be given another meaning"
    await resolver.close()


async def test_the_machine_knows_its_own_addresses() -> None:
    machine = Machine()
    assert IPv4Address("127.0.0.1") in machine.own_addresses()
    assert ip_address("127.0.0.1") in await machine.lookup("localhost")
    await machine.close()
    assert isinstance(Machine().is_online(), bool)
