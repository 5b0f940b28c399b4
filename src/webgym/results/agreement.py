"""A run's verdicts paired with human labels: cases for :mod:`webgym.judge.agreement`."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from webgym.judge.agreement import Case
from webgym.judge.labels import HumanLabel, Humans, Label, settled
from webgym.store.runs import RunReader, verdicts_of
from webgym.store.verdicts import Judged


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
    """The attempts at each task."""
    attempts = defaultdict(list)
    for attempt_id, entry in reader.attempts.items():
        attempts[entry.task_id].append(attempt_id)
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
