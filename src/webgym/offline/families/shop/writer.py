"""What all writers of a shop's tasks share: the shop, its guide, and the choice of products."""

from __future__ import annotations

import random
from collections.abc import Callable

from webgym.offline.families.shop import Shop
from webgym.offline.families.shop.catalogue import Product
from webgym.offline.families.shop.guide import Guide
from webgym.offline.families.shop.shelf import displayed


def _any(product: Product) -> bool:
    del product
    return True


class Writer:
    """Writes parts of one task. Every method that does gives ``None`` where there is no well-posed question.

    Args:
        shop: whose tasks these are.
        rng: decides which products and wordings.
    """

    def __init__(self, shop: Shop, rng: random.Random) -> None:
        self.shop = shop
        self.rng = rng
        self.guide = Guide(shop)
        self._taken: set[int] = set()
        self._displayed = {p.code for products in displayed(shop).values() for p in products}

    # --- choosing -------------------------------------------------------------------------------------

    def take(self, wanted: Callable[[Product], bool] = _any) -> Product | None:
        """A product that was not taken yet, rather one that the front page does not show."""
        found = [p for p in self.shop.products if p.code not in self._taken and wanted(p)]
        found = [p for p in found if p.code not in self._displayed] or found
        if not found:
            return None
        chosen = self.rng.choice(found)
        self._taken.add(chosen.code)
        return chosen

    def category(self, wanted: Callable[[list[Product]], object] = bool) -> str | None:
        """A category whose products are as wanted."""
        found = [c.name for c in self.shop.categories if wanted(self.guide.members(c.name))]
        return self.rng.choice(found) if found else None

    def label(self, text: str) -> str:
        """A figure's name inside a sentence."""
        return text if len(text) < 3 or text[1].isupper() else text[0].lower() + text[1:]
