"""Published judge replies with human labels, as data for measuring agreement.

Records of the AgentRewardBench study, judged by WebJudge (SOURCES.md, "Judge labels"): a JSON object per line
with ``judge_response`` (ends in ``Status: success`` or ``failure``), ``judge_status`` (the status that the
study parsed from it) and ``human`` (annotators' labels; their ``success`` is Successful, Unsuccessful or
Unsure). Online-Mind2Web's own result files of WebJudge and of WebVoyager's judge, whose names begin with the
judge's, are read, too: ``evaluation_details`` has the reply as ``response``, and ``predicted_label`` is 1 or
0. They have no labels; those are joined by ``task_id``.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec.structs import replace

from webgym.core.errors import UsageError
from webgym.core.text import THOUGHT_END
from webgym.judge.agreement import Case
from webgym.judge.labels import BrokenLabel, HumanLabel, Humans, Label, settled
from webgym.judge.verdicts import plain, runs_on, stands_alone, trimmed

_STATUS: Final = re.compile(r"(?:final )?status\s?[:=–—-]\s?(?P<said>[a-z -]+)")
SUCCESS: Final = re.compile(
    r"(?:(?:(?:final|overall|my) )?(?:verdict|evaluation|result)\s?[:=–—-]\s?)?(?P<said>(?:not )?success)"
)
"""A verdict in the form of WebVoyager's judge, whose label may be missing."""
_LAST_SENTENCE: Final = re.compile(r"(?P<before>.*[.!?][\"'”’)\]]*)\s+(?P<last>\S.*)", re.DOTALL)
_TAIL: Final = 400
"""Characters at a reply's end in which its last sentence is looked for."""
_STATUSES: Final = {
    "success": True,
    "successful": True,
    "failure": False,
    "failed": False,
    "fail": False,
    "not success": False,
    "not successful": False,
    "unsuccessful": False,
}


class Labelled(msgspec.Struct, frozen=True):
    """A judged trajectory with human labels.

    Attributes:
        key: judge, benchmark, agent and task.
        verdict: the verdict as :func:`read_status` reads the reply; ``None`` if it has none.
        recorded: the status that the study recorded; ``None`` for anything but success and failure.
        humans: each annotator's label, in order; ``None`` for Unsure.
    """

    key: tuple[str, str, str, str]
    verdict: bool | None
    recorded: bool | None
    humans: tuple[bool | None, ...]

    @property
    def human(self) -> bool | None:
        """The first annotator's label."""
        return self.humans[0] if self.humans else None


class _Details(msgspec.Struct):
    response: str | None = None


class _Record(msgspec.Struct):
    judge_response: str | msgspec.UnsetType | None = msgspec.UNSET
    judge_status: str | None = None
    evaluation_details: _Details | None = None
    predicted_label: int | None = None
    human: list[dict[str, Any]] = []
    judge: str = ""
    benchmark: str = ""
    agent: str = ""
    task_id: str | int = ""


def read_status(reply: str, form: re.Pattern[str] = _STATUS) -> bool | None:
    """The verdict of a WebJudge reply; ``None`` if it has none, or two. Never raises.

    A status on a line of its own counts; if there is none, the last sentence does. It must stand alone: a
    question, a quotation, a condition or a part of a longer sentence ("neither here nor status: success") is
    no status, nor is one inside of the model's thinking.

    Args:
        reply: the text.
        form: of a status, folded; ``said`` is the word that states it.
    """
    lines = [line for line in map(trimmed, THOUGHT_END.split(reply)[-1].splitlines()) if plain(line)]
    places = zip(["", *lines], lines, [*lines[1:], ""], strict=False)
    said = [(match, *place) for place in places if (match := form.fullmatch(plain(place[1])))]
    if len({match["said"] for match, *_ in said if match.start("said") == 0}) > 1:
        return None  # words without a label contradict each other wherever they stand
    statuses = {
        _STATUSES.get(match["said"].strip())
        for match, before, line, after in said
        if (stands_alone(line, before) if match.start("said") == 0 else not runs_on(line, before))
        and not after[:1].islower()  # the sentence goes on: "would be wrong"
    }
    if not statuses and lines and (end := _LAST_SENTENCE.fullmatch(lines[-1][-_TAIL:])):
        match = form.fullmatch(plain(end["last"]))
        return (
            _STATUSES.get(match["said"].strip())
            if match and stands_alone(end["last"], end["before"])
            else None
        )
    return statuses.pop() if len(statuses) == 1 else None


def read_labelled(
    path: Path, broken: list[BrokenLabel] | None = None, labels: Sequence[HumanLabel] = ()
) -> Iterator[Labelled]:
    """The records of a file, in order.

    Args:
        path: of the file.
        broken: a list to which lines that are not such records are added; they are then skipped.
        labels: of tasks, for the records without any.

    Raises:
        UsageError: the file cannot be read, or a line is not such a record and ``broken`` is ``None``.
    """
    by_task: dict[str, list[bool | None]] = defaultdict(list)
    for label in labels:
        if label.label != "not_executable":
            by_task[label.task_id].append({"success": True, "failure": False}.get(label.label))
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, 1):
                if not line.strip():
                    continue
                try:
                    found = _labelled(line, path.name.casefold().startswith("webvoyager"))
                    yield found if found.humans else replace(found, humans=tuple(by_task[found.key[3]]))
                except ValueError as error:
                    if broken is None:
                        raise UsageError(f"{path} line {number} is not a judge record: {error}") from error
                    broken.append(BrokenLabel(f"line {number}", str(error)))
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from error


def _labelled(line: bytes, is_webvoyager: bool) -> Labelled:
    record = msgspec.json.decode(line.removeprefix(BOM_UTF8), type=_Record)
    labels = [str(label.get("success", "")).strip().casefold() for label in record.human]
    humans = tuple({"successful": True, "unsuccessful": False}.get(label) for label in labels)
    key = (record.judge, record.benchmark, record.agent, str(record.task_id))
    if record.evaluation_details is not None:
        recorded = {1: True, 0: False}.get(-1 if record.predicted_label is None else record.predicted_label)
        reply = record.evaluation_details.response or ""
        verdict = read_status(reply, SUCCESS if is_webvoyager else _STATUS)
        judge = record.judge or ("WebVoyager" if is_webvoyager else "WebJudge")
        return Labelled((judge, *key[1:]), verdict, recorded, humans)
    if record.judge_response is msgspec.UNSET:
        raise ValueError("it has neither judge_response nor evaluation_details")
    status = (record.judge_status or "").strip().casefold()
    return Labelled(key, read_status(record.judge_response or ""), _STATUSES.get(status), humans)


class Pairs(msgspec.Struct, frozen=True):
    """Records as cases for :func:`webgym.judge.agreement.agreement`.

    Attributes:
        judges: names: first the judges with the verdicts that the study recorded (``..., as recorded``; only
            judges that have them), then all judges with the verdicts that :func:`read_status` reads. A
            recorded verdict does not count for a reply in which none can be read.
        cases: trajectories that all judges have a record of, with a human label.
        left_out: number of other trajectories, by the reason for leaving them out.
        apart: keys of the records whose recorded and read verdicts differ.
    """

    judges: tuple[str, ...]
    cases: list[Case]
    left_out: Counter[str]
    apart: tuple[tuple[str, str, str, str], ...]


def pairs_of(records: Iterable[Labelled], humans: Humans = "first", *, unsure_fails: bool = True) -> Pairs:
    """Join the records of one or several judges by trajectory.

    Args:
        records: of any number of judges.
        humans: how the labels of several annotators are combined.
        unsure_fails: count "unsure" as a failure, as the study does; ``False`` leaves the trajectory out.
    """
    by_key = _by_key(records)
    names = list(dict.fromkeys(record.key[0] for record in by_key.values()))
    recorded = [
        name
        for name in names
        if any(record.recorded is not None and record.key[0] == name for record in by_key.values())
    ]
    cases, left_out = [], Counter[str]()
    for trajectory in dict.fromkeys(key[1:] for key in by_key):
        matching = [by_key.get((name, *trajectory)) for name in names]
        available = [record for record in matching if record is not None]
        human = _human(available[0].humans, humans, unsure_fails)
        if len(available) < len(names):
            left_out["not judged by every judge"] += 1
        elif isinstance(human, str):
            left_out[human] += 1
        else:
            verdicts = [
                record.recorded if record.verdict is not None else None
                for record in available
                if record.key[0] in recorded
            ]
            verdicts += [record.verdict for record in available]
            benchmark, _, task = available[0].key[1:]
            cases.append(Case(human, tuple(verdicts), task=f"{benchmark}/{task}" if task else ""))
    differing = tuple(
        record.key
        for record in by_key.values()
        if record.key[0] in recorded and record.verdict != record.recorded
    )
    return Pairs((*(f"{name}, as recorded" for name in recorded), *names), cases, left_out, differing)


def _by_key(records: Iterable[Labelled]) -> dict[tuple[str, ...], Labelled]:
    """Records by judge and trajectory. Records with the same key count as different trajectories, in
    order."""
    by_key: dict[tuple[str, ...], Labelled] = {}
    repeats: Counter[tuple[str, ...]] = Counter()
    for record in records:
        by_key[*record.key, str(repeats[record.key])] = record
        repeats[record.key] += 1
    return by_key


def _human(labels: tuple[bool | None, ...], humans: Humans, unsure_fails: bool) -> bool | str:
    """The combined human label (true is success), or why the trajectory is left out."""
    words: dict[bool | None, Label] = {True: "success", False: "failure", None: "unsure"}
    label = settled([words[choice] for choice in labels], humans)
    if label == "unsure":
        return False if unsure_fails else "the annotators are unsure"
    if label is None:
        return "the annotators do not agree" if labels else "nobody labelled it"
    return label == "success"
