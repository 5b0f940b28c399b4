"""Sends the numbers in a run's or a training's ``metrics.jsonl`` to TensorBoard and Weights & Biases.

When a run or a training starts or is resumed, all lines on disk are sent again, so that trackers agree with
the folder. TensorBoard's files are in the subfolder ``tensorboard``. The step of a training is its
iteration, that of a run the line number. Weights & Biases shows a training over the trajectories
collected, and a table of some of them with pictures. Trackers run in the background, and their failures stop
nothing.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import itertools
import queue
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from webgym.core.errors import ConfigError
from webgym.core.outcome import Outcome
from webgym.store.files import ITERATIONS, disk_errors
from webgym.store.runs import RunReader

TrackerName: TypeAlias = Literal["tensorboard", "wandb"]
Log: TypeAlias = Callable[[int, Mapping[str, float], str], None]
"""Takes a step, its numbers, and a new note about the figures; the note is empty if there is none."""

FOLDER: Final = "tensorboard"

CLOSE_SECONDS: Final = 60.0
"""How long the end of a run waits for a tracker that is still writing or sending."""


class _Tracker:
    """A tracker in its own daemon thread."""

    def __init__(
        self, name: str, log: Log, end: Callable[[], object], failed: Callable[[str], object]
    ) -> None:
        self._name, self._log, self._end, self._failed = name, log, end, failed
        self._has_failed = False
        self._jobs: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name=f"tracker-{name}", daemon=True)
        self._thread.start()

    def log(self, step: int, numbers: Mapping[str, float], note: str) -> None:
        if not self._has_failed:
            self._jobs.put(lambda: self._log(step, numbers, note))

    def close(self) -> None:
        """Wait until everything is sent, and end the tracker; report a failure if that takes too long."""
        self._jobs.put(self._end)
        self._jobs.put(None)
        self._thread.join(CLOSE_SECONDS)
        if self._thread.is_alive():
            self._fail(f"it did not end within {CLOSE_SECONDS:g} s")

    def _work(self) -> None:
        while job := self._jobs.get():
            try:
                job()
            except Exception as error:  # trackers' own errors, and those of the disk or the network
                self._fail(" ".join(f"{type(error).__name__}: {error}".split())[:200])

    def _fail(self, reason: str) -> None:
        if not self._has_failed:
            self._has_failed = True
            self._failed(f"{self._name} gets no more figures until this is resumed with --resume: {reason}")


@contextmanager
def tracking(
    names: Sequence[TrackerName],
    path: Path,
    project: str,
    rows: Sequence[Mapping[str, Any]],
    failed: Callable[[str], object],
) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Open trackers of a run or a training, and send them the lines so far.

    Args:
        names: of the trackers.
        path: the run's or training's folder.
        project: name in Weights & Biases.
        rows: the lines of ``metrics.jsonl`` so far.
        failed: called with a message, in the tracker's thread, when a tracker fails; it gets nothing more.

    Yields:
        A function that takes each further row. It never blocks.

    Raises:
        ConfigError: a tracker is not installed, or does not start.
    """
    trackers: list[_Tracker] = []
    counted, noted = itertools.count(1), set[str]()

    def track(row: Mapping[str, Any]) -> None:
        numbers, number, note = dict(numbers_in(row)), next(counted), row.get("note", "")
        for tracker in trackers:
            tracker.log(int(row.get("iteration", number)), numbers, "" if note in noted else note)
        noted.add(note)

    with ExitStack() as stack:
        for name in names:
            try:
                opened = _OPEN[name](path, project)
            except ImportError as error:
                raise _missing(name) from error
            tracker = _Tracker(name, *opened, failed)
            stack.callback(tracker.close)
            trackers.append(tracker)
        for row in rows:
            track(row)
        yield track


def check_installed(names: Sequence[TrackerName]) -> None:
    """Check that trackers are installed.

    Raises:
        ConfigError: one is not installed.
    """
    for name in names:
        if importlib.util.find_spec(name) is None:
            raise _missing(name)


def numbers_in(row: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """All numbers of a row by path, such as ``collect/success_rate/easy``; intervals give ``low`` and
    ``high``."""
    for key, value in row.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from numbers_in(value, f"{name}/")
        elif isinstance(value, list | tuple):
            yield from numbers_in(dict(zip(("low", "high"), value, strict=False)), f"{name}/")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield name, float(value)


_INSTALLED_BY: Final[dict[TrackerName, tuple[str, str]]] = {
    "tensorboard": ("TensorBoard", "pip install 'webgym-rl[train]', or leave it out of `trackers`"),
    "wandb": ("Weights & Biases", "pip install wandb, or leave it out of `trackers`"),
}


def _missing(name: TrackerName) -> ConfigError:
    product, hint = _INSTALLED_BY[name]
    return ConfigError(f"{product} is not installed", hint=hint)


def _tensorboard(path: Path, project: str) -> tuple[Log, Callable[[], object]]:  # noqa: ARG001
    from torch.utils.tensorboard import SummaryWriter

    shutil.rmtree(path / FOLDER, ignore_errors=True)
    with disk_errors("writing figures for TensorBoard"):
        writer: Any = SummaryWriter(str(path / FOLDER))

    def log(step: int, numbers: Mapping[str, float], note: str) -> None:
        at = numbers.get("at")  # when it was measured: rows on disk are sent again later
        if note:
            writer.add_text("note", note, step, at)
        for name, value in numbers.items():
            writer.add_scalar(name, value, step, at)
        writer.flush()

    return log, writer.close


def _wandb(path: Path, project: str) -> tuple[Log, Callable[[], object]]:
    wandb = importlib.import_module("wandb")
    run_id = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16]
    try:
        run = wandb.init(project=project, name=path.resolve().name, id=run_id, resume="allow", dir=str(path))
    except Exception as error:  # wandb's errors differ by version
        reason = " ".join(str(error).split())[:200]
        raise ConfigError(
            f"Weights & Biases does not start: {reason}", hint="WANDB_MODE=offline needs no account"
        ) from error

    @cache
    def name_axis() -> None:
        run.define_metric(_AXIS)
        run.define_metric("*", step_metric=_AXIS)

    def log(step: int, numbers: Mapping[str, float], note: str) -> None:
        if note:
            run.notes = note
        collected = path / ITERATIONS / f"{step:04d}" / "run"
        table: dict[str, Any] = {}
        if _AXIS in numbers:  # of a training
            name_axis()
            table = {"attempts": _table(wandb, collected)} if collected.is_dir() else {}
        run.log({**numbers, **table}, step=step)

    return log, run.finish


_AXIS: Final = "trajectories"
_TABLE_ROWS: Final = 8


def _table(wandb: Any, path: Path) -> Any:
    """Attempts of a run, half of them successes if there are so many, with their first and last picture."""
    run = RunReader(path, skip_corrupt=True)
    rewarded = [entry for entry in run.attempts.values() if entry.outcome.is_rewarded]
    won = [entry for entry in rewarded if entry.outcome is Outcome.SUCCESS][: _TABLE_ROWS // 2]
    lost = [entry for entry in rewarded if entry.outcome is not Outcome.SUCCESS][: _TABLE_ROWS - len(won)]
    table = wandb.Table(columns=["task", "outcome", "steps", "last reply", "first picture", "last picture"])
    for trajectory in run.trajectories(entry.attempt_id for entry in [*won, *lost]):
        steps = trajectory.episode.steps
        pictures = [
            wandb.Image(str(run.image_path(observation.screenshot)))
            for observation in (steps[0].observation, steps[-1].observation)
        ]
        task = run.tasks[trajectory.episode.task_id].instruction
        table.add_data(task, trajectory.outcome.value, len(steps), steps[-1].reply.text, *pictures)
    return table


_OPEN: Final[dict[TrackerName, Callable[[Path, str], tuple[Log, Callable[[], object]]]]] = {
    "tensorboard": _tensorboard,
    "wandb": _wandb,
}
