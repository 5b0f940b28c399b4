"""How the branches of retail are described: sectors with categories, nouns, materials and figures."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True)
class Figure:
    """A measured property: ``"Weight 600-1600 g"``.

    Attributes:
        name: as the specifications call it.
        low, high: range.
        decimals: behind the point.
        unit: behind the number; may be empty.
    """

    name: str
    low: float
    high: float
    decimals: int
    unit: str

    def written(self, value: float) -> str:
        """The value with its unit."""
        return f"{value:.{self.decimals}f} {self.unit}".strip()


@dataclass(frozen=True)
class Category:
    """A category of products.

    Attributes:
        name: plural, as the menu has it.
        nouns: what its products are, comma separated; the last word of a product's name.
        low, high: prices.
        measured: figures, separated by semicolons.
    """

    name: str
    nouns: str
    low: int
    high: int
    measured: str

    @cached_property
    def figures(self) -> tuple[Figure, ...]:
        """The figures, read from :attr:`measured`."""
        found = []
        for text in self.measured.split("; "):
            match = re.fullmatch(r"(.+?) ([\d.]+)-([\d.]+)(?: (.+))?", text)
            assert match is not None, text
            name, low, high, unit = match.groups()
            decimals = len(low.partition(".")[2])
            found.append(Figure(name, float(low), float(high), decimals, unit or ""))
        return tuple(found)


@dataclass(frozen=True)
class Sector:
    """A branch of retail.

    Attributes:
        key: for people who read code.
        domain, subdomain: of the Mind2Web-2 taxonomy.
        suffixes: second words of brands.
        taglines: under the brand.
        maker: what the maker of a product is called: ``"Brand"``, ``"Author"``.
        facet: the second thing to filter by, with its values.
        options: what a buyer chooses, with the values; may be empty.
        uses: whom or what the products are for.
        categories: five or more.
        naming: ``series``: a model name and a noun; ``title``: books, films and games have titles.
    """

    key: str
    domain: str
    subdomain: str
    suffixes: tuple[str, ...]
    taglines: tuple[str, ...]
    maker: str
    facet: tuple[str, str]
    options: tuple[tuple[str, str], ...]
    uses: str
    categories: tuple[Category, ...]
    naming: str = "series"


LIFESTYLE = "Lifestyle & Leisure"
