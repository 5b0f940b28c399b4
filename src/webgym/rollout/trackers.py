"""Figures for TensorBoard and Weights & Biases: the numbers of a run's or a training's ``metrics.jsonl``.

Both are made from the lines on disk whenever a run or a training starts or goes on, so that they never say
anything else than the folder does. TensorBoard's files are in its subfolder ``tensorboard``. The step of a
training is its iteration, that of a run the number of the line. Nobody waits for a tracker, and one that
fails stops nothing.
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
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from webgym.core.errors import ConfigError
from webgym.rollout.files import disk_errors

TrackerName: TypeAlias = Literal["tensorboard", "wandb"]
Log: TypeAlias = Callable[[int, Mapping[str, float], str], None]
"""Takes a step's numbers, and what must be read with them from then on; empty for nothing new."""

FOLDER: Final = "tensorboard"

CLOSE_SECONDS: Final = 60.0
"""How long the end of a run waits for a tracker that still writes or sends."""


class _Tracker:
    """One of them, in a thread of its own, which no process waits for when it ends."""

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
        """Wait until it has all, and end it; one that takes too long is left behind, and that is told."""
        self._jobs.put(self._end)
        self._jobs.put(None)
        self._thread.join(CLOSE_SECONDS)
        if self._thread.is_alive():
            self._fail(f"it did not end within {CLOSE_SECONDS:g} s")

    def _work(self) -> None:
        while job := self._jobs.get():
            try:
                job()
            except Exception as error:  # of their own kinds, and whatever the disk or the network says
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
    """Trackers of a run or a training, with what it has told so far in them.

    Args:
        names: which.
        path: its folder.
        project: in Weights & Biases.
        rows: of ``metrics.jsonl``.
        failed: is told, in a thread of the tracker's, when one fails; it gets nothing more then.

    Yields:
        What takes each further row. Never blocks.

    Raises:
        ConfigError: a tracker is not installed, or does not start.
    """
    trackers: list[_Tracker] = []
    counted, told = itertools.count(1), set[str]()

    def track(row: Mapping[str, Any]) -> None:
        numbers, number, note = dict(numbers_in(row)), next(counted), row.get("note", "")
        for tracker in trackers:
            tracker.log(int(row.get("iteration", number)), numbers, "" if note in told else note)
        told.add(note)

    with ExitStack() as stack:
        for name in names:
            tracker = _Tracker(name, *_OPEN[name](path, project), failed)
            stack.callback(tracker.close)
            trackers.append(tracker)
        for row in rows:
            track(row)
        yield track


def check_installed(names: Sequence[TrackerName]) -> None:
    """Be sure that trackers can be imported, before anything is made.

    Raises:
        ConfigError: one is not installed.
    """
    for name in names:
        if importlib.util.find_spec(name) is None:
            raise _MISSING[name]()


def numbers_in(row: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, float]]:
    """All numbers of a row by their path, such as ``collect/success_rate/easy``; of intervals both ends."""
    for key, value in row.items():
        name = f"{above}{key}"
        if isinstance(value, Mapping):
            yield from numbers_in(value, f"{name}/")
        elif isinstance(value, list | tuple):
            yield from numbers_in(dict(zip(("low", "high"), value, strict=False)), f"{name}/")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield name, float(value)


def _no_tensorboard() -> ConfigError:
    hint = "pip install 'webgym-rl[train]', or leave it out of `trackers`"
    return ConfigError("TensorBoard is not installed", hint=hint)


def _no_wandb() -> ConfigError:
    hint = "pip install wandb, or leave it out of `trackers`"
    return ConfigError("Weights & Biases is not installed", hint=hint)


_MISSING: Final[dict[TrackerName, Callable[[], ConfigError]]] = {
    "tensorboard": _no_tensorboard,
    "wandb": _no_wandb,
}


def _tensorboard(path: Path, project: str) -> tuple[Log, Callable[[], object]]:  # noqa: ARG001
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise _no_tensorboard() from error
    shutil.rmtree(path / FOLDER, ignore_errors=True)
    with disk_errors("writing figures for TensorBoard"):
        writer: Any = SummaryWriter(str(path / FOLDER))

    def log(step: int, numbers: Mapping[str, float], note: str) -> None:
        if note:
            writer.add_text("note", note, step)
        for name, value in numbers.items():
            writer.add_scalar(name, value, step)
        writer.flush()

    return log, writer.close


def _wandb(path: Path, project: str) -> tuple[Log, Callable[[], object]]:
    try:
        wandb = importlib.import_module("wandb")
    except ImportError as error:
        raise _no_wandb() from error
    known = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16]
    try:
        run = wandb.init(project=project, name=path.resolve().name, id=known, resume="allow", dir=str(path))
    except Exception as error:  # its own kinds, which differ by version
        reason = " ".join(str(error).split())[:200]
        raise ConfigError(
            f"Weights & Biases does not start: {reason}", hint="WANDB_MODE=offline needs no account"
        ) from error

    def log(step: int, numbers: Mapping[str, float], note: str) -> None:
        if note:
            run.notes = note
        run.log(dict(numbers), step=step)

    return log, run.finish


_OPEN: Final[dict[TrackerName, Callable[[Path, str], tuple[Log, Callable[[], object]]]]] = {
    "tensorboard": _tensorboard,
    "wandb": _wandb,
}
