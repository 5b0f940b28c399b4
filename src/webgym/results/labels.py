"""Human labels of a run: saved as they are given, and paired with verdicts for :mod:`webgym.judge.agreement`.

One small file, which is rewritten atomically with every label, so that kill -9 loses no acknowledged label.
Several viewers may write to it: each reads it again under a lock before it writes.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from webgym.core.errors import UsageError
from webgym.core.outcome import Outcome
from webgym.judge.agreement import Case
from webgym.judge.labels import HumanLabel, Humans, Label, LabelFile, read_labels, render_labels, settled
from webgym.store.files import disk_errors, sync_folder, write_whole
from webgym.store.runs import RunReader, verdicts_of
from webgym.store.verdicts import Judged

__all__ = ["LABELS", "HumanLabel", "Label", "LabelStore", "labels_path", "sample_to_label"]

LABELS = "labels.csv"


def labels_path(run: Path) -> Path:
    """The default path of a run's labels."""
    return run / LABELS


class LabelStore:
    """A writable file of labels. Its methods do blocking I/O: call them in a thread, one at a time.

    Args:
        path: the file, CSV or JSON by its suffix; need not exist yet.

    Raises:
        UsageError: the file exists, and rewriting it would lose some of its content.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._check(self._read())

    def labels(self) -> list[HumanLabel]:
        """The labels in the file."""
        return self._read().labels

    def put(self, label: HumanLabel) -> None:
        """Store a label, in place of the same person's earlier one: on disk when this returns.

        Raises:
            StoreFull: there is no space; the file is unchanged.
            UsageError: another program has changed the file, and rewriting it would lose some of its content.
        """
        with disk_errors("writing a label"), self._locked():
            read = self._read()
            self._check(read)
            key = (label.subject, label.annotator)
            kept = [it for it in read.labels if (it.subject, it.annotator) != key]
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
        # A separate lock file: the file of labels is replaced by every write.
        fd = os.open(self.path.with_name(f".{self.path.name}.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX)
            yield
        finally:
            os.close(fd)


_PER_DIFFICULTY: Final = dict.fromkeys(range(1, 7), 10) | dict.fromkeys(range(7, 11), 5)
"""Number of the paper's 80 trajectories by difficulty: the number of facts of their tasks."""


def sample_to_label(reader: RunReader, count: int, seed: int) -> list[str]:
    """Sample attempts to be labelled, as in the paper's study (§3.4), as far as the run allows.

    Of 80 attempts, ten are at tasks of each difficulty from 1 to 6 and five at each from 7 to 10, and about
    half of them succeeded by the run's own verdict; other counts have the same proportions. Where a
    difficulty has too few attempts, others are used instead, including those beyond 10.

    Only attempts that ended regularly are sampled, and a second attempt at a task only after the first of
    other tasks. The difficulties alternate, so that the proportions also hold if labelling stops early, and
    the order does not depend on the verdicts. It is determined by the seed and the attempts, so that
    everybody labels the same ones.

    Args:
        reader: reader of the run.
        count: most attempts.
        seed: seed of the sample.
    """
    strata = _strata(reader, seed)
    sizes = _shares(count, {difficulty: len(strata.get(difficulty, ())) for difficulty in _PER_DIFFICULTY})
    chosen: dict[int, list[_Ended]] = {}
    remaining, successes_needed = sum(sizes.values()), round(sum(sizes.values()) / 2)
    ends = {it: [attempt.succeeded for attempt in strata.get(it, ())] for it in sizes}
    # Difficulties with few successes or failures first, so that the others can compensate.
    for difficulty in sorted(sizes, key=lambda it: (min(map(ends[it].count, (True, False))), it)):
        ended, size = strata.get(difficulty, []), sizes[difficulty]
        won = [attempt for attempt in ended if attempt.succeeded]
        lost = [attempt for attempt in ended if not attempt.succeeded]
        share = round(size * successes_needed / remaining) if remaining else 0
        successes = min(len(won), max(0, share, size - len(lost)))
        chosen[difficulty] = sorted([*won[:successes], *lost[: size - successes]])
        remaining, successes_needed = remaining - size, successes_needed - successes
    used = {attempt.attempt_id for ended in chosen.values() for attempt in ended}
    spare = [[it for it in ended if it.attempt_id not in used] for _, ended in sorted(strata.items())]
    in_turn = (attempt for turn in zip_longest(*spare) for attempt in turn if attempt is not None)
    ordered = [*_spread(list(chosen.values())), *in_turn]
    return [attempt.attempt_id for attempt in ordered[:count]]


class _Ended(NamedTuple):
    """An attempt that ended regularly; the order of the fields is the order of sampling."""

    nth: int
    digest: str
    attempt_id: str
    succeeded: bool


def _strata(reader: RunReader, seed: int) -> dict[int, list[_Ended]]:
    """Attempts by the difficulty of their task, in random order; difficulty 0 if the task is not known."""
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


def _shares(count: int, available: Mapping[int, int]) -> dict[int, int]:
    """The number of attempts per difficulty, by the paper's proportions as far as attempts are available."""
    sizes = dict.fromkeys(available, 0)
    for _ in range(min(count, sum(available.values()))):
        open_ = [difficulty for difficulty in sizes if sizes[difficulty] < available[difficulty]]
        sizes[min(open_, key=lambda it: ((sizes[it] + 0.5) / _PER_DIFFICULTY[it], it))] += 1
    return sizes


def _spread(lists: Sequence[Sequence[_Ended]]) -> list[_Ended]:
    """One list of all items, in which the items of each list are evenly distributed."""
    placed = [((index + 0.5) / len(ended), it) for ended in lists for index, it in enumerate(ended)]
    return [attempt for _, attempt in sorted(placed, key=lambda pair: (pair[0], pair[1].digest))]


@dataclass(frozen=True)
class Pairs:
    """Attempts with the labels of people and the verdicts of judges.

    Attributes:
        judges: full names of the judges.
        cases: the attempts that people and every one of the judges have judged.
        left_out: number of labelled attempts that are not among them, by reason.
    """

    judges: tuple[str, ...]
    cases: list[Case]
    left_out: Counter[str]


def pairs_of(
    run: Path,
    judges: Sequence[str],
    labels: Iterable[HumanLabel],
    humans: Humans = "majority",
    *,
    agent: str | None = None,
) -> Pairs:
    """Pair a run's verdicts with people's labels.

    An attempt that a judge found blocked counts as not successful by this judge. A judge that failed to give
    a verdict has none (:class:`webgym.judge.agreement.AgreementConfig` says how that counts).

    Args:
        run: the run folder.
        judges: names of judges, or prefixes; ``recorded`` is the judge of the collection.
        labels: labels of attempts, or of tasks that were attempted once.
        humans: which label counts if several people labelled an attempt.
        agent: the agent that made the run, in files that name agents; labels of others are left out.

    Raises:
        RunFolderError: the folder is not a run, or a judge has not judged it.
    """
    reader = RunReader(run, skip_corrupt=True)
    named = [verdicts_of(run, judge) for judge in judges]
    labels_by_attempt, left_out = _labels_by_attempt(labels, reader, agent)
    cases = []
    for attempt_id, attempt_labels in labels_by_attempt.items():
        label = settled(attempt_labels, humans)
        if label not in ("success", "failure"):
            left_out[_WHY[label]] += 1
            continue
        verdicts = [_verdict(judged, attempt_id) for _, judged in named]
        if any(verdict == "not judged" for verdict in verdicts):
            left_out["not judged by every judge"] += 1
            continue
        task_id = reader.attempts[attempt_id].task_id
        task = reader.tasks.get(task_id)
        by_judge = tuple(verdict if isinstance(verdict, bool) else None for verdict in verdicts)
        cases.append(Case(label == "success", by_judge, task.level if task else None, task_id))
    return Pairs(tuple(name for name, _ in named), cases, left_out)


_WHY: Mapping[Label | None, str] = {
    None: "the annotators do not agree",
    "unsure": "the annotators are unsure",
    "not_executable": "the task could not be done",
}


def _attempts_of(reader: RunReader) -> Mapping[str, Sequence[str]]:
    """The attempts at each task, by its id, and by its id in its source, as a benchmark's labels have it."""
    attempts = defaultdict(list)
    for attempt_id, entry in reader.attempts.items():
        for name in {entry.task_id, entry.task_id.partition("/")[2]}:
            attempts[name].append(attempt_id)
    return attempts


def resolved(reader: RunReader, labels: Iterable[HumanLabel]) -> list[HumanLabel]:
    """The labels, those of a task that was attempted once as labels of that attempt; the last of every person
    on each attempt."""
    attempts_of, latest = _attempts_of(reader), {}
    for label in labels:
        attempts = attempts_of.get(label.task_id, ())
        if not label.attempt_id and len(attempts) == 1:
            label = msgspec.structs.replace(label, attempt_id=attempts[0])
        latest[label.subject, label.agent, label.annotator] = label
    return list(latest.values())


def _labels_by_attempt(
    labels: Iterable[HumanLabel], reader: RunReader, agent: str | None
) -> tuple[dict[str, list[Label]], Counter[str]]:
    """People's labels by attempt, and the number of labels that are not used by reason."""
    given, labels_by_attempt, left_out = list(labels), defaultdict(list), Counter[str]()
    kept, attempts_of = resolved(reader, given), _attempts_of(reader)
    if again := len(given) - len(kept):
        left_out["a label that the same person gave again"] = again
    for label in kept:
        if label.agent not in ("", agent):
            left_out["a label of another agent's run"] += 1
        elif label.attempt_id in reader.attempts:
            labels_by_attempt[label.attempt_id].append(label.label)
        elif not label.attempt_id and label.task_id in attempts_of:
            left_out["a label of a task that was attempted several times"] += 1
        else:
            left_out["a label of an attempt that is not in the run"] += 1
    return labels_by_attempt, left_out


def _verdict(judged_by_attempt: Mapping[str, Judged], attempt_id: str) -> bool | str:
    """Whether the attempt succeeded by a judge's verdict, or why there is none."""
    judged = judged_by_attempt.get(attempt_id)
    if judged is None:
        return "not judged"
    return "no verdict" if judged.verdict is None else judged.verdict.reward == 1
