"""Normalised forms of texts, for finding duplicates."""

from __future__ import annotations

import re
import unicodedata
from typing import Final

FUNCTION_WORDS: Final = frozenset(
    "a an the this that these those it its is are was be been of on in at for and as with which who please "
    "me my i you your we our can could would should will do does by so then there here about".split()
)
"""Words without influence on what a task asks for. "to", "from", "or", "not", "under" are not among them."""

_VALUES: Final = {
    word: str(value)
    for value, word in enumerate(
        "zero one two three four five six seven eight nine ten eleven twelve".split()
    )
}


class _Folding(dict[int, int | None]):
    """Table for ``str.translate``: punctuation, separators and control characters become spaces, apostrophes
    vanish.

    Symbols are kept ("C++" is not "C", "$" is not "€"), and so is "#": "C#" is not "C".
    """

    def __missing__(self, code: int) -> int | None:
        kind = unicodedata.category(chr(code))
        folded = kind[0] in "PZC" or kind == "Sk"
        self[code] = value = 32 if folded and code != ord("#") else code
        return value


_FOLDING: Final = _Folding(dict.fromkeys(map(ord, "'’‘ʼ`´")))
_THOUSANDS: Final = re.compile(r"(?<=\d),(?=\d{3}(?!\d))")
_TWO_NUMBERS: Final = re.compile(r"\d \d")
_NOT_BETWEEN_DIGITS: Final = re.compile(r"(?<!\d) | (?!\d)")
_DIGITS: Final = re.compile(r"\d+(?: \d+)*")
_WORD: Final = re.compile(r"(?<![\w'’])[^\W\d_][\w'’+#]*")
_BEGINNING: Final = re.compile(r"(?:\A|[.!?:;\"“(]\s*)\Z")


def fold(text: str) -> str:
    """The words of a text in a normal form: Unicode NFKC, lower case, no punctuation, single spaces.

    A text without words is returned stripped.
    """
    if not text.isascii():
        text = unicodedata.normalize("NFKC", text)
    if "," in text:
        text = _THOUSANDS.sub("", text)
    return " ".join(text.casefold().translate(_FOLDING).split()) or text.strip()


def joined(folded: str) -> str:
    """A folded text without white space, in which sources differ ("Fox Sports", "foxsports")."""
    if _TWO_NUMBERS.search(folded):
        return _NOT_BETWEEN_DIGITS.sub("", folded)
    return folded.replace(" ", "")


def template(folded: str) -> str:
    """A folded text with every number replaced by 0."""
    return _DIGITS.sub("0", folded)


def number(word: str) -> str | None:
    """The number that a folded word is or contains; ``None`` if it contains no digit and is no number
    word."""
    if word.isalpha():
        return _VALUES.get(word)
    return word if any(map(str.isdigit, word)) else None


def names(text: str) -> set[str]:
    """The words that look like names, folded: a capital inside a sentence, or capitals throughout."""
    text = unicodedata.normalize("NFKC", text)
    folded = set()
    for match in _WORD.finditer(text):
        word = match.group()
        begins = _BEGINNING.search(text, max(0, match.start() - 8), match.start()) is not None
        if word[0].isupper() and (not begins or (len(word) > 1 and word.isupper())):
            folded.update(fold(word).split())
    return folded - {"i"}
