"""The figures of ``webgym simulate``, in a format that the file's suffix names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes

from webgym.plotting import CATEGORIES, MUTED, PAGE, new_figure, save, styled
from webgym.simulate.config import SCHEDULES, Schedule
from webgym.simulate.paper import Reproduced
from webgym.simulate.sizing import Sized

NAMES: Final[dict[Schedule, str]] = {
    "async": "async",
    "step_barrier": "step barrier",
    "episode_barrier": "episode barrier",
}
COLOURS: Final = dict(zip(SCHEDULES, CATEGORIES, strict=False))

_SHOWN_SECONDS: Final = 600.0
"""How much of a utilisation trace is drawn."""


def draw_paper(found: Reproduced, path: Path) -> None:
    """Time against CPUs, utilisation at 64 CPUs, throughput against GPUs.

    Raises:
        UsageError: the file cannot be written, or has no known suffix.
    """
    with styled():
        figure = new_figure(PAGE, 2.1)
        times, traces, gpus = figure.subplots(1, 3)
        for schedule in SCHEDULES:
            minutes = [at[schedule] for at in found.minutes.values()]
            _line(times, list(found.minutes), minutes, schedule)
        told = [(64, 48.6), (128, 30.0), (64, 264.0)]
        times.plot(*zip(*told, strict=True), "x", color="black", label="paper")
        _label(times, "Wall time of 1,800 trajectories", "CPUs", "minutes")
        times.set_xticks(list(found.minutes))
        times.set_ylim(0)
        for schedule in ("async", "step_barrier"):
            trace = found.traces[schedule].trace
            if trace is not None:
                shown = [at for at in trace.seconds if at <= _SHOWN_SECONDS]
                traces.plot(shown, trace.cpu[: len(shown)], color=COLOURS[schedule], linewidth=0.8)
        _label(traces, "Processors at work, 64 CPUs", "seconds", "share")
        gpus.plot(list(found.steps), list(found.steps.values()), "o-", color=COLOURS["async"], markersize=3)
        first = min(found.steps)
        linear = [found.steps[first] * count / first for count in found.steps]
        gpus.plot(list(found.steps), linear, ":", color=MUTED, label="linear")
        _label(gpus, "Throughput, 768 CPUs", "GPUs", "steps per second")
        gpus.set_ylim(0)
        times.legend(frameon=False, loc="center right")
        gpus.legend(frameon=False)
        save(figure, path)


def draw_sizes(found: Sequence[Sized], path: Path) -> None:
    """Trajectories per hour and price of a thousand, for every size, in the order given.

    Raises:
        UsageError: the file cannot be written, or has no known suffix.
    """
    with styled():
        figure = new_figure(PAGE, 2.3)
        rates, prices = figure.subplots(1, 2)
        names = [f"{one.cpus:,} CPUs\n{one.gpus:g} GPUs" for one in found]
        places = range(len(found))
        for schedule in SCHEDULES:
            _line(rates, places, [one.rates[schedule] for one in found], schedule)
        rates.set_yscale("log")
        _label(rates, "Throughput", "", "trajectories per hour")
        prices.bar(places, [one.per_thousand for one in found], color=COLOURS["async"], width=0.6)
        _label(prices, "Price of 1,000 trajectories", "", "")
        for axes in (rates, prices):
            axes.set_xticks(places, names)
        rates.legend(frameon=False)
        save(figure, path)


def _line(axes: Axes, across: Sequence[float], up: Sequence[float], schedule: Schedule) -> None:
    axes.plot(across, up, "o-", color=COLOURS[schedule], label=NAMES[schedule], markersize=3)


def _label(axes: Axes, title: str, across: str, up: str) -> None:
    axes.set_title(title)
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.grid(axis="y")
