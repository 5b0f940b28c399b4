"""Checks the text of a derived task, without a model: it must ask for its own fact groups and nothing else.

The checks compare numbers, names, quotations and content words. A text that is refused is requested again,
with the reason.
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
    """Number of tries, and limits on the length of a rewritten task."""

    tries: int = Field(default=3, ge=1)
    """Most requests for one website, rubric or text, until the reply is usable."""

    shortest_chars: int = Field(default=12, ge=1)
    """Fewest characters of a rewritten task."""

    times_parent: float = Field(default=2.0, gt=0)
    """Most characters of a rewritten task, as a multiple of its parent's, plus ``more_chars``."""

    more_chars: int = Field(default=200, ge=0)
    """Characters added to ``times_parent``, so that tasks derived from short ones have room."""

    def longest(self, parent: str) -> int:
        """Most characters of a task derived from one with this text."""
        return int(self.times_parent * len(parent)) + self.more_chars


DEFAULT_LIMITS: Final = WritingLimits()


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
_MARKDOWN: Final = re.compile(r"(?m)^[ \t]*(?:#{1,6} |```|[-*•] |\d+[.)] |> )|\*\*|```|^[ \t]*\|.*\|[ \t]*$")
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
_WRAPPED: Final = (('"', '"'), ("“", "”"), ("'", "'"), ("`", "`"), ("«", "»"), ("‘", "’"))
_SHORTEST_ANSWER: Final = 4


def refused_rewriting(
    text: str, task: Task, groups: Sequence[FactGroup], limits: WritingLimits = DEFAULT_LIMITS
) -> str | None:
    """Why a text cannot be the instruction of a task with only these groups; ``None`` if it can."""
    return _ill_formed(text, task.instruction, limits) or _inaccurate(text, task, groups)


def _ill_formed(text: str, parent: str, limits: WritingLimits) -> str | None:
    if len(text) > limits.longest(parent):
        return f"it has {len(text)} characters; write at most {limits.longest(parent)}."
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
    if _CONTROL.search(text) and not _CONTROL.search(parent):
        return "it holds control characters; write plain text."
    if "\n" in text and "\n" not in parent:
        return "it has several lines; write one paragraph."
    if _plain(text) == _plain(parent):
        return "it is the original task; write one that asks for the given facts alone."
    if len(text) < limits.shortest_chars:
        return f"it has {len(text)} characters; that is too short for a task."
    return None


def _inaccurate(text: str, task: Task, groups: Sequence[FactGroup]) -> str | None:
    """Why a text does not ask for exactly the given facts, or gives the answer away; ``None`` if it is
    correct."""
    rewritten, parent = Text(text), Text(task.instruction)
    ids = {group.id for group in groups}
    dropped = [group for group in task.rubric.groups if group.id not in ids]
    wanted = _text_of(groups)
    problem = (
        _invented(rewritten, parent, wanted, Text(task.website))
        or _missing(rewritten, parent, groups)
        or _left_over(rewritten, parent, wanted, dropped, task)
    )
    if problem:
        return problem
    answers = [answer for answer in (task.reference_answer, task.example_answer) if answer]
    revealed = [
        answer for answer in answers if len(answer) >= _SHORTEST_ANSWER and says(rewritten.folded, answer)
    ]
    if any(not says(parent.folded, answer) for answer in revealed):
        return "it gives the answer away."
    return None


def _text_of(groups: Iterable[FactGroup]) -> Text:
    return Text("\n".join(part for group in groups for part in (group.description, *group.facts)))


def _invented(rewritten: Text, parent: Text, wanted: Text, website: Text) -> str | None:
    if invented := rewritten.numbers - parent.counts - wanted.counts - website.counts:
        return f"it states {_listed(invented)}, which neither the original task nor the facts state."
    return None


def _missing(rewritten: Text, parent: Text, groups: Sequence[FactGroup]) -> str | None:
    """Why a text leaves out part of a given fact, which the original task has; ``None`` if it does not."""
    once = _unique_stems(parent)
    for group in groups:
        elsewhere = _text_of(other for other in groups if other is not group).content
        facts = [Text(fact) for fact in group.facts]
        for fact in facts:
            missing = (fact.numbers & parent.counts) - rewritten.counts
            missing |= {
                name
                for name in _proper_names(fact)
                if says(parent.folded, name) and not _says(rewritten, name)
            }
            if missing:
                return f"it leaves out {_listed(missing)}, which the facts ask for."
        common = _common(facts)
        for words, quoted_fact in [
            *((fact.content - common, fact.raw) for fact in facts),
            (common, group.facts[0]),
        ]:
            identifying = (words & once) - elsewhere
            if identifying and rewritten.stems.isdisjoint(identifying):
                return f"it leaves out what this fact asks for: {quoted_fact!r}."
    return None


def _left_over(
    rewritten: Text, parent: Text, wanted: Text, dropped: Sequence[FactGroup], task: Task
) -> str | None:
    """Why a text still asks for a dropped fact, which the rubric does not check; ``None`` if it does not."""
    setting = Text(" ".join((*_SETTING.findall(task.instruction), task.website)))
    once = _unique_stems(parent) - wanted.stems - setting.stems - _REPORTING
    for group in dropped:
        facts = [Text(fact) for fact in group.facts]
        for fact in facts:
            kept = (rewritten.numbers & fact.numbers) - wanted.counts - Text(task.website).counts
            kept |= {
                name
                for name in _proper_names(fact)
                if max(1, parent.raw.count(name))
                <= rewritten.raw.count(name)  # else it belongs to another fact
                and not _says(wanted, name)
                and not _says(setting, name)
            }
            if kept:
                return f"it still asks for {_listed(kept)}, which only facts say that were not given."
        common = _common(facts)
        for words, quoted_fact in [
            *((fact.content - common, fact.raw) for fact in facts),
            (common, group.facts[0]),
        ]:
            identifying = words & once
            if identifying and identifying <= rewritten.stems:
                return f"it still asks for what was not given: {quoted_fact!r}."
    return None


def _unique_stems(parent: Text) -> frozenset[str]:
    """The stems of the words that occur once in the original: only these identify a part of it."""
    counts = Counter(map(stem, parent.words))
    return frozenset(word for word, count in counts.items() if count == 1)


def _common(facts: Sequence[Text]) -> frozenset[str]:
    """The stems that several facts of a group share: the subject of the group."""
    counts = Counter(word for fact in facts for word in fact.content)
    return frozenset(word for word, count in counts.items() if count > 1)


_SETTING: Final = re.compile(
    r"^\s*(?:on|at|in|using|from|visit|open|go to|for)\s+[^,.;:]{1,60}", re.IGNORECASE
)
"""The setting of a task, which is not part of a fact: "On Petal & Post, ..."."""
_REPORTING: Final = frozenset(
    stem(word)
    for word in "instructions instruction directions information details number name price page".split()
)
"""Stems of fact words that may occur in any task."""


def _proper_names(fact: Text) -> Iterator[str]:
    """The quotations in a fact, and its words with a capital within a sentence."""
    yield from fact.quotations
    yield from fact.names


def _says(text: Text, name: str) -> bool:
    return says(text.folded, name) or Text(name).stems <= text.stems


def _plain(text: str) -> str:
    return "".join(filter(str.isalnum, fold(text)))


def _listed(items: Iterable[str]) -> str:
    return ", ".join(sorted(items))
