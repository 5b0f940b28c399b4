"""A run's verdicts paired with human labels: cases for :mod:`webgym.judge.agreement`."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from webgym.judge.agreement import Case
from webgym.judge.labels import HumanLabel, Humans, Label, settled
from webgym.rollout.rejudge import verdicts_of
from webgym.rollout.store import RunReader
from webgym.rollout.verdicts import Judged


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
    run: Path, judges: Sequence[str], labels: Iterable[HumanLabel], humans: Humans = "majority"
) -> Pairs:
    """Pair a run's verdicts with people's labels.

    An attempt that a judge found blocked counts as not successful by this judge. A judge that failed to give
    a verdict has none (:class:`webgym.judge.agreement.AgreementConfig` says how that counts).

    Args:
        run: the run folder.
        judges: names of judges, or prefixes; ``recorded`` is the judge of the collection.
        labels: labels of attempts, or of tasks that were attempted once.
        humans: which label counts if several people labelled an attempt.

    Raises:
        RunFolderError: the folder is not a run, or a judge has not judged it.
    """
    reader = RunReader(run, skip_corrupt=True)
    named = [verdicts_of(run, judge) for judge in judges]
    attempts_of = defaultdict(list)
    for attempt_id, entry in reader.attempts.items():
        attempts_of[entry.task_id].append(attempt_id)
    labels_by_attempt, left_out = _labels_by_attempt(labels, reader, attempts_of)
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


def _labels_by_attempt(
    labels: Iterable[HumanLabel], reader: RunReader, attempts_of: Mapping[str, Sequence[str]]
) -> tuple[dict[str, list[Label]], Counter[str]]:
    """People's labels by attempt, and the number of labels without an attempt by reason."""
    labels_by_attempt: dict[str, list[Label]] = {}
    left_out: Counter[str] = Counter()
    for label in labels:
        candidates = [label.attempt_id] if label.attempt_id else attempts_of.get(label.task_id, ())
        if len(candidates) > 1:
            left_out["a label of a task that was attempted several times"] += 1
        elif not candidates or candidates[0] not in reader.attempts:
            left_out["a label of an attempt that is not in the run"] += 1
        else:
            labels_by_attempt.setdefault(candidates[0], []).append(label.label)
    return labels_by_attempt, left_out


def _verdict(judged_by_attempt: Mapping[str, Judged], attempt_id: str) -> bool | str:
    """Whether the attempt succeeded by a judge's verdict, or why there is none."""
    judged = judged_by_attempt.get(attempt_id)
    if judged is None:
        return "not judged"
    return "no verdict" if judged.verdict is None else judged.verdict.reward == 1
