"""Human labels of trajectories: files in CSV or JSON, and agreement between annotators.

A file has a row per attempt and annotator with the columns ``attempt_id`` (or ``task_id``, for runs with one
attempt per task), ``label``, ``annotator`` and ``note``. The last two may be missing. As JSON it is a
list of such objects, or one object per line.

``human_label.json`` of Online-Mind2Web (SOURCES.md) is read, too: it has one record per task, with the labels
of several agents' runs in ``<agent>_human_label``, as strings.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, get_args

import msgspec

from webgym.core.errors import UsageError
from webgym.core.text import plain
from webgym.judge.agreement import Confusion, rates

Label: TypeAlias = Literal["success", "failure", "unsure", "not_executable"]
"""``unsure``: the annotator cannot tell. ``not_executable``: the task cannot be done (any more). Neither
counts in a rate."""
LABELS: Final[tuple[Label, ...]] = get_args(Label)

Humans: TypeAlias = Literal["majority", "first", "unanimous"]
"""How the labels of several annotators of one attempt are combined; see :func:`settled`."""

COLUMNS: Final = ("attempt_id", "task_id", "label", "annotator", "note")

_COLUMN_SYNONYMS: Final = {
    "attempt": "attempt_id",
    "trajectory_id": "attempt_id",
    "task": "task_id",
    "human_label": "label",
    "success": "label",
    "notes": "note",
    "comment": "note",
    "labeler": "annotator",
    "labeller": "annotator",
}
_SPELLINGS: Final[dict[str, Label]] = {
    **dict.fromkeys(("success", "successful", "pass", "yes", "true", "1"), "success"),
    **dict.fromkeys(("failure", "failed", "fail", "unsuccessful", "not success"), "failure"),
    **dict.fromkeys(("no", "false", "0"), "failure"),
    **dict.fromkeys(("unsure", "cannot tell", "unclear", "?"), "unsure"),
    "not executable": "not_executable",
}
_ONLINE_MIND2WEB: Final[dict[str, Label]] = {"1": "success", "0": "failure", "2": "not_executable"}
_AGENT_SUFFIX: Final = "_human_label"
_DELIMITERS: Final = ",;\t"
_FORMULA: Final = re.compile(r"'*[=+\-@]")
"""Start of a cell that a spreadsheet would evaluate as a formula. Such cells are written with an apostrophe
before them, which spreadsheets hide, and read without it."""


class HumanLabel(msgspec.Struct, frozen=True, omit_defaults=True):
    """One person's label of one attempt.

    Attributes:
        label: success, failure, unsure or not_executable.
        attempt_id: of the labelled attempt; empty if the label is for a task.
        task_id: of the labelled task.
        annotator: name of the person; empty if the file does not say.
        note: the person's comment.
        agent: name of the agent, in files with the runs of several agents.
    """

    label: Label
    attempt_id: str = ""
    task_id: str = ""
    annotator: str = ""
    note: str = ""
    agent: str = ""

    @property
    def subject(self) -> str:
        """The id of the attempt, else of the task."""
        return self.attempt_id or self.task_id


class BrokenLabel(msgspec.Struct, frozen=True):
    """A row of a file that is not used as a label.

    Attributes:
        where: its position in the file (``"line 7"``, ``"record 3"``).
        reason: what is wrong with it.
    """

    where: str
    reason: str

    def __str__(self) -> str:
        return f"{self.where}: {self.reason}"


class LabelFile(msgspec.Struct, frozen=True):
    """The contents of a file of labels.

    Attributes:
        labels: in the file's order; at most one per subject, agent and annotator.
        broken: rows that are not used.
        is_ours: whether the file has only columns that :func:`render_labels` writes, so that rewriting it
            from the labels loses nothing.
    """

    labels: list[HumanLabel]
    broken: list[BrokenLabel]
    is_ours: bool = True


def read_labels(path: Path) -> LabelFile:
    """Read a file of labels in any of the formats described above.

    A row that is superseded (same attempt and annotator, another label further down) is listed in ``broken``.

    Raises:
        UsageError: the file cannot be read, or is not a table of labels.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(
            f"cannot read the labels {path}: {error.strerror}",
            hint="label trajectories on the page /label of webgym view RUN",
        ) from error
    try:
        return parse_labels(data)
    except ValueError as error:
        raise UsageError(
            f"{path} is not a table of labels: {error}", hint=f"it needs the columns {', '.join(COLUMNS)}"
        ) from error


def parse_labels(data: bytes) -> LabelFile:
    """Parse the bytes of a file of labels; see :func:`read_labels`.

    Raises:
        ValueError: it is not a table of labels.
    """
    text = data.decode("utf-8-sig", errors="replace")
    by_key: dict[tuple[str, str, str], tuple[str, HumanLabel]] = {}
    broken: list[BrokenLabel] = []
    is_ours = True
    for where, row in _json_rows(text) if text.lstrip()[:1] in ("[", "{") else _csv_rows(text):
        if isinstance(row, str):
            broken.append(BrokenLabel(where, row))
            continue
        is_ours = is_ours and row.keys() <= set(COLUMNS)
        for label in _labels(row):
            if isinstance(label, str):
                broken.append(BrokenLabel(where, label))
                continue
            key = (label.subject, label.agent, label.annotator)
            if key in by_key and by_key[key][1] != label:
                reason = f"{label.subject} is labelled again further down, at {where}"
                broken.append(BrokenLabel(by_key.pop(key)[0], reason))
            by_key[key] = (where, label)
    return LabelFile([label for _, label in by_key.values()], broken, is_ours)


def render_labels(labels: Iterable[HumanLabel], *, as_json: bool = False) -> bytes:
    """The bytes of a file with these labels, as CSV or JSON; :func:`parse_labels` reads it back."""
    rows = [{name: getattr(label, name) for name in COLUMNS} for label in labels]
    if as_json:
        return msgspec.json.format(msgspec.json.encode(rows), indent=2) + b"\n"
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {name: f"'{cell}" if _FORMULA.match(cell) else cell for name, cell in row.items()} for row in rows
    )
    return text.getvalue().encode("utf-8", errors="replace")


def _json_rows(text: str) -> Iterator[tuple[str, dict[str, Any] | str]]:
    """The records of a JSON list, or of JSON lines."""
    try:
        whole = msgspec.json.decode(text)
    except ValueError as error:
        if text.lstrip().startswith("["):
            raise ValueError(f"it is invalid JSON: {error}") from error
        yield from _json_lines(text)
        return
    if isinstance(whole, dict):
        whole = whole["labels"] if isinstance(whole.get("labels"), list) else [whole]
    for number, record in enumerate(whole, 1):
        yield (
            f"record {number}",
            _with_column_names(record) if isinstance(record, dict) else "it is not an object",
        )


def _json_lines(text: str) -> Iterator[tuple[str, dict[str, Any] | str]]:
    for number, line in enumerate(text.split("\n"), 1):  # strings may hold other line ends
        if not line.strip():
            continue
        try:
            record = msgspec.json.decode(line)
        except ValueError as error:
            yield f"line {number}", f"it is invalid JSON: {error}"
            continue
        yield (
            f"line {number}",
            _with_column_names(record) if isinstance(record, dict) else "it is not an object",
        )


def _with_column_names(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record with its keys as names of columns; keys with an agent's name keep their case."""
    return {
        key if key.endswith(_AGENT_SUFFIX) and len(key) > len(_AGENT_SUFFIX) else _column(key): value
        for key, value in record.items()
    }


def _column(name: str) -> str:
    plain = "_".join(name.strip().casefold().replace("-", " ").split())
    return _COLUMN_SYNONYMS.get(plain, plain)


def _csv_rows(text: str) -> Iterator[tuple[str, dict[str, Any] | str]]:
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = max(_DELIMITERS, key=first.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    header: list[str] | None = None
    while True:
        line = reader.line_num + 1
        try:
            cells = next(reader, None)
        except csv.Error as error:
            reason = "a quote is never closed, so the rest of the file cannot be read"
            yield f"line {line}", reason if "end of data" in str(error) else f"it is not a row: {error}"
            continue
        if cells is None:
            break
        if not any(cell.strip() for cell in cells):
            continue
        if header is None:
            header = [_column(cell) for cell in cells]
            if "label" not in header or not {"attempt_id", "task_id"} & set(header):
                raise ValueError("its first line has no column label, or neither attempt_id nor task_id")
        elif len(cells) != len(header):
            yield f"line {line}", f"{len(cells)} columns where the header has {len(header)}"
        else:
            values = (cell[1:] if cell[:1] == "'" and _FORMULA.match(cell) else cell for cell in cells)
            yield f"line {line}", dict(zip(header, values, strict=True))


def _labels(row: Mapping[str, Any]) -> Iterator[HumanLabel | str]:
    """The labels of a row; in place of one that cannot be used, what is wrong with it."""
    agents = [key for key in row if key.endswith(_AGENT_SUFFIX) and key != _AGENT_SUFFIX]
    if agents and "label" not in row:
        for key in agents:
            yield _online_mind2web_label(row, key)
        return
    subject = {name: _text(row.get(name)) for name in ("attempt_id", "task_id", "annotator", "note")}
    text = _text(row.get("label"))
    label = _SPELLINGS.get(" ".join(text.casefold().replace("_", " ").split()))
    if not subject["attempt_id"] and not subject["task_id"]:
        yield "it has neither an attempt_id nor a task_id"
    elif label is None:
        yield f"the label {text[:40]!r} is not one of {', '.join(LABELS)}"
    else:
        yield HumanLabel(label, **subject)


def _online_mind2web_label(row: Mapping[str, Any], key: str) -> HumanLabel | str:
    """A label in Online-Mind2Web's format, or what is wrong with it."""
    agent, task = key.removesuffix(_AGENT_SUFFIX), _text(row.get("task_id"))
    label = _ONLINE_MIND2WEB.get(_text(row[key]))
    if not task:
        return f"{agent}'s label has no task_id"
    if label is None:
        return f"{agent}'s label {_text(row[key])[:40]!r} is not 0, 1 or 2"
    return HumanLabel(label, task_id=task, agent=agent)


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).casefold()
    return str(value).strip()


# --- combining the labels of several people, and their agreement --------------------------------------------


def settled(labels: Sequence[Label], humans: Humans = "majority") -> Label | None:
    """The combined label of one attempt that several people labelled.

    Args:
        labels: in the order of the annotators.
        humans: ``majority`` takes the most frequent label apart from unsure; ``first`` takes the first label;
            ``unanimous`` requires all labels to be the same.

    Returns:
        The combined label; ``None`` if there is none (no labels, a tie, or disagreement).
    """
    if humans == "first" or len(set(labels)) <= 1:
        return labels[0] if labels else None
    if humans == "unanimous":
        return None
    counts = Counter(label for label in labels if label != "unsure").most_common(2)
    return None if len({count for _, count in counts}) < len(counts) else counts[0][0]


class Annotators(msgspec.Struct, frozen=True):
    """Agreement of two people on the attempts that both labelled success or failure.

    Attributes:
        pair: their names.
        attempts: number of those attempts.
        observed: share of them with the same label; ``None`` without attempts.
        kappa: Cohen's kappa; ``None`` where it is undefined.
    """

    pair: tuple[str, str]
    attempts: int
    observed: float | None
    kappa: float | None


class AnnotatorAgreement(msgspec.Struct, frozen=True):
    """Agreement between all annotators.

    Attributes:
        attempts: number of attempts with at least two labels of success or failure.
        observed: share of pairs of labels of one attempt that are the same; ``None`` without pairs.
        alpha: Krippendorff's alpha, for any number of annotators and missing labels; ``None`` where it is
            undefined, for example if all labels are the same.
        pairs: every two annotators who share an attempt.
    """

    attempts: int
    observed: float | None
    alpha: float | None
    pairs: tuple[Annotators, ...]

    def __str__(self) -> str:
        def said(value: float | None, form: str) -> str:
            return "undefined" if value is None else f"{value:{form}}"

        same = f"{self.attempts} shared attempts, {said(self.observed, '.1%')} labelled the same"
        lines = [f"annotators: {same}, Krippendorff's α {said(self.alpha, '.3f')}"]
        for pair in self.pairs:
            same = f"{pair.attempts} shared, {said(pair.observed, '.1%')} labelled the same"
            lines.append(f"  {plain(' and '.join(pair.pair))}: {same}, κ {said(pair.kappa, '.3f')}")
        return "\n".join(lines)


def annotator_agreement(labels: Iterable[HumanLabel]) -> AnnotatorAgreement:
    """Agreement between annotators on success and failure."""
    by_subject: dict[tuple[str, str], dict[str, bool]] = {}
    for label in labels:
        if label.label in ("success", "failure"):
            by_annotator = by_subject.setdefault((label.subject, label.agent), {})
            by_annotator[label.annotator] = label.label == "success"
    shared = [by_annotator for by_annotator in by_subject.values() if len(by_annotator) > 1]
    names = sorted({name for by_annotator in shared for name in by_annotator})
    pairs = (_pair(first, second, shared) for first, second in combinations(names, 2))
    observed, alpha = _krippendorff(shared)
    return AnnotatorAgreement(len(shared), observed, alpha, tuple(pair for pair in pairs if pair.attempts))


def _pair(first: str, second: str, shared: Iterable[Mapping[str, bool]]) -> Annotators:
    counts = Counter(
        (by_annotator[first], by_annotator[second])
        for by_annotator in shared
        if first in by_annotator and second in by_annotator
    )
    table = Confusion(counts[True, True], counts[False, True], counts[True, False], counts[False, False])
    metrics = rates(table)
    return Annotators((first, second), table.total, metrics["accuracy"], metrics["kappa"])


def _krippendorff(shared: Sequence[Mapping[str, bool]]) -> tuple[float | None, float | None]:
    """Observed agreement over pairs of labels, and Krippendorff's alpha for two nominal values."""
    same = pairs = 0.0
    disagreed = 0.0
    values: Counter[bool] = Counter()
    for by_annotator in shared:
        yes, total = sum(by_annotator.values()), len(by_annotator)
        no = total - yes
        values.update({True: yes, False: no})
        pairs += total * (total - 1)
        same += yes * (yes - 1) + no * (no - 1)
        disagreed += 2 * yes * no / (total - 1)
    if not pairs:
        return None, None
    expected = 2 * values[True] * values[False] / (values.total() - 1)
    return same / pairs, 1 - disagreed / expected if expected else None
