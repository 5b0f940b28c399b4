"""Judge replies that others have published with human labels beside them, as pairs for measuring agreement.

Records of the AgentRewardBench study, judged by WebJudge (SOURCES.md, "Judge labels"): a JSON object per line
with ``judge_response`` (ends in ``Status: success`` or ``failure``), ``judge_status`` (what the study's own
reader made of it) and ``human`` (annotators' labels, ``success`` being Successful, Unsuccessful or Unsure).
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from webgym.core.errors import UsageError
from webgym.judge.verdicts import plain

_STATUS: Final = re.compile(r"(?:final )?status\s?[:=–—-]\s?(?P<said>[a-z -]+)")
_AT_END: Final = re.compile(
    r"\bstatus\W{1,6}(?P<said>(?:not |un)?success(?:ful)?|failure|failed)\W*$", re.IGNORECASE
)
_SAID: Final = {
    "success": True,
    "successful": True,
    "failure": False,
    "failed": False,
    "fail": False,
    "not success": False,
    "not successful": False,
    "unsuccessful": False,
}
_THOUGHT_END: Final = re.compile(r"</think(?:ing)?\s*>", re.IGNORECASE)


class Labelled(msgspec.Struct, frozen=True):
    """A judged trajectory with what people said of it.

    Attributes:
        key: judge, benchmark, agent and task.
        verdict: what the reply says, read strictly; ``None`` if it holds no verdict.
        recorded: what the study's own reader took it for; ``None`` for anything but success and failure.
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


class _Record(msgspec.Struct):
    judge_response: str | None = None
    judge_status: str | None = None
    human: list[dict[str, Any]] = []
    judge: str = ""
    benchmark: str = ""
    agent: str = ""
    task_id: str | int = ""


def read_status(reply: str) -> bool | None:
    """The verdict of a WebJudge reply; ``None`` if it holds none, or two. Never raises.

    A line of its own that says the status counts, and where there is none, the reply's very end. A status
    that is told of within the thoughts does not, nor one that is cut off.
    """
    said = _THOUGHT_END.split(reply)[-1]
    found = set()
    for line in said.splitlines():
        match = _STATUS.fullmatch(plain(line))
        if match is not None:
            found.add(_SAID.get(match["said"].strip()))
    if not found:
        end = _AT_END.search(unicodedata.normalize("NFKC", said[-200:]))
        return _SAID[end["said"].casefold()] if end else None
    return found.pop() if len(found) == 1 else None


def read_labelled(path: Path) -> Iterator[Labelled]:
    """The records of a file, in order.

    Raises:
        UsageError: the file cannot be read, or a line is no such record; names the line.
    """
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, 1):
                if line.strip():
                    yield _labelled(line, f"{path} line {number}")
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from error


def _labelled(line: bytes, where: str) -> Labelled:
    try:
        record = msgspec.json.decode(line, type=_Record)
    except ValueError as error:
        raise UsageError(f"{where} is no judge record: {error}") from error
    labels = [str(label.get("success", "")).strip().casefold() for label in record.human]
    humans = tuple({"successful": True, "unsuccessful": False}.get(label) for label in labels)
    status = (record.judge_status or "").strip().casefold()
    return Labelled(
        (record.judge, record.benchmark, record.agent, str(record.task_id)),
        read_status(record.judge_response or ""),
        _SAID.get(status),
        humans,
    )
