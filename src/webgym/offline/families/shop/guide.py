"""How to find one's way in a shop: the moves that lead somewhere, and the views that prove something."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Evidence, Fill, Move
from webgym.offline.families.shop.catalogue import Product
from webgym.offline.families.shop.shelf import FacetName, Order, ordered
from webgym.offline.website import slug

if TYPE_CHECKING:
    from webgym.offline.families.shop import Shop

NUMBER_WORDS = "zero one two three four five six seven eight nine ten eleven twelve".split()
BEYOND_FRONT = r"/[^?]"
END = r"(?:\?|$)"


def said(shop: Shop, cents: int) -> tuple[str, ...]:
    """The ways to write an amount."""
    amount = cents / 100
    spellings = [
        shop.money(cents),
        f"{amount:,.2f}",
        f"{amount:.2f}",
        f"{amount:g}" if amount < 10**5 else "",
    ]
    return tuple(dict.fromkeys(text for text in spellings if text))


def counted(number: int) -> tuple[str, ...]:
    """The ways to write a count."""
    return (str(number), NUMBER_WORDS[number]) if number < len(NUMBER_WORDS) else (str(number),)


def dated(day: date) -> tuple[str, ...]:
    """The ways to write a date."""
    return (
        f"{day.day} {day:%b %Y}",
        f"{day.day} {day:%B %Y}",
        f"{day:%B} {day.day}, {day.year}",
        f"{day:%b} {day.day}, {day.year}",
        day.isoformat(),
    )


class Guide:
    """The shop as a visitor who knows it."""

    def __init__(self, shop: Shop) -> None:
        self.shop = shop

    # --- views ---------------------------------------------------------------------------------------

    def at(self, pattern: str, **values: object) -> str:
        """Regular expression of a page's address, with any query."""
        return re.escape(self.shop.path(pattern, **values)) + END

    def detail(self, product: Product) -> str:
        """Regular expression of a product's page."""
        return re.escape(self.shop.address(product)) + END

    def shelves(self, category: str | None, **needed: str) -> str:
        """Regular expression of listings that show a category, with query parameters that they need.

        Args:
            category: its name; ``None`` also takes the listing of everything and the search.
            needed: regular expression of the value, by the name of a facet, or ``order``.
        """
        shop = self.shop
        homes = [shop.path("/~category/everything"), shop.path("/~search")]
        homes = (
            [shop.shelf(category)] if category else [*homes, *(shop.shelf(c.name) for c in shop.categories)]
        )
        path = "(?:" + "|".join(re.escape(home) for home in homes) + ")" + r"(?=\?|$)"
        for name, value in needed.items():
            key = shop.paths["k_order"] if name == "order" else shop.facet(name).key
            path += rf"(?=.*[?&]{re.escape(key)}=(?:{value})(?:&|$))"
        return path

    def whole(self, category: str, texts: tuple[str, ...]) -> tuple[Evidence, ...]:
        """The listing of a category as proof of something about all of it, where one page holds it all."""
        size = len(self.members(category))
        if size <= self.shop.per_page or self.shop.look.pager == "more":
            return (Evidence(texts, self.shelves(category)),)
        return (Evidence(texts, self.shelves(category, price=r"[\d-]+")),)

    def priced(self, product: Product) -> tuple[Evidence, ...]:
        """Views that show a product's price: prices are unique, so any page but the first does."""
        return (Evidence((product.name, self.shop.money(product.cents)), BEYOND_FRONT),)

    def specified(self, product: Product, label: str) -> tuple[Evidence, ...]:
        """Views that show a line of the specifications."""
        value = dict(product.facts)[label]
        return (
            Evidence((label, value), self.detail(product)),
            Evidence((product.name, label, value), self.at("/~compare")),
        )

    # --- moves ---------------------------------------------------------------------------------------

    def members(self, category: str) -> list[Product]:
        """The products of a category, as the shelf has them."""
        return [product for product in self.shop.products if product.category == category]

    def search(self, product: Product) -> tuple[Move, ...]:
        """Search for a product by its name."""
        return (Fill(self.shop.say["hint"], product.name),)

    def open(self, product: Product, *, browse: bool = False) -> tuple[Move, ...]:
        """Go to a product's page, by its category where it is on the first page, else by searching."""
        here = Click(path=self.shop.address(product))
        if browse and self.members(product.category).index(product) < self.shop.per_page:
            return (Click(path=self.shop.shelf(product.category)), here)
        return (*self.search(product), here)

    def section(self, key: str) -> tuple[Move, ...]:
        """Open a section of a product's page: ``facts``, ``terms`` or ``opinions``."""
        return () if self.shop.look.detail == "plain" else (Click(name=self.shop.say[key]),)

    def help_section(self, title: str) -> tuple[Move, ...]:
        """Open a section of the help page."""
        opened = self.shop.look.detail == "plain" or title == "Delivery"
        return (Click(path=self.shop.path("/~help")), *(() if opened else (Click(name=title),)))

    def sort(self, order: Order) -> Move:
        """Sort the listing."""
        return Choose(self.shop.say["sorting"], self.shop.say[order])

    def filter(self, *wanted: tuple[FacetName, str]) -> tuple[Move, ...]:
        """Filter the listing by the texts of values."""
        moves: list[Move] = []
        for name, text in wanted:
            facet = self.shop.facet(name)
            if self.shop.style == "links":
                moves.append(Click(name=text, role="link"))
            elif facet.many or name in ("stock", "sale"):
                moves.append(Click(name=text, role="checkbox"))
            else:
                moves.append(Choose(facet.label, text))
        if self.shop.applies:
            moves.append(Click(name=self.shop.say["filter"], role="button"))
        return tuple(moves)

    def turn_to(self, place: int) -> tuple[Move, ...]:
        """Turn to the page of a listing on which the product at ``place`` (from 0) stands."""
        page = place // self.shop.per_page
        if not page:
            return ()
        match self.shop.look.pager:
            case "numbers":
                return (Click(name=f"Page {page + 1}"),)
            case "steps":
                return (Click(name="Next"),) * page
            case "more":
                return (Click(name="Load more"),) * page

    def shelf(self, category: str) -> Move:
        """Go to a category."""
        return Click(path=self.shop.shelf(category))

    def first(self, products: Sequence[Product], order: Order, count: int = 1) -> list[Product]:
        """The first products in an order."""
        return ordered(products, order)[:count]

    def filtered(self, category: str, name: FacetName, text: str, **needed: str) -> str:
        """Regular expression of a category's listing that is filtered by a facet's value."""
        return self.shelves(category, **{name: re.escape(slug(text))}, **needed)
