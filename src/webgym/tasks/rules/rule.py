"""What a rule is, what it looks at, and what it finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.core.task import Rubric
from webgym.tasks.rules.reading import Text

Severity: TypeAlias = Literal["error", "warning"]


_SHOWN_CHARS: Final = 160
"""How much of a fact a finding quotes."""


class DraftGroup(msgspec.Struct, frozen=True):
    """A fact group as a model wrote it, which may break every rule."""

    id: int
    description: str
    facts: tuple[str, ...]


class Draft(msgspec.Struct, frozen=True):
    """A rubric as a model wrote it.

    Attributes:
        fact_groups: in the model's order.
        difficulty: the number of facts, as the model says.
    """

    fact_groups: tuple[DraftGroup, ...]
    difficulty: int

    @classmethod
    def of(cls, rubric: Rubric) -> Draft:
        """A finished rubric, to be checked again."""
        groups = tuple(DraftGroup(group.id, group.description, group.facts) for group in rubric.groups)
        return cls(groups, rubric.difficulty)


class Asked(msgspec.Struct, frozen=True):
    """What the rubric is for.

    Attributes:
        instruction: the task.
        website: its URL or host, whose name a fact may say.
        hints: the source's steps and criteria, which may hold the answer.
        answers: reference and example answers.
        derived: whether the task was decomposed from another, whose numbers its groups keep.
    """

    instruction: str
    website: str = ""
    hints: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    derived: bool = False


class Fact(msgspec.Struct, frozen=True):
    """A fact and its place."""

    group: int
    number: int
    text: Text


class Finding(msgspec.Struct, frozen=True):
    """A rule that a rubric breaks.

    Attributes:
        rule: its id.
        severity: an ``"error"`` is refused and asked again, a ``"warning"`` reported.
        message: one line: where, what is wrong, and the words in question.
    """

    rule: str
    severity: Severity
    message: str

    def __str__(self) -> str:
        return f"{self.message} [{self.rule}]"


class Case:
    """A draft beside its task, as the rules look at it."""

    def __init__(self, draft: Draft, asked: Asked) -> None:
        self.draft = draft
        self.asked = asked
        self.task = Text(asked.instruction)

    @cached_property
    def facts(self) -> list[Fact]:
        """Every fact that says something, with its group and its number in it, from 1."""
        return [
            Fact(group.id, number, Text(fact))
            for group in self.draft.fact_groups
            for number, fact in enumerate(group.facts, start=1)
            if fact.strip()
        ]

    def says(self, phrase: str) -> bool:
        """Whether the task's own words hold this lower-case phrase."""
        return phrase in self.task.folded


Look: TypeAlias = Callable[[Case], Iterator[str]]
"""Yields one message for every place where a case breaks the rule."""


class Rule(msgspec.Struct, frozen=True):
    """One rule of the rubric.

    Attributes:
        id: as findings and the documentation name it.
        severity: of its findings.
        about: what it asks for, in one line.
        look: what sees where it is broken.
    """

    id: str
    severity: Severity
    about: str
    look: Look


def at(fact: Fact, wrong: str) -> str:
    """One line about a fact: its place, what is wrong with it, and the fact."""
    shown = " ".join(fact.text.raw.split())
    shown = shown if len(shown) <= _SHOWN_CHARS else f"{shown[: _SHOWN_CHARS - 1]}…"
    return f"fact {fact.number} of group {fact.group} {' '.join(wrong.split())}: {shown!r}"
