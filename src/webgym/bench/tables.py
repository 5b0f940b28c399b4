"""What ``webgym bench server`` found, as tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from webgym.bench.ceiling import SERVER, Ceiling
from webgym.bench.server import Burst, Cost, Density, ServerFigures, Thinking
from webgym.bench.stepping import Paced, quantile
from webgym.bench.usage import MEGABYTE
from webgym.tables import Table

_KINDS = {name: name for name in ("client", "server", "browser", "renderer")} | {"gpu-process": "gpu"}
"""Columns by kind of process; the others are small and counted in the sum alone."""


def server_tables(figures: ServerFigures) -> Iterator[Table]:
    """What ``webgym bench server`` found."""
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
    middle = quantile(values, 0.5)
    return f"{middle:.{digits}f} ({min(values):.{digits}f}-{max(values):.{digits}f})"


def _ms(seconds: float) -> str:
    return f"{seconds * 1000:.0f}"


def _latencies(runs: Sequence[Paced]) -> list[float]:
    return [latency for run in runs for latency in run.latencies]


def _ceiling(found: list[Ceiling], sessions: int) -> Table:
    rows = []
    for one in found:
        for name, runs in one.rounds.items():
            ratio = "" if name == SERVER else _spread(one.ratios(name), 2)
            rates = _spread([run.rate for run in runs])
            rows.append((f"{one.page}, {name}", rates, ratio, _p50_p95(_latencies(runs))))
    return Table(
        f"Against the ceiling: {sessions} sessions, median (lowest-highest) of rounds",
        ("pages", "steps per second", "the server's over these", "step p50 / p95, ms"),
        rows,
    )


def _p50_p95(seconds: Sequence[float]) -> str:
    return f"{_ms(quantile(seconds, 0.5))} / {_ms(quantile(seconds, 0.95))}"


def _per_step(found: list[Ceiling]) -> Table:
    rows = []
    for one in found:
        for name, runs in one.rounds.items():
            steps = sum(run.steps for run in runs)
            kinds = {kind for run in runs for kind in run.cpu}
            cpu = {kind: sum(run.cpu.get(kind, 0.0) for run in runs) * 1000 / steps for kind in kinds}
            rows.append((f"{one.page}, {name}", *_kinds(cpu)))
    return Table("CPU milliseconds per step, by kind of process", ("pages", *_KINDS.values(), "all"), rows)


def _kinds(cpu: dict[str, float]) -> Iterator[str]:
    for kind in _KINDS:
        yield f"{cpu.get(kind, 0.0):.1f}"
    yield f"{sum(cpu.values()):.1f}"


def _costs(found: list[Cost]) -> Table:
    rows = [
        (cost.operation, *(_kinds(cost.cpu) if cost.cpu else [""] * (len(_KINDS) + 1)), f"{cost.wall:.1f}")
        for cost in found
    ]
    return Table(
        "CPU milliseconds per call, one at a time, by kind of process; and wall milliseconds, median",
        ("operation", *_KINDS.values(), "all", "wall"),
        rows,
    )


def _thinking(found: Thinking) -> Table:
    rows = []
    slots = (("frozen between steps", found.frozen), ("not frozen", found.unfrozen))
    for (name, run), idle in zip(slots, found.idle, strict=True):
        rows.append(
            (
                name,
                f"{idle:.2f}",
                _ms(quantile(run.latencies, 0.5)),
                _ms(quantile(run.latencies, 0.95)),
                f"{run.rate:.1f}",
                f"{run.rate / found.allowed:.2f}",
                str(run.failures),
            )
        )
    if found.frozen.latencies and found.unfrozen.latencies:
        slower = quantile(found.unfrozen.latencies, 0.5) / quantile(found.frozen.latencies, 0.5)
        faster = found.frozen.rate / found.unfrozen.rate
        rows.append(("ratio", "", f"{slower:.1f}x", "", f"{faster:.1f}x", "", ""))
    return Table(
        f"{found.sessions} sessions on busy pages, {found.think_seconds:g} s of thinking per step "
        f"(which allows {found.allowed:.1f} steps/s)",
        (
            "slots",
            "processors, idle",
            "step p50, ms",
            "p95, ms",
            "steps/s",
            "of what thinking allows",
            "failed",
        ),
        rows,
    )


def _burst(found: Burst) -> Table:
    rows = [
        (name.replace("_", " "), _ms(quantile(waits, 0.5)), _ms(max(waits)))
        for name, waits in found.seconds.items()
    ]
    return Table(
        f"Screenshots that come behind a burst of {found.navigations} navigations",
        ("queue", "p50, ms", "slowest, ms"),
        rows,
    )


def _density(found: Density) -> Table:
    run = found.steps
    rows = [
        ("live sessions", str(found.sessions)),
        ("failed steps", f"{run.failures} of {run.steps}"),
        ("until all were ready, s", f"{found.ready_seconds:.0f}"),
        ("memory per further session (PSS), MB", f"{found.marginal / MEGABYTE:.0f}"),
        ("memory of all browsers, GB", f"{max(found.bytes.values()) / MEGABYTE / 1024:.1f}"),
        ("steps per second, half of them on busy pages", f"{run.rate:.1f}"),
        ("step p50 / p95, ms", _p50_p95(run.latencies)),
    ]
    return Table("Density", ("", "measured"), rows)
