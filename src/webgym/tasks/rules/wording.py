"""Rules about the wording of a single fact."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from webgym.tasks.rules.granularity import BOUND
from webgym.tasks.rules.reading import QUOTED, stem
from webgym.tasks.rules.rule import Case, Draft, Fact, message

LONG_FACT_WORDS: Final = 40
"""Words from which a fact is reported as long."""

LONGEST_FACT_WORDS: Final = 90
"""Words from which a fact is refused."""

LONGEST_FACT_CHARS: Final = 1_000
"""Characters from which a fact or a description is refused before the other rules see it."""

_OR: Final = re.compile(r"(\b[Aa]nd ?/ ?)?(?<![\w-])or\b(?!-)(?=\s*(\S*))")
_ATTRIBUTES: Final = (
    r"(?:titles?|names?|prices?|costs?|ratings?|address(?:es)?|phones?|(?:tele)?phone numbers?|e-?mails?"
    r"|e-?mail addresses|websites?|links?|urls?|dates?|times?|durations?|lengths?|sizes?|colou?rs?|weights?"
    r"|heights?|widths?|authors?|directors?|artists?|publishers?|years?|genres?|locations?|venues?|summar(?:y|ies)"
    r"|descriptions?|abstracts?|salar(?:y|ies)|distances?|populations?|areas?|calories|reviews?|ranks?|ingredients"
    r"|hours|deadlines?|fees?|fares?|discounts?|materials?|versions?|licen[cs]es?|isbn|availability|warrant(?:y|ies)"
    r"|capacit(?:y|ies)|temperatures?|humidity|speeds?|steps)"
)
_BETWEEN: Final = r"(?:(?!by\b|from\b)[\w'’-]+ ){0,3}?"
_PAIR: Final = re.compile(
    rf"(?<!by )(?<!by the )\b({_ATTRIBUTES}),? (?:and|as well as|along with|plus) "
    rf"(?:{_BETWEEN})({_ATTRIBUTES})\b",
    re.I,
)
_FIXED_PAIRS: Final = frozenset(
    {("date", "time"), ("dates", "times"), ("day", "time"), ("time", "date"), ("time", "location")}
)
_TOGETHER: Final = re.compile(
    r"\b(?:differences?|differ|sums?|totals? of|ratios?|between|combined|compar\w+|match\w*|together"
    r"|whether|sorted|filter\w*|relation\w*|correspond\w*|same)\b",
    re.I,
)
_CLAUSES: Final = re.compile(
    r"\b(?:is|are|was|were|has|have|had|costs?|contains?|includes?|says?|shows?)\b[^,;:]*?,? and "
    r"(?:it |they |also )?"
    r"(?:is|are|was|were|has|have|costs?|contains?|includes?|says?|shows?|gives?|states?|offers?)\b",
    re.I,
)
_PLURAL: Final = re.compile(
    r"^(?!.*\b(?:dates? and times?|terms and conditions|pros and cons)\b)"
    r"(?:the |its |their |an? )?(?:[\w'’-]+ ){0,5}?[\w'’-]+ and "
    r"(?:the |its |their |an? )?[^,;:]{1,80}? (?:are|were|have been)(?: \w+ly| both)? "
    r"(?:found|reported|given|stated|provided|listed|identified|named|shown|returned)\b",
    re.I,
)
_CONDITIONS: Final = re.compile(
    r", (?:and )?(?:with|priced|rated|includes?|featur\w+|launched|released|offers?|eligible|sorted"
    r"|from|under|has)\b",
    re.I,
)
_SENTENCES: Final = re.compile(r"(?<![^\W\d_])[^\W\d_]{4,}[.!?]\s+[A-Z]|;\s+\w+\s+\w+")

_STEP_LABEL: Final = re.compile(r"^\s*(?:step\s*\d+|\d+\s*[.)](?!\d)|[-*•]\s)", re.I)
_ACTS: Final = re.compile(
    r"\b(click(?:s|ed|ing)?|navigat(?:e|es|ed|ing)|scroll(?:s|ed|ing)?|hover(?:s|ed|ing)?|tap(?:s|ped)? on"
    r"|press(?:es|ed)? (?:the )?(?:enter|button|key)|typ(?:e|es|ed|ing)\b[^.;]{0,60}\binto?\b"
    r"|enter(?:s|ed)?\b[^.;]{0,60}\b(?:in|into) the (?:search|field|box|form)|go(?:es)? to the"
    r"|visit(?:s|ed) the"
    r"|us(?:e|es|ed|ing) the (?:search|filter|menu|navigation|dropdown)|search (?:bar|box)"
    r"|home ?page is (?:open|reached|loaded))",
    re.I,
)
_ACTING: Final = frozenset(
    stem(word)
    for word in "click navigate scroll hover tap press type enter go goes visit use used using search home "
    "homepage".split()
)
"""Stems one of which every match of :data:`_ACTS` has; a fast test before the regular expression."""

_EXAMPLES: Final = re.compile(
    r"\bsuch as\b|\be\.\s?g\b\.?|\bfor (?:example|instance)\b|\bincluding but not limited\b", re.I
)
_HOLLOW: Final = re.compile(
    r"^(?:the |all (?:the )?|every )?(?:whole |entire |final |user'?s |required |requested |given |other )*"
    r"(?:tasks?|requests?|answers?|information|requirements?|conditions?|constraints?|details|results?|facts"
    r"|instructions?) (?:is|are|was|were|has been|have been) (?:\w+ly )?(?:complete[d]?|correct|accurate|met"
    r"|satisfied|done|fulfilled"
    r"|successful|finished|right|valid|followed)\W*$",
    re.I,
)
_AGENT: Final = re.compile(r"\bthe (?:web )?(?:agent|assistant|model|bot|ai)\b", re.I)
_MARKUP: Final = re.compile(r"```|\*\*|[{}]|</?\w+>|\n")


def lower_case_or(case: Case) -> Iterator[str]:
    """Alternatives are in one fact, joined by OR in capitals (SYSTEM.md 1.1)."""
    for fact in case.facts:
        if with_capital_or(fact.text.raw) != fact.text.raw:
            yield message(fact, 'has an "or" that is not in capitals; write OR')


def with_capital_or(fact: str) -> str:
    """The fact with OR between alternatives in capitals; "or" in a bound or a quotation is kept."""
    hidden = QUOTED.sub(lambda quoted: "_" * len(quoted.group()), fact)
    for match in reversed([*_OR.finditer(hidden)]):
        if match[1] or match[2].strip(".,;:)").lower() not in BOUND:
            fact = f"{fact[: match.start()]}OR{fact[match.end() :]}"
    return fact


def several_things(case: Case) -> Iterator[str]:
    """One fact is one verifiable piece of information: not a price and a rating."""
    for fact in _joining(case):
        for match in _PAIR.finditer(fact.text.unquoted):
            first, second = match.group(1).lower(), match.group(2).lower()
            if (first, second) not in _FIXED_PAIRS and stem(first) != stem(second):
                yield message(fact, f'holds two things, "{first}" and "{second}"; write one fact for each')
                break


def several_clauses(case: Case) -> Iterator[str]:
    """One fact makes one statement."""
    for fact in _joining(case):
        text = fact.text.unquoted
        if _CLAUSES.search(text) or _PLURAL.search(text):
            yield message(fact, "seems to make several statements")


def several_conditions(case: Case) -> Iterator[str]:
    """A fact is a single condition."""
    for fact in case.facts:
        if len(_CONDITIONS.findall(fact.text.unquoted)) >= 2:
            yield message(fact, "seems to list several conditions")


def several_sentences(case: Case) -> Iterator[str]:
    """A fact is a single sentence."""
    for fact in case.facts:
        if _SENTENCES.search(fact.text.unquoted):
            yield message(fact, "seems to be several sentences")


def _joining(case: Case) -> Iterator[Fact]:
    """The facts that join things by "and" or the like, except for comparing or combining them."""
    for fact in case.facts:
        text = fact.text.folded
        joins = " and " in text or " as well as " in text or " along with " in text or " plus " in text
        if joins and not _TOGETHER.search(fact.text.unquoted):
            yield fact


def steps(case: Case) -> Iterator[str]:
    """A fact is a result, not an intermediate step, unless the task asks for the step."""
    for fact in case.facts:
        if _STEP_LABEL.match(fact.text.raw):
            yield message(fact, "is numbered like a step")
            continue
        act = _ACTS.search(fact.text.unquoted) if not fact.text.stems.isdisjoint(_ACTING) else None
        if act is not None and not case.asks_for(act.group().split()[0]):
            yield message(fact, f'tells a step ("{act.group()}") instead of what must hold')


def examples(case: Case) -> Iterator[str]:
    """A fact gives no examples."""
    for fact in case.facts:
        match = _EXAMPLES.search(fact.text.unquoted)
        if match is not None:
            yield message(fact, f'gives examples ("{match.group()}"); leave them out')


def hollow(case: Case) -> Iterator[str]:
    """A fact states something that can be verified, not just that everything is correct."""
    for fact in case.facts:
        if _HOLLOW.match(fact.text.raw.strip()):
            yield message(fact, "names nothing that could be verified")


def agent(case: Case) -> Iterator[str]:
    """A fact is about the result, not about the agent."""
    for fact in case.facts:
        match = _AGENT.search(fact.text.unquoted)
        if match is not None and not case.says(match.group().casefold()):
            yield message(fact, f'speaks of "{match.group().lower()}" instead of what must hold')


def question(case: Case) -> Iterator[str]:
    """A fact is a statement."""
    for fact in case.facts:
        if fact.text.unquoted.rstrip().endswith("?"):
            yield message(fact, "is a question; state what must hold")


def markup(case: Case) -> Iterator[str]:
    """A fact is one line of plain text."""
    for fact in case.facts:
        if _MARKUP.search(fact.text.raw):
            yield message(fact, "holds markup or line breaks; write one line of plain text")


def without_bounds(draft: Draft) -> Iterator[str]:
    """Facts and descriptions are short enough for rules whose time grows with the square of their length."""
    for group in draft.fact_groups:
        texts = [("the description", group.description)]
        texts += [(f"fact {number}", fact) for number, fact in enumerate(group.facts, start=1)]
        for name, text in texts:
            if (length := len(text)) > LONGEST_FACT_CHARS:
                limit = f"{LONGEST_FACT_CHARS:,} is the limit"
                yield f"{name} of group {group.id} has {length:,} characters; {limit}"


def long_facts(case: Case) -> Iterator[str]:
    """A fact is short."""
    for fact in case.facts:
        if LONG_FACT_WORDS < len(fact.text.words) <= LONGEST_FACT_WORDS:
            yield message(fact, f"has {len(fact.text.words)} words")


def endless_facts(case: Case) -> Iterator[str]:
    """No fact is a paragraph."""
    for fact in case.facts:
        if len(fact.text.words) > LONGEST_FACT_WORDS:
            yield message(fact, f"has {len(fact.text.words)} words; {LONGEST_FACT_WORDS} is the limit")
