"""The judge of the offline web: it checks a trajectory against the task's known ground truth, without a
model.

It reads the text that was visible in each screenshot, which is recorded with it, and the state of the
website's server at the end. It ignores what the policy says it did.

Instructions say how to answer, with the values alone and in the order asked for, so nothing of an answer is
interpreted: it is split into items, what a list or emphasis adds is taken off, and each item must be a
spelling of its value. Nothing else is right.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from webgym.core.errors import JudgeError
from webgym.core.task import Task
from webgym.core.text import fold, says
from webgym.core.trajectory import Episode
from webgym.core.truth import AnswerTruth, Evidence, FactTruth, StateCheck, Truth
from webgym.core.verdict import FactJudgement, Fault, Judgement, Verdict
from webgym.judge.base import Pictures, score_of
from webgym.judge.blocking import find_block


@dataclass(frozen=True)
class _View:
    """An observation of one of the task's websites, with its visible text folded for searching."""

    index: int
    host: str
    path: str
    text: str


def why_unjudgeable(task: Task) -> str:
    """Why the offline judge cannot judge a task, as the end of a sentence about it; empty if it can."""
    if task.truth is None:
        return "has no hidden truth, as only the offline web's tasks have"
    known = {(fact.group, fact.index) for fact in task.truth.facts if fact.evidence or fact.state}
    for group, index, _ in task.rubric.facts():
        if (group.id, index) not in known:
            return f"has a truth without evidence for fact {group.id}.{index}"
    return ""


class OfflineJudge:
    """Judges tasks that carry a :class:`webgym.core.truth.Truth`."""

    name = "offline/9"

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        """Judge one episode; see :meth:`webgym.judge.base.Judge.judge`.

        Args:
            task: the attempted task, with its hidden truth.
            episode: the recorded steps, with visible text and the website's final state.
            pictures: not used.

        Raises:
            JudgeError: the task has no truth, visible text was not recorded, or the final state of a website
                that was visited is needed and was not recorded.
        """
        del pictures  # what they show was recorded as text when they were taken
        truth = task.truth
        if truth is None:
            raise JudgeError(
                f"task {task.id} has no hidden truth", hint="the offline judge is for the offline web's tasks"
            )
        views = _views(truth, episode)
        if (
            episode.final_state is None
            and any(fact.state for fact in truth.facts)
            and any(view.host == truth.host for view in views)
        ):  # whatever else failed: pages that were shown after the loss are without it, too
            raise JudgeError(
                "the state of the website's server was not recorded",
                hint="the offline web lost it, or the collector did not request it",
            )
        judged = [
            (group, index, text, *self._fact(truth, group.id, index, views, episode.final_state))
            for group, index, text in task.rubric.facts()
        ]
        facts = tuple(FactJudgement(group.id, index, text, found) for group, index, text, found, _ in judged)
        response = reference = None
        if episode.answer is not None:
            response, reference = compare(truth.answer, episode.answer)
        faults: list[Fault | None] = [fault for *_, fault in judged]
        if response and not response.passed:
            faults.insert(0, "form")
        elif reference and not reference.passed:
            faults.insert(0, "wrong value")
        fault = next((each for each in faults if each), None)
        passed = response is not None and fault is None
        blocked = find_block(task, episode) if not passed else Judgement(False, "the task was done")
        return Verdict(
            judge=self.name,
            reward=None if blocked.passed else int(passed),
            fault=None if blocked.passed or response is None else fault,
            facts=facts,
            response=response,
            reference=reference,
            blocked=blocked,
            score=score_of(task.rubric, facts),
        )

    def _fact(
        self, truth: Truth, group: int, index: int, views: list[_View], state: dict[str, Any] | None
    ) -> tuple[Judgement, Fault | None]:
        """Criterion A: whether the screenshots and the server's state confirm one fact; if not, what is
        missing."""
        fact = next((fact for fact in truth.facts if (fact.group, fact.index) == (group, index)), None)
        if fact is None or not (fact.evidence or fact.state):
            raise JudgeError(
                f"the truth has no evidence for fact {group}.{index}", hint="the task's truth is incomplete"
            )
        steps: tuple[int, ...] = ()
        reasons = []
        if fact.evidence:
            steps = _confirming(fact, truth.host, views)
            if not steps:
                wanted = " or ".join(_describe(evidence) for evidence in fact.evidence[:3])
                return Judgement(False, f"no screenshot shows {wanted}"), "no evidence"
            reasons.append(f"shown at step {steps[0] + 1}")
        for check in fact.state:
            if state is None:  # no page of it was opened
                return Judgement(False, f"nothing was done on {truth.host}", steps), "state"
            actual = _look_up(check, state)
            if actual != check.value and (actual or check.value is not None):
                name = " / ".join(check.key)
                why = f"the server holds {name} = {actual!r}, not {check.value!r}"
                return Judgement(False, why, steps), "state"
            reasons.append(f"the server holds {' / '.join(check.key)} = {actual!r}")
        return Judgement(True, "; ".join(reasons), steps), None


def _views(truth: Truth, episode: Episode) -> list[_View]:
    views, hosts = [], truth.hosts
    for index, observation in enumerate(episode.observations):
        if observation.text is None:
            raise JudgeError(
                "the visible text was not recorded", hint="open sessions with text recording for this judge"
            )
        address = urlsplit(observation.url)
        is_page = (
            observation.status is None or observation.status < 400
        )  # an error page may repeat the request
        host = address.hostname or ""
        if host in hosts and is_page:
            path = f"{address.path}?{address.query}" if address.query else address.path
            views.append(_View(index, host, path, fold(observation.text)))
    return views


def _confirming(fact: FactTruth, host: str, views: list[_View]) -> tuple[int, ...]:
    """Indices of the observations that confirm the fact; evidence without a host of its own counts on
    ``host``."""
    return tuple(
        view.index
        for view in views
        if any(
            view.host == (evidence.host or host)
            and re.match(evidence.path, view.path)
            and all(says(view.text, text) for text in evidence.texts)
            for evidence in fact.evidence
        )
    )


def _describe(evidence: Evidence) -> str:
    quoted = ", ".join(f'"{text}"' for text in evidence.texts)
    return f"{quoted} together" if len(evidence.texts) > 1 else quoted


def _look_up(check: StateCheck, state: dict[str, Any]) -> Any:
    value: Any = state
    for key in check.key:
        value = value.get(key) if isinstance(value, dict) else None
    return value


_ANNOUNCED: Final = re.compile(r"^[\W_]*(?:final )?answer[*_]*\s*:", re.IGNORECASE)
_ENDS: Final = re.compile(r"[\n\r\v\f\x85\u2028\u2029;]")
_ENDS_AND_COMMAS: Final = re.compile(rf"{_ENDS.pattern}|,")
_BULLET: Final = re.compile(r"^[-*+•‣◦]\s+")
_AROUND: Final = "*_`\"'“”‘’„«»"
_MORE_WORDS: Final = 2
"""A wrong item with this many more words than any spelling of its value is taken for a sentence."""


def items(answer: str, *, by_comma: bool = False) -> list[str]:
    """The items of an answer, folded, without list markers, emphasis, quotes and final full stops."""
    values = _ANNOUNCED.sub("", answer, count=1)
    lines = (_ENDS_AND_COMMAS if by_comma else _ENDS).split(values)
    written = filter(None, map(_bare, lines))
    return [
        _bare(item.removeprefix(f"{number}. ").removeprefix(f"{number}) "))
        for number, item in enumerate(written, 1)
    ]


def _bare(text: str) -> str:
    while True:
        shorter = _BULLET.sub("", text.strip().strip(_AROUND).removesuffix(".").strip())
        if shorter == text:
            return fold(text)
        text = shorter


def compare(truth: AnswerTruth, answer: str) -> tuple[Judgement, Judgement | None]:
    """Compare an answer with the values that the task asks for.

    Returns:
        Whether the answer has the form asked for; and whether it gives the right values; ``None`` for
        an answer in another form.
    """
    given, wanted = items(answer, by_comma=truth.by_comma), truth.values
    if len(given) != len(wanted):
        count = "1 value" if len(wanted) == 1 else f"{len(wanted)} values, one a line"
        return Judgement(False, f"the answer has {len(given)} items instead of {count}"), None
    for item, spellings in zip(given, wanted, strict=True):
        known = [_bare(spelling) for spelling in spellings]
        if item in known:
            continue
        if item not in map(_bare, truth.others) and _is_prose(item, known):
            return Judgement(False, f'"{item}" is more than the value alone'), None
        form = Judgement(True, "the answer has as many items as values")
        return form, Judgement(False, f'the answer says "{item}", not "{spellings[0]}"')
    return Judgement(True, "the answer is the values alone"), Judgement(True, "every value is right")


def _is_prose(item: str, known: Sequence[str]) -> bool:
    """Whether an item says more than a value, right or wrong."""
    longest = max(len(spelling.split()) for spelling in known)
    return len(item.split()) > longest + _MORE_WORDS or any(says(item, spelling) for spelling in known)
