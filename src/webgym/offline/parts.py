"""The parts of which tasks of the offline web are composed.

A task is a list of parts. A part is a subtask: its clause in the instruction, its facts (one fact group), and
the moves that solve it. A task and all tasks derived from it by decomposition (paper Algorithm 1) are
compositions of the same parts, so no model is needed to write them. The instruction ends by saying how to
answer: with the values alone, in the order of the parts.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, TypeAlias, TypeGuard

from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.truth import (
    AnswerTruth,
    Done,
    Evidence,
    FactTruth,
    Give,
    Home,
    Move,
    Remember,
    StateCheck,
    Truth,
)
from webgym.offline.data import Table, load
from webgym.offline.seeds import pick

_CHANGED = ("cart", "files", "saved", "sent")
"""What a website reports that tasks change."""

Expected: TypeAlias = Literal["success", "blocked", "environment_error", "judge_error"]


@dataclass(frozen=True)
class Fact:
    """A fact that a trajectory must show.

    Attributes:
        text: its text in the rubric, which never reveals the answer.
        evidence: views that confirm it; one of them is enough.
        state: required state of the server.
        answer: spellings of the value that the answer gives for it; empty if it gives none.
        what: what instructions call that value: ``"the price of the Blue Mug"``.
        wrong: other candidates, which are not right.
    """

    text: str
    evidence: tuple[Evidence, ...] = ()
    state: tuple[StateCheck, ...] = ()
    answer: tuple[str, ...] = ()
    what: str = "the value"
    wrong: tuple[str, ...] = ()


@dataclass(frozen=True)
class Part:
    """A subtask.

    Attributes:
        ask: an imperative clause without a full stop: ``"find the cheapest kettle and give its price"``.
            It must make sense alone and after other parts.
        description: of the fact group.
        facts: at least one.
        moves: the solution, from the website's front page until all evidence is seen and all state is
            reached.
    """

    ask: str
    description: str
    facts: tuple[Fact, ...]
    moves: tuple[Move, ...]


@dataclass(frozen=True)
class Assignment:
    """A task before it is written out.

    Attributes:
        name: unique on its website, part of the task's id.
        parts: in the order of the instruction.
        expects: how a correct attempt ends.
    """

    name: str
    parts: tuple[Part, ...]
    expects: Expected = "success"


class AnswerForms(Table, frozen=True):
    """How instructions ask for the answer: alternatives for one value, several and none.

    They are in ``answers.toml``, and have the placeholders ``{what}`` and ``{count}``.
    """

    one: tuple[str, ...]
    many: tuple[str, ...]
    none: tuple[str, ...]

    def sentence(self, whats: Sequence[str], *seeds: object) -> str:
        """The sentence for these values, drawn by ``seeds``."""
        phrases = self.many if len(whats) > 1 else self.one if whats else self.none
        return pick(phrases, "answer form", *seeds).format(what="; ".join(whats), count=len(whats))


@cache
def answer_forms() -> dict[str, AnswerForms]:
    """The forms of each collection's answers."""
    return load("webgym.offline", "answers.toml", dict[str, AnswerForms])


@dataclass(frozen=True)
class Wording:
    """The wording of a collection's tasks.

    Attributes:
        source: of the tasks, and the first part of their ids.
        instruct: composes the instruction from the website's brand and the clauses of the parts.
        form: key of the answers' forms in ``answers.toml``.
        separator: what stands between the values of an answer.
        keeps_count: whether parts are numbered: the solution marks when each is done, and memory keys that
            are empty or begin with a space get the part's number as a prefix.
    """

    source: str
    instruct: Callable[[str, Sequence[str]], str]
    form: str = "large"
    separator: str = "\n"
    keeps_count: bool = False


def _sentences(brand: str, asks: Sequence[str]) -> str:
    first, *others = asks
    sentences = [f"On {brand}, {first}."]
    sentences += [f"{lead} {ask}." for lead, ask in zip(("Also", "Finally,"), others[:2], strict=False)]
    sentences += [f"And {ask}." for ask in others[2:]]
    return " ".join(sentences)


SENTENCES = Wording("offline", _sentences)
"""Plain English sentences; the answer has a line for each value."""


@dataclass(frozen=True)
class Place:
    """The properties of a website that tasks contain.

    Attributes:
        label: first part of its hostname; part of the task's id.
        brand: its name in instructions.
        host: its hostname; evidence counts only there.
        start: URL of the front page.
        domain, subdomain: of the Mind2Web-2 taxonomy.
        split: of all its tasks.
        wording: of its tasks.
    """

    label: str
    brand: str
    host: str
    start: str
    domain: str
    subdomain: str
    split: Literal["train", "test"] | None = None
    wording: Wording = SENTENCES


def write(place: Place, assignment: Assignment) -> list[Task]:
    """The task of an assignment, followed by the tasks derived from it by decomposition."""
    rubric = Rubric(
        tuple(
            FactGroup(number, part.description, tuple(fact.text for fact in part.facts))
            for number, part in enumerate(assignment.parts, start=1)
        )
    )
    return [_compose(place, assignment, chosen) for chosen in (rubric, *rubric.decompositions())]


def _compose(place: Place, assignment: Assignment, rubric: Rubric) -> Task:
    parts = [(group.id, assignment.parts[group.id - 1]) for group in rubric.groups]
    chosen = [part for _, part in parts]
    wording = place.wording
    root = f"{wording.source}/{place.label}/{assignment.name}"
    is_whole = len(parts) == len(assignment.parts)
    answer = _answer(chosen, by_comma=wording.separator != "\n")
    whats = [fact.what for part in chosen for fact in part.facts if fact.answer]
    task_id = root if is_whole else f"{root}/{'+'.join(str(number) for number, _ in parts)}"
    form = answer_forms()[wording.form].sentence(whats, task_id)
    merged = _merged_checks(chosen)
    changed = {check.key[0] for part in chosen for fact in part.facts for check in fact.state}
    others = [StateCheck((kind,), None) for kind in _CHANGED if kind not in changed]
    first = next((fact for part in chosen for fact in part.facts if fact.state), None)
    return Task(
        id=task_id,
        instruction=f"{wording.instruct(place.brand, [part.ask for part in chosen])} {form}",
        website=place.start,
        domain=place.domain,
        subdomain=place.subdomain,
        rubric=rubric,
        source=wording.source,
        reference_answer="; ".join(options[0] for options in answer.required) or None,
        parent_id=None if is_whole else root,
        split=place.split,
        truth=Truth(
            host=place.host,
            facts=tuple(
                FactTruth(
                    group=number,
                    index=index,
                    evidence=fact.evidence,
                    state=(
                        *(merged.get(check.key, check) for check in fact.state),
                        *(others if fact is first else ()),
                    ),
                )
                for number, part in parts
                for index, fact in enumerate(part.facts)
            ),
            answer=answer,
            moves=(
                *_moves(chosen, keeps_count=wording.keeps_count),
                Give(wording.separator.join(options[0] for options in answer.values)),
            ),
            expects=_expected(assignment.expects, chosen),
        ),
    )


def _moves(parts: Sequence[Part], *, keeps_count: bool) -> list[Move]:
    moves: list[Move] = []
    for number, part in enumerate(parts, start=1):
        own = part.moves
        if keeps_count:
            named = (
                Remember(f"{number}{move.key}", move.value) if _belongs_to_part(move) else move
                for move in own
            )
            own = (*named, Done(str(number)))
        moves += [Home(), *own]
    return moves


def _belongs_to_part(move: Move) -> TypeGuard[Remember]:
    return isinstance(move, Remember) and move.key[:1] in ("", " ")


def _merged_checks(parts: Sequence[Part]) -> dict[tuple[str, ...], StateCheck]:
    """Merge the checks of collections that several parts add to, such as a cart."""
    checks = [check for part in parts for fact in part.facts for check in fact.state]
    merged: dict[tuple[str, ...], dict[str, Any]] = {}
    for check in checks:
        if isinstance(check.value, dict):
            merged.setdefault(check.key, {}).update(check.value)
    return {key: StateCheck(key, value) for key, value in merged.items()}


def _expected(whole: Expected, parts: Sequence[Part]) -> Expected:
    # If a server loses its state, only tasks with state checks cannot be judged.
    if whole == "judge_error" and not any(fact.state for part in parts for fact in part.facts):
        return "success"
    return whole


def _answer(parts: Sequence[Part], *, by_comma: bool) -> AnswerTruth:
    facts = [fact for part in parts for fact in part.facts]
    required = tuple(fact.answer for fact in facts if fact.answer)
    accepted = {option.casefold() for options in required for option in options}
    wrong = dict.fromkeys(text for fact in facts for text in fact.wrong)
    return AnswerTruth(required, tuple(w for w in wrong if w.casefold() not in accepted), by_comma)


def exactly(path: str) -> str:
    """Regular expression for the address of a page, with any query."""
    return re.escape(path) + r"(?:\?|$)"


def shown(path: str, *texts: str) -> Evidence:
    """Evidence: these texts together on a page whose path matches the regular expression ``path``."""
    return Evidence(texts, path)
