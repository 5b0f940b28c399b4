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
    """Attempts with what people and judges say of them.

    Attributes:
        judges: their whole names.
        cases: the attempts that people and every one of the judges have looked at.
        left_out: why labelled attempts are not among them, and how many.
    """

    judges: tuple[str, ...]
    cases: list[Case]
    left_out: Counter[str]


def pairs_of(
    run: Path, judges: Sequence[str], labels: Iterable[HumanLabel], humans: Humans = "majority"
) -> Pairs:
    """Put a run's verdicts beside people's labels.

    A judge that found an attempt blocked says that it did not succeed. One that looked and came to no verdict
    has none (:class:`webgym.judge.agreement.AgreementConfig` says what that counts).

    Args:
        run: the run folder.
        judges: names, or how they begin; ``recorded`` is the judge of the collection.
        labels: of attempts, or of tasks that were attempted once.
        humans: whose label stands where several people labelled an attempt.

    Raises:
        RunFolderError: the folder is no run, or a judge has not judged it.
    """
    reader = RunReader(run, skip_corrupt=True)
    named = [verdicts_of(run, judge) for judge in judges]
    attempts_of = defaultdict(list)
    for attempt_id, entry in reader.attempts.items():
        attempts_of[entry.task_id].append(attempt_id)
    said, left_out = _said(labels, reader, attempts_of)
    cases = []
    for attempt_id, words in said.items():
        label = settled(words, humans)
        if label not in ("success", "failure"):
            left_out[_WHY[label]] += 1
            continue
        verdicts = [_verdict(held, attempt_id) for _, held in named]
        if any(verdict == "not judged" for verdict in verdicts):
            left_out["not judged by every judge"] += 1
            continue
        task_id = reader.attempts[attempt_id].task_id
        task = reader.tasks.get(task_id)
        found = tuple(verdict if isinstance(verdict, bool) else None for verdict in verdicts)
        cases.append(Case(label == "success", found, task.level if task else None, task_id))
    return Pairs(tuple(name for name, _ in named), cases, left_out)


_WHY: Mapping[Label | None, str] = {
    None: "the annotators do not agree",
    "unsure": "the annotators are unsure",
    "not_executable": "the task could not be done",
}


def _said(
    labels: Iterable[HumanLabel], reader: RunReader, attempts_of: Mapping[str, Sequence[str]]
) -> tuple[dict[str, list[Label]], Counter[str]]:
    """People's labels by attempt, and why some are of no attempt."""
    said: dict[str, list[Label]] = {}
    left_out: Counter[str] = Counter()
    for label in labels:
        fitting = [label.attempt_id] if label.attempt_id else attempts_of.get(label.task_id, ())
        if len(fitting) > 1:
            left_out["a label of a task that was attempted several times"] += 1
        elif not fitting or fitting[0] not in reader.attempts:
            left_out["a label of an attempt that the run does not hold"] += 1
        else:
            said.setdefault(fitting[0], []).append(label.label)
    return said, left_out


def _verdict(held: Mapping[str, Judged], attempt_id: str) -> bool | str:
    """What a judge says: whether the attempt succeeded, or why there is no saying."""
    judged = held.get(attempt_id)
    if judged is None:
        return "not judged"
    return "no verdict" if judged.verdict is None else judged.verdict.reward == 1
