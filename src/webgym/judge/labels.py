"""Human labels of trajectories: files in CSV or JSON, and agreement between annotators.

A file has a row per attempt and annotator with the columns ``attempt_id`` (or ``task_id``, for runs with one
attempt per task), ``label``, ``annotator`` and ``note``. The last two may be missing. As JSON it is a
list of such objects, or one object a line.

Read as well, because it is there: ``human_label.json`` of Online-Mind2Web (SOURCES.md), with one record per
task and the labels of several agents' runs in ``<agent>_human_label``, strings all of them.
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
from webgym.judge.agreement import Confusion, rates

Label: TypeAlias = Literal["success", "failure", "unsure", "not_executable"]
"""``unsure``: the annotator cannot tell. ``not_executable``: the task cannot be done (any more). Neither
enters a rate."""
LABELS: Final[tuple[Label, ...]] = get_args(Label)

Humans: TypeAlias = Literal["majority", "first", "unanimous"]
"""Whose label stands where several people labelled an attempt."""

COLUMNS: Final = ("attempt_id", "task_id", "label", "annotator", "note")

_NAMES: Final = {
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
"""What a spreadsheet would carry out. Cells that begin so are written with an apostrophe before it, which
spreadsheets do not show, and read without it."""


class HumanLabel(msgspec.Struct, frozen=True, omit_defaults=True):
    """One person's label of one attempt.

    Attributes:
        label: the finding.
        attempt_id: of the attempt; empty if the label is for a task.
        task_id: of the task.
        annotator: who says so; empty if the file does not tell.
        note: why, in the person's words.
        agent: whose attempt it was, in files that hold the runs of several agents.
    """

    label: Label
    attempt_id: str = ""
    task_id: str = ""
    annotator: str = ""
    note: str = ""
    agent: str = ""

    @property
    def subject(self) -> str:
        """What it is about: the attempt, else the task."""
        return self.attempt_id or self.task_id


class BrokenLabel(msgspec.Struct, frozen=True):
    """A row that cannot be used.

    Attributes:
        where: its place in the file (``"line 7"``, ``"record 3"``).
        reason: what is wrong with it.
    """

    where: str
    reason: str

    def __str__(self) -> str:
        return f"{self.where}: {self.reason}"


class LabelFile(msgspec.Struct, frozen=True):
    """A file as it was read.

    Attributes:
        labels: in the file's order; at most one per subject, agent and annotator.
        broken: rows that do not count.
        is_ours: whether nothing would be lost if it were written again from the labels.
    """

    labels: list[HumanLabel]
    broken: list[BrokenLabel]
    is_ours: bool = True


def read_labels(path: Path) -> LabelFile:
    """Read a file of labels, whatever its form.

    A row that was superseded (same attempt, same annotator, another label further down) is listed among the
    broken ones.

    Raises:
        UsageError: the file cannot be read, or is no table at all.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"cannot read the labels {path}: {error.strerror}") from error
    try:
        return parse_labels(data)
    except ValueError as error:
        raise UsageError(
            f"{path} holds no labels: {error}", hint=f"it needs the columns {', '.join(COLUMNS)}"
        ) from error


def parse_labels(data: bytes) -> LabelFile:
    """The labels in a file's bytes; see :func:`read_labels`.

    Raises:
        ValueError: it is no table of labels at all.
    """
    text = data.decode("utf-8-sig", errors="replace")
    found: dict[tuple[str, str, str], tuple[str, HumanLabel]] = {}
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
            if key in found and found[key][1] != label:
                reason = f"{label.subject} is labelled again further down, at {where}"
                broken.append(BrokenLabel(found.pop(key)[0], reason))
            found[key] = (where, label)
    return LabelFile([label for _, label in found.values()], broken, is_ours)


def render_labels(labels: Iterable[HumanLabel], *, as_json: bool = False) -> bytes:
    """A file of labels; :func:`parse_labels` reads it back."""
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
            raise ValueError(f"it is broken JSON: {error}") from error
        yield from _json_lines(text)
        return
    if isinstance(whole, dict):
        whole = whole["labels"] if isinstance(whole.get("labels"), list) else [whole]
    for number, record in enumerate(whole, 1):
        yield f"record {number}", _lowered(record) if isinstance(record, dict) else "it is not an object"


def _json_lines(text: str) -> Iterator[tuple[str, dict[str, Any] | str]]:
    for number, line in enumerate(text.split("\n"), 1):  # strings may hold other line ends
        if not line.strip():
            continue
        try:
            record = msgspec.json.decode(line)
        except ValueError as error:
            yield f"line {number}", f"it is broken JSON: {error}"
            continue
        yield f"line {number}", _lowered(record) if isinstance(record, dict) else "it is not an object"


def _lowered(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record with our names for its keys; what names an agent keeps its case."""
    return {
        key if key.endswith(_AGENT_SUFFIX) and len(key) > len(_AGENT_SUFFIX) else _column(key): value
        for key, value in record.items()
    }


def _column(name: str) -> str:
    plain = "_".join(name.strip().casefold().replace("-", " ").split())
    return _NAMES.get(plain, plain)


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
            reason = "a quote is never closed, and all that follows it is lost"
            yield f"line {line}", reason if "end of data" in str(error) else f"it is not a row: {error}"
            continue
        if cells is None:
            break
        if not any(cell.strip() for cell in cells):
            continue
        if header is None:
            header = [_column(cell) for cell in cells]
            if "label" not in header or not {"attempt_id", "task_id"} & set(header):
                raise ValueError("its first line names no label, or neither an attempt_id nor a task_id")
        elif len(cells) != len(header):
            yield f"line {line}", f"{len(cells)} columns where the header has {len(header)}"
        else:
            told = (cell[1:] if cell[:1] == "'" and _FORMULA.match(cell) else cell for cell in cells)
            yield f"line {line}", dict(zip(header, told, strict=True))


def _labels(row: Mapping[str, Any]) -> Iterator[HumanLabel | str]:
    """The labels of a row, and what is wrong with those that are none."""
    agents = [key for key in row if key.endswith(_AGENT_SUFFIX) and key != _AGENT_SUFFIX]
    if agents and "label" not in row:
        for key in agents:
            yield _foreign(row, key)
        return
    subject = {name: _text(row.get(name)) for name in ("attempt_id", "task_id", "annotator", "note")}
    said = _text(row.get("label"))
    label = _SPELLINGS.get(" ".join(said.casefold().replace("_", " ").split()))
    if not subject["attempt_id"] and not subject["task_id"]:
        yield "it names neither an attempt nor a task"
    elif label is None:
        yield f"the label {said[:40]!r} is not one of {', '.join(LABELS)}"
    else:
        yield HumanLabel(label, **subject)


def _foreign(row: Mapping[str, Any], key: str) -> HumanLabel | str:
    """A label of Online-Mind2Web."""
    agent, task = key.removesuffix(_AGENT_SUFFIX), _text(row.get("task_id"))
    label = _ONLINE_MIND2WEB.get(_text(row[key]))
    if not task:
        return f"it names no task that {agent}'s label could be for"
    if label is None:
        return f"{agent}'s label {_text(row[key])[:40]!r} is none of 0, 1 and 2"
    return HumanLabel(label, task_id=task, agent=agent)


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).casefold()
    return str(value).strip()


# --- one answer from several people, and how far they agree --------------------------------------------


def settled(labels: Sequence[Label], humans: Humans = "majority") -> Label | None:
    """The combined label of one attempt that several people labelled.

    Args:
        labels: in the order of the annotators.
        humans: ``majority`` counts success against failure, and where neither has more, nothing is settled;
            ``first`` takes the first label; ``unanimous`` needs all to be the same.

    Returns:
        ``None`` where nothing is settled. ``unsure`` and ``not_executable`` where nobody said more.
    """
    if humans == "first" or len(set(labels)) <= 1:
        return labels[0] if labels else None
    if humans == "unanimous":
        return None
    counts = Counter(labels)
    if counts["success"] != counts["failure"]:
        return "success" if counts["success"] > counts["failure"] else "failure"
    return None


class Annotators(msgspec.Struct, frozen=True):
    """Two people on the attempts that both labelled success or failure.

    Attributes:
        pair: their names.
        attempts: how many.
        observed: share with the same label; ``None`` of nothing.
        kappa: Cohen's; ``None`` where it is undefined.
    """

    pair: tuple[str, str]
    attempts: int
    observed: float | None
    kappa: float | None


class AnnotatorAgreement(msgspec.Struct, frozen=True):
    """How far people agree.

    Attributes:
        attempts: attempts with at least two labels that say success or failure.
        observed: share of pairs of labels of one attempt that are the same; ``None`` of nothing.
        alpha: Krippendorff's, for any number of annotators and missing labels; ``None`` where it is
            undefined, as where everybody always says the same.
        pairs: every two annotators who share an attempt.
    """

    attempts: int
    observed: float | None
    alpha: float | None
    pairs: tuple[Annotators, ...]


def annotator_agreement(labels: Iterable[HumanLabel]) -> AnnotatorAgreement:
    """How far several annotators agree on success and failure."""
    by_subject: dict[tuple[str, str], dict[str, bool]] = {}
    for label in labels:
        if label.label in ("success", "failure"):
            said = by_subject.setdefault((label.subject, label.agent), {})
            said[label.annotator] = label.label == "success"
    shared = [said for said in by_subject.values() if len(said) > 1]
    names = sorted({name for said in shared for name in said})
    pairs = (_pair(one, other, shared) for one, other in combinations(names, 2))
    observed, alpha = _krippendorff(shared)
    return AnnotatorAgreement(len(shared), observed, alpha, tuple(pair for pair in pairs if pair.attempts))


def _pair(one: str, other: str, shared: Iterable[Mapping[str, bool]]) -> Annotators:
    counts = Counter((said[one], said[other]) for said in shared if one in said and other in said)
    table = Confusion(counts[True, True], counts[False, True], counts[True, False], counts[False, False])
    found = rates(table)
    return Annotators((one, other), table.total, found["accuracy"], found["kappa"])


def _krippendorff(shared: Sequence[Mapping[str, bool]]) -> tuple[float | None, float | None]:
    """Observed agreement over pairs of labels, and Krippendorff's alpha for two nominal values."""
    same = pairs = 0.0
    disagreed = 0.0
    values: Counter[bool] = Counter()
    for said in shared:
        yes, total = sum(said.values()), len(said)
        no = total - yes
        values.update({True: yes, False: no})
        pairs += total * (total - 1)
        same += yes * (yes - 1) + no * (no - 1)
        disagreed += 2 * yes * no / (total - 1)
    if not pairs:
        return None, None
    expected = 2 * values[True] * values[False] / (values.total() - 1)
    return same / pairs, 1 - disagreed / expected if expected else None
