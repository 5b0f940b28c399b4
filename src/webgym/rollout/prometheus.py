"""A collector's metrics for Prometheus, on an address of their own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from webgym.core.errors import ConfigError
from webgym.rollout.progress import STATES, Progress

_HOST = "127.0.0.1"


class _Figures(Collector):
    """Metrics that are read when they are collected."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def collect(self) -> Iterable[Metric]:
        """The metrics at this moment."""
        progress = self._progress
        calls = GaugeMetricFamily("webgym_collector_calls", "Calls under way", labels=["kind", "state"])
        done = CounterMetricFamily("webgym_collector_calls_done", "Calls that ended", labels=["kind"])
        seconds = CounterMetricFamily(
            "webgym_collector_call_seconds", "Spent waiting and being served", labels=["kind", "state"]
        )
        for kind, queue in progress.calls.items():
            load = queue.load
            calls.add_metric([kind, "running"], load.running)
            calls.add_metric([kind, "waiting"], load.waiting)
            done.add_metric([kind], load.done)
            seconds.add_metric([kind, "running"], load.served_seconds)
            seconds.add_metric([kind, "waiting"], load.waited_seconds)
        yield from (calls, done, seconds)
        attempts = GaugeMetricFamily("webgym_collector_attempts", "By what they do", labels=["state"])
        for state in STATES:
            attempts.add_metric([state], progress.states[state])
        yield attempts
        ended = CounterMetricFamily("webgym_collector_outcomes", "Attempts that ended", labels=["outcome"])
        for outcome, count in progress.outcomes.items():
            ended.add_metric([outcome.value], count)
        yield ended
        yield CounterMetricFamily("webgym_collector_steps", "Steps taken", value=progress.steps)
        if progress.note:
            note = GaugeMetricFamily("webgym_collector_note", "To read the figures with", labels=["note"])
            note.add_metric([progress.note], 1)
            yield note
        lag = GaugeMetricFamily(
            "webgym_collector_loop_lag_seconds", "How late the event loop is", labels=["quantile"]
        )
        for share in (0.5, 0.99):
            lag.add_metric([str(share)], progress.lag.milliseconds(share) / 1000)
        yield lag


@contextmanager
def exposing(progress: Progress, port: int | None) -> Iterator[int | None]:
    """Serve a run's figures at ``/metrics`` during the block.

    Args:
        progress: progress of the run.
        port: port on the loopback address; 0 for any free one, ``None`` to serve nothing.

    Yields:
        The port.

    Raises:
        ConfigError: the port is in use.
    """
    if port is None:
        yield None
        return
    registry = CollectorRegistry()
    registry.register(_Figures(progress))
    try:
        server, thread = start_http_server(port, _HOST, registry)
    except OSError as error:
        raise ConfigError(f"cannot listen on collector.metrics_port {port}: {error.strerror}") from error
    try:
        yield server.server_port
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
