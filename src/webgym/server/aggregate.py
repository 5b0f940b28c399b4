"""The load and metrics of many workers, combined."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from webgym.server.fleet import Fleet
from webgym.server.metrics import CallMetrics
from webgym.server.queue import SlotQueue

_SAMPLE = re.compile(rb"([a-zA-Z_:][a-zA-Z0-9_:]*)(\{)?")


class _Load(Collector):
    def __init__(self, fleet: Fleet, queue: SlotQueue) -> None:
        self._fleet, self._queue = fleet, queue

    def collect(self) -> Iterable[Metric]:
        """Collect the load at this moment."""
        yield GaugeMetricFamily(
            "webgym_gateway_workers", "Workers that are up", value=len(self._fleet.workers)
        )
        yield GaugeMetricFamily(
            "webgym_gateway_waiting", "Callers who wait for a slot", value=len(self._queue)
        )
        yield CounterMetricFamily(
            "webgym_gateway_workers_lost", "Workers that were up and are gone", value=self._fleet.lost
        )


class GatewayMetrics(CallMetrics):
    """The metrics of one gateway."""

    def __init__(self, fleet: Fleet, queue: SlotQueue) -> None:
        super().__init__(_Load(fleet, queue), "webgym_gateway")


def total(parts: list[Any]) -> Any:
    """Combine decoded messages: integers are added, mappings combined by key; of other values the first
    counts.

    Shares (of busy processors) are floats, and must not be added: the largest counts, as it matters more to
    an operator than the mean.
    """
    first = parts[0]
    if isinstance(first, dict):
        keys = dict.fromkeys(key for part in parts for key in part)
        return {key: total([part[key] for part in parts if key in part]) for key in keys}
    if isinstance(first, bool):
        return all(parts)
    if isinstance(first, int):
        return sum(parts)
    if isinstance(first, float):
        return max(parts)
    return first


def merge_expositions(own: bytes, others: Mapping[str, bytes]) -> bytes:
    """Merge the Prometheus texts of workers: samples are labelled with their worker, families occur once."""
    families: dict[bytes, list[bytes]] = {}
    for worker, text in others.items():
        label = b'worker="%s"' % worker.encode("ascii")
        family: list[bytes] = []
        is_new = True
        for line in text.splitlines():
            if line.startswith(b"# HELP "):
                name = line.split(b" ", 3)[2]
                is_new = name not in families
                family = families.setdefault(name, [])
            if not line.startswith(b"#"):
                family.append(_labelled(line, label))
            elif is_new:
                family.append(line)
    return own + b"\n".join([*(line for family in families.values() for line in family), b""])


def _labelled(sample: bytes, label: bytes) -> bytes:
    match = _SAMPLE.match(sample)
    assert match is not None
    rest = sample[match.end() :]
    return b"%s{%s,%s" % (match[1], label, rest) if match[2] else b"%s{%s}%s" % (match[1], label, rest)
