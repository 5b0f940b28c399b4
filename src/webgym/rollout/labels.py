"""People's labels of a run, kept while they label.

One small file, which is written anew, whole or not at all, with every label: kill -9 loses nothing that was
acknowledged. Several viewers may write to it, for each reads it again under a lock before it writes.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path

from webgym.core.errors import UsageError
from webgym.core.task import LEVELS
from webgym.judge.labels import HumanLabel, Label, LabelFile, read_labels, render_labels
from webgym.rollout.files import disk_errors, sync_folder, write_whole
from webgym.rollout.store import RunReader

__all__ = ["LABELS", "HumanLabel", "Label", "LabelBook", "labels_path", "sample_to_label"]

LABELS = "labels.csv"


def labels_path(run: Path) -> Path:
    """Where a run's labels lie unless somebody says otherwise."""
    return run / LABELS


class LabelBook:
    """A file of labels that is written to. Blocks: call it from a thread, one call at a time.

    Args:
        path: CSV, or JSON by its name; need not be there yet.

    Raises:
        UsageError: it is there, and writing it again would lose something that stands in it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._check(self._read())

    def labels(self) -> list[HumanLabel]:
        """What the file holds now."""
        return self._read().labels

    def put(self, label: HumanLabel) -> None:
        """Write down a label: on disk when this returns. It takes the place of the person's earlier one.

        Raises:
            StoreFull: there is no space; the file is as it was.
            UsageError: somebody wrote something else to the file meanwhile.
        """
        with disk_errors("writing a label"), self._locked():
            read = self._read()
            self._check(read)
            key = (label.subject, label.annotator)
            kept = [one for one in read.labels if (one.subject, one.annotator) != key]
            data = render_labels([*kept, label], as_json=self.path.suffix == ".json")
            write_whole(self.path, data)
            sync_folder(self.path.parent)

    def _read(self) -> LabelFile:
        return read_labels(self.path) if self.path.exists() else LabelFile([], [])

    def _check(self, read: LabelFile) -> None:
        if not read.is_ours or read.broken:
            why = str(read.broken[0]) if read.broken else "it has columns that would be lost"
            raise UsageError(
                f"cannot write labels to {self.path}: {why}", hint="mend it, or give another file: --labels"
            )

    @contextmanager
    def _locked(self) -> Iterator[None]:
        # A file beside it: the labels' own is another one after every write.
        fd = os.open(self.path.with_name(f".{self.path.name}.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX)
            yield
        finally:
            os.close(fd)


def sample_to_label(reader: RunReader, count: int, seed: int) -> list[str]:
    """Attempts to be labelled: as evenly over the levels of difficulty as the run allows (paper §3.4).

    Only attempts that came to an end of their own, and another task's before a second one of the same task.
    The order goes round the levels, so that whoever stops early has labelled evenly too. It depends on the
    seed and the attempts alone: everybody labels the same ones.

    Args:
        reader: of the run.
        count: how many at most.
        seed: of the draw.
    """
    by_level: dict[str, list[tuple[int, str, str]]] = defaultdict(list)
    seen: dict[str, int] = defaultdict(int)
    judged = [
        (hashlib.sha256(f"labels/{seed}/{one}".encode()).hexdigest(), one, entry.task_id)
        for one, entry in reader.attempts.items()
        if not entry.outcome.is_retried
    ]
    for digest, attempt_id, task_id in sorted(judged):
        task = reader.tasks.get(task_id)
        by_level[task.level if task else ""].append((seen[task_id], digest, attempt_id))
        seen[task_id] += 1
    ranked = [[one for *_, one in sorted(by_level[level])] for level in (*LEVELS, "")]
    return _round_robin(ranked)[:count]


def _round_robin(lists: Sequence[Sequence[str]]) -> list[str]:
    return [one for turn in zip_longest(*lists) for one in turn if one is not None]
