"""The tables of ``webgym bench server``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from webgym.bench.ceiling import SERVER, Ceiling
from webgym.bench.server import Burst, Cost, Density, ServerFigures, Thinking
from webgym.bench.stepping import StepTimes, quantile
from webgym.bench.usage import MEGABYTE
from webgym.core.tables import DASH, Table

_KINDS = {name: name for name in ("client", "server", "browser", "renderer")} | {"gpu-process": "gpu"}
"""Kinds of processes with a column; the others use little, and are included in the sum only."""


def server_tables(figures: ServerFigures) -> Iterator[Table]:
    """A table for every part that was run."""
    if figures.ceiling:
        yield _ceiling(figures.ceiling, figures.plan.sessions)
        yield _per_step(figures.ceiling)
    if figures.costs:
        yield _costs(figures.costs)
    if figures.thinking:
        yield _thinking(figures.thinking)
    if figures.burst:
        yield _burst(figures.burst)
    if figures.density:
        yield _density(figures.density)


def _spread(values: Sequence[float], digits: int = 1) -> str:
    if not values:  # rounds so short that not a step ended
        return DASH
    middle = quantile(values, 0.5)
    return f"{middle:.{digits}f} ({min(values):.{digits}f}-{max(values):.{digits}f})"


def _ms(seconds: float) -> str:
    return DASH if math.isnan(seconds) else f"{seconds * 1000:.0f}"


def _latencies(runs: Sequence[StepTimes]) -> list[float]:
    return [latency for run in runs for latency in run.latencies]


def _ceiling(results: list[Ceiling], sessions: int) -> Table:
    rows = []
    for ceiling in results:
        for name, runs in ceiling.rounds.items():
            ratio = "" if name == SERVER else _spread(ceiling.ratios(name), 2)
            rates = _spread([run.rate for run in runs])
            rows.append((f"{ceiling.page}, {name}", rates, ratio, _p50_p95(_latencies(runs))))
    return Table(
        f"Against the ceiling: {sessions} sessions, median (min-max) of rounds",
        ("pages", "steps per second", "server / this", "step p50 / p95, ms"),
        rows,
    )


def _p50_p95(seconds: Sequence[float]) -> str:
    return f"{_ms(quantile(seconds, 0.5))} / {_ms(quantile(seconds, 0.95))}"


def _per_step(results: list[Ceiling]) -> Table:
    rows = []
    for ceiling in results:
        for name, runs in ceiling.rounds.items():
            steps = sum(run.steps for run in runs)
            kinds = {kind for run in runs for kind in run.cpu}
            cpu = {kind: sum(run.cpu.get(kind, 0.0) for run in runs) * 1000 / max(1, steps) for kind in kinds}
            rows.append((f"{ceiling.page}, {name}", *_kinds(cpu)))
    return Table("CPU milliseconds per step, by kind of process", ("pages", *_KINDS.values(), "all"), rows)


def _kinds(cpu: dict[str, float]) -> Iterator[str]:
    for kind in _KINDS:
        yield f"{cpu.get(kind, 0.0):.1f}"
    yield f"{sum(cpu.values()):.1f}"


def _costs(costs: list[Cost]) -> Table:
    rows = [
        (cost.operation, *(_kinds(cost.cpu) if cost.cpu else [""] * (len(_KINDS) + 1)), f"{cost.wall:.1f}")
        for cost in costs
    ]
    return Table(
        "CPU milliseconds per call, one at a time, by kind of process; median wall milliseconds",
        ("operation", *_KINDS.values(), "all", "wall"),
        rows,
    )


def _thinking(result: Thinking) -> Table:
    rows = []
    slots = (("frozen between steps", result.frozen), ("not frozen", result.unfrozen))
    for (name, run), idle in zip(slots, result.idle, strict=True):
        rows.append(
            (
                name,
                f"{idle:.2f}",
                _ms(quantile(run.latencies, 0.5)),
                _ms(quantile(run.latencies, 0.95)),
                f"{run.rate:.1f}",
                f"{run.rate / result.allowed:.2f}",
                str(run.failures),
            )
        )
    if result.frozen.latencies and result.unfrozen.latencies:
        slower = quantile(result.unfrozen.latencies, 0.5) / quantile(result.frozen.latencies, 0.5)
        faster = result.frozen.rate / result.unfrozen.rate
        rows.append(("ratio", "", f"{slower:.1f}x", "", f"{faster:.1f}x", "", ""))
    return Table(
        f"{result.sessions} sessions on busy pages, {result.think_seconds:g} s of thinking per step "
        f"(at most {result.allowed:.1f} steps/s)",
        ("slots", "idle CPU use, cores", "step p50, ms", "p95, ms", "steps/s", "of the maximum", "failed"),
        rows,
    )


def _burst(result: Burst) -> Table:
    rows = [
        (name.replace("_", " "), _ms(quantile(waits, 0.5)), _ms(max(waits)))
        for name, waits in result.seconds.items()
    ]
    return Table(
        f"Screenshots that are requested during a burst of {result.navigations} navigations",
        ("queue", "p50, ms", "max, ms"),
        rows,
    )


def _density(result: Density) -> Table:
    run = result.steps
    rows = [
        ("live sessions", str(result.sessions)),
        ("failed steps", f"{run.failures} of {run.steps}"),
        ("time until all were ready, s", f"{result.ready_seconds:.0f}"),
        ("memory per additional session (PSS), MB", f"{result.marginal / MEGABYTE:.0f}"),
        ("memory of all browsers, GB", f"{max(result.bytes.values()) / MEGABYTE / 1024:.1f}"),
        ("steps per second, half of the sessions on busy pages", f"{run.rate:.1f}"),
        ("step p50 / p95, ms", _p50_p95(run.latencies)),
    ]
    return Table("Density", ("", "measured"), rows)
