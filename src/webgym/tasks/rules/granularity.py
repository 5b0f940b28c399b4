"""Rules about how a rubric divides its task into facts.

Alternatives, instructions and computations are one fact each; intermediate steps are not facts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations, islice
from typing import Final

from webgym.tasks.rules.reading import STOP_WORDS, stem
from webgym.tasks.rules.rule import Case, Fact, message

# --- alternatives -----------------------------------------------------------------------------------------

BOUND: Final = frozenset(
    """
    more less higher lower above below over under fewer greater better worse later earlier older newer longer
    shorter larger bigger smaller cheaper faster equal so not at up after before beyond within further wider
    thinner lighter heavier closer nearer no exactly
    """.split()
)
"""Words after *or* that only extend a bound ("4 or more", "at or below") and are no alternatives."""

_SENTENCE: Final = re.compile(r"[^.!?;\n]+[.!?;]?")
_NEEDS_BOTH: Final = re.compile(
    r"\b(?:compar\w*|differ\w*|versus|vs|between|better|cheaper|both|each|whether|altogether"
    r"|how (?:many|much)|in (?:total|all)|(?:more|less|fewer|\w{2,}er) than)\b"
    r"|(?:^|[,:(]|\b(?:and|out|me|determine|say|see|check|decide|know|identify|tell|report|state|find|of)) ?"
    r"(?:which|who|what)\b"
    r"|^ ?(?:is|are|do|does|did|was|were|has|have|can|could|will|would|should)\b",
    re.IGNORECASE,
)
"""Phrases of a sentence in which both sides of an *or* must be considered: "which is cheaper, A or B"."""


def split_alternatives(case: Case) -> Iterator[str]:
    """Alternatives are one fact with OR. One fact for each would require all of them."""
    if " or " not in case.task.folded:
        return
    for words in islice(_alternatives(case), _MOST_ALTERNATIVES):
        naming = [(fact, words & fact.text.stems) for fact in case.facts]
        if any(len(named) > 1 for _, named in naming):
            continue
        separate = [(fact, named) for fact, named in naming if named]
        first = separate[0] if separate else None
        other = next((fact for fact, named in separate if first and named != first[1]), None)
        if first and other:
            yield message(
                other,
                f"and fact {first[0].number} of group {first[0].group} are alternatives; write one with OR",
            )


def _alternatives(case: Case) -> Iterator[frozenset[str]]:
    """For every *or* between alternatives in the task, one distinctive word of each alternative."""
    for sentence in _SENTENCE.findall(case.task.unquoted):
        if _NEEDS_BOTH.search(sentence):
            continue
        for match in re.finditer(r",? or (?:either )?", sentence):
            end, start = match.end(), match.start()
            after = _content_stems(sentence[end : end + _LONGEST_LIST])[:_LONGEST_ITEM]
            before = sentence[max(0, start - _LONGEST_LIST) : start]
            items = [_content_stems(item)[-_LONGEST_ITEM:] for item in _items_before(before)]
            if after and items[0] and after[0] not in _BOUND_STEMS:
                yield frozenset(
                    (
                        *(word for item in items for word in _other_than(after, item)[-1:]),
                        *_other_than(items[0], after)[:1],
                    )
                )


def _other_than(others: list[str], words: list[str]) -> list[str]:
    return [word for word in words if word not in others]


_BOUND_STEMS: Final = frozenset(map(stem, BOUND))
_MOST_ALTERNATIVES: Final = 100
"""Most *or* of a task that are looked at."""
_LONGEST_LIST: Final = 1_000
"""Characters before and after an *or* that are looked at."""
_LONGEST_ITEM: Final = 4
"""Most words of an item of a list before *or*; anything longer is the rest of the sentence."""


_ENDS_IN_NAME: Final = re.compile(r" [A-Z][\w'’-]*$")
"""A clause that ends in a name, the first item of a list of names: "a laptop by Dell, HP or Lenovo"."""


def _items_before(text: str) -> Iterator[str]:
    """The last item of the list that a text ends in, then the items before it."""
    *others, last = text.split(",")
    yield last
    for item in reversed(others):
        is_long = len(item.split()) > _LONGEST_ITEM
        if is_long and not _ENDS_IN_NAME.search(item):
            break
        yield item
        if is_long:
            break


def _content_stems(text: str) -> list[str]:
    """The stems of the content words, in order."""
    words = re.findall(r"[^\W_]+(?:'[^\W_]+)?", text.casefold())
    return [stem(word) for word in words if word not in STOP_WORDS or word in BOUND]


# --- instructions and purchases ---------------------------------------------------------------------------

_HOW_TO: Final = re.compile(
    r"\bhow (?:do|does|can|could|should|would|to|might)\b|\b(?:instructions?|directions?|a guide|a tutorial"
    r"|steps?) (?:on|for|to|about|of)\b|\bexplain how\b|\bprocess (?:of|for|to)\b",
    re.I,
)
_ACTION: Final = re.compile(
    r"^(?:then |next |first |finally |the (?:user|agent) )?(?:clicks?|opens?|goes|go|visits?|navigates?"
    r"|enters?|types?|fills?|selects?|chooses?|picks?|press(?:es)?|holds?|proceeds?|continues?|submits?|signs?|logs?|pays?"
    r"|waits?|unplugs?|plugs?|removes?|turns?|adds?|drops?|prints?|downloads?|uploads?|confirms?|taps?|scrolls?)"
    r"\b(?! of\b)"
    r"|\b(?:is|are|was|were|has been|have been) (?:clicked|opened|entered|typed|filled(?: (?:in|out))?"
    r"|selected|chosen|pressed|submitted|confirmed|tapped)\b",
    re.I,
)
"""The beginning or end of a fact that describes an action."""

_PURCHASE: Final = re.compile(
    r"\b(?:buy|buying|purchas\w*|(?<!in )(?<!by )order(?:ing)? (?!by\b|of\b)"
    r"|book(?:ing)? (?:an?|the|\d+|me)\b|reserv\w*|check ?out|cart|basket|rent(?:ing)?"
    r"|subscrib\w*|sign(?:ing)? up|register\w*)\b",
    re.I,
)
_STAGES: Final[tuple[frozenset[str], ...]] = tuple(
    frozenset(stem(word) for word in words.split())
    for words in (
        "cart basket",
        "checkout",
        "payment pay paid card credit billing",
        "shipping delivery address contact personal passenger traveller traveler",
        "account login log signed logged register registered registration",
        "confirm confirmed confirmation submit submitted placed finalised finalized",
        "click clicked button page opened selected quantity chosen entered filled",
    )
)
"""Stages of a purchase, by the words for them."""


def steps_of_instructions(case: Case) -> Iterator[str]:
    """A "how to" question asks for instructions, which are one fact, not one per step."""
    if not _HOW_TO.search(case.context.instruction) or len(case.facts) < 2:
        return
    for group in case.draft.fact_groups:
        facts = [fact for fact in case.facts if fact.group == group.id]
        steps = [fact for fact in facts if _novelty(fact, case) >= 0.6 or _is_action(fact, case)]
        if len(steps) >= 2:
            yield f"group {group.id} has a fact for each step; that the instructions are found is one fact"


def _is_action(fact: Fact, case: Case) -> bool:
    """Whether a fact describes an action that the task does not ask for."""
    action = _ACTION.search(fact.text.raw.strip())
    return action is not None and not case.asks_for(action.group().split()[-1])


def _novelty(fact: Fact, case: Case) -> float:
    """The share of a fact's content words that the task does not contain."""
    content = fact.text.content - _REPORTING
    return len(content - case.task.stems) / len(content) if len(content) >= 2 else 0.0


_REPORTING: Final = frozenset(
    stem(word)
    for word in "instructions instruction directions steps step guide explained described answer".split()
)


def steps_of_purchase(case: Case) -> Iterator[str]:
    """The facts of a purchase are what is bought, and that it is bought: not cart, checkout and payment."""
    if len(case.facts) < 2 or not _PURCHASE.search(case.context.instruction):
        return
    known = case.task.stems
    intermediate: list[tuple[Fact, int]] = []
    for fact in case.facts:
        stages = (
            number for number, words in enumerate(_STAGES) if words & fact.text.stems and not words & known
        )
        stage = next(stages, None)
        if stage is not None:
            intermediate.append((fact, stage))
    if len({stage for _, stage in intermediate}) >= 2:
        yield message(
            intermediate[0][0], "is a step on the way, as others are; write what is bought, and that it is"
        )


# --- computations -----------------------------------------------------------------------------------------

_INTERVAL: Final = (
    r"how old|how long ago|how many (?:years|months|days|hours) (?:ago|before|after|between|passed|apart"
    r"|earlier|later|until|since)"
)
_COMPUTATION: Final = re.compile(
    r"\b(?:differen(?:ce|t)|sums?|totals?|averages?|mean|ratio|percent(?:age)?|convert\w*|comput\w+"
    r"|calculat\w+|combined|how (?:much|many) (?:more|less|fewer|longer|older|higher)|how many times"
    rf"|altogether|add(?:ed)? up|{_INTERVAL})\b",
    re.I,
)
_ONE_RESULT: Final = re.compile(
    r"\b(?:calculat(?:e|es|ed|ing)|compute[sd]?|(?-i:computing)|convert(?:ed|ing)?|work out|add(?:ed|ing)? up"
    r"|altogether|in total|combined|how many times|difference (?:in|of|between)|by how (?:much|many)"
    rf"|{_INTERVAL}|(?:sum|ratio|percentage) of|(?:total|average|mean) of (?:the|all|both|these|those)"
    r"|how (?:much|many)(?: \w+)? (?:more|less|fewer|\w{2,}er)(?= \w))\b",
    re.I,
)
"""Phrases of a task that asks for the result of a computation."""
_ARITHMETIC: Final = re.compile(
    r"\b(?:subtract\w*|divid(?:e|es|ed|ing)|multipl(?:y|ies|ied|ying)|add(?:s|ed|ing)? (?:up|together)"
    r"|summ(?:ed|ing))\b",
    re.I,
)
_WORKED_OUT: Final = re.compile(r"\b(?:comput|calculat|work(?:s|ed|ing)? out)", re.I)
_RESULT: Final = re.compile(
    r"\b(?:difference|sum|total|average|mean|ratio|percentage|share|result|how (?:much|many)|combined"
    r"|calculated|computed|converted)\b",
    re.I,
)
_OPERANDS_TOO: Final = re.compile(
    r"\b(?:each|every|respective\w*|individual\w*|as well as|along with|also"
    r"|and (?:(?:the|their|its) (?:\w+ )?(?:differ\w*|sum|total|average|mean|ratio|percentage|share|result)"
    r"|how|then|calculate|compute|report|give|tell|by))\b",
    re.I,
)
"""Phrases of a task that asks for the operands as well as the result."""
_LOOKED_UP: Final = re.compile(
    r"\b(?:is|are|was|were) (?:\w+ly )?(?:found|identified|given|reported|retrieved|obtained|determined"
    r"|looked up|noted|known|collected|located|stated|recorded|extracted)\b"
    r"|^(?:find|identify|get|retrieve|obtain|determine|look up|note|collect|locate|record|extract)s?\b"
    r"|^(?:the|its|their) (?!.*\b(?:is|are|was|were|has|have|must|can|costs?|comes?|goes|lies)\b)",
    re.I,
)
"""A fact that a value is found, possibly without a verb ("the price of the tent")."""


def steps_of_computation(case: Case) -> Iterator[str]:
    """A computation is one fact; its steps are not."""
    if len(case.facts) < 2 or not _COMPUTATION.search(case.task.unquoted):
        return
    asks_to_compute = _WORKED_OUT.search(case.task.unquoted) is not None
    for fact in case.facts:
        text = fact.text.unquoted
        act = _ARITHMETIC.search(text)
        if act is None and not asks_to_compute and not _RESULT.search(text):
            act = _WORKED_OUT.search(text)
        if act is not None and not case.asks_for(act.group().split()[0]):
            yield message(fact, f'is a step of a computation ("{act.group()}"); the result is one fact')


def operands(case: Case) -> Iterator[str]:
    """The operands of a computation are facts only if the task asks for them, too."""
    instruction = case.task.unquoted
    if len(case.facts) < 2 or not _ONE_RESULT.search(instruction) or _OPERANDS_TOO.search(instruction):
        return
    for group in case.draft.fact_groups:
        facts = [fact for fact in case.facts if fact.group == group.id]
        results = [fact for fact in facts if _RESULT.search(fact.text.raw)]
        values = [fact for fact in facts if fact not in results and _LOOKED_UP.search(fact.text.unquoted)]
        is_template = any(
            all(_differing_parts(one.text.words, two.text.words)) for one, two in combinations(values, 2)
        )
        unrequested = [fact for fact in values if not fact.text.content <= case.task.stems]
        if is_template or (results and unrequested):
            yield message(
                (unrequested or values)[0], "is where a computation starts; its result alone is asked for"
            )


def _differing_parts(one: tuple[str, ...], other: tuple[str, ...]) -> tuple[str, str]:
    """The differing middle parts of two facts; empty if more than a few words differ."""
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
