"""Features of a text that rules use: words, numbers, names, quotations, found without a model or
dictionary."""

from __future__ import annotations

import re
from functools import cached_property, lru_cache
from typing import Final

from webgym.core.text import fold
from webgym.tasks.rules.numbers import MONTHS, in_digits, quantities, stated

STOP_WORDS: Final = frozenset(
    """
    a about all also an and any are as at be been being both but by can could did do does each either
    every find found for from give given had has have he her him his how i if in including into is it its
    least list listed made make many may me more most must my name named need no not of off on one only
    or other our out over per please provide provided report reported said same say says see she should
    show shown so some state stated such than that the their them then there these they this those to
    under up us was we were what when where whether which while who whom whose why will with within would
    you your identified identify return returned tell told look search locate determine check
    """.split()
)
"""Words without content: function words, and the reporting verbs of tasks and facts."""

WEEKDAYS: Final = "monday tuesday wednesday thursday friday saturday sunday".split()
_NO_NAMES: Final = (
    frozenset(
        "or and not i am pm usd eur gbp url urls id ids ok yes no faq tv pdf gb tb mb ghz km kg hd".split()
    )
    | set(MONTHS + WEEKDAYS)
    | {word[:3] for word in MONTHS + WEEKDAYS}
)

_TITLE_CASE: Final = 0.6
"""Share of capitalised words above which a text counts as a title, in which capitals do not mark names."""

_ENDLESS_NUMBER: Final = re.compile(r"(\d{40})\d+")
"""A number whose digits after the first are left out: the time of some patterns grows with their square."""
_WORD: Final = re.compile(r"[^\W_]+(?:'[^\W_]+)?")
QUOTED: Final = re.compile(
    r"“([^”]*)”|\"([^\"]*)\"|«([^»]*)»|(?<![\w’'])[‘']([^’']{2,}(?:[’']s [^’']*)?)[’'](?!\w)"
)


class Text:
    """A text and its features, computed on demand."""

    def __init__(self, raw: str) -> None:
        self.raw = _ENDLESS_NUMBER.sub(r"\1", raw)

    @cached_property
    def folded(self) -> str:
        """The text with case, quotation marks and white space normalised."""
        return fold(self.raw)

    @cached_property
    def words(self) -> tuple[str, ...]:
        """Its words, in order, in lower case."""
        return tuple(_WORD.findall(self.folded))

    @cached_property
    def stems(self) -> frozenset[str]:
        """The stems of its words (:func:`stem`)."""
        return frozenset(stem(word) for word in self.words)

    @cached_property
    def content(self) -> frozenset[str]:
        """The stems of its words that are not in :data:`STOP_WORDS`."""
        return frozenset(stem(word) for word in self.words if word not in STOP_WORDS)

    @cached_property
    def numbers(self) -> frozenset[str]:
        """The numbers in digits, in normal form (:func:`webgym.tasks.rules.numbers.plain`)."""
        return in_digits(self.raw)

    @cached_property
    def counts(self) -> frozenset[str]:
        """The numbers in digits or in words, in every form that may be used for them."""
        return stated(self.raw, self.folded)

    @cached_property
    def quantities(self) -> frozenset[tuple[int, int]]:
        """The quantities with units that can be converted (:func:`webgym.tasks.rules.numbers.quantities`)."""
        return quantities(self.folded)

    @cached_property
    def quotations(self) -> tuple[str, ...]:
        """The texts in quotation marks."""
        found = ("".join(groups) for groups in QUOTED.findall(self.raw))
        return tuple(quoted.strip() for quoted in found if quoted.strip())

    @cached_property
    def unquoted(self) -> str:
        """The text with every quotation replaced by the word "quoted"."""
        return QUOTED.sub("quoted", self.raw)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Capitalised words that do not begin a sentence; empty for titles, with most words capitalised."""
        text = self.unquoted
        words = _WORD.findall(text)
        if len(words) > 3 and sum(word[0].isupper() for word in words) > _TITLE_CASE * len(words):
            return ()
        return tuple(
            match.group()
            for match in _WORD.finditer(text)
            if match.group().lower() != match.group()
            and match.group().lower() not in _NO_NAMES
            and not _begins(text, match.start())
        )


def _begins(text: str, place: int) -> bool:
    before = text[:place].rstrip(" \"“'‘([")
    return not before or before[-1] in ".!?:;*-\n"


@lru_cache(maxsize=50_000)
def stem(word: str) -> str:
    """A word without the endings of plurals and verbs: crude, but the same for all forms of most words."""
    word = word.removesuffix("'s").replace("'", "")
    if len(word) > 4 and word.endswith("ies"):
        return word[:-3] + "i"
    for ending in ("ings", "ing", "ed", "es", "ly", "s", "e", "y"):
        if word.endswith(ending) and len(word) - len(ending) >= 3 and not word.endswith("ss"):
            base = word[: -len(ending)]
            base = base[:-1] if base[-1] == base[-2] and base[-1] not in "sle" else base
            return base + "i" if ending == "y" else base
    return word
