"""Whether an answer says what the reference answer says.

Four ways, chosen per source (:data:`webgym.judge.config.WAYS_BY_SOURCE`) and tried in turn until one is sure:

exact        the same text, but for case, white space, typographic forms and closing punctuation
normalised   the same words and values: numbers, units, dates, times, currencies, articles, accents do not
             count as they are written but as what they mean; a short answer may be a sentence around them
set          a list whose order does not count: every item, and no other
model        a judge model decides; not here, but where this is unsure

A rule never guesses. It is sure that an answer agrees, or that it differs (another amount of the same kind);
everything in between is unsure, and without a model to ask the answer then does not match.

An answer agrees only if its one claim is the reference answer: a list with the right one in it is a guess.
So the answer is cut into pieces at every gap (full stops, commas, line ends, brackets, quotes, "and", …),
and beside the reference a piece may hold nothing but words of a short list, with which no answer can be
named (``_TALK`` in :mod:`webgym.judge.sentence`), and words of the task, where they cannot be a second claim.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Final

from webgym.core.text import fold
from webgym.judge.config import Way
from webgym.judge.sentence import QUALIFIERS, REFUSED, TRUTHS, RuleFinding, SentenceAnswer
from webgym.judge.value_comparison import Match, equal
from webgym.judge.values import Gap, Text, Token, read, tokens

_CLOSING: Final = re.compile(r" ?[.!]$")
_HYPHEN: Final = re.compile(r"(?<=[^\W\d_])[-‐‑](?=[^\W\d_])")

READ_CHARS: Final = 20_000
"""A longer answer is left to a model."""


def hold_against(reference: str, answer: str, ways: Sequence[Way], instruction: str = "") -> RuleFinding:
    """Compare an answer with a reference answer by rules.

    Args:
        reference: what the source says is right.
        answer: the agent's.
        ways: which rules, in order; ``model`` is passed over.
        instruction: the task; what it says itself is no part of the answer.
    """
    if not is_reference(reference):
        return RuleFinding(Match.UNSURE, "there is no reference answer")
    if not answer.strip():
        return RuleFinding(Match.DIFFERENT, "the answer is empty")
    held = RuleFinding(Match.UNSURE, "no rule says whether the answer matches")
    for way in ways:
        if way == "exact":
            held = exact(reference, answer)
        elif way in ("normalised", "set"):
            if max(len(reference), len(answer)) > READ_CHARS:
                continue
            rule = normalised if way == "normalised" else as_set
            held = rule(reference, answer, instruction)
        if held.match is not Match.UNSURE:
            return held
    return held


def is_reference(text: str | None) -> bool:
    """Whether there is a reference answer. An empty field is none, nor is the "None" that a program wrote.

    A "none" in lower case is an answer.
    """
    return text is not None and text.strip() not in ("", "None")


def exact(reference: str, answer: str) -> RuleFinding:
    """The same text, but for one full stop or exclamation mark that closes it."""
    if _CLOSING.sub("", fold(reference)) == _CLOSING.sub("", fold(answer)):
        return RuleFinding(Match.SAME, "the answer is the reference answer")
    return RuleFinding(Match.UNSURE, "the answer is not the reference answer word for word")


def normalised(reference: str, answer: str, instruction: str = "") -> RuleFinding:
    """The same words and values."""
    wanted, given = read(reference), read(answer)
    if not wanted.tokens or not given.tokens:
        return exact(reference, answer)
    if _says_more(wanted, given):
        return RuleFinding(Match.UNSURE, "the answer holds signs that no rule reads")
    if equal(wanted.tokens, given.tokens) or equal(_closed(reference), _closed(answer)):
        return RuleFinding(Match.SAME, "the answer says the same as the reference answer")
    told = SentenceAnswer(read(instruction), [wanted.tokens], given.tokens)
    if len(wanted.tokens) == 1 and wanted.tokens[0].word in TRUTHS:
        return told.truth(wanted.tokens[0].word)
    if _stands_alone(wanted.tokens, given.tokens):
        return told.value(wanted.tokens[0])
    if told.is_all():
        return RuleFinding(Match.SAME, "the answer says the same as the reference answer")
    if len(wanted.tokens) == 1 and wanted.tokens[0].value is not None:
        return told.value(wanted.tokens[0])
    return RuleFinding(Match.UNSURE, "the answer does not say the reference answer and nothing else")


def _stands_alone(wanted: Sequence[Token], given: Sequence[Token]) -> bool:
    """Whether the answer is the number alone: "3 albums" and "3", as the question says of what.

    "3 years" says so itself, and "3 or more" is not a number.
    """
    counted, lone = wanted[0].value, given[0].value if len(given) == 1 else None
    if counted is None or lone is None or not 1 < len(wanted) <= 3:
        return False
    if any(token.value or token.gap != "none" for token in wanted[1:]):  # a list
        return False
    bounds = QUALIFIERS | REFUSED | {"plus"}
    return lone.kinds <= counted.kinds and not any(token.word in bounds for token in wanted)


def as_set(reference: str, answer: str, instruction: str = "") -> RuleFinding:
    """The same items in any order."""
    wanted, given = read(reference), read(answer)
    items = _items(wanted.tokens, ("comma",))
    if len(items) < 2:
        return RuleFinding(Match.UNSURE, "the reference answer is no list")
    if _says_more(wanted, given):
        return RuleFinding(Match.UNSURE, "the answer holds signs that no rule reads")
    left = _items(given.tokens, ("comma", "label", "strong"))
    for item in items:
        found = next((other for other in left if equal(item, other)), None)
        if found is None:
            break
        left.remove(found)
    else:
        if not left:
            return RuleFinding(Match.SAME, "the answer lists the same items")
    if SentenceAnswer(read(instruction), items, given.tokens).is_all():
        return RuleFinding(Match.SAME, "the answer gives every item")
    return RuleFinding(Match.UNSURE, "the answer does not plainly give every item and no other")


def _closed(text: str) -> list[Token]:
    """The tokens of a text whose hyphens join words: e-mail is email."""
    return tokens(_HYPHEN.sub("", text))


def _says_more(wanted: Text, given: Text) -> bool:
    """Whether the answer has signs that the reference lacks, or lacks some that do not merely close it."""
    more, less = Counter(given.signs), Counter(wanted.signs)
    return bool(more - less) or any(sign not in "?…'\"" for sign in less - more)


def _items(found: Sequence[Token], gaps: Sequence[Gap]) -> list[list[Token]]:
    """A list's items: split at such gaps and at "and"."""
    items: list[list[Token]] = [[]]
    for token in found:
        if token.gap in gaps or token.word == "and":
            items.append([])
        if token.word != "and":
            items[-1].append(token)
    return [item for item in items if item]
