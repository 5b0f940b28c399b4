"""``report.html`` of a training: success over time, training data, tasks before and after.

It reads ``metrics.jsonl`` and the run folders of the evaluations, and does not import ``webgym.train``.
"""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml

from webgym.core.errors import RunFolderError
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS
from webgym.report import formatting
from webgym.report.config import ReportConfig
from webgym.report.content import page
from webgym.report.curves import Curves, Line, Point, phase_bars
from webgym.report.template import Document, Page, outcome_words
from webgym.report.thumbnails import thumbnails
from webgym.report.write import ReportProgress, quiet, write_parts
from webgym.results.rates import Interval
from webgym.store.files import CONFIG, EVALUATIONS, METRICS, REPORT, disk_errors, refuse_special_files
from webgym.store.records import Entry
from webgym.store.runs import RunReader

_SCRIPTS: Final = ("dom.js", "theme.js", "stage.js", "training.js")
_SMOOTHING: Final = 0.5
"""Weight of the newest value in the moving average (SYSTEM.md 5.1: EMA 0.5)."""
_GROUPS: Final = ("overall", *LEVELS)
_RULES: Final = {
    "unrewarded": "attempts without a reward",
    "left_out": "attempts without an advantage",
    "unreadable": "replies without an action",
    "unchanged": "steps that changed nothing",
    "used_up": "steps used up",
    "stale": "steps of stale weights",
}
"""Labels of the counts of the replay."""


def _figure(*path: str) -> Callable[[Mapping[str, Any]], float | None]:
    """Returns a function that finds a figure in a row of the metrics; ``None`` if it has none."""

    def find(row: Mapping[str, Any]) -> float | None:
        value: Any = row
        for key in path:
            value = value.get(key) if value else None
        return None if value is None else float(value)

    return find


class Pair(NamedTuple):
    """The same sample of a task in two evaluations."""

    before: Entry
    after: Entry

    @property
    def rank(self) -> int:
        """Order of display: newly solved, no longer solved, solved both times, solved neither time."""
        won = (self.before.outcome is Outcome.SUCCESS, self.after.outcome is Outcome.SUCCESS)
        return [(False, True), (True, False), (True, True), (False, False)].index(won)


class Training:
    """The contents of a training folder; the training may still be going on.

    Raises:
        RunFolderError: it is not a training, or its figures cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        refuse_special_files(path, path / EVALUATIONS)
        try:
            with disk_errors(f"reading {path}"):
                self.config: dict[str, Any] = yaml.safe_load((path / CONFIG).read_text())
                lines = (path / METRICS).read_bytes().splitlines() if (path / METRICS).exists() else []
                self.rows: list[dict[str, Any]] = [json.loads(line) for line in lines]
                self.evaluations: dict[int, dict[str, Any]] = {
                    int(file.stem): json.loads(file.read_bytes())
                    for file in sorted(path.glob(f"{EVALUATIONS}/*.json"))
                }
        except (ValueError, yaml.YAMLError) as error:
            raise RunFolderError(f"{path} cannot be read: {' '.join(str(error).split())}") from error

    # --- curves ---------------------------------------------------------------------------------------------

    def _line(
        self, name: str, value: Callable[[Mapping[str, Any]], float | None], smoothing: float = 1.0
    ) -> Line:
        """A value of every iteration, over the number of trajectories collected until its end."""
        pairs = ((row["trajectories"], value(row)) for row in self.rows)
        return Line(name, [Point(x, y) for x, y in pairs if y is not None], smoothing)

    def _tested(self) -> list[Line]:
        """Success rates of the evaluations, over the number of trajectories collected before each."""
        collected = {0: 0} | {row["iteration"]: row["trajectories"] for row in self.rows}
        points: dict[str, list[Point]] = {group: [] for group in _GROUPS}
        for number, metrics in self.evaluations.items():
            for group in _GROUPS:
                rate, interval = metrics["success_rate"][group], metrics["success_interval"][group]
                if rate is not None and number in collected:
                    points[group].append(Point(collected[number], rate, interval))
        return [Line(group.capitalize(), series) for group, series in points.items()]

    def curves(self) -> dict[str, Curves]:
        """All line charts, by title."""

        share, number = formatting.percent, formatting.number
        # Not every policy reports tokens.
        unit = "tokens" if any(row["collect"]["reply_tokens"] for row in self.rows) else "characters"
        charts = {
            "Success on unseen test tasks": Curves(
                "Success on test tasks", self._tested(), share, whole=True
            ),
            "Success while collecting": Curves(
                "Success on training tasks, moving average",
                [
                    self._line(group.capitalize(), _figure("collect", "success_rate", group), _SMOOTHING)
                    for group in _GROUPS
                ],
                share,
                whole=True,
            ),
            "Steps per trajectory": Curves(
                "Steps per trajectory",
                [self._line("Steps", _figure("collect", "steps_per_trajectory"))],
                number,
            ),
            "Steps that changed nothing on the screen": Curves(
                "Share of unchanged screenshots",
                [self._line("Unchanged", _figure("collect", "unchanged_share"))],
                share,
                whole=True,
            ),
            f"Reply length, {unit}": Curves(
                f"Length of replies, {unit}",
                [self._line("Reply", _figure("collect", f"reply_{unit}"))],
                number,
            ),
            "Blocked attempts": Curves(
                "Share of blocked attempts",
                [self._line("Blocked", _figure("collect", "blocked_share"))],
                share,
                whole=True,
            ),
            "Loss": Curves(
                "Loss", [self._line("Loss", _figure("update", "loss"))], lambda value: f"{value:.3g}"
            ),
            "Gradient norm before clipping": Curves(
                "Gradient norm",
                [self._line("Norm", _figure("update", "grad_norm"))],
                lambda value: f"{value:.3g}",
            ),
        }
        return {title: curves for title, curves in charts.items() if not curves.is_empty}

    def dropped(self) -> list[tuple[int, int, dict[str, int]]]:
        """For each iteration, the number of steps trained on, and the numbers left out by each rule."""
        rows = []
        for row in self.rows:
            replay, update = row["replay"], row["update"]
            counts = {**replay["counts"], **replay}
            left_out = {label: int(counts.get(name, 0)) for name, label in _RULES.items()}
            rows.append((row["iteration"], update.get("samples", 0), left_out | update.get("dropped", {})))
        return rows

    # --- before and after -----------------------------------------------------------------------------------

    @cached_property
    def compared(self) -> tuple[int, int] | None:
        """The numbers of the first and the last evaluation; ``None`` if there are fewer than two."""
        numbers = sorted(self.evaluations)
        return (numbers[0], numbers[-1]) if len(numbers) > 1 else None

    def evaluation(self, number: int) -> RunReader:
        """The run of an evaluation."""
        return RunReader(self.path / EVALUATIONS / f"{number:04d}", skip_corrupt=True)

    def pairs(self) -> list[Pair]:
        """The samples of tasks that were judged in both evaluations, in the order of :attr:`Pair.rank`."""
        if self.compared is None:
            return []
        before, after = (self._judged(number) for number in self.compared)
        pairs = [Pair(entry, after[key]) for key, entry in before.items() if key in after]
        return sorted(pairs, key=lambda pair: (pair.rank, pair.before.task_id, pair.before.sample))

    def _judged(self, number: int) -> dict[tuple[str, int], Entry]:
        entries = self.evaluation(number).attempts.values()
        return {(entry.task_id, entry.sample): entry for entry in entries if entry.outcome.is_rewarded}


def write_training_report(
    path: Path, *, config: ReportConfig | None = None, progress: ReportProgress = quiet
) -> Path:
    """Write the report of a training, which may still be going on. Blocks.

    Args:
        path: the training folder.
        config: settings of the report.
        progress: called with the progress.

    Returns:
        Path of ``report.html`` in the folder.

    Raises:
        RunFolderError: the folder is not a training.
        StoreFull: there is no space.
    """
    training = Training(path)
    return write_parts(path / REPORT, _parts(training, config or ReportConfig(), progress))


def _parts(training: Training, config: ReportConfig, progress: ReportProgress) -> Iterator[str]:
    title = training.path.resolve().name
    pairs = training.pairs()
    shown = pairs[: config.pairs]
    homes = [f"{EVALUATIONS}/{number:04d}" for number in training.compared or ()]
    document = Document(title, _SCRIPTS, {"outcomes": outcome_words(), "homes": homes}, live=False)
    yield document.render("training.html.j2", **_context(training, title, pairs), pairs_shown=len(shown))
    names: list[dict[str, None]] = [{}, {}]
    if training.compared:
        readers = [training.evaluation(number) for number in training.compared]
        for number, pair in enumerate(shown):
            sides = []
            for side, reader, entry in zip(names, readers, pair, strict=True):
                trajectory = reader.trajectory(entry.attempt_id)
                side |= dict.fromkeys(
                    observation.screenshot for observation in trajectory.episode.observations
                )
                sides.append(page(trajectory, reader.tasks.get(entry.task_id)))
            yield Page.data(f"pair-{number}", sides)
        for number, (reader, side) in enumerate(zip(readers, names, strict=True)):
            half = config.model_copy(update={"image_budget_bytes": config.image_budget_bytes // 2})
            wanted = side if number == 0 else {name: None for name in side if name not in names[0]}
            for count, small in enumerate(thumbnails(reader.path, wanted, half)):
                yield Page.picture(small.name, small.data)
                progress("pictures", count + 1, len(wanted))
    yield document.tail()


def _context(training: Training, title: str, pairs: Sequence[Pair]) -> dict[str, Any]:
    """The variables of the template."""
    rows, config = training.rows, training.config
    first, last = (training.evaluations[n] for n in training.compared) if training.compared else (None, None)
    phases = [(str(row["iteration"]), row["seconds"]) for row in rows]
    changes = Counter(pair.rank for pair in pairs)
    loop = config.get("loop") or {}
    return {
        "name": title,
        "folder": shlex.quote(str(training.path)),
        "model": (config.get("learn") or {}).get("model", "–"),
        "objective": ((config.get("learn") or {}).get("objective") or {}).get("name", "–"),
        "seed": config.get("seed", "–"),
        "wanted": loop.get("iterations"),
        "rows": rows,
        "first": first,
        "last": last,
        "compared": training.compared,
        "rise": _rise(first, last),
        "apart": _do_not_overlap(first, last),
        "samples": sum(row["update"].get("samples", 0) for row in rows),
        "seconds": sum(sum(row["seconds"].values()) for row in rows),
        "curves": training.curves(),
        "dropped": training.dropped(),
        "rules": list(
            dict.fromkeys(
                label for _, _, left_out in training.dropped() for label, n in left_out.items() if n
            )
        ),
        "phases": list(dict.fromkeys(phase for _, parts in phases for phase in parts)),
        "phase_bars": phase_bars(phases, formatting.duration),
        "pairs": pairs,
        "changes": [changes[rank] for rank in range(4)],
    }


def _rise(first: Mapping[str, Any] | None, last: Mapping[str, Any] | None) -> float | None:
    if first is None or last is None:
        return None
    before, after = first["success_rate"]["overall"], last["success_rate"]["overall"]
    return None if before is None or after is None else after - before


def _do_not_overlap(first: Mapping[str, Any] | None, last: Mapping[str, Any] | None) -> bool:
    """Whether the two success intervals do not overlap."""
    ends: list[Interval | None] = [
        evaluation["success_interval"]["overall"] if evaluation else None for evaluation in (first, last)
    ]
    before, after = ends
    return before is not None and after is not None and (before[1] < after[0] or after[1] < before[0])
