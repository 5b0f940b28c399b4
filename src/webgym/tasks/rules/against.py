"""Rules about facts beside their task: what it does not state, what is only an example, how it is cut."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations
from typing import Final

from webgym.core.text import fold, says
from webgym.tasks.rules.case import Case, Fact, at
from webgym.tasks.rules.reading import STOP_WORDS, WEEKDAYS, Text, plain, stem

_LABEL: Final = re.compile(r"(?:#|\b[A-Za-z]+ )(\d{1,2})(?=$|[:,)'’]| (?:is|are|has|have|and|of|was)\b)")
"""``Park 2: ...``: the second of three parks is numbered by the writer, not by the task."""

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

_HOW_TO: Final = re.compile(
    r"\bhow (?:do|does|can|could|should|would|to|might)\b|\b(?:instructions?|directions?|a guide|a tutorial"
    r"|steps?) (?:on|for|to|about|of)\b|\bexplain how\b|\bprocess (?:of|for|to)\b",
    re.I,
)
_COMPUTATION: Final = re.compile(
    r"\b(?:differen(?:ce|t)|sums?|totals?|averages?|mean|ratio|percent(?:age)?|convert\w*|comput\w+"
    r"|calculat\w+|combined|how (?:much|many) (?:more|less|fewer|longer|older|higher)|how many times"
    r"|altogether|add(?:ed)? up)\b",
    re.I,
)
_ARITHMETIC: Final = re.compile(
    r"\b(?:subtract\w*|divid(?:e|es|ed|ing)|multipl(?:y|ies|ied|ying)|add(?:s|ed|ing)? (?:up|together)"
    r"|summ(?:ed|ing))\b",
    re.I,
)
_WORKED_OUT: Final = re.compile(r"\b(?:comput|calculat|work(?:s|ed|ing)? out)", re.I)
_RESULT: Final = re.compile(
    r"\b(?:difference|sum|total|average|mean|ratio|percentage|share|result|how (?:much|many))\b", re.I
)
_EACH: Final = re.compile(
    r"\b(?:both|each|every|all|respective\w*|individual\w*|as well as|along with|also"
    r"|and (?:the|how|their))\b",
    re.I,
)

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


def split_alternatives(case: Case) -> Iterator[str]:
    """Alternatives are one fact with OR, not a fact each, which would ask for all of them."""
    if " or " not in case.task.folded:
        return
    for one, other in combinations(case.facts, 2):
        first, second = _where_they_differ(one.text.words, other.text.words)
        if first and second and _are_alternatives(case.task.folded, first, second):
            yield at(
                other, f"and fact {one.number} of group {one.group} are alternatives; write one fact with OR"
            )


_OR_BETWEEN: Final = re.compile(r"(?:, [\w' -]{1,30})*,? or (?:(?:the|an?|in|on|at|to|for|from|with|by) )*")
_COMMA_BETWEEN: Final = re.compile(r"(?:, [\w' -]{1,30})*, (?:(?:the|an?|in|on|at|to|for|from|with|by) )*")
_OR_AFTER: Final = re.compile(r"(?:, [\w' -]{1,30})*,? or ")


def _where_they_differ(one: tuple[str, ...], other: tuple[str, ...]) -> tuple[str, str]:
    """The words in the middle that two facts do not share; empty where they differ in more than a few."""
    start = 0
    while start < min(len(one), len(other)) and one[start] == other[start]:
        start += 1
    end = 0
    while end < min(len(one), len(other)) - start and one[-1 - end] == other[-1 - end]:
        end += 1
    first, second = one[start : len(one) - end], other[start : len(other) - end]
    if not first or not second or max(len(first), len(second)) > 5 or start + end == 0:
        return "", ""
    return " ".join(first), " ".join(second)


def _are_alternatives(task: str, first: str, second: str) -> bool:
    """Whether the task lists both in one breath, with *or* before the last."""
    one, two = sorted((first, second), key=task.find)
    start = task.find(one)
    end = task.find(two, start + len(one))
    if start < 0 or end < 0:
        return False
    between, rest = task[start + len(one) : end], task[end + len(two) :]
    return _OR_BETWEEN.fullmatch(between) is not None or (
        _COMMA_BETWEEN.fullmatch(between) is not None and _OR_AFTER.match(rest) is not None
    )


def unstated_numbers(case: Case) -> Iterator[str]:
    """A fact states no number that the task does not state, in digits or in words."""
    stated = case.task.counts | Text(case.asked.website).numbers
    most = max((int(number) for number in stated if number.isdecimal() and int(number) <= 20), default=1)
    for fact in case.facts:
        unstated = fact.text.numbers - stated
        if not unstated:
            continue
        labels = {plain(label) for label in _LABEL.findall(fact.text.raw) if 0 < int(label) <= most}
        unstated -= labels | {
            number for number in unstated if fact.text.counts & stated & _scaled_forms(number)
        }
        if unstated:
            numbers = ", ".join(sorted(unstated))
            yield at(fact, f"states {numbers}, which the task does not state")


def _scaled_forms(number: str) -> frozenset[str]:
    if "." in number and number.count(".") > 1:
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
            if any(item <= fact.text.content for item in items):
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


def steps_of_instructions(case: Case) -> Iterator[str]:
    """A "how to" question asks for instructions: one fact, never one per step."""
    if not _HOW_TO.search(case.asked.instruction) or len(case.facts) < 2:
        return
    for group in case.draft.fact_groups:
        facts = [fact for fact in case.facts if fact.group == group.id]
        novel = [fact for fact in facts if _novelty(fact, case) >= 0.6]
        if len(novel) >= 2:
            yield f"group {group.id} has a fact for each step; that the instructions are found is one fact"


def _novelty(fact: Fact, case: Case) -> float:
    """The share of a fact's telling words that the task does not have."""
    content = fact.text.content - _REPORTING
    return len(content - case.task.stems) / len(content) if len(content) >= 2 else 0.0


_REPORTING: Final = frozenset(
    stem(word)
    for word in "instructions instruction directions steps step guide explained described answer".split()
)


def steps_of_computation(case: Case) -> Iterator[str]:
    """A computation is one fact, never its steps."""
    if len(case.facts) < 2 or not _COMPUTATION.search(case.asked.instruction):
        return
    by_hand = _WORKED_OUT.search(case.asked.instruction) is not None
    for fact in case.facts:
        text = fact.text.unquoted
        act = _ARITHMETIC.search(text)
        if act is None and not by_hand and not _RESULT.search(text):
            act = _WORKED_OUT.search(text)
        if act is not None and stem(act.group().casefold().split()[0]) not in case.task.stems:
            yield at(fact, f'is a step of a computation ("{act.group()}"); the result is one fact')


def operands(case: Case) -> Iterator[str]:
    """The numbers that a computation starts from are facts only where the task asks for them too."""
    asked = case.asked.instruction
    if len(case.facts) < 3 or not _COMPUTATION.search(asked) or _EACH.search(asked):
        return
    for group in case.draft.fact_groups:
        facts = [fact for fact in case.facts if fact.group == group.id]
        results = [fact for fact in facts if _RESULT.search(fact.text.raw)]
        others = [fact for fact in facts if fact not in results]
        alike = any(
            all(_where_they_differ(one.text.words, two.text.words)) for one, two in combinations(others, 2)
        )
        if len(results) == 1 and alike:
            yield at(results[0], "is a computation whose operands are facts beside it")


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
