"""Rules that compare facts with the task: what it does not state, its examples, what it leaves open."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from typing import Final

from webgym.core.text import fold, says
from webgym.tasks.rules.numbers import MONTHS, plain, stated_in_other_units
from webgym.tasks.rules.reading import STOP_WORDS, WEEKDAYS, Text, stem
from webgym.tasks.rules.rule import Case, Fact, message

_ORDINAL: Final = re.compile(
    r"\b[A-Za-z]+ (?P<label>\d{1,2})(?=$|[:,)'’]| (?:is|are|has|have|and|of|was)\b)"
    r"|(?:#|\bno\.|\bnumber)\s?(?P<sign>\d{1,2})\b|\b(?P<ordinal>\d{1,2})(?:st|nd|rd|th)\b",
    re.I,
)
"""Ordinal numbers that a rubric gives to one of several things: ``Park 2: ...``."""
_BY_A_MONTH: Final = re.compile(rf"\b(?:{'|'.join(month[:3] for month in MONTHS)})[a-z]*\b", re.I)
_NUMBERED: Final = re.compile(r"(#|\b[A-Za-z]+ )(\d{1,2})\b(?![.,:/%-]?\d|\s?%)")

_DISTINCTIVE_NUMBER: Final = re.compile(r"(?<![\w.,])[$€£]?\d[\d.,:/-]*\d")
_DISTINCTIVE_NAMES: Final = re.compile(
    r"(?<=[a-z,'’] )[A-Z][\w'’&-]+(?: (?:of |the |de |and |& )?[A-Z\d][\w'’&-]+)+"
)
_ANSWER_PARTS: Final = re.compile(r"\s*[;|\n]\s*")
_SHORTEST_ANSWER: Final = 4
"""Fewest characters of an answer that is searched for; shorter ones ("3", "Yes") occur in facts by chance."""

_LONGEST_INITIALS: Final = 5
"""Most letters of an abbreviation of the task's words."""

_AFTER_EXAMPLE: Final = re.compile(
    r"\b(?:such as|e\.\s?g\.?|for example|for instance)[,:]?\s+([^.;:()?!]{2,120})", re.I
)
_ITEMS: Final = re.compile(r",?\s+(?:and|or)\s+|\s*/\s*", re.I)
_BEYOND_ITEM: Final = re.compile(
    r"\s(?:with|for|in|that|which|who|near|to|as|from|on|at|by|has|have|is|are)\b.*", re.I
)

_MOST_EXAMPLES: Final = 50
"""Most lists of examples in a task that are looked at."""
_LONGEST_ITEM: Final = 4
"""Most words of an item of a list; anything longer is the rest of the sentence."""

_UMBRELLAS: Final[tuple[tuple[re.Pattern[str], frozenset[str]], ...]] = tuple(
    (re.compile(umbrella, re.I), frozenset(stem(word) for word in members.split()))
    for umbrella, members in (
        (
            r"\bcontact (?:details?|info(?:rmation)?|data)\b|\bhow to contact\b",
            "phone telephone email mail address fax website hours",
        ),
        (
            r"\bspec(?:s|ifications?)\b|\btechnical (?:details?|data)\b",
            "processor cpu ram memory storage battery screen display resolution weight camera ports",
        ),
        (
            r"\bnutrition(?:al)? (?:facts?|info(?:rmation)?|values?|data)\b",
            "calories fat protein carbohydrates carbs sugar sodium fibre fiber cholesterol",
        ),
        (r"\b(?:opening |business |operating )?hours\b|\bschedule\b|\btimetable\b", " ".join(WEEKDAYS)),
        (r"\bamenities\b|\bfacilities\b", "pool gym wifi parking breakfast spa restaurant sauna"),
        (
            r"\bpersonal (?:details?|info(?:rmation)?|data)\b",
            "name surname birth email phone address nationality gender",
        ),
        (
            r"\b(?:weather|forecast)\b",
            "temperature humidity wind precipitation rain pressure visibility sunrise sunset",
        ),
        (
            r"\b(?:full |complete |more |further |main |key |basic )?(?:details|information)\b",
            "price date location address phone email author director duration description rating",
        ),
    )
)

_UMBRELLA_STEMS: Final = frozenset(
    stem(word)
    for word in "contact specs specification technical nutrition nutritional hours schedule timetable "
    "amenities facilities personal weather forecast details information".split()
)
"""Stems one of which every umbrella term has; a fast test before the regular expressions."""


def unstated_numbers(case: Case) -> Iterator[str]:
    """A fact states no number that the task does not state in digits, in words or in other units."""
    stated = case.task.counts | Text(case.context.website).numbers
    short = (int(number) for number in stated if len(number) <= 2 and number.isdecimal())
    most = max((number for number in short if number <= 20), default=1)
    counted = _counted_through(case)
    for fact in case.facts:
        unstated = fact.text.numbers - stated
        if unstated:
            unstated -= stated_in_other_units(fact.text.folded, case.task.quantities)
        if unstated:
            places = {plain(number) for number in _ordinals(fact.text.raw) if 0 < int(number) <= most}
            labels = {number for label, number in _labelled(fact) if int(number) <= counted.get(label, 0)}
            scaled = {number for number in unstated if fact.text.counts & stated & _scaled_forms(number)}
            unstated -= places | labels | scaled
        if unstated:
            numbers = ", ".join(sorted(unstated))
            yield message(fact, f"states {numbers}, which the task does not state")


def _ordinals(raw: str) -> Iterator[str]:
    """The ordinal numbers in a fact: "park 2: ...", "#2", "the 2nd one", but not in dates."""
    for match in _ORDINAL.finditer(raw):
        if not match["ordinal"] or not _BY_A_MONTH.search(raw[max(0, match.start() - 12) : match.end() + 14]):
            yield match["label"] or match["sign"] or match["ordinal"]


def _labelled(fact: Fact) -> Iterator[tuple[str, str]]:
    return ((word.casefold().strip(), number) for word, number in _NUMBERED.findall(fact.text.raw))


def _counted_through(case: Case) -> dict[str, int]:
    """How far a rubric counts from 1 without a gap, by the word before the number ("author 1", "author
    2")."""
    numbers: dict[str, set[int]] = {}
    for fact in case.facts:
        for word, number in _labelled(fact):
            numbers.setdefault(word, set()).add(int(number))
    return {word: max(found) for word, found in numbers.items() if found == set(range(1, max(found) + 1))}


def _scaled_forms(number: str) -> frozenset[str]:
    """The number in thousands, millions and billions: "1.5" of "1.5 million"."""
    if number.count(".") > 1:
        return frozenset()
    return frozenset(plain(f"{float(number) * scale:.6f}") for scale in (10**3, 10**6, 10**9))


def unstated_names(case: Case) -> Iterator[str]:
    """A fact contains no name that neither the task nor the website's address contains."""
    host = case.context.website.casefold()
    initials = "".join(word[0] for word in case.task.words)
    for fact in case.facts:
        unstated = [
            name
            for name in fact.text.names
            if stem(fold(name)) not in case.task.stems
            and fold(name) not in host
            and not (1 < len(name) <= _LONGEST_INITIALS and fold(name) in initials)
            and fold(name) not in case.task.folded
        ]
        if unstated and not _spells_out(unstated, case.task):
            yield message(fact, f"names {' '.join(unstated)}, which the task does not")


def _spells_out(names: list[str], task: Text) -> bool:
    letters = "".join(name[0] for name in names).casefold()
    return len(letters) > 1 and letters in task.words


def unstated_quotations(case: Case) -> Iterator[str]:
    """A quotation in a fact occurs in the task."""
    for fact in case.facts:
        for quoted in fact.text.quotations:
            if not Text(quoted).content <= case.task.stems and not says(case.task.folded, quoted):
                yield message(fact, f'quotes "{quoted}", which the task does not say')


def leaked_answers(case: Case) -> Iterator[str]:
    """A fact contains nothing that only the answer or the source's hints contain: it would reveal the
    answer."""
    known = f"{case.task.folded} {fold(case.context.website)}"
    phrases = {
        part
        for answer in case.context.answers
        for part in (answer, *_ANSWER_PARTS.split(answer))
        if len(part.strip()) >= _SHORTEST_ANSWER and fold(part) not in _COMMON_ANSWERS
    }
    for source in (*case.context.hints, *case.context.answers):
        phrases.update(_distinctive_parts(source))
    facts_text = "\n".join(fact.text.folded for fact in case.facts)
    suspicious = sorted(
        (phrase for phrase in phrases if fold(phrase) in facts_text), key=lambda text: (-len(text), text)
    )
    not_in_task = [phrase for phrase in suspicious if not says(known, phrase)]
    for fact in case.facts:
        for phrase in not_in_task:
            if says(fact.text.folded, phrase) and not Text(phrase).content <= case.task.stems:
                yield message(fact, f'says "{phrase}", which only the answer or the hints say')
                break


_COMMON_ANSWERS: Final = frozenset(
    "available unavailable true false none free open closed unknown found".split()
)


def _distinctive_parts(source: str) -> Iterator[str]:
    """The quotations, numbers and names of a text, by which it is recognised in a fact."""
    text = Text(source)
    yield from (quoted for quoted in text.quotations if len(quoted) >= _SHORTEST_ANSWER)
    yield from (number.rstrip(".,:/-") for number in _DISTINCTIVE_NUMBER.findall(source))
    yield from _DISTINCTIVE_NAMES.findall(source)


def examples_as_facts(case: Case) -> Iterator[str]:
    """A fact does not require what the task gives only as an example."""
    task = case.context.instruction
    for match in islice(_AFTER_EXAMPLE.finditer(task), _MOST_EXAMPLES):
        elsewhere = Text(f"{task[: match.start()]} {task[match.end() :]}").stems
        items = [item for item in map(_content, _listed(match.group(1))) if item and not item <= elsewhere]
        for fact in case.facts:
            is_example_itself = _AFTER_EXAMPLE.search(fact.text.raw) is not None
            if not is_example_itself and any(item <= fact.text.content for item in items):
                yield message(fact, "asks for what the task only gives as an example")


def _listed(text: str) -> Iterator[str]:
    """The items of the list at the beginning of a text: "A, B or C, ensuring that ..." gives three."""
    for part in text.split(","):
        first, *others = _ITEMS.split(part.strip())
        yield from (_BEYOND_ITEM.sub("", item) for item in (first, *others[:1]))
        if others or len(first.split()) > _LONGEST_ITEM:
            return


def _content(text: str) -> frozenset[str]:
    content = Text(text).content
    return content if len(content) <= _LONGEST_ITEM else frozenset()


def enumerated(case: Case) -> Iterator[str]:
    """Facts do not enumerate what the task leaves open: "contact details" is one fact, not phone and
    address."""
    known = case.task.stems
    if known.isdisjoint(_UMBRELLA_STEMS):
        return
    for umbrella, members in _UMBRELLAS:
        match = umbrella.search(case.context.instruction)
        if match is None:
            continue
        naming = [(fact, (fact.text.stems & members) - known) for fact in case.facts]
        named = frozenset[str]().union(*(unstated for _, unstated in naming))
        if len(named) >= 2:
            last = next(fact for fact, unstated in reversed(naming) if unstated)
            yield message(
                last, f'enumerates what the task leaves open; "{match.group().strip()}" is one fact'
            )
            return


def stop_words_only(case: Case) -> Iterator[str]:
    """A fact says what it is about."""
    for fact in case.facts:
        if all(word in STOP_WORDS for word in fact.text.words):
            yield message(fact, "does not say what it is about")
