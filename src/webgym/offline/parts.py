"""What a task of the offline web is made of.

A task is a list of parts. A part is one thing to ask for: its clause in the instruction, its facts (one
fact group), the moves that solve it and the sentence that answers it. A task and everything that can
be decomposed from it (paper Algorithm 1) are therefore compositions of the same parts, and no model
is needed to write them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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

Expected: TypeAlias = Literal["success", "blocked", "environment_error", "judge_error"]


@dataclass(frozen=True)
class Fact:
    """One thing that a trajectory must show.

    Attributes:
        text: the fact, as a rubric says it. It never gives the answer away.
        evidence: views that confirm it, any one of them.
        state: what the server must hold.
        answer: alternatives of which the answer must contain one; empty if the fact is not asked for.
        wrong: what a right answer does not contain: the other candidates.
    """

    text: str
    evidence: tuple[Evidence, ...] = ()
    state: tuple[StateCheck, ...] = ()
    answer: tuple[str, ...] = ()
    wrong: tuple[str, ...] = ()


@dataclass(frozen=True)
class Part:
    """One thing to ask for.

    Attributes:
        ask: an imperative clause without a full stop: ``"find the cheapest kettle and give its price"``.
            It must make sense alone and after other parts.
        description: of the fact group.
        facts: at least one.
        moves: from the website's front page until all evidence was seen and all state is reached.
        says: the sentence that answers it; empty if nothing is asked.
    """

    ask: str
    description: str
    facts: tuple[Fact, ...]
    moves: tuple[Move, ...]
    says: str = ""


@dataclass(frozen=True)
class Assignment:
    """A task before it is written out.

    Attributes:
        name: unique on its website, part of the task's id.
        parts: in the order in which they are asked for.
        expects: how a faultless attempt ends.
    """

    name: str
    parts: tuple[Part, ...]
    expects: Expected = "success"


@dataclass(frozen=True)
class Wording:
    """How a collection's tasks are written out.

    Attributes:
        source: of the tasks, and the first part of their ids.
        instruct: from the website's brand and the parts' clauses to the instruction.
        answer: from what the parts say to the answer.
        keeps_count: whether the parts are told apart by number: the solution says when each is done, a
            memory key that is empty or begins with a space is led by the part's number, and the answer's
            values stand in the parts' order.
    """

    source: str
    instruct: Callable[[str, Sequence[str]], str]
    answer: Callable[[Sequence[str]], str]
    keeps_count: bool = False


def _sentences(brand: str, asks: Sequence[str]) -> str:
    first, *others = asks
    sentences = [f"On {brand}, {first}."]
    sentences += [f"{lead} {ask}." for lead, ask in zip(("Also", "Finally,"), others[:2], strict=False)]
    sentences += [f"And {ask}." for ask in others[2:]]
    return " ".join(sentences)


SENTENCES = Wording("offline", _sentences, lambda says: " ".join(says) or "Done.")
"""Plain English sentences."""


@dataclass(frozen=True)
class Place:
    """The website a task is about, as far as a task needs to know it.

    Attributes:
        label: first part of its hostname; part of the task's id.
        brand: how the instruction calls it.
        host: evidence counts on it alone.
        start: URL of the front page.
        domain, subdomain: of the Mind2Web-2 taxonomy.
        split: of all its tasks: a website is never in both.
        wording: how its tasks are written out.
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
    """The assignment as a task, followed by the tasks that are decomposed from it."""
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
    answer = _answer(chosen, in_order=wording.keeps_count)
    says = wording.answer([part.says for part in chosen if part.says])
    held = _held(chosen)
    return Task(
        id=root if is_whole else f"{root}/{'+'.join(str(number) for number, _ in parts)}",
        instruction=wording.instruct(place.brand, [part.ask for part in chosen]),
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
                    state=tuple(held.get(check.key, check) for check in fact.state),
                )
                for number, part in parts
                for index, fact in enumerate(part.facts)
            ),
            answer=answer,
            moves=(*_moves(chosen, keeps_count=wording.keeps_count), Give(says)),
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


def _held(parts: Sequence[Part]) -> dict[tuple[str, ...], StateCheck]:
    """Collections that several parts add to, such as a cart, must hold what they add together."""
    checks = [check for part in parts for fact in part.facts for check in fact.state]
    held: dict[tuple[str, ...], dict[str, Any]] = {}
    for check in checks:
        if isinstance(check.value, dict):
            held.setdefault(check.key, {}).update(check.value)
    return {key: StateCheck(key, value) for key, value in held.items()}


def _expected(whole: Expected, parts: Sequence[Part]) -> Expected:
    # Where a server loses what visitors did, only a task that asks the server for it cannot be judged.
    if whole == "judge_error" and not any(fact.state for part in parts for fact in part.facts):
        return "success"
    return whole


def _answer(parts: Sequence[Part], *, in_order: bool = False) -> AnswerTruth:
    facts = [fact for part in parts for fact in part.facts]
    asked = [fact.answer for fact in facts if fact.answer]
    required = tuple(asked if in_order else dict.fromkeys(asked))
    said = {option.casefold() for options in required for option in options}
    # What is wrong for one part may be right, or part of what is right, for another.
    wrong = dict.fromkeys(w for fact in facts for w in fact.wrong)
    if in_order:  # as a whole word of what is right only: 1 is wrong where 12 is right
        padded = [f" {option} " for option in said]
        forbidden = tuple(w for w in wrong if not any(f" {w.casefold()} " in option for option in padded))
    else:  # a part may also name, beside its answer, what is wrong for another
        said |= {part.says.casefold() for part in parts}
        forbidden = tuple(w for w in wrong if not any(w.casefold() in each for each in said))
    return AnswerTruth(required, forbidden, in_order=in_order and bool(required))


def exactly(path: str) -> str:
    """Pattern of a page's address, whatever its query."""
    return re.escape(path) + r"(?:\?|$)"


def shown(path: str, *texts: str) -> Evidence:
    """Evidence: these texts, together, at an address that matches ``path``."""
    return Evidence(texts, path)
