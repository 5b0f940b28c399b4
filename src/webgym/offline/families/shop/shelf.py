"""Shelves: which products a listing shows, in which order, and by what they can be filtered."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, TypeAlias

from webgym.offline.families.shop.catalogue import Product
from webgym.offline.seeds import pick
from webgym.offline.website import Visit, slug

if TYPE_CHECKING:
    from webgym.offline.families.shop import Shop

FacetName: TypeAlias = Literal["maker", "facet", "price", "rating", "stock", "sale"]
Order: TypeAlias = Literal["featured", "cheap", "dear", "best", "most", "alphabet"]

ORDERS: Mapping[Order, Callable[[Product], object] | None] = {
    "featured": None,
    "cheap": lambda product: product.cents,
    "dear": lambda product: -product.cents,
    "best": lambda product: (-(product.rating or 0), product.code),
    "most": lambda product: (-product.ratings, product.code),
    "alphabet": lambda product: product.name,
}


@dataclass(frozen=True)
class Facet:
    """Something to filter by.

    Attributes:
        name: what it is, on every shop.
        key: its query parameter, on this shop.
        label: above its values.
        values: (value in the address, text); one value alone for a yes-or-no facet.
        many: whether several values may be chosen at once (any of them matches).
    """

    name: FacetName
    key: str
    label: str
    values: tuple[tuple[str, str], ...]
    many: bool

    def chosen(self, visit: Visit) -> list[str]:
        """The values that a visit asks for; unknown ones do not count."""
        known = {value for value, _ in self.values}
        asked = [value for value in visit.lists.get(self.key, []) if value in known]
        return asked if self.many else asked[-1:]

    def takes(self, product: Product, value: str) -> bool:
        """Whether a product belongs to a value."""
        match self.name:
            case "maker":
                return slug(product.maker) == value
            case "facet":
                return slug(product.facet) == value
            case "price":
                low, _, high = value.partition("-")
                return int(low) * 100 <= product.cents < (int(high) * 100 if high else 10**9)
            case "rating":
                return (product.rating or 0) >= int(value)
            case "stock":
                return product.stock > 0
            case "sale":
                return product.was is not None


def price_steps(products: Sequence[Product]) -> list[int]:
    """Three round prices that cut the range into four parts."""
    prices = sorted(product.cents for product in products)
    steps: list[int] = []
    for share in (0.2, 0.5, 0.8):
        whole = prices[int(len(prices) * share)] // 100
        unit = 5 if whole < 60 else 10 if whole < 200 else 50
        steps.append(max(unit, round(whole / unit) * unit))
    return sorted(set(steps))


def price_values(products: Sequence[Product], money: Callable[[int], str]) -> tuple[tuple[str, str], ...]:
    """Values of the price facet: under the first step, between steps, from the last step on."""
    steps = price_steps(products)
    values = [(f"0-{steps[0]}", f"Under {money(steps[0] * 100)}")]
    values += [
        (f"{low}-{high}", f"{money(low * 100)} to {money(high * 100)}") for low, high in pairwise(steps)
    ]
    return (*values, (f"{steps[-1]}-", f"{money(steps[-1] * 100)} and more"))


def make_facets(shop: Shop) -> tuple[Facet, ...]:
    """Everything that a shop's listings can be filtered by, in the shop's words."""

    def values(texts: Iterable[str]) -> tuple[tuple[str, str], ...]:
        return tuple((slug(text), text) for text in sorted(set(texts), key=str.casefold))

    key, say, many, products = shop.paths, shop.say, shop.style == "checks", shop.products
    makers, kinds = values(p.maker for p in products), values(p.facet for p in products)
    stars = (("4", "4 stars and up"), ("3", "3 stars and up"))
    return (
        Facet("maker", key["k_maker"], shop.sector.maker, makers, many),
        Facet("facet", key["k_facet"], shop.sector.facet[0], kinds, many),
        Facet("price", key["k_price"], say["price"], price_values(products, shop.whole), False),
        Facet("rating", key["k_rating"], say["rating"], stars, False),
        Facet("stock", key["k_stock"], "Availability", (("1", say["stock"]),), False),
        Facet("sale", key["k_sale"], "Bargains", (("1", say["sale"]),), False),
    )


def displayed(shop: Shop) -> dict[str, list[Product]]:
    """What the front page shows: ``popular`` products and ``reduced`` ones."""
    popular = sorted(shop.products, key=lambda p: (-p.ratings, p.code))
    reduced = [product for product in shop.products if product.was]
    return {
        "popular": popular[: pick((4, 5, 8), shop.seed, "popular")],
        "reduced": reduced[: pick((3, 4, 5), shop.seed, "reduced")],
    }


def select(products: Sequence[Product], facets: Sequence[Facet], visit: Visit) -> list[Product]:
    """The products that match every facet the visit filters by."""
    found = list(products)
    for facet in facets:
        values = facet.chosen(visit)
        if values:
            found = [product for product in found if any(facet.takes(product, value) for value in values)]
    return found


def matches(product: Product, text: str) -> bool:
    """Whether every word of ``text`` stands in what a product says about itself."""
    about = " ".join((product.name, product.maker, product.category, product.facet)).casefold()
    return all(word in about for word in text.casefold().split())


def ordered(products: Sequence[Product], order: str) -> list[Product]:
    """The products in one of :data:`ORDERS`; as they are if it is unknown."""
    key = next((key for name, key in ORDERS.items() if name == order), None)
    return sorted(products, key=key) if key is not None else list(products)  # type: ignore[arg-type]
