"""Prometheus metrics of a server."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

from webgym.browser.egress.proxy import EgressLoad
from webgym.server.admission import AdmissionController
from webgym.server.leases import Leases
from webgym.server.pool import Pool

_BUCKETS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)


class Load(Collector):
    """Gauges and counters that are read when the metrics are collected."""

    def __init__(self, gate: AdmissionController, pool: Pool, leases: Leases) -> None:
        self._gate, self._pool, self._leases = gate, pool, leases

    def collect(self) -> Iterable[Metric]:
        """The load at this moment."""
        calls = GaugeMetricFamily("webgym_queue_calls", "Calls per operation type", labels=["queue", "state"])
        for name, load in self._gate.load.items():
            calls.add_metric([name, "running"], load.running)
            calls.add_metric([name, "waiting"], load.waiting)
        yield calls
        done = CounterMetricFamily(
            "webgym_queue_done", "Calls that have run, per operation type", labels=["queue"]
        )
        for name, load in self._gate.load.items():
            done.add_metric([name], load.done)
        yield done
        seconds = CounterMetricFamily(
            "webgym_queue_seconds", "Spent waiting for a turn and being served", labels=["queue", "state"]
        )
        for name, load in self._gate.load.items():
            seconds.add_metric([name, "waiting"], load.waited_milliseconds / 1000)
            seconds.add_metric([name, "running"], load.served_milliseconds / 1000)
        yield seconds
        permits = self._gate.permits
        yield GaugeMetricFamily("webgym_run_permits", "Slots that may run at once", value=permits.limit)
        yield GaugeMetricFamily("webgym_running_slots", "Slots that run", value=permits.running)
        yield GaugeMetricFamily("webgym_busy_share", "Busy share of the processors", value=permits.busy)
        slots = GaugeMetricFamily("webgym_slots", "Slots by what they do", labels=["state"])
        now = self._pool.load
        for state, count in (("free", now.free), ("leased", now.leased), ("preparing", now.preparing)):
            slots.add_metric([state], count)
        yield slots
        yield GaugeMetricFamily("webgym_sessions", "Live leases", value=len(self._leases))
        yield CounterMetricFamily("webgym_sessions_expired", "Leases taken back", value=self._leases.expired)
        yield from _egress_metrics(self._pool.egress.load)
        launches = sum(slot.launches for slot in self._pool.slots)
        yield CounterMetricFamily("webgym_browser_launches", "Browsers brought up", value=launches)


def _egress_metrics(load: EgressLoad) -> Iterable[Metric]:
    yield GaugeMetricFamily("webgym_egress_open", "Connections that pages have", value=load.open)
    connections = CounterMetricFamily(
        "webgym_egress_connections", "Connections that pages asked for, by how that ended", labels=["result"]
    )
    for result, count in load.results.items():
        connections.add_metric([result], count)
    yield connections
    routes = CounterMetricFamily(
        "webgym_egress_routes", "The same by upstream proxy", labels=["route", "result"]
    )
    for route, results in load.routes.items():
        for result, count in results.items():
            routes.add_metric([route, result], count)
    yield routes
    transferred = CounterMetricFamily("webgym_egress_bytes", "Bytes of pages", labels=["direction"])
    transferred.add_metric(["sent"], load.sent)
    transferred.add_metric(["received"], load.received)
    yield transferred


class CallMetrics:
    """Times and errors per operation, and the metrics of a collector.

    Has a registry of its own, so that several servers in one process do not mix.

    Args:
        collector: the other metrics of the server.
        prefix: prefix of the metrics' names.
    """

    def __init__(self, collector: Collector, prefix: str = "webgym") -> None:
        self._registry = CollectorRegistry()
        self._registry.register(collector)
        self.seconds = Histogram(
            f"{prefix}_operation_seconds",
            "Wall time per operation, waiting included",
            ["operation"],
            buckets=_BUCKETS,
            registry=self._registry,
        )
        self.errors = Counter(
            f"{prefix}_operation_errors", "Typed errors", ["operation", "code"], registry=self._registry
        )

    def exposition(self, more: Collector | None = None) -> bytes:
        """The metrics, and those of another collector, in Prometheus's text format."""
        if more is None:
            return generate_latest(self._registry)
        others = CollectorRegistry()
        others.register(more)
        return generate_latest(self._registry) + generate_latest(others)


class LabelledByWorker(Collector):
    """The metrics of several workers: every sample is labelled with its worker, families occur once.

    Args:
        expositions: each worker's metrics in Prometheus's text format, by its name.
    """

    def __init__(self, expositions: Mapping[str, bytes]) -> None:
        self._expositions = expositions

    def collect(self) -> Iterable[Metric]:
        """The merged families."""
        merged: dict[str, Metric] = {}
        for worker, text in self._expositions.items():
            for family in text_string_to_metric_families(text.decode()):
                whole = merged.setdefault(family.name, Metric(family.name, family.documentation, family.type))
                whole.samples += [
                    sample._replace(labels={"worker": worker, **sample.labels}) for sample in family.samples
                ]
        return merged.values()
