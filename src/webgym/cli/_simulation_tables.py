"""The tables of ``webgym simulate``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from webgym.simulate.paper import Point
from webgym.simulate.sizing import Sized
from webgym.tables import Table


def paper_table(points: Iterable[Point]) -> Table:
    """The paper's figures, the model's, and the errors."""
    rows = []
    for point in points:
        told = "–"
        if point.told is not None:
            low, high = point.told
            told = f"{low:g}" if low == high else f"{low:g}–{high:g}"
        error = "–" if point.error is None else f"{point.error:+.1%}"
        kind = "fitted" if point.is_fitted else "predicted"
        rows.append((point.what, told, f"{point.found:.1f}", point.unit, error, kind))
    return Table("The paper's rollout system, simulated", ("", "paper", "model", "", "error", ""), rows)


def sizes_table(found: Sequence[Sized]) -> Table:
    """What every size does, what limits it, what one more of each thing buys, what it costs."""
    rows = []
    for one in found:
        ratios = (one.rates["async"] / one.rates[name] for name in ("step_barrier", "episode_barrier"))
        rows.append(
            (
                f"{one.cpus:,} / {one.gpus:g} / {one.environments:,}",
                f"{one.rates[one.schedule]:,.0f}",
                " / ".join(f"{ratio:.1f}" for ratio in ratios),
                f"{one.cpu:.0%} / {one.gpu:.0%}",
                one.bottleneck,
                f"{one.buys['cpus']:.1f}",
                f"{one.buys['gpus']:.1f}",
                f"{one.buys['environments']:.1f}",
                f"{one.per_thousand:.2f}",
            )
        )
    columns = (
        "CPUs / GPUs / environments",
        "trajectories per hour",
        "async over step / episode barrier",
        "CPU / GPU use",
        "bottleneck",
        "one more CPU",
        "one more GPU",
        "one more environment",
        "price of 1,000",
    )
    return Table("Steady state; one more of each: trajectories per hour that it adds", columns, rows)
