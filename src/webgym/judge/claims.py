"""Whether an answer claims a value that it mentions, for the offline judge.

A mention is no claim where it is denied ("not on Thursday", "except Thursday"), bounded ("over 370 m"), or
followed by another unit than the value has ("36 miles" for 36 km, "10:45 pm" for 10:45 am).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from datetime import date
from functools import lru_cache
from itertools import combinations, groupby
from types import MappingProxyType
from typing import Final, TypeAlias
from unicodedata import normalize

from webgym.core.text import fold, whole_phrase
from webgym.judge.units import CURRENCY_SIGNS, CURRENCY_WORDS, MONTHS, NUMBER_WORDS, SCALES, UNITS
from webgym.judge.values import read

_Unit: TypeAlias = tuple[str, object]

_NOT: Final = (
    r"(?<!\bif )not|never|except|excluding|besides|without|instead of|rather than|other than|unlike"
    r"|neither|nor"
)
_UP_TO_IT: Final = (
    r"(?:[^\w.;!?]+(?:a|an|the|that|on|in|at|for|of|to|by|it|is|was|be|called|named))*[^\w.;!?]*$"
)
_DENIED_BEFORE: Final = re.compile(rf"(?:\b(?:{_NOT})|n't){_UP_TO_IT}", re.IGNORECASE)
_OTHER_BEFORE: Final = re.compile(
    rf"(?:\b(?:{_NOT}|than|compared (?:to|with))|n't){_UP_TO_IT}", re.IGNORECASE
)
"""Before a value that is not the answer: what denies it, or compares the answer with it."""
_DENIED_AFTER: Final = re.compile(
    r"[^\w.;!?]*(?:(?:is|was|are|were) (?:wrong|incorrect|false)\b"
    r"|(?:(?:is|was|are|were) not|isn't|wasn't|aren't|weren't)"
    r"(?: (?:it|true|right|correct|the (?:right|correct|answer))\b| ?[.,;!]|$))",
    re.IGNORECASE,
)
_SCALE: Final = "|".join(SCALES)
_BOUNDS: Final = "less than|more than|fewer than|under|over|below|above|at least|at most|up to|almost|nearly"
_BOUND: Final = re.compile(rf"(?:\b({_BOUNDS}) |(?<![-=])[<>≤≥]=? ?|\b(?:{_SCALE}) (?:and )?)[$£€¥]?$")
_SCALED: Final = re.compile(rf"\+(?!\w)| (?:{_SCALE}|and a half)\b| ?(?:[^\W\d_]+ )?or (?:more|less|fewer)\b")
_QUALIFIER: Final = re.compile(rf"\b(?:([^\W\d_]+) )?(?:{_NOT}|{_BOUNDS})$", re.IGNORECASE)
_RATE: Final = re.compile(
    r" ?(?:(?:\b(?:per|an?|each|every) |/ ?)(hour|day|night|week|month|year)\b"
    r"|\b(hour|dai|night|week|month|year)ly\b)"
)
"""How often an amount is due: "per week", "weekly"."""
_CURRENCIES: Final = frozenset(CURRENCY_SIGNS.values())
_VISITED: Final = "pages?|sites?|websites?|links?|steps?|times|attempts?|searches|clicks"
"""What an answer counts that reports the search and not its result."""
_VISITED_AFTER: Final = re.compile(rf" ({_VISITED})\b")
_VISITED_BEFORE: Final = re.compile(rf"\b({_VISITED}) (?:\d+ of )?$")
_REPORTED: Final = re.compile(
    rf"\b({_VISITED}) \d+(?: (?:of|to|through) \d+)?(?![.,:]?\d)|(?<![\d.,:])\b\d+ ({_VISITED})\b",
    re.IGNORECASE,
)
_ONE: Final = re.compile(r"\b(?:no|the|first|second|which|any|each|every|this|that|another|other) $")
_NONE: Final = re.compile(
    r" of (?:the|these|those|my|all) (?:\w+ )?(?:pages?|sites?|websites?|links?|others?)\b"
)
_WORD_AFTER: Final = re.compile(r" ?([^\W\d_]+|°[cf]?|%)")
_SIGN_BEFORE: Final = re.compile(r"((?:\b[a-z]{1,2})?[$£€¥₹₩₽]|\b[a-z]{2,3}\b) ?$")
_WORD: Final = re.compile(r"[^\W_]+")  # of "closing_day", too
_NAMED: Final = re.compile(r"^ ?(?:for|in) .*, (?=the )")
_UNLABELLING: Final = frozenset(
    "a an and are at by for from has have in is it of on the there to was with".split()
)
_CLOCK: Final = {"am": ("clock", "am"), "pm": ("clock", "pm")}
_HALVES: Final = frozenset(_CLOCK.values())

_MONTHS: Final = "|".join(MONTHS)
_AMOUNT: Final = r"(?<![\w.,:$€£])(\d+(?:[.,]\d+)*)"
_SPELLINGS: Final = tuple(
    (re.compile(pattern, re.IGNORECASE), written)
    for pattern, written in (
        (r"\b([ap])\. ?m\b\.?", r"\1m"),
        (r"(?<![\d.,:])(\d{1,2})\.(\d\d ?[ap]m)\b", r"\1:\2"),
        (r"(?<![\d.,:])(\d{1,2})( ?[ap]m)\b", r"\1:00\2"),
        (r"\b0(\d:\d\d ?[ap]m)\b", r"\1"),
        (r"\b(\d{1,2})(?:st|nd|rd|th)\b", r"\1"),
        (rf"\b(?!may)({_MONTHS})\.(?=,?\s*\d)", r"\1"),
        (rf"\b0?(\d{{1,2}})(?: of |-| |\. (?=\w+\.? \d{{4}}))(?=(?:{_MONTHS})\b)", r"\1 "),
        (rf"\b(?<=\d )({_MONTHS})-(?=\d{{4}}\b)", r"\1 "),
        (rf"\b({_MONTHS}) 0(?=\d\b)", r"\1 "),
        (rf"(?<![*_`])[*_`]+{_AMOUNT}[*_`]+(?= ?(?:[^\W\d_]|[%°]))", r"\1"),
        (r"\b(\d+) ?(?:h|hr|hrs|hours?),? ?(?:and )?(\d+) ?(?:m|mins?|minutes?)\b", r"\1 h \2 min"),
        (r"(?<=\w) out of (?=\w)", " of "),
        (r" & ", " and "),
        (r"\b(dr|mr|mrs|ms|prof)\.(?= )", r"\1"),
        (r"(?<=\d) ?(?:per ?cent\b|pct\b|%)", "%"),
        (r"(?<=\d) ?[°ºo]c\b", "°C"),
        (r"(?<=\d),00(?![\d.,:])", ""),
        (r"(?<=\d)['’](?=\d{3}(?!\d))", ","),
        *(
            (pattern, rf"{sign}\1")
            for sign, words, code in (
                ("$", "dollars?", "USD"),
                ("€", "euros?", "EUR"),
                ("£", "pounds?", "GBP"),
            )
            for pattern in (
                rf"{_AMOUNT} ?(?:(?:{words}|{code})\b|{re.escape(sign)}(?!\d))(?! ?\d)",
                rf"\b{code} ?{_AMOUNT}",
            )
        ),
        (r"([$€£]) (?=\d)", r"\1"),
    )
)
"""Patterns of spellings of times, days, amounts and names, and what stands for them."""
_MONTH: Final = re.compile(rf"\b(?:{'|'.join(name for name in MONTHS if len(name) > 3)})\b", re.IGNORECASE)

_NUMERIC_DATE: Final = re.compile(
    r"(?<![\w./-])(?:\d{1,2}([./])\d{1,2}\1\d{4}|\d{4}([/-])\d{1,2}\2\d{1,2})(?![\w/]|[.-]\d)"
)
_COUNTED_OFF: Final = "step|part|question|answer|task|item|fact|result|q|a"
"""Words before the numbers of list items."""
_LIST_NUMBER: Final = re.compile(
    r"(?:^[ \t>#]*(?:[-*•][ \t]+)?[*_]{0,3}"
    r"(?:[(\[](\d{1,2})(?:(?: of |/)\d{1,2})?[)\]]|(\d{1,2})[.:)]|\|[ \t]*(\d{1,2})[ \t]*\|)[*_:]{0,3}"
    rf"|(?:^[ \t>#]*(?:[-*•][ \t]+)?[*_]{{0,3}}|(?<=[,;.!?]\s))(?:{_COUNTED_OFF}) ?(\d{{1,2}})"
    r"(?:[.:)]|[ \t]+[-–—→])[*_]{0,3}"
    r"|(?:(?<=[,;:.]\s)|(?<=\band\s))\(?(\d{1,2})\)"
    r"|(?:^|(?<=[.!?]\s))(\d{1,2})[.:](?=\s[^\W\d_]))[ \t]+(?=\S)",
    re.MULTILINE | re.IGNORECASE,
)
_LABEL_AFTER: Final = re.compile(r"(?<=\d)[ \t]*\n(?=[ \t]*[^\W\d_][^\n]*:)")
"""The line end between a number and the label of the next line, which is not its unit."""
_WHOLE_AMOUNT: Final = re.compile(r"(?<=\d)\.00(?![\d.,:])")
_GROUPED: Final = re.compile(r"(?<=\d)[\u00a0\u2009\u202f](?=\d{3}(?!\d))")
_INVISIBLE: Final = re.compile("[\x00\u00ad\u200b-\u200d\u2060\ufeff]")
_SHORT_UNITS: Final = {
    name: next(other for other, same in UNITS.items() if same == size) for name, size in UNITS.items()
}
_UNIT_AFTER: Final = re.compile(
    rf"(?<=\d) ?({'|'.join(map(re.escape, sorted(UNITS, key=len, reverse=True)))})(?![\w/])", re.IGNORECASE
)
_NAMED_NUMBER: Final = re.compile(rf"\b(?:{_COUNTED_OFF}) ?\d", re.IGNORECASE)
_ESCAPE: Final = re.compile(r"\\u(?![dD][89a-fA-F])([0-9a-fA-F]{4})")
_MARKUP: Final = tuple(
    (re.compile(pattern), written)
    for pattern, written in (
        (r"</?[a-zA-Z][a-zA-Z0-9]* ?/?>", "\n"),
        (r"(?<=[\w.,;:!?)])\[\^?\d{1,2}\](?!\()| ?【\d+†[^【】]{0,40}】", ""),
        (r"\$(\d[\d.,]*)\$(?!\d)", r"\1"),
        (r"(?<!\d)(\d{1,2})：(?=\d\d(?!\d))", r"\1:"),
    )
)
_PUNCTUATION: Final = str.maketrans({"，": ", ", "、": ", ", "；": "; ", "：": ": ", "。": ". "})
_NUMERAL: Final = re.compile(r"(?<!\w)[²³¹⁰-₉①-⒛⓪０-９𝟎-𝟿]+")
"""Digits other than ASCII's, which are the same number."""
_NUMBER: Final = re.compile(rf"\d|\b(?:{'|'.join(NUMBER_WORDS)})\b", re.IGNORECASE)
_DIGIT: Final = re.compile(r"(?<![\w.,:])\d{1,2}(?![\w.,:])")
_DIGITS: Final = {str(number): word for word, number in NUMBER_WORDS.items()}


def _without_list_numbers(text: str) -> str:
    """The text without the numbers of list items that count up from 1. A number 1 alone is one if a word says
    so ("Answer 1: …"), or another number follows it in its line."""
    following, is_list = 1, False

    def stripped(match: re.Match[str]) -> str:
        nonlocal following, is_list
        number = int(match[match.lastindex or 0])
        if number not in (1, following):
            return match[0]
        rest = text[match.end() :].partition("\n")[0]
        is_list |= number > 1 or bool(_NAMED_NUMBER.search(match[0])) or bool(_NUMBER.search(rest))
        following = number + 1
        return ""

    without = _LIST_NUMBER.sub(stripped, text)
    return without if is_list else text


def without_markup(text: str) -> str:
    """The text without tags, citations ("[1]") and escapes, and with the separators of every script in
    ASCII."""
    for pattern, written in _MARKUP:
        text = pattern.sub(written, text)
    return _ESCAPE.sub(lambda escape: chr(int(escape[1], 16)), text).translate(_PUNCTUATION)


@lru_cache(maxsize=1024)
def respelled(text: str) -> str:
    """The text without the numbers of list items, and with common spellings of times, dates and amounts
    written in one way."""
    return _respelled(_without_list_numbers(text))


def _respelled(text: str) -> str:
    text = _NUMERAL.sub(lambda sign: normalize("NFKC", sign[0]), _GROUPED.sub(",", text))
    for pattern, written in _SPELLINGS:
        text = pattern.sub(written, text)
    text = _UNIT_AFTER.sub(lambda unit: f" {_SHORT_UNITS[unit[1].casefold()]}", text)
    text = _NUMERIC_DATE.sub(_in_words, text)
    return _MONTH.sub(lambda month: month[0][:3], text)


def _in_words(match: re.Match[str]) -> str:
    day = day_of(match[0])
    return f"{day.day} {day:%b %Y}" if day else match[0]


def day_of(text: str) -> date | None:
    """The day that the text is in any spelling; ``None`` if it is none, or may be another (03/05/2026)."""
    values = [token.value for token in read(text).tokens]
    readings = values[0].readings if len(values) == 1 and values[0] else ()
    dates = [amount for kind, _, amount in readings if kind == "date" and "?" not in amount]
    return date(*map(int, dates[0].split("-"))) if len(dates) == len(readings) == 1 else None


@lru_cache(maxsize=1024)
def spelled(text: str) -> str:
    """The same of the folded text, with whole amounts without their ".00"."""
    folded = fold(_LABEL_AFTER.sub(" ;", _GROUPED.sub(",", _without_list_numbers(text))))
    return _WHOLE_AMOUNT.sub("", _respelled(folded).casefold())


def numeral(option: str) -> tuple[str, ...]:
    """The spelling, with digits and number words for each other ("5 stars" and "five stars", "1" and "One"),
    and times of day also as 9.45 and 9h45."""
    if option.casefold() in NUMBER_WORDS:
        return option, str(NUMBER_WORDS[option.casefold()])
    if clock := re.fullmatch(r"(\d{1,2}):(\d\d)", option):
        hour, minute = clock.groups()
        return option, f"{hour}h{minute}", *((f"{hour}.{minute}",) if minute != "00" else ())
    in_words = _DIGIT.sub(lambda digit: _DIGITS.get(digit[0], digit[0]), option)
    return (option,) if in_words == option else (option, in_words)


def claims(answer: str, options: Sequence[str], known: str) -> bool:
    """Whether an answer claims one of a value's accepted spellings.

    Args:
        answer: as :func:`spelled` writes it.
        options: the accepted spellings.
        known: texts whose bounds an answer may repeat, in the same spelling: the task and its solution.
    """
    units = {unit for option in options for unit in _units(spelled(option))}
    return any(
        _is_claim(answer, start, end, units, known)
        for option in options
        for start, end in _places(answer, spelled(option).rstrip(".!?") or option)
    )


def with_units(answer: str, required: Iterable[Sequence[str]]) -> str:
    """The answer with the units of those required small numbers that stand alone after a label: "Days: 6". A
    noun before a number must be in the label: "Gate: 6" is "Gate 6"."""
    answer = _without_list_numbers(answer)
    for text, *_ in required:
        if small := re.fullmatch(r"[$€£](\d)|(\d) (?!of )[a-z°%].*|([A-Z][a-z]+) (\d)", text):
            digit = small[1] or small[2] or small[4]
            noun = rf"(?<![^\W_])(?i:{small[3]})(?![^\W_])[^\n.;]{{0,60}}?" if small[3] else ""
            alone = re.compile(
                rf"""({noun}(?:[:=|→]|\b(?:is|are|was|were|of)\b)[\s"*`]*){digit}"""
                r"""(?=["*`]*\s*(?:[;,|)}\n]|\.(?!\d)|and\b|$))"""
            )
            answer = alone.sub(rf"\g<1>{text}", answer, count=1)
    return answer


def without_qualifiers(answer: str, labels: Iterable[str]) -> str:
    """The answer without the denials and bounds that end labels of the page: "Cannot cook without: miso" and
    "Half earn more than: $67,900" say what the page says."""
    for label in labels:
        if found := _QUALIFIER.search(label):
            answer = re.sub(rf"\b{re.escape(found[0])}\b", found[1] or "", answer, flags=re.IGNORECASE)
    return answer


def without_denied(answer: str, values: Iterable[str]) -> str:
    """The answer without those of the values that it denies, and without the denials: "Rock, not Sulphur" is
    "Rock"."""
    answer = _INVISIBLE.sub("", answer).replace("’", "'")
    folded = fold(answer)
    for value in sorted((each for each in values if fold(each) in folded), key=len, reverse=True):
        pattern = re.compile(whole_phrase(fold(value)).pattern, re.IGNORECASE)
        for match in reversed([*pattern.finditer(answer)]):
            start, end = match.span()
            before = _OTHER_BEFORE.search(answer, max(0, start - 80), start)
            after = _DENIED_AFTER.match(answer, end)
            if before or after:
                answer = (
                    answer[: before.start() if before else start] + answer[after.end() if after else end :]
                )
    return answer


def without_reported(text: str, known: str) -> str:
    """The text without numbers of pages, steps and the like, which report the search and are no claims; with
    those of what the folded text ``known``, the task, speaks of."""

    def bare(match: re.Match[str]) -> str:
        word = match[1] or match[2]
        return match[0] if _is_counted(fold(word), known) else word

    return _REPORTED.sub(bare, text)


def _is_counted(word: str, known: str) -> bool:
    """Whether a task counts what the word names: it speaks of it in the plural."""
    return f"{word.removesuffix('s')}s" in known


def swapped(
    answer: str,
    required: Sequence[Sequence[str]],
    solution: str,
    shown: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Two numbers or two names that an answer gives for each other: the label of one stands with the other.

    Their labels are the words before them in the solution, such as the name of its item or field, and those
    beside them on the page. They may stand before or after the values in the answer; where that can be read
    the right way, it is no swap. Both labels before both values, or after them, are in the same order.
    Numbers of a kind that are listed without labels are in the task's order.

    Args:
        answer, solution: as :func:`spelled` writes them.
        required: the accepted spellings of each value, in the solution's order.
        shown: the text beside a value on its page, by the value.

    Returns:
        Both, for a sentence; empty if there are none.
    """
    labelled = [*_labelled(required, solution, shown)]
    values = [place for options, *_ in labelled for option in options for place in _places(answer, option)]
    within = {at for start, end in values for at in range(start, end)}
    words = [word for word in _WORD.finditer(answer) if word.start() not in within]
    for (one, ours, our_labels), (other, theirs, their_labels) in combinations(labelled, 2):
        labels = dict.fromkeys(our_labels - theirs, "a") | dict.fromkeys(their_labels - ours, "b")
        starts, others = (
            dict(sorted(place for option in options for place in _places(answer, option)))
            for options in (one, other)
        )
        if starts.keys() & others.keys():
            continue
        found = dict.fromkeys(starts, "A") | dict.fromkeys(others, "B")
        found |= {word.start(): labels[word[0]] for word in words if word[0] in labels}
        order = "".join(mark for mark, _ in groupby(found[at] for at in sorted(found)))
        if re.fullmatch("(ab|ba)(AB|BA)|(AB|BA)(ab|ba)", order):
            is_swap = order[:2].lower() != order[2:].lower()
        elif order == "BA":
            between = answer[max(others.values()) : min(starts)]
            is_swap = _kind(one[0]) == _kind(other[0]) and _is_separator(between, ours & theirs)
        else:
            owners = [(_owners(marks, "A"), _owners(marks, "B")) for marks in (order, order[::-1])]
            is_right = any("a" in own and "b" in their for own, their in owners)
            is_swap = not is_right and ({"b"}, {"a"}) in owners
        if is_swap:
            return f'"{one[0]}" for "{other[0]}"'
    return ""


def _owners(order: str, value: str) -> set[str]:
    """The labels that stand next before a value, in a sequence of labels (a, b) and values (A, B)."""
    owners, label = set[str](), ""
    for mark in order:
        if mark == value:
            owners.add(label)
        elif mark.islower():
            label = mark
    return owners


def _kind(value: str) -> str:
    """A number's spelling without its digits; the whole of a name."""
    return re.sub(r"\d+(?:[.,]\d+)*", "9", value)


def _is_separator(text: str, shared: Set[str]) -> bool:
    """Whether nothing stands between two values in a list but what both have, such as their unit."""
    return not re.search("[:=()]", text) and set(_WORD.findall(text)) <= shared | _UNLABELLING


def _labelled(
    required: Sequence[Sequence[str]], solution: str, shown: Mapping[str, str]
) -> Iterator[tuple[list[str], set[str], set[str]]]:
    """The required values, each with the words before it in the solution or beside it on its page, and with
    those of them that are its label. Words before it are none if another has all of them ("the number is …,
    the number of bridges is …"), and one beside it is none if another has it, too."""
    at, named, found = 0, "", list[tuple[list[str], set[str], set[str]]]()
    for spellings in required:
        options = [spelled(option) for option in spellings]
        place = next(((start, end) for start, end in _places(solution, options[0]) if start >= at), None)
        if place is None:
            break
        *earlier, before = re.split(r"[.;!?] ", solution[at : place[0]])
        if earlier or not at:  # "For NAME, the price is …" names it for all values of the sentence
            named = "".join(_NAMED.findall(before))
        at = place[1]
        told, beside = (
            set(_WORD.findall(text)) - _UNLABELLING
            for text in (f"{named} {before}", spelled(shown.get(spellings[0], "")))
        )
        found.append((options, told, beside))
    uses = Counter(word for _, told, beside in found for word in told | beside)
    for options, told, beside in found:
        labels = {word for word in beside if uses[word] == 1}
        is_told_apart = sum(told <= others for _, others, _ in found) == 1
        yield options, told | beside, labels | told if is_told_apart else labels


def _places(text: str, phrase: str) -> Iterator[tuple[int, int]]:
    if phrase.startswith("no ") and phrase.count(" ") == 1:  # "no excellent reviews"
        pattern = re.compile(rf"\bno (?:[^\W\d_]+ ){{0,2}}{re.escape(phrase[3:])}(?!\w)")
    else:
        pattern = whole_phrase(phrase)
    return (match.span() for match in pattern.finditer(text))


def _is_claim(text: str, start: int, end: int, units: set[_Unit], known: str) -> bool:
    before, value, after = text[max(0, start - 80) : start], text[start:end], text[end:]
    if _DENIED_BEFORE.search(before) or _DENIED_AFTER.match(after):
        return False
    if value == "one":
        return not _ONE.search(before)
    if value == "none":
        return not _NONE.match(after)
    is_count = value.isdigit() or value in NUMBER_WORDS
    if not is_count and not any(map(str.isdigit, value)):
        return True
    bound = _BOUND.search(before)
    if (bound and (bound[1] or bound[0]) not in known) or _SCALED.match(after):
        return False
    is_price = any(kind in _CURRENCIES for kind, _ in units)
    rate = _RATE.match(after) if is_price else None
    if rate and (rates := _rates(known)) and rates.isdisjoint(_rates(rate[0])):
        return False
    visited = is_count and (_VISITED_AFTER.match(after) or _VISITED_BEFORE.search(before))
    if visited and not _is_counted(visited[1], known):
        return False
    sign, word = _SIGN_BEFORE.search(before), _WORD_AFTER.match(after)
    other = {_unit(word[1])} if word else set()
    if sign:
        other.add(_unit(sign[1]) if sign[1] in CURRENCY_SIGNS else CURRENCY_WORDS.get(sign[1]))
    other.discard(None)
    if units <= _HALVES:  # "19:30 h" is no other unit
        other &= _HALVES
    return not units or not other or bool(other & units)


def _rates(text: str) -> set[str]:
    return {found[1] or found[2].replace("dai", "day") for found in _RATE.finditer(text)}


def _units(text: str) -> Iterator[_Unit]:
    for word in re.findall(r"[^\W\d_]++(?!\d\d)|°[cf]?|[%$£€¥₹₩₽]", text):  # the h of 9h45 is no unit
        if unit := _unit(word):
            yield unit


def _unit(word: str) -> _Unit | None:
    if word in CURRENCY_SIGNS:
        return (CURRENCY_SIGNS[word], 1)
    return UNITS.get(word) or CURRENCY_WORDS.get(word) or _CLOCK.get(word)
