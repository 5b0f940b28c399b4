"""Rules about facts beside their task: what it does not state, its examples, what it leaves open."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from webgym.core.text import fold, says
from webgym.tasks.rules.numbers import MONTHS, plain, stated_in_other_units
from webgym.tasks.rules.reading import STOP_WORDS, WEEKDAYS, Text, stem
from webgym.tasks.rules.rule import Case, Fact, at

_PLACE: Final = re.compile(
    r"\b[A-Za-z]+ (?P<label>\d{1,2})(?=$|[:,)'’]| (?:is|are|has|have|and|of|was)\b)"
    r"|(?:#|\bno\.|\bnumber)\s?(?P<sign>\d{1,2})\b|\b(?P<ordinal>\d{1,2})(?:st|nd|rd|th)\b",
    re.I,
)
"""``Park 2: ...``: the second of three parks is numbered by the writer, not by the task."""
_BY_A_MONTH: Final = re.compile(rf"\b(?:{'|'.join(month[:3] for month in MONTHS)})[a-z]*\b", re.I)
_NUMBERED: Final = re.compile(r"(#|\b[A-Za-z]+ )(\d{1,2})\b(?![.,:/%-]?\d|\s?%)")

_TELL_TALE_NUMBER: Final = re.compile(r"(?<![\w.,])[$€£]?\d[\d.,:/-]*\d")
_TELL_TALE_NAMES: Final = re.compile(
    r"(?<=[a-z,'’] )[A-Z][\w'’&-]+(?: (?:of |the |de |and |& )?[A-Z\d][\w'’&-]+)+"
)
_ANSWER_PARTS: Final = re.compile(r"\s*[;|\n]\s*")
_SHORTEST_ANSWER: Final = 4
"""Characters: a shorter answer ("3", "Yes") stands in facts by chance."""

_LONGEST_INITIALS: Final = 5
"""Letters: what is longer is no abbreviation of the task's own words."""

_AFTER_EXAMPLE: Final = re.compile(
    r"\b(?:such as|e\.\s?g\.?|for example|for instance)[,:]?\s+([^.;:()?!]{2,120})", re.I
)
_ITEMS: Final = re.compile(r",?\s+(?:and|or)\s+|\s*/\s*", re.I)
_BEYOND_ITEM: Final = re.compile(
    r"\s(?:with|for|in|that|which|who|near|to|as|from|on|at|by|has|have|is|are)\b.*", re.I
)

_LONGEST_ITEM: Final = 4
"""Words: what is longer is the sentence going on."""

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

_OPEN: Final = frozenset(
    stem(word)
    for word in "contact specs specification technical nutrition nutritional hours schedule timetable "
    "amenities facilities personal weather forecast details information".split()
)
"""A task without any of these leaves nothing open that is known here: looked at first, for it is quick."""


def unstated_numbers(case: Case) -> Iterator[str]:
    """A fact states no number that the task does not state, in digits, in words or in other units."""
    stated = case.task.counts | Text(case.asked.website).numbers
    most = max((int(number) for number in stated if number.isdecimal() and int(number) <= 20), default=1)
    counted = _counted_through(case)
    for fact in case.facts:
        unstated = fact.text.numbers - stated
        if unstated:
            unstated -= stated_in_other_units(fact.text.folded, case.task.quantities)
        if unstated:
            places = {plain(number) for number in _place_numbers(fact.text.raw) if 0 < int(number) <= most}
            labels = {number for label, number in _labelled(fact) if int(number) <= counted.get(label, 0)}
            scaled = {number for number in unstated if fact.text.counts & stated & _scaled_forms(number)}
            unstated -= places | labels | scaled
        if unstated:
            numbers = ", ".join(sorted(unstated))
            yield at(fact, f"states {numbers}, which the task does not state")


def _place_numbers(raw: str) -> Iterator[str]:
    """The numbers that say which of several is meant: "park 2: ...", "#2", "the 2nd one". No dates."""
    for found in _PLACE.finditer(raw):
        if not found["ordinal"] or not _BY_A_MONTH.search(raw[max(0, found.start() - 12) : found.end() + 14]):
            yield found["label"] or found["sign"] or found["ordinal"]


def _labelled(fact: Fact) -> Iterator[tuple[str, str]]:
    return ((word.casefold().strip(), number) for word, number in _NUMBERED.findall(fact.text.raw))


def _counted_through(case: Case) -> dict[str, int]:
    """By the word before it, how far a rubric counts from 1 without a gap ("author 1", "author 2")."""
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
    """A fact names nothing that the task and the website's name do not."""
    host = case.asked.website.casefold()
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
            yield at(fact, f"names {' '.join(unstated)}, which the task does not")


def _spells_out(names: list[str], task: Text) -> bool:
    letters = "".join(name[0] for name in names).casefold()
    return len(letters) > 1 and letters in task.words


def unstated_quotations(case: Case) -> Iterator[str]:
    """What a fact quotes stands in the task."""
    for fact in case.facts:
        for quoted in fact.text.quotations:
            if not Text(quoted).content <= case.task.stems and not says(case.task.folded, quoted):
                yield at(fact, f'quotes "{quoted}", which the task does not say')


def leaked_answers(case: Case) -> Iterator[str]:
    """What only the answer or the source's hints say stands in no fact: it would be given away."""
    known = f"{case.task.folded} {fold(case.asked.website)}"
    telling = {
        part
        for answer in case.asked.answers
        for part in (answer, *_ANSWER_PARTS.split(answer))
        if len(part.strip()) >= _SHORTEST_ANSWER and fold(part) not in _COMMON_ANSWERS
    }
    for source in (*case.asked.hints, *case.asked.answers):
        telling.update(_tell_tales(source))
    said = "\n".join(fact.text.folded for fact in case.facts)
    suspicious = sorted(
        (phrase for phrase in telling if fold(phrase) in said), key=lambda text: (-len(text), text)
    )
    unsaid = [phrase for phrase in suspicious if not says(known, phrase)]
    for fact in case.facts:
        for phrase in unsaid:
            if says(fact.text.folded, phrase) and not Text(phrase).content <= case.task.stems:
                yield at(fact, f'says "{phrase}", which only the answer or the hints say')
                break


_COMMON_ANSWERS: Final = frozenset(
    "available unavailable true false none free open closed unknown found".split()
)


def _tell_tales(source: str) -> Iterator[str]:
    """The quotations, numbers and names of a text that give it away where they turn up."""
    text = Text(source)
    yield from (quoted for quoted in text.quotations if len(quoted) >= _SHORTEST_ANSWER)
    yield from (number.rstrip(".,:/-") for number in _TELL_TALE_NUMBER.findall(source))
    yield from _TELL_TALE_NAMES.findall(source)


def examples_as_facts(case: Case) -> Iterator[str]:
    """What the task only gives as an example is not asked for."""
    task = case.asked.instruction
    for match in _AFTER_EXAMPLE.finditer(task):
        elsewhere = Text(f"{task[: match.start()]} {task[match.end() :]}").stems
        items = [item for item in map(_content, _listed(match.group(1))) if item and not item <= elsewhere]
        for fact in case.facts:
            says_so = _AFTER_EXAMPLE.search(fact.text.raw) is not None
            if not says_so and any(item <= fact.text.content for item in items):
                yield at(fact, "asks for what the task only gives as an example")


def _listed(text: str) -> Iterator[str]:
    """The items of the list that a text begins with: "A, B or C, ensuring that ..." gives three."""
    for part in text.split(","):
        first, *others = _ITEMS.split(part.strip())
        yield from (_BEYOND_ITEM.sub("", item) for item in (first, *others[:1]))
        if others or len(first.split()) > _LONGEST_ITEM:
            return


def _content(text: str) -> frozenset[str]:
    content = Text(text).content
    return content if len(content) <= _LONGEST_ITEM else frozenset()


def enumerated(case: Case) -> Iterator[str]:
    """What the task leaves open is not enumerated: "contact details" is one fact, not phone and address."""
    known = case.task.stems
    if known.isdisjoint(_OPEN):
        return
    for umbrella, members in _UMBRELLAS:
        found = umbrella.search(case.asked.instruction)
        if found is None:
            continue
        naming = [(fact, (fact.text.stems & members) - known) for fact in case.facts]
        named = frozenset[str]().union(*(unstated for _, unstated in naming))
        if len(named) >= 2:
            last = next(fact for fact, unstated in reversed(naming) if unstated)
            yield at(last, f'enumerates what the task leaves open; "{found.group().strip()}" is one fact')
            return


def stop_words_only(case: Case) -> Iterator[str]:
    """A fact says what thing it is about."""
    for fact in case.facts:
        if all(word in STOP_WORDS for word in fact.text.words):
            yield at(fact, "does not say what it is about")
