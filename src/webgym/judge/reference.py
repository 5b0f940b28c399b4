"""Whether an answer agrees with the reference answer.

Four methods, chosen per source (:data:`webgym.judge.config.WAYS_BY_SOURCE`) and tried in order until one is
sure:

exact        the same text, except for case, white space, typography and closing punctuation
normalised   the same words and values: numbers, units, dates, times and currencies are compared by their
             meaning, articles and accents are ignored; a short answer may be embedded in a sentence
set          a list in any order: every item, and no other
model        a judge model decides; the rubric judge asks it where the rules here are unsure

A rule never guesses. It is sure that an answer agrees, or that it differs (another amount of the same kind);
everything else is unsure, and if no model is asked the answer then does not match.

An answer agrees only if the reference answer is its only claim: a list that contains the right answer is a
guess. So the answer is split into pieces at every gap (full stops, commas, line ends, brackets, quotes, "and"
and so on). Apart from the reference answer, a piece may contain only filler words that no answer consists of
(``_FILLER`` in :mod:`webgym.judge.sentence`), and words of the task where they cannot be a second claim.
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
"""Longest answer that rules read, characters; a longer one is left to a model."""


def compare_with_reference(
    reference: str, answer: str, methods: Sequence[Way], instruction: str = ""
) -> RuleFinding:
    """Compare an answer with a reference answer by rules.

    Args:
        reference: the reference answer of the task's source.
        answer: the agent's answer.
        methods: which rules to try, in order; ``model`` is skipped.
        instruction: of the task; an answer may repeat its words.

    Returns:
        The finding of the first rule that is sure, else of the last rule that was tried.
    """
    if not is_reference(reference):
        return RuleFinding(Match.UNSURE, "there is no reference answer")
    if not answer.strip():
        return RuleFinding(Match.DIFFERENT, "the answer is empty")
    finding = RuleFinding(Match.UNSURE, "no rule says whether the answer matches")
    for method in methods:
        if method == "exact":
            finding = exact(reference, answer)
        elif method in ("normalised", "set"):
            if max(len(reference), len(answer)) > READ_CHARS:
                continue
            rule = normalised if method == "normalised" else as_set
            finding = rule(reference, answer, instruction)
        if finding.match is not Match.UNSURE:
            return finding
    return finding


def is_reference(text: str | None) -> bool:
    """Whether a text is a reference answer: not empty, and not the "None" that a program wrote.

    "none" in lower case is an answer.
    """
    return text is not None and text.strip() not in ("", "None")


def exact(reference: str, answer: str) -> RuleFinding:
    """Compare as text, ignoring one full stop or exclamation mark at the end."""
    if _CLOSING.sub("", fold(reference)) == _CLOSING.sub("", fold(answer)):
        return RuleFinding(Match.SAME, "the answer is the reference answer")
    return RuleFinding(Match.UNSURE, "the answer is not the reference answer word for word")


def normalised(reference: str, answer: str, instruction: str = "") -> RuleFinding:
    """Compare words and values by their meaning."""
    wanted, given = read(reference), read(answer)
    if not wanted.tokens or not given.tokens:
        return exact(reference, answer)
    if _signs_differ(wanted, given):
        return RuleFinding(Match.UNSURE, "the answer contains signs that no rule interprets")
    if equal(wanted.tokens, given.tokens) or equal(_without_hyphens(reference), _without_hyphens(answer)):
        return RuleFinding(Match.SAME, "the answer says the same as the reference answer")
    sentence = SentenceAnswer(read(instruction), [wanted.tokens], given.tokens)
    if len(wanted.tokens) == 1 and wanted.tokens[0].word in TRUTHS:
        return sentence.truth(wanted.tokens[0].word)
    if _is_bare_number(wanted.tokens, given.tokens):
        return sentence.value(wanted.tokens[0])
    if sentence.is_all():
        return RuleFinding(Match.SAME, "the answer says the same as the reference answer")
    if len(wanted.tokens) == 1 and wanted.tokens[0].value is not None:
        return sentence.value(wanted.tokens[0])
    return RuleFinding(Match.UNSURE, "the answer does not say the reference answer and nothing else")


def _is_bare_number(wanted: Sequence[Token], given: Sequence[Token]) -> bool:
    """Whether the answer is only the number of the reference answer: "3" for "3 albums".

    "3 years" has a unit of its own, and "3 or more" is not a number.
    """
    counted, lone = wanted[0].value, given[0].value if len(given) == 1 else None
    if counted is None or lone is None or not 1 < len(wanted) <= 3:
        return False
    if any(token.value or token.gap != "none" for token in wanted[1:]):  # a list
        return False
    bounds = QUALIFIERS | REFUSED | {"plus"}
    return lone.kinds <= counted.kinds and not any(token.word in bounds for token in wanted)


def as_set(reference: str, answer: str, instruction: str = "") -> RuleFinding:
    """Compare as lists whose order does not matter."""
    wanted, given = read(reference), read(answer)
    items = _items(wanted.tokens, ("comma",))
    if len(items) < 2:
        return RuleFinding(Match.UNSURE, "the reference answer is no list")
    if _signs_differ(wanted, given):
        return RuleFinding(Match.UNSURE, "the answer contains signs that no rule interprets")
    remaining = _items(given.tokens, ("comma", "label", "strong"))
    for item in items:
        match = next((other for other in remaining if equal(item, other)), None)
        if match is None:
            break
        remaining.remove(match)
    else:
        if not remaining:
            return RuleFinding(Match.SAME, "the answer lists the same items")
    if SentenceAnswer(read(instruction), items, given.tokens).is_all():
        return RuleFinding(Match.SAME, "the answer gives every item")
    return RuleFinding(Match.UNSURE, "the answer does not plainly give every item and no other")


def _without_hyphens(text: str) -> list[Token]:
    """The tokens of a text with the hyphens inside words removed: "e-mail" becomes "email"."""
    return tokens(_HYPHEN.sub("", text))


def _signs_differ(wanted: Text, given: Text) -> bool:
    """Whether the signs of the two texts differ, apart from closing punctuation that the answer lacks."""
    more, less = Counter(given.signs), Counter(wanted.signs)
    return bool(more - less) or any(sign not in "?…'\"" for sign in less - more)


def _items(tokens: Sequence[Token], gaps: Sequence[Gap]) -> list[list[Token]]:
    """The items of a list: the tokens, split at these kinds of gap and at "and"."""
    items: list[list[Token]] = [[]]
    for token in tokens:
        if token.gap in gaps or token.word == "and":
            items.append([])
        if token.word != "and":
            items[-1].append(token)
    return [item for item in items if item]
