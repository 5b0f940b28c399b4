"""The tasks of a shop: which parts stand alone, and which are asked for together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

from webgym.offline.families.shop import Shop
from webgym.offline.families.shop.asks import Asks
from webgym.offline.families.shop.choices import Choices
from webgym.offline.families.shop.deeds import Deeds
from webgym.offline.families.shop.service import Service
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import stream

TRIES = 4
"""How often a part is tried with other products before the shop has no such question."""


class _All(Asks, Choices, Deeds, Service):
    """Every part that a shop's task may have."""


Make: TypeAlias = Callable[[_All], Part | None]

SINGLE: dict[str, Make] = {
    "price": lambda w: w.price(),
    "saving": lambda w: w.saving(),
    "figure": lambda w: w.figures(1),
    "figures": lambda w: w.figures(2),
    "data-sheet": lambda w: w.figures(3),
    "origin": lambda w: w.origin(),
    "critic": lambda w: w.review(),
    "latest-review": lambda w: w.latest_review(),
    "store-stock": lambda w: w.nearby(),
    "extreme": lambda w: w.extreme(),
    "best-rated": lambda w: w.best_rated(),
    "by-maker": lambda w: w.by_maker(),
    "count": lambda w: w.count(),
    "count-cheap": lambda w: w.count_cheap(),
    "sold-out": lambda w: w.sold_out(),
    "either": lambda w: w.either(),
    "difference": lambda w: w.difference(),
    "total": lambda w: w.total(),
    "gap": lambda w: w.gap(),
    "larger": lambda w: w.larger(),
    "cart": lambda w: w.put(),
    "cart-total": lambda w: w.put_and_total(),
    "code": lambda w: w.redeem(),
    "order": lambda w: w.order(),
    "wish": lambda w: w.wish(),
    "past-order": lambda w: w.past_order(2),
    "past-order-total": lambda w: w.past_order(3),
    "register": lambda w: w.register(),
    "newsletter": lambda w: w.subscribe(),
    "message": lambda w: w.message(),
    "term": lambda w: w.term(),
    "delivery": lambda w: w.delivery(),
    "how-to": lambda w: w.how_to(),
    "sunday": lambda w: w.sunday(),
    "early-or-late": lambda w: w.early_or_late(),
    "store": lambda w: w.store(),
}
SINGLES = 21
"""Tasks of one part on every shop, out of :data:`SINGLE`."""

# Parts that use the same thing on the server (cart, account, comparison) are never asked for together.
LARGE: tuple[Make, ...] = (
    lambda w: w.by_maker(),
    lambda w: w.figures(3),
    lambda w: w.difference(),
    lambda w: w.gap(),
    lambda w: w.store(),
    lambda w: w.delivery(),
    lambda w: w.message(),
)
SMALL_DEEDS: tuple[Make, ...] = (
    lambda w: w.wish(),
    lambda w: w.subscribe(),
    lambda w: w.past_order(2),
    lambda w: w.register(),
)
SMALL: tuple[Make, ...] = (
    lambda w: w.extreme(),
    lambda w: w.figures(2),
    lambda w: w.review(),
    lambda w: w.origin(),
    lambda w: w.count(),
    lambda w: w.sold_out(),
    lambda w: w.either(),
    lambda w: w.best_rated(),
    lambda w: w.nearby(),
    lambda w: w.saving(),
    lambda w: w.total(),
    lambda w: w.how_to(),
    lambda w: w.larger(),
)
SMALL_PAIRS: tuple[Make, ...] = SMALL[:4]
CART: tuple[Make, ...] = (lambda w: w.put_and_total(), lambda w: w.redeem())
ORDER: tuple[Make, ...] = (lambda w: w.order(),)

TOGETHER: dict[str, tuple[tuple[Make, ...], ...]] = {
    "look-and-ask": (LARGE, SMALL),
    "two-errands": (LARGE, SMALL),
    "look-and-do": (LARGE, SMALL_DEEDS),
    "two-lists": (LARGE, LARGE),
    "shopping": (ORDER, LARGE),
    "cart-and-look": (CART, SMALL),
    "long-list": (LARGE, SMALL_PAIRS, SMALL_DEEDS),
    "long-look": (LARGE, LARGE, SMALL),
}


def assignments(shop: Shop) -> Iterator[Assignment]:
    """The tasks of a shop, before decomposition."""
    chosen = stream(shop.seed, "singles").sample(sorted(SINGLE), len(SINGLE))
    made = 0
    for name in chosen:
        part = _first(SINGLE[name], _All(shop, stream(shop.seed, "task", name)))
        if part is not None and made < SINGLES:
            made += 1
            yield Assignment(name, (part,))
    for name, kinds in TOGETHER.items():
        rng = stream(shop.seed, "together", name)
        writer = _All(shop, rng)
        parts: list[Part] = []
        for kind in kinds:
            for make in rng.sample(kind, len(kind)):
                part = _first(make, writer)
                if part is not None and all(part.description != other.description for other in parts):
                    parts.append(part)
                    break
        if len(parts) == len(kinds):
            yield Assignment(name, tuple(parts))


def _first(make: Make, writer: _All) -> Part | None:
    return next((part for part in (make(writer) for _ in range(TRIES)) if part is not None), None)
