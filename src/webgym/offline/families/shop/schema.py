"""How the branches of retail are described: sectors with categories, nouns, materials and figures."""

from __future__ import annotations

from webgym.offline.data import Row, Table, load


class Figure(Row, frozen=True):
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
    unit: str = ""

    def written(self, value: float) -> str:
        """The value with its unit."""
        return f"{value:.{self.decimals}f} {self.unit}".strip()


class Category(Row, frozen=True):
    """A category of products.

    Attributes:
        name: plural, as the menu has it.
        nouns: what its products are; the last word of a product's name.
        low, high: prices.
        figures: what is measured.
    """

    name: str
    nouns: tuple[str, ...]
    low: int
    high: int
    figures: tuple[Figure, ...]


class Sector(Table, frozen=True):
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
    facet: tuple[str, tuple[str, ...]]
    uses: tuple[str, ...]
    categories: tuple[Category, ...]
    options: tuple[tuple[str, tuple[str, ...]], ...] = ()
    naming: str = "series"


class Stock(Table, frozen=True):
    """``sectors.toml``."""

    sectors: tuple[Sector, ...]


SECTORS = load("webgym.offline.families.shop", "sectors.toml", Stock).sectors
