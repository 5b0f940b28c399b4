"""What a shop has: products, reviews, stores, terms and an account, all from its seed."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from datetime import date, timedelta
from itertools import pairwise

from webgym.offline import names
from webgym.offline.families.shop.schema import SECTORS, Category, Sector
from webgym.offline.families.shop.words import WORDS
from webgym.offline.seeds import number, stream
from webgym.offline.website import TODAY, slug


@dataclass(frozen=True)
class Review:
    """What a buyer wrote; ``stars`` from 1 to 5."""

    author: str
    day: date
    stars: int
    title: str
    text: str


@dataclass(frozen=True)
class Product:
    """One product.

    Attributes:
        code: article number, unique in the shop.
        name: unique; it never stands inside another product's name.
        category: its name.
        maker, facet: what it can be filtered by.
        cents: the price; unique in the shop.
        was: the price before it was reduced.
        rating: average with one decimal, or ``None`` if nobody has rated it.
        ratings: how many did.
        stock: pieces; 0 if it is sold out.
        figures: measured value by figure name.
        facts: the specifications as they are shown, figures among them.
        options: what a buyer chooses, with the values.
    """

    code: int
    name: str
    quoted: bool
    category: str
    maker: str
    facet: str
    cents: int
    was: int | None
    rating: float | None
    ratings: int
    stock: int
    figures: dict[str, float]
    facts: tuple[tuple[str, str], ...]
    options: tuple[tuple[str, tuple[str, ...]], ...]
    description: tuple[str, ...]
    reviews: tuple[Review, ...]

    @property
    def slug(self) -> str:
        """The name as a part of an address."""
        return slug(self.name)

    @property
    def called(self) -> str:
        """The product in a sentence."""
        return f"“{self.name}”" if self.quoted else f"the {self.name}"


@dataclass(frozen=True)
class Store:
    """A shop with a door. Hours in minutes of the day."""

    town: str
    street: str
    opens: int
    closes: int
    saturday_closes: int
    sunday: bool
    phone: str


@dataclass(frozen=True)
class PastOrder:
    """An order of the account that tasks lend."""

    number: str
    day: date
    status: str
    lines: tuple[tuple[str, int], ...]
    total: int


@dataclass(frozen=True)
class Account:
    """The account that tasks lend."""

    person: str
    email: str
    password: str
    orders: tuple[PastOrder, ...]


@dataclass(frozen=True)
class Terms:
    """Delivery, returns and service. Money in cents.

    Attributes:
        methods: delivery methods: name, price, days.
        free_from: order value from which the first method costs nothing.
        code, percent: the discount code on the front page.
    """

    methods: tuple[tuple[str, int, str], ...]
    free_from: int
    return_days: int
    wrapping: int
    guarantee: int
    returns: tuple[str, tuple[str, ...]]
    gift_cards: tuple[str, tuple[str, ...]]
    phone: str
    hours: str
    code: str
    percent: int


def sector_of(seed: int) -> Sector:
    """What the shop with this seed sells."""
    return SECTORS[number(seed, "sector") % len(SECTORS)]


def choose_categories(seed: int, sector: Sector) -> tuple[Category, ...]:
    """Four categories or more, in the shop's own order."""
    rng = stream(seed, "categories")
    return tuple(rng.sample(sector.categories, rng.randint(max(4, len(sector.categories) - 2), 6)))


def make_products(seed: int, sector: Sector, categories: tuple[Category, ...]) -> list[Product]:
    """The range of a shop. Prices, article numbers and names are unique."""
    rng = stream(seed, "products")
    per_category = rng.choice((6, 9, 12, 16))
    counts = [rng.randint(max(5, per_category - 3), per_category + 3) for _ in categories]
    maker_pool = names.people(rng, 9) if sector.maker in ("Author", "Director", "Designer") else WORDS.makers
    makers = rng.sample(list(maker_pool), rng.randint(5, 8))
    fresh_names = _titles(rng) if sector.naming == "title" else rng.sample(WORDS.series, len(WORDS.series))
    codes = rng.sample(range(1000, 9999), sum(counts))
    prices: set[int] = set()
    found: list[Product] = []
    for category, count in zip(categories, counts, strict=True):
        figures = {figure.name: _spread(rng, figure.low, figure.high, figure.decimals, count)
                   for figure in category.figures}  # fmt: skip
        sold_out = set(rng.sample(range(count), rng.choice((1, 1, 2))))
        unrated = rng.randrange(count) if rng.random() < 0.5 else None
        for place in range(count):
            noun = rng.choice(category.nouns)
            stem = fresh_names[len(found)]
            name = stem if sector.naming == "title" else f"{stem} {noun}"
            measured = {figure: values[place] for figure, values in figures.items()}
            found.append(
                _product(
                    stream(seed, "product", len(found)),
                    sector,
                    category,
                    name=name,
                    code=codes[len(found)],
                    maker=rng.choice(makers),
                    cents=_price(rng, category, prices),
                    stock=0 if place in sold_out else rng.randint(2, 60),
                    rated=place != unrated,
                    measured=measured,
                )
            )
    return found


def _product(
    rng: random.Random,
    sector: Sector,
    category: Category,
    *,
    name: str,
    code: int,
    maker: str,
    cents: int,
    stock: int,
    rated: bool,
    measured: dict[str, float],
) -> Product:
    facet = rng.choice(sector.facet[1])
    was = None
    if rng.random() < 0.22:
        was = cents + max(100, round(cents * rng.choice((0.1, 0.15, 0.2, 0.25, 0.3)) / 50) * 50)
    shown = {figure.name: figure.written(measured[figure.name]) for figure in category.figures}
    facts = [("Article number", str(code)), (sector.maker, maker), (sector.facet[0], facet), *shown.items()]
    facts += [
        ("Made in", rng.choice(("Portugal", "Denmark", "Poland", "Slovenia", "Canada", "Japan", "Wales")))
    ]
    kept = []
    for label, values in sector.options:
        chosen = set(rng.sample(values, rng.randint(min(3, len(values)), len(values))))
        kept.append((label, tuple(value for value in values if value in chosen)))
    use = rng.choice(sector.uses)
    called = f"“{name}”" if sector.naming == "title" else f"the {name}"
    first = rng.choice(WORDS.descriptions).format(
        Name=called[0].upper() + called[1:], name=called, maker=maker, use=use
    )
    return Product(
        code=code,
        name=name,
        quoted=sector.naming == "title",
        category=category.name,
        maker=maker,
        facet=facet,
        cents=cents,
        was=was,
        rating=round(min(5.0, max(2.1, rng.gauss(4.0, 0.55))), 1) if rated else None,
        ratings=rng.randint(3, 420) if rated else 0,
        stock=stock,
        figures=measured,
        facts=tuple(facts),
        options=tuple(kept),
        description=(first, *rng.sample(WORDS.descriptions_more, 3)),
        reviews=_reviews(rng) if rated else (),
    )


def _reviews(rng: random.Random) -> tuple[Review, ...]:
    count = rng.randint(3, 6)
    authors = names.people(rng, count)
    titles = rng.sample(WORDS.review_titles, count)
    days = sorted((TODAY - timedelta(days=d) for d in rng.sample(range(2, 600), count)), reverse=True)
    made = []
    for author, day, title in zip(authors, days, titles, strict=True):
        stars = rng.choice((5, 5, 4, 4, 4, 3, 3, 2, 1))
        pool = WORDS.review_good if stars > 3 else WORDS.review_fair if stars == 3 else WORDS.review_bad
        made.append(Review(author, day, stars, title, " ".join(rng.sample(pool, 2))))
    return tuple(made)


def _spread(rng: random.Random, low: float, high: float, decimals: int, count: int) -> list[float]:
    """Values in the range, different where the range has room for it."""
    scale = 10**decimals
    room = range(round(low * scale), round(high * scale) + 1)
    drawn = rng.sample(room, count) if len(room) >= count else [rng.choice(room) for _ in range(count)]
    return [value / scale for value in drawn]


def _price(rng: random.Random, category: Category, taken: set[int]) -> int:
    while True:
        # Cheap things are more common than dear ones.
        share = math.pow(rng.random(), 1.7)
        whole = round(category.low + (category.high - category.low) * share)
        cents = whole * 100 - rng.choice((0, 1, 5, 10, 50))
        if cents not in taken:
            taken.add(cents)
            return cents


def _titles(rng: random.Random) -> list[str]:
    """Titles of which none stands inside another."""
    towns = names.towns(rng, 30)
    found: list[str] = []
    while len(found) < 160:
        adjective, adjective2 = rng.sample(WORDS.title_adjectives, 2)
        title = rng.choice(WORDS.title_patterns).format(
            adjective=adjective,
            adjective2=adjective2,
            noun=rng.choice(WORDS.title_nouns),
            town=rng.choice(towns),
            given=rng.choice(names.GIVEN),
        )
        if not any(title in other or other in title for other in found):
            found.append(title)
    return found


def make_stores(seed: int) -> tuple[Store, ...]:
    """Three to five stores; opening and closing times differ from store to store."""
    rng = stream(seed, "stores")
    count = rng.randint(3, 5)
    opens = rng.sample(range(7 * 60, 11 * 60, 30), count)
    closes = rng.sample(range(17 * 60, 21 * 60 + 30, 30), count)
    streets = rng.sample(("Mill Lane", "Market Square", "Station Road", "Harbour Street", "Church Walk",
                          "Bridge Street", "Canal Side", "Tanner's Row"), count)  # fmt: skip
    sunday = rng.randrange(count)
    return tuple(
        Store(
            town=town,
            street=f"{rng.randint(1, 98)} {streets[i]}",
            opens=opens[i],
            closes=closes[i],
            saturday_closes=rng.choice((14, 15, 16, 18)) * 60,
            sunday=i == sunday,
            phone=f"555 {rng.randint(1000, 9999)}",
        )
        for i, town in enumerate(names.towns(rng, count))
    )


def make_terms(seed: int) -> Terms:
    """Delivery, returns and service of a shop."""
    rng = stream(seed, "terms")
    low = rng.choice((290, 390, 450, 495, 550))
    first, second, third = rng.choice(
        (("Standard", "Express", "Pick-up point"), ("Parcel", "Courier", "Collect in store"),
         ("Economy", "Next day", "Parcel locker"))
    )  # fmt: skip
    days = rng.choice(("2-3", "3-4", "3-5", "4-6"))
    methods = (
        (first, low, f"{days} working days"),
        (second, low + rng.choice((500, 600, 750, 900)), "1 working day"),
        (third, low - rng.choice((100, 150, 200)), f"{rng.randint(6, 9)} working days"),
    )
    percent = rng.choice((5, 10, 15))
    return Terms(
        methods=methods,
        free_from=rng.choice((4000, 5000, 6000, 7500, 9000)),
        return_days=rng.choice((14, 21, 30, 45, 60, 100)),
        wrapping=rng.choice((250, 300, 350, 420)),
        guarantee=rng.choice((2, 3, 4, 5)),
        returns=rng.choice(WORDS.returns),
        gift_cards=rng.choice(WORDS.gift_cards),
        phone=f"0800 555 {rng.randint(100, 999)}",
        hours=f"Monday to Friday, {rng.randint(7, 10)} am to {rng.randint(4, 9)} pm",
        code=f"{rng.choice(WORDS.codes)}{percent}",
        percent=percent,
    )


def make_account(seed: int, products: list[Product]) -> Account:
    """The account that tasks lend, with its past orders."""
    rng = stream(seed, "account")
    person = names.person(rng)
    email = f"{slug(person).replace('-', '.')}@mailbox.test"
    word = rng.choice(WORDS.series).lower()
    days = sorted((TODAY - timedelta(days=d) for d in rng.sample(range(1, 200), 4)), reverse=True)
    statuses = [rng.choice(("On its way", "Being packed")), "Delivered", "Cancelled", "Sent back"]
    rng.shuffle(statuses)
    orders = []
    for day, status, digits in zip(days, statuses, rng.sample(range(10_000, 99_999), 4), strict=True):
        lines = tuple((product, rng.randint(1, 3)) for product in rng.sample(products, rng.randint(1, 3)))
        total = sum(product.cents * count for product, count in lines) + rng.choice((0, 390, 490))
        orders.append(
            PastOrder(f"{digits}", day, status, tuple((p.name, count) for p, count in lines), total)
        )
    assert all(a.day > b.day for a, b in pairwise(orders))
    return Account(person, email, f"{word}-{rng.randint(100, 999)}", tuple(orders))
