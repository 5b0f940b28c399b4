"""Figures for TensorBoard and Weights & Biases: the numbers of a run's or a training's ``metrics.jsonl``.

Both are made from the lines on disk whenever a run or a training starts or goes on, so that they never say
anything else than the folder does. TensorBoard's files are in its subfolder ``tensorboard``. The step of a
training is its iteration, that of a run the number of the line.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import itertools
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from webgym.core.errors import ConfigError
from webgym.rollout.files import disk_errors

TrackerName: TypeAlias = Literal["tensorboard", "wandb"]
Log: TypeAlias = Callable[[int, Mapping[str, float]], None]

FOLDER: Final = "tensorboard"


@contextmanager
def tracking(
    names: Sequence[TrackerName], path: Path, project: str, rows: Sequence[Mapping[str, Any]]
) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Trackers of a run or a training, with what it has told so far in them.

    Args:
        names: which.
        path: its folder.
        project: in Weights & Biases.
        rows: of ``metrics.jsonl``.

    Yields:
        What takes each further row.

    Raises:
        ConfigError: a tracker is not installed, or does not start.
    """
    logs: list[Log] = []
    ends: list[Callable[[], object]] = []
    counted = itertools.count(1)

    def track(row: Mapping[str, Any]) -> None:
        numbers, number = dict(numbers_in(row)), next(counted)
        for log in logs:
            with disk_errors("writing figures for a tracker"):
                log(int(row.get("iteration", number)), numbers)

    try:
        for name in names:
            log, end = _OPEN[name](path, project)
            logs.append(log)
            ends.append(end)
        for row in rows:
            track(row)
        yield track
    finally:
        for end in ends:
            end()


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

    def log(step: int, numbers: Mapping[str, float]) -> None:
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
    return lambda step, numbers: run.log(dict(numbers), step=step), run.finish


_OPEN: Final[dict[TrackerName, Callable[[Path, str], tuple[Log, Callable[[], object]]]]] = {
    "tensorboard": _tensorboard,
    "wandb": _wandb,
}
