"""The tables of ``webgym simulate``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from webgym.core.tables import Table
from webgym.simulate.paper import Point
from webgym.simulate.sizing import Sized


def paper_table(points: Iterable[Point]) -> Table:
    """The paper's figures beside those of the model, with relative errors."""
    rows = []
    for point in points:
        paper = "–"
        if point.reported is not None:
            low, high = point.reported
            paper = f"{low:g}" if low == high else f"{low:g}–{high:g}"
        error = "–" if point.error is None else f"{point.error:+.1%}"
        kind = "fitted" if point.is_fitted else "predicted"
        rows.append((point.what, paper, f"{point.simulated:.1f}", point.unit, error, kind))
    return Table("The paper's rollout system, simulated", ("", "paper", "model", "", "error", ""), rows)


def sizes_table(results: Sequence[Sized]) -> Table:
    """Throughput, bottleneck, gain by one more of each resource, and price, for every size of a system."""
    rows = []
    for size in results:
        ratios = (size.rates["async"] / size.rates[name] for name in ("step_barrier", "episode_barrier"))
        rows.append(
            (
                f"{size.cpus:,} / {size.gpus:g} / {size.environments:,}",
                f"{size.rates[size.schedule]:,.0f}",
                " / ".join(f"{ratio:.1f}" for ratio in ratios),
                f"{size.cpu:.0%} / {size.gpu:.0%}",
                size.bottleneck,
                f"{size.buys['cpus']:.1f}",
                f"{size.buys['gpus']:.1f}",
                f"{size.buys['environments']:.1f}",
                f"{size.per_thousand:.2f}",
            )
        )
    columns = (
        "CPUs / GPUs / environments",
        "per hour",
        "async over step / episode barrier",
        "CPU / GPU use",
        "bottleneck",
        "one more CPU",
        "one more GPU",
        "one more environment",
        "price of 1,000",
    )
    return Table("Trajectories per hour in steady state, and how many one more of each adds", columns, rows)
