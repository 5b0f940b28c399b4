"""A training run on disk. Its files alone determine its progress.

TRAINING/
  config.yaml                the resolved config
  iterations/0001/
    tasks.jsonl              stage 1, sample: the tasks, in the order drawn
    sampler.json             state of the sampler and of the frontier afterwards
    run/                     stage 2, collect: an ordinary run folder, resumable
    collected.json           its figures, written once every attempt is on disk
    batch.jsonl              stage 3, replay: references to the steps that are trained on
    replay.json              counts of what each replay rule left out
    weights/                 stage 4, update: weights and optimizer (webgym.train.weights); of old iterations
                             only the weights with the best evaluation stay
    update.json              figures of the update; there are no weights if there was nothing to train on
    metrics.json             stage 5, finish: all figures above, with the duration of each stage
  evaluations/0000/          run folders on the test split; 0000 is before the first iteration
  metrics.jsonl, tensorboard/, report.html    derived from the above
  stopped                    when the training stopped because its time was over; deleted once it goes on

With ``loop.staleness`` above 0, stages 3 and 4 may be done while stragglers of stage 2 still run.
"""

from __future__ import annotations

import json
import shlex
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import msgspec

from webgym.core.consent import remember
from webgym.core.errors import RunFolderError
from webgym.core.task import Task
from webgym.store.files import (
    CONFIG,
    EVALUATIONS,
    ITERATIONS,
    METRICS,
    TASKS,
    TORN,
    delete_torn,
    disk_errors,
    locked,
    make_folder,
    write_whole,
)
from webgym.train.replay import ReplaySample, StepRef

TRAINING: Final = "training"
"""What training goes on from, within a folder of weights."""


class Stage(StrEnum):
    """The stages of an iteration, in order."""

    SAMPLE = "sample"
    COLLECT = "collect"
    REPLAY = "replay"
    UPDATE = "update"
    FINISH = "finish"


STOPPED = "stopped"
_DONE = {
    Stage.SAMPLE: "sampler.json",
    Stage.COLLECT: "collected.json",
    Stage.REPLAY: "replay.json",
    Stage.UPDATE: "update.json",
    Stage.FINISH: "metrics.json",
}
"""The file that each stage writes last."""


class TrainingFolder:
    """The folder of a training run: reads and writes its files.

    Args:
        path: of the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def iteration(self, number: int) -> Path:
        """The folder of an iteration, from 1."""
        return self.path / ITERATIONS / f"{number:04d}"

    def run(self, number: int) -> Path:
        """The run folder of an iteration."""
        return self.iteration(number) / "run"

    def weights(self, number: int) -> Path:
        """The weights folder of an iteration, which may have been deleted."""
        return self.iteration(number) / "weights"

    def evaluation(self, number: int) -> Path:
        """The run folder of the evaluation after an iteration; 0 is before the first."""
        return self.path / EVALUATIONS / f"{number:04d}"

    def is_evaluated(self, number: int) -> bool:
        """Whether an evaluation is complete on disk."""
        return (self.evaluation(number).with_suffix(".json")).exists()

    def stage(self, number: int) -> Stage | None:
        """The next stage of an iteration; ``None`` if it is finished."""
        folder = self.iteration(number)
        return next((stage for stage, name in _DONE.items() if not (folder / name).exists()), None)

    def is_past(self, number: int, stage: Stage) -> bool:
        """Whether an iteration has completed a stage."""
        return (self.iteration(number) / _DONE[stage]).exists()

    @property
    def stopped(self) -> str:
        """What tells a stop for lack of time from any other; empty if the training did not stop so."""
        file = self.path / STOPPED
        return file.read_text() if file.exists() else ""

    def mark_stopped(self, is_stopped: bool) -> None:
        """Write down that the training stopped for lack of time, or that it goes on."""
        if is_stopped:
            with disk_errors(f"writing {STOPPED}"):
                write_whole(self.path / STOPPED, _json({"at": time.time()}))
        else:
            (self.path / STOPPED).unlink(missing_ok=True)

    def latest_weights(self) -> tuple[int, Path] | None:
        """The iteration and folder of the newest weights; ``None`` before the first update."""
        states = sorted(self.path.glob(f"{ITERATIONS}/*/weights/state.json"))
        made = [path for path in states if (path.parent.parent / _DONE[Stage.UPDATE]).exists()]
        return (int(made[-1].parent.parent.name), made[-1].parent) if made else None

    def learned(self, number: int) -> int:
        """The newest iteration up to this one that made weights; 0 if there is none."""
        past = (each for each in range(number, 0, -1) if self.is_past(each, Stage.UPDATE))
        return next((each for each in past if self.figures(each, Stage.UPDATE)), 0)

    def best_weights(self) -> Path | None:
        """The folder of the weights with the highest success rate of all evaluations; of equals the newest.

        ``None`` if none was evaluated since the first update.
        """
        best: tuple[float, Path] | None = None
        for number, figures in self.evaluations().items():
            path = self.weights(self.learned(number))
            rate = figures["success_rate"]["overall"]
            if path.is_dir() and rate is not None and (best is None or rate >= best[0]):
                best = rate, path
        return best and best[1]

    def prune_weights(self, keep: int, finished: int) -> None:
        """Delete weights but the newest and the best, and what training would go on from but the newest.

        Args:
            keep: number of newest iterations whose weights stay, of those that are finished.
            finished: the last one; later weights stay.
        """
        folders, best = sorted(self.path.glob(f"{ITERATIONS}/*/weights")), self.best_weights()
        old = [path for path in folders if int(path.parent.name) <= finished]
        for path in old[:-keep]:
            if path != best:
                shutil.rmtree(path, ignore_errors=True)
        for path in folders[:-1]:
            shutil.rmtree(path / TRAINING, ignore_errors=True)

    # --- what stages write and read ---------------------------------------------------------------------

    def refuse_used(self) -> None:
        """Refuse a folder that is in use.

        Raises:
            RunFolderError: it holds more than the leftovers of a failed start.
        """
        with disk_errors(f"reading {self.path}"):
            entries = list(self.path.iterdir()) if self.path.exists() else []
        if any(not entry.name.endswith((TORN, ".log")) for entry in entries):
            is_begun = (self.path / CONFIG).is_file() and not (self.path / TASKS).is_file()
            command = f"webgym train --resume {shlex.quote(str(self.path))}"
            resume = f"{command} continues what it holds; or " if is_begun else ""
            raise RunFolderError(f"{self.path} is not empty", hint=f"{resume}choose another folder")

    def create(self, config: Mapping[str, Any]) -> None:
        """Create the folder.

        Raises:
            RunFolderError: the folder is not empty.
        """
        import yaml

        self.refuse_used()
        make_folder(self.path)
        with disk_errors(f"making {self.path}"):
            text = yaml.safe_dump(dict(config), sort_keys=False, allow_unicode=True)
            write_whole(self.path / CONFIG, text.encode())
        remember(config, self.path / CONFIG)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder for this process; incomplete files of a crashed process are deleted.

        Raises:
            StoreLocked: another process trains in it.
        """
        with locked(self.path):
            with disk_errors(f"clearing {self.path}"):
                delete_torn(self.path, "", f"{ITERATIONS}/*/", f"{EVALUATIONS}/")
            yield

    def write_sample(self, number: int, tasks: Sequence[Task], sampler: Mapping[str, Any]) -> None:
        """Write the results of stage 1: drawn tasks and sampler state."""
        folder = self._ensure_folder(number)
        _write_lines(folder / "tasks.jsonl", tasks)
        self.write(number, _DONE[Stage.SAMPLE], sampler)

    def tasks(self, number: int) -> list[Task]:
        """The tasks that stage 1 drew."""
        lines = (self.iteration(number) / "tasks.jsonl").read_bytes().splitlines()
        return [msgspec.json.decode(line, type=Task) for line in lines]

    def write_batch(self, number: int, draw: ReplaySample) -> None:
        """Write the results of stage 3."""
        _write_lines(self._ensure_folder(number) / "batch.jsonl", draw.steps)
        counts = msgspec.to_builtins(msgspec.structs.replace(draw, steps=()), str_keys=True)
        self.write(number, _DONE[Stage.REPLAY], {"drawn": len(draw.steps), **counts})

    def draw(self, number: int) -> ReplaySample:
        """The results of stage 3."""
        figures = self.figures(number, Stage.REPLAY)
        figures.pop("drawn")
        return msgspec.convert(figures | {"steps": self.batch(number)}, ReplaySample, strict=False)

    def batch(self, number: int) -> list[StepRef]:
        """The steps that stage 3 drew."""
        lines = (self.iteration(number) / "batch.jsonl").read_bytes().splitlines()
        return [msgspec.json.decode(line, type=StepRef) for line in lines]

    def finish(self, number: int, stage: Stage, figures: Mapping[str, Any]) -> None:
        """Write the file that ends a stage."""
        self.write(number, _DONE[stage], figures)

    def figures(self, number: int, stage: Stage) -> dict[str, Any]:
        """The figures that a stage wrote at its end."""
        data: dict[str, Any] = json.loads((self.iteration(number) / _DONE[stage]).read_bytes())
        return data

    def write(self, number: int, name: str, value: Mapping[str, Any]) -> None:
        """Write a JSON file of an iteration atomically."""
        with disk_errors(f"writing {name} of iteration {number}"):
            write_whole(self._ensure_folder(number) / name, _json(value))

    def write_evaluation(self, number: int, figures: Mapping[str, Any]) -> None:
        """Write an evaluation's figures, which marks it as complete."""
        with disk_errors(f"writing the evaluation after iteration {number}"):
            write_whole(self.evaluation(number).with_suffix(".json"), _json(figures))

    def evaluations(self) -> dict[int, dict[str, Any]]:
        """All evaluations by the iteration that they follow."""
        paths = sorted(self.path.glob(f"{EVALUATIONS}/*.json"))
        return {int(path.stem): json.loads(path.read_bytes()) for path in paths}

    def write_metrics(self) -> list[dict[str, Any]]:
        """Write and return ``metrics.jsonl``: a line per finished iteration, with the evaluation after it."""
        evaluations = self.evaluations()
        rows = []
        for path in sorted(self.path.glob(f"{ITERATIONS}/*/{_DONE[Stage.FINISH]}")):
            row = json.loads(path.read_bytes())
            rows.append(row | {"evaluation": evaluations.get(row["iteration"])})
        with disk_errors("writing metrics"):
            write_whole(self.path / METRICS, b"".join(msgspec.json.encode(row) + b"\n" for row in rows))
        return rows

    def _ensure_folder(self, number: int) -> Path:
        folder = self.iteration(number)
        with disk_errors(f"making {folder}"):
            folder.mkdir(parents=True, exist_ok=True)
        return folder


def _write_lines(path: Path, items: Sequence[Any]) -> None:
    with disk_errors(f"writing {path.name}"):
        write_whole(path, b"".join(msgspec.json.encode(item) + b"\n" for item in items))


def _json(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value, ensure_ascii=False, indent=1).encode() + b"\n"
