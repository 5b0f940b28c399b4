"""Checks on the text of a derived task: it states the groups that it keeps, and nothing of the others.

What can be seen without a model is seen here: numbers, names, quotations and telling words. A text that is
refused is asked for again, with the reason.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from pydantic import Field

from webgym.core.task import FactGroup, Task
from webgym.core.text import fold, says
from webgym.settings import Settings
from webgym.tasks.rules.reading import Text, stem


class WritingLimits(Settings):
    """How often to ask, and what a rewritten task may look like."""

    tries: int = Field(default=3, ge=1)
    """How often a model is asked for one thing, in all."""

    shortest_chars: int = Field(default=12, ge=1)
    """A rewritten task has at least so many characters."""

    times_parent: float = Field(default=2.0, gt=0)
    """A rewritten task has at most so many times its parent's characters, and ``more_chars`` on top."""

    more_chars: int = Field(default=200, ge=0)
    """What short parents leave for their children's own words, in characters."""

    def longest(self, parent: str) -> int:
        """Characters that a task made from this one may have."""
        return int(self.times_parent * len(parent)) + self.more_chars


USUAL: Final = WritingLimits()


_PREAMBLE: Final = re.compile(
    r"(?:sure|certainly|of course|okay|absolutely)\b[,.!:]|here(?:'s| is| are)\b.{0,60}"
    r"\b(?:task|version|rewrit)"
    r"|(?:the |a )?(?:new|rewritten|revised|simplified) (?:task|version|instruction)\b.{0,40}:"
    r"|(?:task|instruction|rewrite|output|answer|response)\s*:",
    re.IGNORECASE,
)
_REFUSAL: Final = re.compile(
    r"(?:i'm sorry|i am sorry|sorry\b|i can(?:no|')t\b|i'm (?:unable|not able)|i am (?:unable|not able)"
    r"|as an ai\b)",
    re.IGNORECASE,
)
_MARKDOWN: Final = re.compile(r"(?m)^\s*(?:#{1,6} |```|[-*•] |\d+[.)] |> )|\*\*|```|^\s*\|.*\|\s*$")
_WRAPPED: Final = (('"', '"'), ("“", "”"), ("'", "'"), ("`", "`"), ("«", "»"), ("‘", "’"))
_SHORTEST_ANSWER: Final = 4


def refused_rewriting(
    text: str, task: Task, groups: Sequence[FactGroup], limits: WritingLimits = USUAL
) -> str | None:
    """Why a text cannot stand for the task that asks for these groups alone; ``None`` if it can."""
    return _ill_formed(text, task.instruction, limits) or _untrue(text, task, groups)


def _ill_formed(text: str, parent: str, limits: WritingLimits) -> str | None:
    folded = fold(text)
    if _REFUSAL.match(folded):
        return "it is a refusal, not the text of a task."
    if _PREAMBLE.match(folded):
        return "it begins with an introduction; write the text of the task alone."
    if text[0] in "{[" and text[-1] in "}]":
        return "it is JSON; write the text of the task alone."
    if any(
        len(text) > 1 and text[0] == first and text[-1] == last and last not in text[1:-1]
        for first, last in _WRAPPED
    ):
        return "it stands in quotation marks; write the text of the task alone."
    if _MARKDOWN.search(text) and not _MARKDOWN.search(parent):
        return "it holds markdown; write plain text."
    if "\n" in text and "\n" not in parent:
        return "it has several lines; write one paragraph."
    if _plain(text) == _plain(parent):
        return "it is the original task; write one that asks for the given facts alone."
    if len(text) < limits.shortest_chars:
        return f"it has {len(text)} characters; that is too short for a task."
    if len(text) > limits.longest(parent):
        return f"it has {len(text)} characters; write at most {limits.longest(parent)}."
    return None


def _untrue(text: str, task: Task, groups: Sequence[FactGroup]) -> str | None:
    """Whether it asks for all of the given facts and for none of the others, and tells no answer."""
    said, parent = Text(text), Text(task.instruction)
    ids = {group.id for group in groups}
    dropped = [group for group in task.rubric.groups if group.id not in ids]
    wanted = _told_by(groups)
    wrong = (
        _invented(said, parent, wanted, Text(task.website))
        or _lost(said, parent, groups)
        or _kept(said, parent, wanted, dropped, task)
    )
    if wrong:
        return wrong
    answers = [answer for answer in (task.reference_answer, task.example_answer) if answer]
    told = [answer for answer in answers if len(answer) >= _SHORTEST_ANSWER and says(said.folded, answer)]
    if any(not says(parent.folded, answer) for answer in told):
        return "it gives the answer away."
    return None


def _told_by(groups: Iterable[FactGroup]) -> Text:
    return Text("\n".join(part for group in groups for part in (group.description, *group.facts)))


def _invented(said: Text, parent: Text, wanted: Text, website: Text) -> str | None:
    if invented := said.numbers - parent.counts - wanted.counts - website.counts:
        return f"it states {_listed(invented)}, which neither the original task nor the facts state."
    return None


def _lost(said: Text, parent: Text, groups: Sequence[FactGroup]) -> str | None:
    """Whether it leaves out what a given fact says in the original's own words: it would ask for less."""
    once = _said_once(parent)
    for group in groups:
        elsewhere = _told_by(other for other in groups if other is not group).content
        facts = [Text(fact) for fact in group.facts]
        for fact in facts:
            missing = (fact.numbers & parent.counts) - said.counts
            missing |= {name for name in _names(fact) if says(parent.folded, name) and not _says(said, name)}
            if missing:
                return f"it leaves out {_listed(missing)}, which the facts ask for."
        common = _common(facts)
        for words, what in [*((fact.content - common, fact.raw) for fact in facts), (common, group.facts[0])]:
            own = (words & once) - elsewhere
            if own and said.stems.isdisjoint(own):
                return f"it leaves out what this fact asks for: {what!r}."
    return None


def _kept(said: Text, parent: Text, wanted: Text, dropped: Sequence[FactGroup], task: Task) -> str | None:
    """Whether it still says what only the other facts do: the rubric would not look at it."""
    setting = Text(" ".join((*_SETTING.findall(task.instruction), task.website)))
    once = _said_once(parent) - wanted.stems - setting.stems - _REPORTING
    for group in dropped:
        facts = [Text(fact) for fact in group.facts]
        for fact in facts:
            kept = (said.numbers & fact.numbers) - wanted.counts - Text(task.website).counts
            kept |= {
                name
                for name in _names(fact)
                if max(1, parent.raw.count(name)) <= said.raw.count(name)  # else another fact's is meant
                and not _says(wanted, name)
                and not _says(setting, name)
            }
            if kept:
                return f"it still asks for {_listed(kept)}, which only facts say that were not given."
        common = _common(facts)
        for words, what in [*((fact.content - common, fact.raw) for fact in facts), (common, group.facts[0])]:
            own = words & once
            if own and own <= said.stems:
                return f"it still asks for what was not given: {what!r}."
    return None


def _said_once(parent: Text) -> frozenset[str]:
    """The stems of the words that stand in the original once: only these tell which part of it is meant."""
    counts = Counter(map(stem, parent.words))
    return frozenset(word for word, count in counts.items() if count == 1)


def _common(facts: Sequence[Text]) -> frozenset[str]:
    """The words that several facts of a group share: what the group is about."""
    counts = Counter(word for fact in facts for word in fact.content)
    return frozenset(word for word, count in counts.items() if count > 1)


_SETTING: Final = re.compile(
    r"^\s*(?:on|at|in|using|from|visit|open|go to|for)\s+[^,.;:]{1,60}", re.IGNORECASE
)
"""Where a task takes place, which is no detail of a fact: "On Petal & Post, ..."."""
_REPORTING: Final = frozenset(
    stem(word)
    for word in "instructions instruction directions information details number name price page".split()
)
"""Words of facts that stand in any task."""


def _names(fact: Text) -> Iterator[str]:
    """What a fact calls by its name: quotations, and words with a capital within a sentence."""
    yield from fact.quotations
    yield from fact.names


def _says(text: Text, name: str) -> bool:
    return says(text.folded, name) or Text(name).stems <= text.stems


def _plain(text: str) -> str:
    return "".join(filter(str.isalnum, fold(text)))


def _listed(what: Iterable[str]) -> str:
    return ", ".join(sorted(what))
