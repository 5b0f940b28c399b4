"""The state of a running collector, for other processes: ``live.json`` in the run folder, and for Prometheus.

The file is rewritten about once a second and removed when the collector ends. One left by a killed collector
is recognised by the time in it. The metrics are served on an address of their own.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import msgspec
from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from webgym.core.errors import ConfigError, StoreCorrupt
from webgym.rollout.progress import STATES, Progress
from webgym.store.files import LIVE, disk_errors, write_whole

FEED_SECONDS: Final = 1.0
"""Interval at which it is written; with 1,000 attempts it has 60 kB."""

STALE_SECONDS: Final = 15.0
"""Age from which the collector counts as dead: longer than a busy machine delays a write."""


@asynccontextmanager
async def feeding(progress: Progress, run: Path, seconds: float = FEED_SECONDS) -> AsyncIterator[None]:
    """Keep ``live.json`` up to date until the block ends, then remove it.

    If it cannot be written, the run continues, and ``progress.feed_error`` says why.

    Args:
        progress: progress of the run.
        run: the run folder.
        seconds: interval of writes.
    """
    path = run / LIVE
    # A single thread for writes and the removal, so that no write happens after the removal.
    thread = ThreadPoolExecutor(1, thread_name_prefix="live-feed")
    loop = asyncio.get_running_loop()

    async def write() -> None:
        while True:
            data = msgspec.json.encode(progress.snapshot())
            try:
                await loop.run_in_executor(thread, _write, path, data)
                progress.feed_error = ""
            except OSError as error:
                progress.feed_error = f"{path.name} cannot be written: {error.strerror}"
            await asyncio.sleep(seconds)

    writing = asyncio.create_task(write())
    try:
        yield
    finally:
        writing.cancel()
        removed = thread.submit(path.unlink, missing_ok=True)
        thread.shutdown(wait=False)
        with suppress(asyncio.CancelledError):
            await writing
        with disk_errors(f"removing {path}"):
            await asyncio.wrap_future(removed)


def _write(path: Path, data: bytes) -> None:
    write_whole(path, data, durable=False)


def read_feed(run: Path) -> dict[str, Any] | None:
    """The state that a collector has written, and its ``age`` in seconds; ``None`` if no collector is
    running.

    Raises:
        StoreCorrupt: the file does not have a collector's format.
    """
    path = run / LIVE
    try:
        feed = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
        age = max(0.0, time.time() - float(feed["at"]))
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError) as error:
        raise StoreCorrupt(f"{path} is not what a collector writes: {error}") from error
    return {**feed, "age": round(age, 1), "is_stale": age > STALE_SECONDS}


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
