"""The contract for answers to tasks of the offline web: the values alone, in the order asked for.

Instructions say how to answer, so nothing of an answer is interpreted: it is split into items, what a list
or emphasis adds is taken off, and each item must be a spelling of its value. Nothing else is right.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from webgym.core.text import fold, says
from webgym.core.truth import AnswerTruth
from webgym.core.verdict import Judgement

_ANNOUNCED: Final = re.compile(r"^[\W_]*(?:final )?answer[*_]*\s*:", re.IGNORECASE)
_ENDS: Final = re.compile(r"[\n\r\v\f\x85\u2028\u2029;]")
_ENDS_AND_COMMAS: Final = re.compile(rf"{_ENDS.pattern}|,")
_BULLET: Final = re.compile(r"^[-*+•‣◦]\s+")
_AROUND: Final = "*_`\"'“”‘’„«»"
_MORE_WORDS: Final = 2
"""A wrong item with this many more words than any spelling of its value is taken for a sentence."""


def items(answer: str, *, by_comma: bool = False) -> list[str]:
    """The items of an answer, folded, without list markers, emphasis, quotes and final full stops."""
    values = _ANNOUNCED.sub("", answer, count=1)
    lines = (_ENDS_AND_COMMAS if by_comma else _ENDS).split(values)
    written = filter(None, map(_bare, lines))
    return [
        _bare(item.removeprefix(f"{number}. ").removeprefix(f"{number}) "))
        for number, item in enumerate(written, 1)
    ]


def _bare(text: str) -> str:
    while True:
        shorter = _BULLET.sub("", text.strip().strip(_AROUND).removesuffix(".").strip())
        if shorter == text:
            return fold(text)
        text = shorter


def compare(truth: AnswerTruth, answer: str) -> tuple[Judgement, Judgement | None]:
    """Compare an answer with the values that the task asks for.

    Returns:
        Whether the answer has the form asked for; and whether it gives the right values; ``None`` for
        an answer in another form.
    """
    given, wanted = items(answer, by_comma=truth.by_comma), truth.values
    if len(given) != len(wanted):
        count = "1 value" if len(wanted) == 1 else f"{len(wanted)} values, one a line"
        return Judgement(False, f"the answer has {len(given)} items instead of {count}"), None
    for item, spellings in zip(given, wanted, strict=True):
        known = [_bare(spelling) for spelling in spellings]
        if item in known:
            continue
        if item not in map(_bare, truth.others) and _is_prose(item, known):
            return Judgement(False, f'"{item}" is more than the value alone'), None
        form = Judgement(True, "the answer has as many items as values")
        return form, Judgement(False, f'the answer says "{item}", not "{spellings[0]}"')
    return Judgement(True, "the answer is the values alone"), Judgement(True, "every value is right")


def _is_prose(item: str, known: Sequence[str]) -> bool:
    """Whether an item says more than a value, right or wrong."""
    longest = max(len(spelling.split()) for spelling in known)
    return len(item.split()) > longest + _MORE_WORDS or any(says(item, spelling) for spelling in known)
