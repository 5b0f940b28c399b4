"""Shops: their catalogues, pages and forms."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from itertools import combinations
from typing import Any, TypeAlias
from urllib.parse import parse_qsl, unquote, urlsplit
from xml.etree import ElementTree

import pytest

from webgym.core.text import fold, says
from webgym.offline.families.shop import Shop, art
from webgym.offline.families.shop.catalogue import sector_of
from webgym.offline.families.shop.schema import SECTORS
from webgym.offline.families.shop.words import WORDS
from webgym.offline.look import look
from webgym.offline.seeds import number
from webgym.offline.website import Response, State, Visit

Form: TypeAlias = Sequence[tuple[str, str]]

SEEDS = 8
TAXONOMY = {
    "Lifestyle & Leisure": {
        "Shopping", "Food & Cooking", "Sports & Fitness", "Health & Medicine", "Pets & Animal Welfare",
        "Fashion & Beauty", "Hobbies & DIY",
    },
    "Entertainment": {"Films & TV Shows", "Gaming & Virtual Worlds", "Music", "Books & Reading"},
    "Travel & Transportation": {"Outdoor & Recreation"},
}  # fmt: skip


def make(index: int) -> Shop:
    seed = number("test", "shop", index)
    brand, label = Shop.christen("Fernhill", seed)
    return Shop(seed=seed, brand=brand, label=label, look=look(seed))


class Visitor:
    """Asks a shop for pages, and remembers the last one."""

    def __init__(self, shop: Shop) -> None:
        self.shop = shop
        self.state: State = {}
        self.body = ""

    def ask(self, method: str, url: str, form: Form = ()) -> Response:
        address = urlsplit(url)
        query = parse_qsl(address.query, keep_blank_values=True)
        lists: dict[str, list[str]] = {}
        for key, value in (*query, *form):
            lists.setdefault(key, []).append(value)
        return self.shop.handle(
            Visit(method, unquote(address.path), dict(query), lists, dict(form), self.state)
        )

    def go(self, url: str, method: str = "GET", form: Form = ()) -> None:
        answer = self.ask(method, url, form)
        while answer.location is not None:
            url = answer.location
            answer = self.ask("GET", url)
        assert answer.status == 200, f"{method} {url} answers {answer.status}"
        self.body = answer.body.decode()

    def sees(self, text: str) -> bool:
        return says(fold(html.unescape(re.sub(r"<[^>]+>", " ", self.body))), text)

    def links(self) -> list[str]:
        found = re.findall(r'(?:href|data-url)="(/[^"]*)"', self.body)
        return [link for link in map(html.unescape, dict.fromkeys(found)) if "/assets/" not in link]


# --- catalogues ------------------------------------------------------------------------------------------


def test_words_are_there_once() -> None:
    assert len(set(WORDS.series)) == len(WORDS.series)
    assert len({sector.key for sector in SECTORS}) == len(SECTORS) >= 10


@pytest.mark.parametrize("sector", SECTORS, ids=lambda sector: sector.key)
def test_sectors_are_of_the_taxonomy_and_describe_enough(sector: Any) -> None:
    assert sector.subdomain in TAXONOMY[sector.domain]
    assert len(sector.categories) >= 5
    assert all(len(category.figures) >= 3 for category in sector.categories)


@pytest.mark.parametrize("index", range(SEEDS))
def test_a_catalogue_has_no_ties_where_tasks_need_none(index: int) -> None:
    shop = make(index)
    assert len({p.cents for p in shop.products}) == len(shop.products)
    assert len({p.code for p in shop.products}) == len(shop.products)
    for first, second in combinations([fold(p.name) for p in shop.products], 2):
        assert not says(first, second)
        assert not says(second, first)


def test_shops_differ() -> None:
    shops = [make(index) for index in range(60)]
    assert len({shop.sector.key for shop in shops}) >= 12
    assert len({tuple(shop.paths.values()) for shop in shops}) == len(shops)
    assert {shop.style for shop in shops} == {"checks", "selects", "links"}
    assert len({tuple(shop.say.values()) for shop in shops}) == len(shops)
    counts = [len(shop.products) for shop in shops]
    assert min(counts) < 35
    assert max(counts) > 80


def test_the_brand_says_what_is_sold() -> None:
    shop = make(0)
    assert shop.brand.removeprefix("Fernhill ") in sector_of(shop.seed).suffixes


# --- pictures --------------------------------------------------------------------------------------------


def test_every_word_has_a_silhouette_that_is_well_formed() -> None:
    drawings = ElementTree.parse(art.DRAWINGS).getroot()
    assert (
        set(art.WORDS) | {"box"}
        == set(art.shapes())
        == {symbol.get("id") for symbol in drawings if len(symbol)}
    )


@pytest.mark.parametrize("cover", [True, False])
def test_a_picture_of_goods_is_well_formed_and_follows_from_the_name(cover: bool) -> None:
    drawn = art.draw("A <Kettle> & more", cover=cover)
    assert ElementTree.fromstring(drawn).tag.endswith("svg")
    assert drawn == art.draw("A <Kettle> & more", cover=cover)
    assert drawn != art.draw("Another Kettle", cover=cover)


def test_most_goods_have_a_picture_of_their_own() -> None:
    nouns = [noun for s in SECTORS if s.naming == "series" for c in s.categories for noun in c.nouns]
    boxes = [noun for noun in nouns if art.shape_of(noun) == "box"]
    assert len(boxes) < len(nouns) / 20
    assert art.shape_of("Alma Whistling Kettle") == "kettle"


# --- pages -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", range(SEEDS))
def test_no_link_leads_nowhere(index: int) -> None:
    visitor, seen, todo = Visitor(make(index)), set[str](), ["/"]
    while todo and len(seen) < 70:
        url = todo.pop(0)
        if url in seen:
            continue
        seen.add(url)
        visitor.go(url)
        todo += visitor.links()
    assert len(seen) > 30


def test_same_seed_same_bytes() -> None:
    first, second = Visitor(make(3)), Visitor(make(3))
    urls = ["/", first.shop.shelf(first.shop.categories[0].name), first.shop.address(first.shop.products[0])]
    for url in urls:
        assert first.ask("GET", url).body == second.ask("GET", url).body


@pytest.mark.parametrize("index", range(6))
def test_filters_and_orders_do_what_they_say(index: int) -> None:
    shop = make(index)
    visitor = Visitor(shop)
    order, price = shop.paths["k_order"], shop.facet("price")
    prices = {fold(shop.money(p.cents)): p.cents for p in shop.products}

    def shown(url: str) -> list[int]:
        visitor.go(url)
        cents = {shop.address(p): p.cents for p in shop.products}
        return [cents[link] for link in visitor.links() if link in cents]

    everything = shop.path("/~category/everything")
    assert shown(f"{everything}?{order}=cheap") == sorted(prices.values())[: shop.per_page]
    assert shown(f"{everything}?{order}=dear")[0] == max(prices.values())
    low = int(price.values[0][0].split("-")[1]) * 100
    cheap = [cents for cents in prices.values() if cents < low]
    shown(f"{everything}?{price.key}=0-{low // 100}")
    assert visitor.sees(shop.counted(len(cheap)))
    maker = shop.products[0].maker
    facet = shop.facet("maker")
    value = next(value for value, text in facet.values if text == maker)
    shown(f"{everything}?{facet.key}={value}&{shop.facet('stock').key}=1")
    wanted = [p for p in shop.products if p.maker == maker and p.stock]
    assert visitor.sees(shop.counted(len(wanted)))


def test_unknown_values_of_a_query_are_harmless() -> None:
    shop = make(1)
    visitor = Visitor(shop)
    for query in (
        "page=x",
        "page=99999999999",
        f"{shop.facet('price').key}=a-b",
        f"{shop.paths['k_order']}=?",
    ):
        visitor.go(f"{shop.path('/~category/everything')}?{query}")
    assert visitor.ask("GET", "/nowhere").status == 404
    assert visitor.ask("GET", shop.path("/~product/{n}", n="nothing")).status == 404
    assert visitor.ask("POST", shop.path("/~compare"), [("code", "x")]).status == 404


# --- forms -----------------------------------------------------------------------------------------------


def in_cart(visitor: Visitor, count: str = "2") -> None:
    shop = visitor.shop
    product = next(p for p in shop.products if p.stock)
    form = [("count", count), *((label, values[0]) for label, values in product.options)]
    visitor.go(shop.address(product), "POST", form)


@pytest.mark.parametrize("index", range(6))
def test_the_cart_refuses_what_makes_no_sense(index: int) -> None:
    visitor = Visitor(make(index))
    shop = visitor.shop
    there, gone = (next(p for p in shop.products if bool(p.stock) is has) for has in (True, False))
    options = [(label, values[0]) for label, values in there.options]
    for count in ("0", "-1", "x", "10", "99999999999", ""):
        assert visitor.ask("POST", shop.address(there), [("count", count), *options]).status == 400
    assert visitor.ask("POST", shop.address(gone), [("count", "1")]).status == 400
    if options:
        assert (
            visitor.ask("POST", shop.address(there), [("count", "1"), (options[0][0], "plaid")]).status == 400
        )
    assert shop.report(visitor.state)["pieces"] == 0


@pytest.mark.parametrize("index", range(4))
def test_quantities_change_and_lines_go(index: int) -> None:
    visitor = Visitor(make(index))
    cart = visitor.shop.path("/~cart")
    in_cart(visitor)
    in_cart(visitor)
    assert visitor.shop.report(visitor.state)["pieces"] == 4
    visitor.go(cart, "POST", [("line", "0"), ("count", "7")])
    assert visitor.shop.report(visitor.state)["pieces"] == 7
    visitor.go(cart, "POST", [("line", "5"), ("remove", "1")])
    visitor.go(cart, "POST", [("line", "0"), ("remove", "1")])
    assert visitor.shop.report(visitor.state)["cart"] == {}


def test_a_wrong_code_is_named_and_a_right_one_takes_its_share() -> None:
    visitor = Visitor(make(2))
    shop = visitor.shop
    in_cart(visitor)
    wrong = visitor.ask("POST", shop.path("/~cart"), [("code", "NOPE")])
    assert wrong.status == 400
    assert b"not valid" in wrong.body
    assert b'value="NOPE"' in wrong.body
    visitor.go(shop.path("/~cart"), "POST", [("code", shop.terms.code.lower())])
    assert shop.report(visitor.state)["code"] == shop.terms.code


@pytest.mark.parametrize("index", range(6))
def test_the_checkout_keeps_what_was_typed_and_says_what_is_wrong(index: int) -> None:
    visitor = Visitor(make(index))
    shop = visitor.shop
    assert visitor.ask("GET", shop.path("/~checkout")).location == shop.path("/~cart")
    in_cart(visitor)
    typed = {"person": "Solo", "street": "Mill Lane", "postcode": "12", "town": "Ashford", "email": "nobody"}
    answer = visitor.ask("POST", shop.path("/~checkout"), list(typed.items()))
    assert answer.status == 400
    assert b"A postcode has five digits." in answer.body
    assert b'name="street" value="Mill Lane"' in answer.body
    assert shop.report(visitor.state)["orders"] == {}


def test_the_right_password_opens_the_account_and_no_other() -> None:
    visitor = Visitor(make(4))
    shop, login = visitor.shop, visitor.shop.path("/~account/login")
    wrong = visitor.ask("POST", login, [("email", shop.account.email), ("password", "guess")])
    assert wrong.status == 400
    assert shop.account.email.encode() in wrong.body
    assert visitor.ask("GET", shop.path("/~account")).location == login
    order = shop.path("/~account/orders/{n}", n=shop.account.orders[0].number)
    assert visitor.ask("GET", order).location == login
    visitor.go(login, "POST", [("email", shop.account.email), ("password", shop.account.password)])
    assert visitor.sees(f"Order {shop.account.orders[0].number}")


def test_a_new_account_needs_a_long_password_and_a_new_address() -> None:
    visitor = Visitor(make(5))
    shop, register = visitor.shop, visitor.shop.path("/~account/register")
    given = [("person", "Ada Brandt"), ("email", "ada@post.test"), ("password", "short")]
    assert visitor.ask("POST", register, given).status == 400
    taken = [("person", "Ada Brandt"), ("email", shop.account.email), ("password", "long enough")]
    assert visitor.ask("POST", register, taken).status == 400
    visitor.go(register, "POST", [*given[:2], ("password", "long enough")])
    assert shop.report(visitor.state)["people"] == {"ada@post.test": "Ada Brandt"}


def test_saving_before_signing_in_is_not_forgotten() -> None:
    visitor = Visitor(make(6))
    shop, product = visitor.shop, visitor.shop.products[0]
    visitor.go(shop.path("/~wish"), "POST", [("code", str(product.code))])
    login = [("email", shop.account.email), ("password", shop.account.password)]
    visitor.go(shop.path("/~account/login"), "POST", login)
    assert shop.report(visitor.state)["wish"] == {product.name: True}
