"""Does an answer name other candidates beside the right one? For a judge that knows what is right, by rule.

A list with the right answer in it is a guess. The answer is cut at every gap (full stops, commas, line ends,
"or", …). A piece is a rival claim if, beside words that the task, a right answer or the pieces with the right
answer hold too, it has nothing but another value that is written like the right one: a number of the same
shape, or words in the same case. "Rated 4.7" beside a price is a remark; "$13.50" is a rival, and so is "It
costs $13.50".
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final

from webgym.core.text import fold
from webgym.judge.units import MONTHS

_GAPS: Final = re.compile(
    r"[;\n\r()\[\]{}|/•*!?\"“”„«»=→]|[.,:](?!\d)|(?<!\d)[.,:]|\s[-–—]+\s|^[-–—]"
    r"|\b(?:or|and|vs|versus|also|maybe|perhaps|possibly)\b",
    re.IGNORECASE | re.MULTILINE,
)
_TOKEN: Final = re.compile(r"\d+(?:[.,:]\d+)*|[^\W\d_]+")
_RIGHT: Final = "\x00"
"""Stands where the right answer stood."""

_BESIDE: Final = re.compile(rf"{_RIGHT}\W{{0,3}}(\d[\d.,:]*)|(\d[\d.,:]*)\W{{0,3}}{_RIGHT}")
_LONGEST: Final = 5
"""Words of a name; what has more of its own is a remark."""

_TALK_IN_NAMES: Final = ("a", "an", "the", "of", "in", "on", "for", "with", "that", "was", "it")
_TALK: Final = frozenset(
    "a an the it its is are was were be this that there here i my we our you your he she they of in on at to "
    "for from by with as than then so if not no yes has have had will would can could may might all each "
    "am pm other s answer answers final result results found find done note based page pages website site "
    "according shown however thus therefore which what who when where how ok sure thanks thank hope "
    "helps".split()
)
"""Words that name nothing."""


def rival(answer: str, required: Sequence[Sequence[str]], told: Iterable[str]) -> str:
    """The first piece of an answer that names another candidate; empty if none does.

    Args:
        answer: as it was given.
        required: alternatives, for everything that a right answer says.
        told: texts whose words are no candidates: the task, and an answer that is known to be right.
    """
    options = sorted({option for place in required for option in place}, key=len, reverse=True)
    any_of = "|".join(map(re.escape, options))
    right = re.compile(rf"(?<!\w)(?<!\d[.,:])(?:{any_of})(?!\w)(?![.,:]\d)", re.IGNORECASE)
    pieces = [piece.strip() for piece in _GAPS.split(right.sub(_RIGHT, answer)) if piece.strip()]
    known = _TALK.union(MONTHS, *map(_words, (*told, *options)))
    shapes = {_shape(value) for option in options for value in _TOKEN.findall(option) if value[0].isdigit()}
    names = [option for place in required if not re.search(r"\d", "".join(place)) for option in place]
    folded = set(map(fold, names))
    cases = {match[0][0].isupper() for match in right.finditer(answer) if fold(match[0]) in folded}
    holders = set[str]().union(*(_words(piece) for piece in pieces if _RIGHT in piece))
    for piece in pieces:
        is_holder = _RIGHT in piece
        excused = known if is_holder else known | holders
        own = [token for token in _TOKEN.findall(piece) if fold(token) not in excused]
        values = [token for token in own if token[0].isdigit()]
        beside = [one or other for one, other in _BESIDE.findall(piece)] if is_holder else []
        is_value = all(token[0].isdigit() or token.isupper() for token in own)  # a number, or a code
        claimed = values if is_value else [value for value in values if value in beside]
        if any(_shape(value) in shapes for value in claimed):
            return piece.replace(_RIGHT, "…")
        if own and not values and not is_holder and _is_name(piece, own, names, cases, holders):
            return piece
    return ""


def _is_name(
    piece: str, own: Sequence[str], names: Sequence[str], cases: set[bool], holders: set[str]
) -> bool:
    """Whether what a piece has of its own may be a name: capitalised as the right one is, or else alone."""
    found = {token[0].isupper() for token in own}
    if (
        len(own) > max(_LONGEST, *(len(name.split()) for name in names), 0)
        or own[0][0].isupper() not in cases
    ):
        return False
    is_mixed = any(word[0].islower() and word not in _TALK for name in names for word in name.split())
    is_alone = _words(piece) <= {*map(fold, own), *holders, *_TALK_IN_NAMES}
    return found == {True} or (is_alone and (len(found) == 1 or is_mixed))


def _words(text: str) -> set[str]:
    return {fold(token) for token in _TOKEN.findall(text)}


def _shape(value: str) -> str:
    return re.sub(r"\d+", "9", value)
