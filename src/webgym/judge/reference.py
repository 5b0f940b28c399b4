"""Whether an answer says what the reference answer says.

Four ways, chosen per source (:data:`webgym.judge.config.WAYS_BY_SOURCE`) and tried in turn until one is sure:

exact        the same text, but for case, white space, typographic forms and closing punctuation
normalised   the same words and values: numbers, units, dates, times, currencies, articles, accents do not
             count as they are written but as what they mean; a short answer may be a sentence around them
set          a list whose order does not count: every item, and no other
model        a judge model decides; not here, but where this is unsure

A rule never guesses. It is sure that an answer agrees, or that it differs (another amount of the same kind);
everything in between is unsure, and without a model to ask the answer then does not match.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from enum import StrEnum
from typing import Final

import msgspec

from webgym.core.text import fold
from webgym.judge.config import Way
from webgym.judge.values import Token, Value, tokens

_HYPHEN: Final = re.compile(r"(?<=[^\W\d_])[-‐‑](?=[^\W\d_])")

READ_CHARS: Final = 20_000
"""A longer answer is left to a model."""


class Match(StrEnum):
    """What a rule says."""

    SAME = "same"
    DIFFERENT = "different"
    UNSURE = "unsure"


class Held(msgspec.Struct, frozen=True):
    """The finding of a rule, and why."""

    match: Match
    reason: str


def hold_against(reference: str, answer: str, ways: Sequence[Way], instruction: str = "") -> Held:
    """Hold an answer against a reference answer by rules.

    Args:
        reference: what the source says is right.
        answer: the agent's.
        ways: which rules, in order; ``model`` is passed over.
        instruction: the task; what it says itself is no part of the answer.
    """
    if not answer.strip():
        return Held(Match.DIFFERENT, "the answer is empty")
    held = Held(Match.UNSURE, "no rule says whether the answer matches")
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


def exact(reference: str, answer: str) -> Held:
    """The same text."""
    if fold(reference).rstrip(" .!") == fold(answer).rstrip(" .!"):
        return Held(Match.SAME, "the answer is the reference answer")
    return Held(Match.UNSURE, "the answer is not the reference answer word for word")


def normalised(reference: str, answer: str, instruction: str = "") -> Held:
    """The same words and values."""
    wanted, given = tokens(reference), tokens(answer)
    if not wanted or not given:
        return exact(reference, answer)
    if _equal(wanted, given) or _equal(_closed(reference), _closed(answer)):
        return Held(Match.SAME, "the answer says the same as the reference answer")
    if len(wanted) == 1 and wanted[0].word in _TRUTHS:
        return _truth(wanted[0].word, given)
    if "?" in answer and "?" not in reference:
        return Held(Match.UNSURE, "the answer asks")
    told = tokens(instruction)
    if all(token.value for token in wanted):
        return _values(wanted, given, told) if len(wanted) == 1 else _phrase(wanted, given, told)
    counted, lone = wanted[0].value, given[0].value if len(given) == 1 else None
    if counted and lone and lone.kinds <= counted.kinds and len(wanted) <= 3 and not _bounds(wanted):
        # "3 albums" and "3": the question says of what. "3 years" says so itself.
        return _values(wanted[:1], given, told)
    return _phrase(wanted, given, told)


def as_set(reference: str, answer: str, instruction: str = "") -> Held:
    """The same items in any order."""
    wanted, given = _items(tokens(reference)), _items(tokens(answer))
    if len(wanted) < 2:
        return Held(Match.UNSURE, "the reference answer is no list")
    left = list(given)
    for item in wanted:
        found = next((other for other in left if _equal(item, other)), None)
        if found is None:
            break
        left.remove(found)
    else:
        if not left:
            return Held(Match.SAME, "the answer lists the same items")
    return _told_items(wanted, given, tokens(instruction))


# --- comparing --------------------------------------------------------------------------------------


def same(one: Value, other: Value) -> Match:
    """Whether two values are one; unsure where a spelling has several readings."""
    if one.readings == other.readings:
        return Match.SAME
    if common := one.readings & other.readings:
        # Pounds of money or of mass: the other side says which. Days and times may be either.
        return Match.UNSURE if {kind for kind, _, _ in common} & {"date", "clock"} else Match.SAME
    if one.kinds == {"number"} and one.amount is not None and one.amount == other.amount:
        return Match.SAME if other.kinds != {"ordinal"} else Match.UNSURE
    if one.kinds & other.kinds and not _partial(one, other) and not _rounded(one, other):
        return Match.DIFFERENT
    return Match.UNSURE


def _partial(one: Value, other: Value) -> bool:
    """Whether a date lacks what the other has and agrees in the rest, or a number its country's prefix."""
    if one.kinds == {"identifier"}:
        (a,), (b,) = one.readings, other.readings
        return a[2].lstrip("+").endswith(b[2].lstrip("+")[-7:])
    return any(
        all(x == y or "?" in (x, y) for x, y in zip(a.split("-"), b.split("-"), strict=True))
        for kind, _, a in one.readings
        for other_kind, _, b in other.readings
        if kind == other_kind == "date"
    )


def _rounded(one: Value, other: Value) -> bool:
    """Whether two amounts in different units differ by no more than a conversion is rounded by."""
    if one.amount is None or other.amount is None or one.factor == other.factor:
        return False
    a, b = one.amount * one.factor, other.amount * other.factor
    return abs(a - b) * 50 <= max(abs(a), abs(b))


def _equal(one: Sequence[Token], other: Sequence[Token]) -> bool:
    return len(one) == len(other) and all(map(_one_equal, one, other))


def _one_equal(one: Token, other: Token) -> bool:
    if one.value and other.value:
        return same(one.value, other.value) is Match.SAME
    return one.word == other.word and one.value is None and other.value is None


def _closed(text: str) -> list[Token]:
    """The tokens of a text whose hyphens join words: e-mail is email."""
    return tokens(_HYPHEN.sub("", text))


# --- sentences around it ----------------------------------------------------------------------------

_TRUTHS: Final = {"yes": True, "true": True, "correct": True, "no": False, "false": False, "incorrect": False}
_NEGATIONS: Final = frozenset(
    "not no never neither nor isnt wasnt arent werent doesnt dont didnt cannot cant couldnt wouldnt havent "
    "hasnt hadnt wont without except than instead unlike rather wrong incorrect false excluding".split()
)
_QUALIFIERS: Final = frozenset(
    "about approximately approx around roughly over under above below nearly almost least most more less "
    "fewer up between maximum minimum estimated circa ca only".split()
)
_HEDGES: Final = frozenset(
    "maybe perhaps possibly probably might could likely unsure unclear unknown either or guess assume "
    "alternatively but however".split()
)
_EVASIONS: Final = frozenset(
    "unable failed fail fails failure nothing anything tried gave determine whether couldnt guessed guessing "
    "sorry apologies blocked captcha error".split()
)
"""Words of an answer that says why there is none; what else it mentions is no answer."""
_PLACES: Final = frozenset("page step http status screenshot tab attempt try".split())
"""What is numbered without being counted."""
_AFTER_TRUTH: Final = frozenset("it they he she there you this that these those we i".split())
_FILLERS: Final = frozenset(
    "is are was were be been it its this that there here to for of in on at by with from and as which who "
    "whose where when while has have had costs cost called named titled answer result total price name found "
    "because so according page website shown listed currently now today per each also thus therefore "
    "final".split()
)
_JOINERS: Final = frozenset("and with of to from".split())
"""Fillers that make one thing of what stands on both sides."""


def _truth(wanted: str, given: Sequence[Token]) -> Held:
    """A yes or a no: the answer's first word, if it is the only such word."""
    said = {_TRUTHS[token.word] for token in given if token.word in _TRUTHS}
    if given[0].word not in _TRUTHS or len(said) != 1 or _is_hedged(given):
        return Held(Match.UNSURE, "the answer is no plain yes or no")
    rest = given[1:]
    if rest and rest[0].gap == "none" and rest[0].word not in _AFTER_TRUTH:
        return Held(Match.UNSURE, f"“{given[0].word}” is part of something else in the answer")
    words = {token.word for token in rest}
    if words & {"find", "found", "see", "know"} or (said == {True} and words & _NEGATIONS):
        return Held(Match.UNSURE, "the answer takes back what its first word says")
    if said == {_TRUTHS[wanted]}:
        return Held(Match.SAME, f"the answer says {given[0].word}")
    return Held(Match.DIFFERENT, f"the answer says {given[0].word}, not {wanted}")


def _values(wanted: Sequence[Token], given: Sequence[Token], told: Sequence[Token]) -> Held:
    """One value: the answer must give it, and no other of its kind but those that the task names."""
    value = wanted[0].value
    assert value is not None
    known = [token.value for token in told if token.value]
    found: list[tuple[int, Match]] = []
    for place, token in enumerate(given):
        if token.value is None:
            continue
        match = same(value, token.value)
        comparable = match is not Match.UNSURE or bool(value.kinds & token.value.kinds)
        if comparable and (match is Match.SAME or token.value not in known):
            found.append((place, match))
    matches = {match for _, match in found}
    if matches == {Match.SAME}:
        if _is_hedged(given) or any(
            token.word in _PLACES for place, _ in found for token in given[:place][-1:]
        ):
            return Held(Match.UNSURE, "the answer hedges, or gives the value of something else")
        if any(_is_qualified(given, place, place + 1) for place, _ in found):
            return Held(Match.UNSURE, "the answer qualifies the value")
        return Held(Match.SAME, "the answer gives the same value")
    if matches == {Match.DIFFERENT} and len(found) == 1 and not _is_hedged(given):
        return Held(Match.DIFFERENT, "the answer gives another value")
    return Held(Match.UNSURE, "the answer gives no value that can be compared, or several")


def _phrase(wanted: Sequence[Token], given: Sequence[Token], told: Sequence[Token]) -> Held:
    """Words: they must stand in the answer as a whole, and nothing beside them be another answer."""
    size = len(wanted)
    places = [at for at in range(len(given) - size + 1) if _equal(wanted, given[at : at + size])]
    if not places:
        return Held(Match.UNSURE, "the answer does not have the reference answer's words")
    if _is_hedged(given):
        return Held(Match.UNSURE, "the answer hedges")
    inside = {place for at in places for place in range(at, at + size)}
    known = {token.word for token in (*told, *wanted) if token.word}
    for at in places:
        if not _is_apart(given, at, at + size) or _is_qualified(given, at, at + size):
            return Held(Match.UNSURE, "the reference answer's words are part of something else in the answer")
    for place, token in enumerate(given):
        starts = place == 0 or token.gap in ("label", "strong")
        if place not in inside and token.is_name and not starts and token.word not in known:
            return Held(Match.UNSURE, "the answer names something else too")
    return Held(Match.SAME, "the answer says the same as the reference answer")


def _is_apart(given: Sequence[Token], start: int, end: int) -> bool:
    """Whether these words are a phrase of their own, not a piece of a longer name or a list."""
    if start > 0:
        before, gap = given[start - 1], given[start].gap
        if gap == "comma" or (gap == "none" and before.word not in _FILLERS - _JOINERS):
            return False
    if end < len(given):
        after = given[end]
        if after.gap == "strong":
            return True
        return after.gap != "label" and after.word in _FILLERS - _JOINERS
    return True


def _is_qualified(given: Sequence[Token], start: int, end: int) -> bool:
    """Whether words next to it turn it round or make it a bound."""
    before = [token.word for token in given[max(0, start - 4) : start]]
    after = [token.word for token in given[end : end + 3]]
    return bool(
        _NEGATIONS & set(before)
        or _QUALIFIERS & set(before[-2:])
        or _NEGATIONS & set(after)
        or {"or", "plus"} & set(after[:1])
        or "or" in before[-1:]
    )


def _is_hedged(given: Sequence[Token]) -> bool:
    return any(token.word in _HEDGES or token.word in _EVASIONS for token in given)


def _bounds(found: Sequence[Token]) -> bool:
    return any(token.word in _QUALIFIERS | _NEGATIONS | {"or", "plus"} for token in found)


def _items(found: Sequence[Token]) -> list[list[Token]]:
    """A list's items: split at commas, semicolons, line ends and "and"."""
    items: list[list[Token]] = [[]]
    for token in found:
        if token.gap == "comma" or token.word == "and":
            items.append([])
        if token.word != "and":
            items[-1].append(token)
    return [item for item in items if item]


def _told_items(wanted: list[list[Token]], given: list[list[Token]], told: Sequence[Token]) -> Held:
    """A list told in sentences: every item stands in it, and every piece of the answer holds one."""
    flat = [token for item in given for token in item]
    if _is_hedged(flat):
        return Held(Match.UNSURE, "the answer hedges")
    known = {token.word for token in told if token.word} | _FILLERS
    spent: set[int] = set()
    for item in wanted:
        size = len(item)
        places = [at for at in range(len(flat) - size + 1) if _equal(item, flat[at : at + size])]
        if not places or any(_is_qualified(flat, at, at + size) for at in places):
            return Held(Match.UNSURE, "the answer does not plainly give every item")
        spent.update(place for at in places for place in range(at, at + size))
    for place, token in enumerate(flat):
        is_new = token.value is not None or (token.is_name and token.word not in known)
        if place not in spent and is_new and not (place == 0 or token.gap in ("label", "strong")):
            return Held(Match.UNSURE, "the answer names something else too")
    place = 0
    for piece in given:
        here = set(range(place, place + len(piece)))
        place += len(piece)
        if not here & spent and any(token.word not in known for token in piece):
            return Held(Match.UNSURE, "the answer lists something else too")
    return Held(Match.SAME, "the answer gives every item")
