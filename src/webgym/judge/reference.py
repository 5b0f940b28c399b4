"""Whether an answer is the reference answer of its task: a quasi-exact rule, and a model for all else.

The rule is that of GAIA's scorer in spirit: numbers are compared without separators, lists item by item,
texts without case, leading articles, closing punctuation and surplus space. It reads the whole answer, or
what follows one final "Answer:" in a paragraph of its own. It says *same* only where nothing else can be
meant, and *different* only between two plain numbers; everything else is *unsure*, and a model is asked. So a
spelling that the rule does not know costs a question, never a reward: units, signs, bounds, dates, versions,
``12.500``, ``25 000`` and ``3.10`` have several readings, and prose is not read at all.
"""

from __future__ import annotations

import re
import unicodedata
from decimal import Decimal
from enum import StrEnum
from typing import Final, NamedTuple


class Match(StrEnum):
    """The result of a comparison."""

    SAME = "same"
    DIFFERENT = "different"
    UNSURE = "unsure"


class Comparison(NamedTuple):
    """What the rule says about an answer, and why."""

    match: Match
    reason: str


_STATED: Final = re.compile(
    r"(?:\A|\n[ \t]*\n)[#*_ \t]*(?:the )?(?:final )?answer[*_]*(?: is\b:?| ?[:：])(?:[*_]+(?=\s)|)\s*",
    re.IGNORECASE,
)
"""What announces an answer: at the beginning of the text, or of a paragraph."""

_WRAPPINGS: Final = (
    *(("**", "**"), ("*", "*"), ("```", "```"), ("`", "`")),
    *(('"', '"'), ("'", "'"), ("“", "”"), ("„", "“"), ("‘", "’"), ("«", "»"), ("「", "」")),
    *(("<answer>", "</answer>"), ("\\boxed{", "}")),
)
"""Emphasis and quotation marks. Strokes, brackets, ``>``, ``_`` and question marks mean something."""
_MOST_WRAPPINGS: Final = 4

_CLOSING: Final = re.compile(r"(?<![.\s])[.。]$|(?<=[^\W\d_])!$")
_MARK: Final = re.compile(r"\A(?:[-*•]|#{1,6}) (?=[^\W\d_])")
"""What makes a line an item of a list or a heading; before a digit it may be a sign."""
_ARTICLE: Final = re.compile(r"\A(?:[Tt]he|[Aa]n|a) (?=[^\W\d_]{3})")
"""A leading article. A capital A may be a name: "A major"."""
_ABBREVIATED: Final = re.compile(r"(?<=[^\W\d_])\.(?=\s|$)")
_TYPOGRAPHY: Final = str.maketrans("’‘′“”″−‐‑–", "'''\"\"\"----")
_SHORTEST: Final = 3
"""Characters of the shortest text whose case may be ignored: CO is not Co."""

_GROUPED: Final = r"(?:[1-9][0-9]{0,2}(?:,[0-9]{3})+|0|[1-9][0-9]*)"
_NUMBER: Final = re.compile(rf"{_GROUPED}(?:\.[0-9]*[1-9])?")
"""A plain number: no sign, no unit, no leading zero, and no closing zero after the point."""
_MAYBE_GROUPED: Final = re.compile(r"[1-9][0-9]{0,2}\.[0-9]{3}")
"""The point may separate thousands."""
_AMOUNT: Final = re.compile(rf"{_GROUPED}(?:\.[0-9]{{1,2}})?")
_LONGEST_NUMBER: Final = 9
"""Digits of the longest plain number; a longer one may be an identifier."""

_LINES: Final = re.compile(r"[;；\n]")
_COMMAS: Final = re.compile(r"[,，、](?![0-9])|(?<![0-9])[,，、]")


def compare(reference: str, answer: str) -> Comparison:
    """Compare an answer with the reference answer of its task.

    Args:
        reference: the reference answer; no word for a missing one (:func:`webgym.core.task.reference_of`).
        answer: the agent's answer, of any length.
    """
    if not any(character.isprintable() and not character.isspace() for character in answer):
        return Comparison(Match.DIFFERENT, "the answer is empty")
    wanted, whole = _bare(reference), _bare(answer)
    stated = _stated(whole)
    if any(_is_same(wanted, given) for given in (whole, stated)):
        return Comparison(Match.SAME, "the answer is the reference answer")
    number, other = _number(wanted), _number(stated)
    if number is not None and other is not None and not _may_agree(number, other):
        return Comparison(Match.DIFFERENT, "the answer is another number than the reference answer")
    return Comparison(Match.UNSURE, "no rule says whether the answer is the reference answer")


def _stated(text: str) -> str:
    """The answer after what announces it. The whole text if nothing does, or if it speaks of answers more
    than once: then which one is meant is not for a rule to say."""
    announced = _STATED.search(text)
    if announced is None or text.casefold().count("answer") > 1:
        return text
    return _bare(text[announced.end() :])


def _bare(text: str) -> str:
    """The text without surrounding space, emphasis, quotation marks and the full stop at its end, its lines
    without surplus space, and full-width characters as usual ones. Other forms stay apart: 10² is not 102."""
    usual = text if text.isascii() else unicodedata.normalize("NFC", "".join(map(_usual, text)))
    bare = "\n".join(" ".join(line.split()) for line in usual.splitlines()).strip()
    for _ in range(_MOST_WRAPPINGS):
        before = bare
        for opening, closing in _WRAPPINGS:
            inner = bare[len(opening) : -len(closing)]
            is_wrapped = bare.startswith(opening) and bare.endswith(closing) and bool(inner)
            if is_wrapped and opening not in inner and closing not in inner:
                bare = inner.strip()
        if "\n" not in bare:
            bare = _MARK.sub("", _CLOSING.sub("", bare), count=1).strip() or bare
        if bare == before:
            break
    return bare


def _usual(character: str) -> str:
    kind = unicodedata.decomposition(character).partition(" ")[0]
    return unicodedata.normalize("NFKC", character) if kind in ("<wide>", "<narrow>") else character


def _is_same(wanted: str, given: str) -> bool:
    """Whether two texts are the same value, or lists of the same values in the same order."""
    if _is_same_value(wanted, given):
        return True
    items, others = _items(wanted), _items(given)
    return 1 < len(items) == len(others) and all(map(_is_same_value, items, others))


def _items(text: str) -> list[str]:
    """The items of a list: its lines, or what semicolons separate; else what commas outside of numbers do.
    Empty if one of them is."""
    items = [item for item in _LINES.split(text) if item.strip() or "\n" not in text]
    if len(items) < 2:
        items = _COMMAS.split(text)
    return [_bare(item) for item in items] if all(map(str.strip, items)) else []


def _is_same_value(wanted: str, given: str) -> bool:
    if _key(wanted) == _key(given):
        return True
    number, measure = _number(wanted), _measure(wanted)
    return (number is not None and number == _number(given)) or (
        measure is not None and measure == _measure(given)
    )


def _key(text: str) -> str:
    """What is compared of a text. Case is kept beside digits, where it may be a unit's: not MW for mW."""
    key = _ABBREVIATED.sub("", _ARTICLE.sub("", text.translate(_TYPOGRAPHY), count=1))
    is_cased = len(key) < _SHORTEST or any(character.isnumeric() for character in key)
    return key if is_cased else key.casefold()


def _number(text: str) -> Decimal | None:
    """The value of a plain number that has no other reading; ``None`` for any other text."""
    if len(text) > 2 * _LONGEST_NUMBER or not _NUMBER.fullmatch(text) or _MAYBE_GROUPED.fullmatch(text):
        return None
    digits = text.replace(",", "")
    return Decimal(digits) if len(digits.partition(".")[0]) <= _LONGEST_NUMBER else None


def _measure(text: str) -> tuple[str, Decimal] | None:
    """The sign and the value of an amount of money or of percent: $1,234.50, 5 €, 10%."""
    for sign, number in ((text[:1], text[1:]), (text[-1:], text[:-1])):
        if sign == "%" or (sign and unicodedata.category(sign) == "Sc"):
            is_plain = _AMOUNT.fullmatch(number.strip())
            return (sign, Decimal(number.strip().replace(",", ""))) if is_plain else None
    return None


def _may_agree(wanted: Decimal, given: Decimal) -> bool:
    """Whether two plain numbers may be one value: equal, rounded, or in units of hundreds or more (percent,
    thousands, millions)."""
    low, high = sorted((wanted, given))
    places = max(int(number.as_tuple().exponent) for number in (wanted, given))
    if high - low <= Decimal(1).scaleb(places) / 2:
        return True
    scale = high / low if low else Decimal(0)
    return scale >= 100 and scale.normalize().as_tuple().digits == (1,)
