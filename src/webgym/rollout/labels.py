"""Human labels of a run, saved as they are given.

One small file, which is written anew, whole or not at all, with every label: kill -9 loses nothing that was
acknowledged. Several viewers may write to it, for each reads it again under a lock before it writes.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path
from typing import Final, NamedTuple

from webgym.core.errors import UsageError
from webgym.core.outcome import Outcome
from webgym.judge.labels import HumanLabel, Label, LabelFile, read_labels, render_labels
from webgym.rollout.files import disk_errors, sync_folder, write_whole
from webgym.rollout.store import RunReader

__all__ = ["LABELS", "HumanLabel", "Label", "LabelStore", "labels_path", "sample_to_label"]

LABELS = "labels.csv"


def labels_path(run: Path) -> Path:
    """Where a run's labels lie unless somebody says otherwise."""
    return run / LABELS


class LabelStore:
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
                f"cannot write labels to {self.path}: {why}", hint="fix it, or give another file: --labels"
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


_PER_DIFFICULTY: Final = dict.fromkeys(range(1, 7), 10) | dict.fromkeys(range(7, 11), 5)
"""Of the paper's 80 trajectories, by the number of facts of their tasks."""


def sample_to_label(reader: RunReader, count: int, seed: int) -> list[str]:
    """Attempts to be labelled, drawn as in the paper's study (§3.4), as far as the run allows.

    Of 80 attempts, ten are at tasks of each difficulty from 1 to 6 and five at each from 7 to 10, and about
    half of them succeeded by the run's own verdict; of another count, the same shares. What a difficulty
    lacks, others make up for, those beyond 10 included.

    Only attempts that came to an end of their own, and another task's before a second one of the same task.
    The order goes round the difficulties, so that whoever stops early has labelled alike, and tells nothing
    of the verdicts. It depends on the seed and the attempts alone: everybody labels the same ones.

    Args:
        reader: of the run.
        count: how many at most.
        seed: of the draw.
    """
    strata = _strata(reader, seed)
    sizes = _shares(count, {each: len(strata.get(each, ())) for each in _PER_DIFFICULTY})
    chosen: dict[int, list[_Ended]] = {}
    left, wanted = sum(sizes.values()), round(sum(sizes.values()) / 2)
    # Where one of the two is scarce first: the others can then make up for it.
    for difficulty in sorted(sizes, key=lambda each: (_scarcer(strata.get(each, ())), each)):
        ended, size = strata.get(difficulty, []), sizes[difficulty]
        won = [one for one in ended if one.succeeded]
        lost = [one for one in ended if not one.succeeded]
        share = round(size * wanted / left) if left else 0
        successes = min(len(won), max(0, share, size - len(lost)))
        chosen[difficulty] = sorted([*won[:successes], *lost[: size - successes]])
        left, wanted = left - size, wanted - successes
    taken = {one.attempt_id for ended in chosen.values() for one in ended}
    spare = [[one for one in ended if one.attempt_id not in taken] for _, ended in sorted(strata.items())]
    turns = [*_spread(list(chosen.values())), *_round_robin(spare)]
    return [one.attempt_id for one in turns[:count]]


class _Ended(NamedTuple):
    """An attempt that came to an end of its own; sorted as it is drawn."""

    nth: int
    digest: str
    attempt_id: str
    succeeded: bool


def _strata(reader: RunReader, seed: int) -> dict[int, list[_Ended]]:
    """Attempts by the difficulty of their task, in an order that is drawn; 0 where the task is not known."""
    strata: dict[int, list[_Ended]] = defaultdict(list)
    seen: dict[str, int] = defaultdict(int)
    drawn = [
        (hashlib.sha256(f"labels/{seed}/{entry.attempt_id}".encode()).hexdigest(), entry)
        for entry in reader.attempts.values()
        if not entry.outcome.is_retried
    ]
    for digest, entry in sorted(drawn):
        task = reader.tasks.get(entry.task_id)
        ended = _Ended(seen[entry.task_id], digest, entry.attempt_id, entry.outcome is Outcome.SUCCESS)
        strata[task.difficulty if task else 0].append(ended)
        seen[entry.task_id] += 1
    return {difficulty: sorted(ended) for difficulty, ended in strata.items()}


def _shares(count: int, there: Mapping[int, int]) -> dict[int, int]:
    """How many of each difficulty: by the paper's shares, as far as there are any; the rest spread again."""
    sizes = dict.fromkeys(there, 0)
    for _ in range(min(count, sum(there.values()))):
        open_ = [each for each in sizes if sizes[each] < there[each]]
        sizes[min(open_, key=lambda each: ((sizes[each] + 0.5) / _PER_DIFFICULTY[each], each))] += 1
    return sizes


def _scarcer(ended: Sequence[_Ended]) -> int:
    won = sum(one.succeeded for one in ended)
    return min(won, len(ended) - won)


def _spread(lists: Sequence[Sequence[_Ended]]) -> list[_Ended]:
    """All of them in one list, each list's spread evenly over it."""
    placed = [((place + 0.5) / len(ended), one) for ended in lists for place, one in enumerate(ended)]
    return [one for _, one in sorted(placed, key=lambda each: (each[0], each[1].digest))]


def _round_robin(lists: Sequence[Sequence[_Ended]]) -> list[_Ended]:
    return [one for turn in zip_longest(*lists) for one in turn if one is not None]
