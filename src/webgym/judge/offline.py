"""The judge of the offline web: it checks a trajectory against the task's known ground truth, without a
model.

It reads the text that was visible in each screenshot, which is recorded with it, and the state of the
website's server at the end. It ignores what the policy says it did.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from webgym.core.errors import JudgeError
from webgym.core.task import Task
from webgym.core.text import fold, mentions, says
from webgym.core.trajectory import Episode
from webgym.core.truth import AnswerTruth, Evidence, FactTruth, Give, StateCheck, Truth
from webgym.core.verdict import FactJudgement, Judgement, Verdict
from webgym.judge.base import Pictures
from webgym.judge.blocking import find_block
from webgym.judge.claims import (
    claims,
    numeral,
    spelled,
    swapped,
    with_units,
    without_denied,
    without_markup,
    without_qualifiers,
    without_reported,
)
from webgym.judge.hedging import copied, other_candidate
from webgym.judge.numbers import numbers
from webgym.judge.soft import score_of

COUNTED_NOT_READ = 10
"""Integers below this need not be visible in a screenshot: they may number a list or count items."""


_MOST_LEADING = 3
"""Most texts of a view of one thing; one with more is of a list."""


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

    name = "offline/8"

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
        facts = tuple(
            FactJudgement(
                group.id, index, text, self._fact(truth, group.id, index, views, episode.final_state)
            )
            for group, index, text in task.rubric.facts()
        )
        response = reference = None
        if episode.answer is not None:
            response = _response(task, truth, views, episode)
            reference = _reference(task, truth, episode.answer, {view.text for view in views})
        criteria = (*(fact.judgement for fact in facts), response, reference)
        passed = bool(response and all(criterion.passed for criterion in criteria if criterion))
        blocked = find_block(task, episode) if not passed else Judgement(False, "the task was done")
        return Verdict(
            judge=self.name,
            reward=None if blocked.passed else int(passed),
            facts=facts,
            response=response,
            reference=reference,
            blocked=blocked,
            score=score_of(task.rubric, facts),
        )

    def _fact(
        self, truth: Truth, group: int, index: int, views: list[_View], state: dict[str, Any] | None
    ) -> Judgement:
        """Criterion A: whether the screenshots and the server's state confirm one fact."""
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
                return Judgement(False, f"no screenshot shows {wanted}")
            reasons.append(f"shown at step {steps[0] + 1}")
        for check in fact.state:
            if state is None:  # no page of it was opened
                return Judgement(False, f"nothing was done on {truth.host}", steps)
            actual = _look_up(check, state)
            if actual != check.value and (actual or check.value is not None):
                name = " / ".join(check.key)
                return Judgement(False, f"the server holds {name} = {actual!r}, not {check.value!r}", steps)
            reasons.append(f"the server holds {' / '.join(check.key)} = {actual!r}")
        return Judgement(True, "; ".join(reasons), steps)


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


def _reference(task: Task, truth: Truth, answer: str, pages: Iterable[str] = ()) -> Judgement | None:
    """Compare the answer with the required values; ``None`` if the task requires none. ``pages`` are the
    visible texts, which it must not copy."""
    required = truth.answer
    if not required.required:
        return None
    given = [move.text for move in truth.moves if isinstance(move, Give)]
    labels = _labels(truth)
    answer = without_qualifiers(without_markup(_without_websites(answer, truth.hosts)), labels.values())
    answer = without_denied(with_units(answer, required.required), required.forbidden)
    known = spelled(" ".join((task.instruction, *given)))
    folded = without_reported(spelled(answer), known)
    for options in required.required:
        if not claims(folded, [each for option in options for each in numeral(option)], known):
            return Judgement(False, f'the answer does not say "{options[0]}"')
    for wrong in required.forbidden:
        if says(folded, spelled(wrong)):
            return Judgement(False, f'the answer also says "{wrong}"')
    if given and (pair := swapped(folded, required.required, spelled(given[-1]), labels)):
        return Judgement(False, f"the answer gives {pair}")
    if required.in_order and (fault := _out_of_order(required, folded)):
        return Judgement(False, fault)
    told = (task.instruction, *given, *_shown(truth))
    if other := other_candidate(answer, required.required, told, required.forbidden):
        return Judgement(False, f'the answer also claims "{other}"')
    if quoted := copied(answer, pages, required.required, told):
        return Judgement(False, f'the answer copies the page: "{quoted}"')
    return Judgement(True, "the answer says all that it must")


def _shown(truth: Truth) -> Iterator[str]:
    """What the answer may also tell: the values that led to it, as by which an item was chosen."""
    for fact in truth.facts:
        for evidence in fact.evidence[:1]:
            if len(evidence.texts) <= _MOST_LEADING:
                yield from evidence.texts


def _labels(truth: Truth) -> dict[str, str]:
    """The text beside each value on its page, by the value; other candidates are no label."""
    views = [each.texts for fact in truth.facts for each in fact.evidence[:1] if each.texts]
    return {
        value: " ".join(beside)
        for *beside, value in views
        if len(beside) < _MOST_LEADING and not {*beside} & {*truth.answer.forbidden}
    }


def _without_websites(answer: str, hosts: Iterable[str]) -> str:
    """The answer without names and addresses of the task's websites: "Fern Desk & Paper" names no desk."""
    for host in hosts:
        label, _, domain = host.partition(".")
        name = r"\W+(?:and\W+)?".join(map(re.escape, label.split("-")))
        if "-" in label:
            address = rf"(?:https?://)?\b{name}\b(?:\.{re.escape(domain)}\S*)?"
            answer = re.sub(address, "", answer, flags=re.IGNORECASE)
    return answer


def _out_of_order(truth: AnswerTruth, folded: str) -> str:
    """What is wrong with the order of an answer's values; empty if nothing is."""
    value_of = {
        spelled(each): spellings
        for spellings in truth.required
        for option in spellings
        for each in numeral(option)
        if each != "one"  # may be a pronoun
    }
    given = [value_of[mention] for mention in mentions(folded, value_of)]
    times = max(1, len(given) // len(truth.required))  # "7, 12. Answer: 7, 12"
    if given == list(truth.required) * times:
        return ""
    wanted, named = (", ".join(spellings[0] for spellings in places) for places in (truth.required, given))
    return f'the answer says "{named}", not "{wanted}"'


def _response(task: Task, truth: Truth, views: list[_View], episode: Episode) -> Judgement:
    """Criterion B: every number in the answer occurs in a screenshot, the task or the required values."""
    assert episode.answer is not None
    if not episode.answer.strip():
        return Judgement(False, "the answer is empty")
    grounded = numbers(task.instruction)
    for options in truth.answer.required:
        grounded.update(*(numbers(spelled(each)) for option in options for each in numeral(option)))
    for view in views:
        grounded |= numbers(view.text)
    told = without_reported(spelled(without_markup(episode.answer)), fold(task.instruction))
    invented = {
        number
        for number in numbers(told) - grounded
        if number >= COUNTED_NOT_READ or number != number.to_integral_value()
    }
    if invented:
        return Judgement(False, f"no screenshot shows {', '.join(str(n) for n in sorted(invented))}")
    why = "every number in the answer was seen, given or asked for"
    return Judgement(True, why, tuple(view.index for view in views[-1:]))
