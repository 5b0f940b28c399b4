"""Words of shops: model names, titles, what buttons say, what buyers write."""

from __future__ import annotations

from typing import TypeAlias

from webgym.offline.data import Table, load

Told: TypeAlias = tuple[str, tuple[str, ...]]
"""A text, and the words that an answer about it must contain."""


class Words(Table, frozen=True):
    """``words.toml``.

    Attributes:
        makers: who makes products that have no author.
        series: names of models.
        title_patterns: with ``{adjective}``, ``{adjective2}``, ``{noun}``, ``{town}`` and ``{given}``.
        descriptions: with ``{name}``, ``{Name}``, ``{maker}`` and ``{use}``.
        codes: of discounts.
        topics: of messages to the shop.
        returns: how to send something back.
        voice: what a shop calls things; every shop takes one of each.
    """

    makers: tuple[str, ...]
    series: tuple[str, ...]
    title_adjectives: tuple[str, ...]
    title_nouns: tuple[str, ...]
    title_patterns: tuple[str, ...]
    descriptions: tuple[str, ...]
    descriptions_more: tuple[str, ...]
    review_titles: tuple[str, ...]
    review_good: tuple[str, ...]
    review_fair: tuple[str, ...]
    review_bad: tuple[str, ...]
    codes: tuple[str, ...]
    topics: tuple[str, ...]
    returns: tuple[Told, ...]
    gift_cards: tuple[Told, ...]
    voice: dict[str, tuple[str, ...]]


WORDS = load("webgym.offline.families.shop", "words.toml", Words)
