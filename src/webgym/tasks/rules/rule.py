"""The types of rules, of their input and of their findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.core.task import Rubric
from webgym.tasks.rules.reading import Text, stem

Severity: TypeAlias = Literal["error", "warning"]


_QUOTED_CHARS: Final = 160
"""Most characters of a fact that a finding quotes."""


class DraftGroup(msgspec.Struct, frozen=True):
    """A fact group as a model wrote it, unchecked."""

    id: int
    description: str
    facts: tuple[str, ...]


class Draft(msgspec.Struct, frozen=True):
    """A rubric as a model wrote it, unchecked.

    Attributes:
        fact_groups: in the model's order.
        difficulty: the number of facts according to the model.
    """

    fact_groups: tuple[DraftGroup, ...]
    difficulty: int

    @classmethod
    def of(cls, rubric: Rubric) -> Draft:
        """The draft of a finished rubric, for checking it again."""
        groups = tuple(DraftGroup(group.id, group.description, group.facts) for group in rubric.groups)
        return cls(groups, rubric.difficulty)


class Asked(msgspec.Struct, frozen=True):
    """The task that a rubric is for, as the rules see it.

    Attributes:
        instruction: of the task.
        website: its URL or host, whose name a fact may contain.
        hints: the source's steps and criteria, which may contain the answer.
        answers: reference and example answers.
        derived: whether the task was derived from another, whose group ids its groups keep.
    """

    instruction: str
    website: str = ""
    hints: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    derived: bool = False


class Fact(msgspec.Struct, frozen=True):
    """A fact, its group's id, and its number in the group, from 1."""

    group: int
    number: int
    text: Text


class Finding(msgspec.Struct, frozen=True):
    """A rule that a rubric breaks.

    Attributes:
        rule: id of the rule.
        severity: a rubric with an ``"error"`` is refused, a ``"warning"`` is only reported.
        message: one line: the fact, what is wrong with it, and its text.
    """

    rule: str
    severity: Severity
    message: str

    def __str__(self) -> str:
        return f"{self.message} [{self.rule}]"


class Case:
    """A draft together with its task: the input of the rules."""

    def __init__(self, draft: Draft, context: Asked) -> None:
        self.draft = draft
        self.context = context
        self.task = Text(context.instruction)

    @cached_property
    def facts(self) -> list[Fact]:
        """Every fact that is not blank."""
        return [
            Fact(group.id, number, Text(fact))
            for group in self.draft.fact_groups
            for number, fact in enumerate(group.facts, start=1)
            if fact.strip()
        ]

    def says(self, phrase: str) -> bool:
        """Whether the task contains this lower-case phrase."""
        return phrase in self.task.folded

    def asks_for(self, verb: str) -> bool:
        """Whether the task contains a form of this verb."""
        return stem(verb.casefold()) in self.task.stems


Check: TypeAlias = Callable[[Case], Iterator[str]]
"""Yields one message for every violation of a rule."""


class Rule(msgspec.Struct, frozen=True):
    """One rule of the rubric.

    Attributes:
        id: its name in findings and in the documentation.
        severity: of its findings.
        about: what it requires, in one line.
        look: yields a message for every violation.
    """

    id: str
    severity: Severity
    about: str
    look: Check


def message(fact: Fact, problem: str) -> str:
    """One line about a fact: its position, what is wrong with it, and its text."""
    quoted = " ".join(fact.text.raw.split())
    quoted = quoted if len(quoted) <= _QUOTED_CHARS else f"{quoted[: _QUOTED_CHARS - 1]}…"
    return f"fact {fact.number} of group {fact.group} {' '.join(problem.split())}: {quoted!r}"
