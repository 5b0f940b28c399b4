"""Online shops: shelves, products, a cart, a checkout, and an account."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from webgym.offline.families.shop import art, till
from webgym.offline.families.shop.catalogue import (
    Account,
    Product,
    Store,
    Terms,
    choose_categories,
    make_account,
    make_products,
    make_stores,
    make_terms,
    sector_of,
)
from webgym.offline.families.shop.schema import Category, Sector
from webgym.offline.families.shop.shelf import Facet, Order, displayed, make_facets, matches, ordered, select
from webgym.offline.families.shop.words import WORDS
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import number, pick, stream
from webgym.offline.website import Response, State, Visit, Website, page, redirect, slug

CURRENCIES = ("${}", "${}", "£{}", "€{}", "{} €", "CHF {}")
MOST_COMPARED = 4


@dataclass
class Shop(Website):
    """An online shop.

    Attributes:
        sector: what it sells; decides brand, domain and catalogue.
        say: what it calls things (:data:`webgym.offline.families.shop.words.Words`).
        style: filters as checkboxes, dropdowns or links.
        applies: whether checkboxes wait for a button instead of acting at once.
        stays: whether one stays on the product's page after putting it in the cart.
        reviews_order: whether the checkout has a second page that shows the order before it is placed.
        counts: quantity as a number field instead of a dropdown.
    """

    family: ClassVar[str] = "shop"
    words: ClassVar[dict[str, tuple[str, ...]]] = {
        "category": ("c", "category", "shop", "department", "range", "collections"),
        "product": ("p", "product", "item", "buy", "goods"),
        "search": ("search", "find", "results"),
        "cart": ("cart",),
        "checkout": ("checkout", "order", "pay"),
        "account": ("account", "my-account", "profile", "me"),
        "wish": ("wishlist", "favourites", "saved"),
        "compare": ("compare", "comparison", "side-by-side"),
        "help": ("help", "service", "customer-service", "info"),
        "stores": ("stores", "branches", "visit-us"),
        "contact": ("contact", "write-to-us", "message"),
        "news": ("newsletter", "subscribe", "news"),
        "k_text": ("q", "query", "term", "s", "keywords"),
        "k_order": ("sort", "order", "sort_by", "o"),
        "k_maker": ("brand", "maker", "by", "b"),
        "k_facet": ("type", "f", "kind", "attr"),
        "k_price": ("price", "budget", "range"),
        "k_rating": ("rating", "stars", "min_rating"),
        "k_stock": ("stock", "available", "in_stock"),
        "k_sale": ("sale", "reduced", "offer"),
    }

    sector: Sector = field(init=False)
    categories: tuple[Category, ...] = field(init=False)
    products: list[Product] = field(init=False)
    stores: tuple[Store, ...] = field(init=False)
    terms: Terms = field(init=False)
    account: Account = field(init=False)
    say: dict[str, str] = field(init=False)
    facets: tuple[Facet, ...] = field(init=False)
    orders: tuple[Order, ...] = field(init=False)
    style: str = field(init=False)
    applies: bool = field(init=False)
    stays: bool = field(init=False)
    reviews_order: bool = field(init=False)
    counts: bool = field(init=False)
    per_page: int = field(init=False)

    # --- making one --------------------------------------------------------------------------------

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """A brand that fits what the shop sells."""
        brand = f"{stem} {pick(sector_of(seed).suffixes, seed, 'brand')}"
        return brand, slug(brand)

    def build(self) -> None:
        """Fill the shelves."""
        self.sector = sector_of(self.seed)
        self.domain, self.subdomain = self.sector.domain, self.sector.subdomain
        self.tagline = pick(self.sector.taglines, self.seed, "tagline")
        self.say = {key: pick(options, self.seed, "say", key) for key, options in WORDS.voice.items()}
        for key in ("empty", "save"):
            self.say[key] = self.say[key].format(cart=self.say["cart"], wish=self.say["wish"].lower())
        self.say["add"] = f"Add to {self.say['cart']}"
        self.paths["cart"] = self.say["cart"]
        self.categories = choose_categories(self.seed, self.sector)
        self.products = make_products(self.seed, self.sector, self.categories)
        self.stores = make_stores(self.seed)
        self.terms = make_terms(self.seed)
        self.account = make_account(self.seed, self.products)
        self._by_code = {product.code: product for product in self.products}
        self._by_slug = {self._slug(product): product for product in self.products}
        rng = stream(self.seed, "ways")
        styles = (
            ("selects", "links") if self.look.filters == "top" else ("checks", "checks", "selects", "links")
        )
        self.style = rng.choice(styles)
        self.applies = rng.random() < 0.4 and self.style != "links"
        self.stays = rng.random() < 0.5
        self.reviews_order = rng.random() < 0.4
        self.counts = rng.random() < 0.4
        self.per_page = rng.choice((6, 8, 9, 12, 16) if self.look.listing != "table" else (8, 10, 15, 20))
        extras: list[Order] = [name for name in ("most", "alphabet") if rng.random() < 0.6]
        self.orders = ("featured", "cheap", "dear", "best", *extras)
        self.facets = make_facets(self)

    def _slug(self, product: Product) -> str:
        with_code = number(self.seed, "slugs") % 2 == 0
        return f"{product.code}-{product.slug}" if with_code else product.slug

    def menu(self) -> list[tuple[str, str]]:
        """Categories and the bargains."""
        shelves = [(category.name, self.shelf(category.name)) for category in self.categories]
        return [*shelves, (self.say["bargains"], self.path("/~category/bargains"))]

    def report(self, state: State) -> dict[str, Any]:
        """Cart, wish list, orders and what else a visitor left behind."""
        return till.report(self, state)

    def assignments(self) -> Iterable[Assignment]:
        """The shop's tasks."""
        from webgym.offline.families.shop.tasks import assignments  # it imports this module

        return assignments(self)

    # --- what templates and tasks ask ---------------------------------------------------------------

    def money(self, cents: int) -> str:
        """An amount in the shop's currency."""
        sign = "-" if cents < 0 else ""
        return sign + pick(CURRENCIES, self.seed, "currency").format(f"{abs(cents) / 100:,.2f}")

    def whole(self, cents: int) -> str:
        """A round amount without cents."""
        return pick(CURRENCIES, self.seed, "currency").format(f"{cents // 100:,}")

    def shelf(self, category: str) -> str:
        """Address of a category."""
        return self.path("/~category/{slug}", slug=slug(category))

    def address(self, product: Product) -> str:
        """Address of a product."""
        return self.path("/~product/{slug}", slug=self._slug(product))

    def product(self, code: int) -> Product:
        """The product with an article number."""
        return self._by_code[code]

    def _named(self, visit: Visit) -> Product | None:
        code = visit.form.get("code", "")
        return self._by_code.get(int(code)) if code.isdecimal() else None

    def counted(self, count: int) -> str:
        """How a listing says how many it found."""
        return f"{count} {self.say['items'] if count != 1 else self.say['items'].removesuffix('s')}"

    def stock_in(self, store: Store, product: Product) -> int:
        """Pieces of a product in a store."""
        return number(self.seed, "store stock", store.town, product.code) % 9

    def clock(self, minutes: int) -> str:
        """A time of day."""
        return f"{minutes // 60:02d}:{minutes % 60:02d}"

    def facet(self, name: str) -> Facet:
        """A facet by its name."""
        return next(facet for facet in self.facets if facet.name == name)

    def in_cart(self, state: State) -> int:
        """Pieces in the cart."""
        return sum(line["count"] for line in state.get("cart", []))

    @page("/picture/goods/{name}")
    def picture_of(self, visit: Visit, name: str) -> Response:
        """A product's picture."""
        del visit
        drawn = art.draw(name.removesuffix(".svg"), cover=self.sector.naming == "title")
        return Response(drawn.encode(), media_type="image/svg+xml")

    # --- shelves -------------------------------------------------------------------------------------

    @page("/")
    def front(self, visit: Visit) -> Response:
        """Front page."""
        blocks = ["tiles", "popular", "reduced"]
        stream(self.seed, "front").shuffle(blocks)
        return self.render("shop/front.html", visit, blocks=blocks, displayed=displayed(self))

    @page("/~category/{name}")
    def category(self, visit: Visit, name: str) -> Response:
        """A category, everything, or the bargains."""
        if name == "everything":
            return self._listing(visit, self.say["everything"], self.products)
        if name == "bargains":
            return self._listing(visit, self.say["bargains"], [p for p in self.products if p.was])
        title = next((c.name for c in self.categories if slug(c.name) == name), None)
        if title is None:
            return self.missing(visit)
        return self._listing(visit, title, [p for p in self.products if p.category == title])

    @page("/~search")
    def search(self, visit: Visit) -> Response:
        """Products whose words match."""
        text = visit.query.get(self.paths["k_text"], "").strip()
        found = [product for product in self.products if matches(product, text)]
        return self._listing(visit, "Results" if text else self.say["everything"], found)

    def _listing(self, visit: Visit, title: str, products: list[Product]) -> Response:
        order = visit.query.get(self.paths["k_order"], "featured")
        chosen = ordered(select(products, self.facets, visit), order)
        return self.render(
            "shop/listing.html",
            visit,
            title=title,
            shown=paged(chosen, visit, self.per_page),
            order=order,
            useful=[f for f in self.facets if any(f.takes(p, v) for p in products for v, _ in f.values)],
            present=lambda facet: [
                (value, text) for value, text in facet.values if any(facet.takes(p, value) for p in products)
            ],
        )

    # --- products ------------------------------------------------------------------------------------

    @page("/~product/{name}")
    def detail(self, visit: Visit, name: str) -> Response:
        """One product."""
        product = self._by_slug.get(name)
        if product is None:
            return self.missing(visit)
        return self._detail(visit, product)

    def _detail(self, visit: Visit, product: Product, error: str | None = None) -> Response:
        alike = [p for p in self.products if p.category == product.category and p != product]
        stream(self.seed, "alike", product.code).shuffle(alike)
        return self.render(
            "shop/product.html", visit, status=400 if error else 200, product=product, error=error,
            alike=alike[:4], flash=visit.state.pop("flash", None), most=till.MOST_PIECES,
        )  # fmt: skip

    @page("/~product/{name}", method="POST")
    def add(self, visit: Visit, name: str) -> Response:
        """Put a product in the cart."""
        product = self._by_slug.get(name)
        if product is None:
            return self.missing(visit)
        error = till.add(visit.state, product, visit.form)
        if error is not None:
            return self._detail(visit, product, error)
        visit.state["flash"] = f"{product.name} is in your {self.say['cart']}."
        return redirect(self.address(product) if self.stays else self.path("/~cart"))

    @page("/~compare")
    def comparison(self, visit: Visit) -> Response:
        """Chosen products side by side."""
        chosen = [self.product(code) for code in visit.state.get("compare", [])]
        labels = list(dict.fromkeys(label for product in chosen for label, _ in product.facts))
        return self.render("shop/compare.html", visit, chosen=chosen, labels=labels)

    @page("/~compare", method="POST")
    def compare(self, visit: Visit) -> Response:
        """Put a product on the comparison, or take it off."""
        product = self._named(visit)
        if product is None:
            return self.missing(visit)
        codes: list[int] = visit.state.setdefault("compare", [])
        if product.code in codes:
            codes.remove(product.code)
            return redirect(self.path("/~compare"))
        codes.append(product.code)
        del codes[:-MOST_COMPARED]
        visit.state["flash"] = f"{product.name} can now be compared."
        return redirect(self.address(product))

    # --- cart and checkout ---------------------------------------------------------------------------

    @page("/~cart")
    def cart(self, visit: Visit) -> Response:
        """The cart."""
        return self._cart(visit)

    def _cart(self, visit: Visit, error: str | None = None, code: str = "") -> Response:
        bill = till.bill(self, visit.state)
        flash = visit.state.pop("flash", None)
        return self.render("shop/cart.html", visit, status=400 if error else 200, bill=bill, error=error,
                           code=code, flash=flash, most=till.MOST_PIECES)  # fmt: skip

    @page("/~cart", method="POST")
    def change_cart(self, visit: Visit) -> Response:
        """Change a quantity, remove a line, or redeem a code."""
        if "code" in visit.form:
            code = visit.form["code"].strip().upper()
            if code != self.terms.code:
                return self._cart(visit, "This code is not valid.", code)
            visit.state["code"] = code
            visit.state["flash"] = f"Code {code} was applied."
        else:
            till.change(visit.state, visit.form)
        return redirect(self.path("/~cart"))

    @page("/~checkout")
    def checkout(self, visit: Visit) -> Response:
        """The address form."""
        if not visit.state.get("cart"):
            return redirect(self.path("/~cart"))
        return self._checkout(visit, visit.state.get("address", {}), {})

    def _checkout(self, visit: Visit, given: dict[str, str], errors: dict[str, str]) -> Response:
        bill = till.bill(self, visit.state, given.get("delivery"))
        return self.render("shop/checkout.html", visit, status=400 if errors else 200, given=given,
                           errors=errors, bill=bill, till=till)  # fmt: skip

    @page("/~checkout", method="POST")
    def give_address(self, visit: Visit) -> Response:
        """Check the form; then either place the order or show it once more."""
        if not visit.state.get("cart"):
            return redirect(self.path("/~cart"))
        given, errors = till.check_address(self, visit.form)
        if errors:
            return self._checkout(visit, given, errors)
        visit.state["address"] = given
        if self.reviews_order:
            return redirect(self.path("/~checkout/review"))
        return redirect(self.path("/~checkout/done/{number}", number=till.place(self, visit.state)))

    @page("/~checkout/review")
    def review(self, visit: Visit) -> Response:
        """The order before it is placed."""
        address = visit.state.get("address")
        if not address or not visit.state.get("cart"):
            return redirect(self.path("/~checkout"))
        bill = till.bill(self, visit.state, address["delivery"])
        return self.render("shop/review.html", visit, given=address, bill=bill)

    @page("/~checkout/review", method="POST")
    def place(self, visit: Visit) -> Response:
        """Place the order."""
        if not visit.state.get("address") or not visit.state.get("cart"):
            return redirect(self.path("/~checkout"))
        return redirect(self.path("/~checkout/done/{number}", number=till.place(self, visit.state)))

    @page("/~checkout/done/{number}")
    def done(self, visit: Visit, number: str) -> Response:
        """The confirmation."""
        order = visit.state.get("orders", {}).get(number)
        if order is None:
            return self.missing(visit)
        return self.render("shop/done.html", visit, number=number, order=order)

    # --- account -------------------------------------------------------------------------------------

    @page("/~account")
    def my_account(self, visit: Visit) -> Response:
        """Past orders of whoever is signed in."""
        if "user" not in visit.state:
            return redirect(self.path("/~account/login"))
        lent = visit.state["user"] == self.account.email
        return self.render("shop/account.html", visit, orders=self.account.orders if lent else ())

    @page("/~account/orders/{number}")
    def past_order(self, visit: Visit, number: str) -> Response:
        """One past order."""
        order = next((o for o in self.account.orders if o.number == number), None)
        if visit.state.get("user") != self.account.email or order is None:
            return redirect(self.path("/~account/login"))
        return self.render("shop/past_order.html", visit, order=order)

    @page("/~account/login")
    def login(self, visit: Visit) -> Response:
        """The form to sign in."""
        return self.render(
            "shop/login.html", visit, email="", error=None, flash=visit.state.pop("flash", None)
        )

    @page("/~account/login", method="POST")
    def enter(self, visit: Visit) -> Response:
        """Sign in; what was to be saved before is saved now."""
        email, password = visit.form.get("email", "").strip().lower(), visit.form.get("password", "")
        if till.passwords(self, visit.state).get(email) != password:
            error = "The e-mail address or the password is wrong."
            return self.render("shop/login.html", visit, status=400, email=email, error=error, flash=None)
        visit.state["user"] = email
        waiting = visit.state.pop("waiting", None)
        if waiting is None:
            return redirect(self.path("/~account"))
        till.save(visit.state, waiting)
        return redirect(self.path("/~wish"))

    @page("/~account/logout", method="POST")
    def leave(self, visit: Visit) -> Response:
        """Sign out."""
        visit.state.pop("user", None)
        return redirect("/")

    @page("/~account/register")
    def registration(self, visit: Visit) -> Response:
        """The form for a new account."""
        return self.render("shop/register.html", visit, given={}, errors={})

    @page("/~account/register", method="POST")
    def register(self, visit: Visit) -> Response:
        """Open an account."""
        given, errors = till.check_registration(self, visit.form)
        if errors:
            return self.render("shop/register.html", visit, status=400, given=given, errors=errors)
        till.open_account(visit.state, given)
        return redirect(self.path("/~account"))

    @page("/~wish")
    def wishes(self, visit: Visit) -> Response:
        """What was saved for later."""
        if "user" not in visit.state:
            return redirect(self.path("/~account/login"))
        saved = [self.product(code) for code in visit.state.get("wish", [])]
        return self.render("shop/wish.html", visit, saved=saved)

    @page("/~wish", method="POST")
    def wish(self, visit: Visit) -> Response:
        """Save a product, or drop it; signing in comes first."""
        product = self._named(visit)
        if product is None:
            return self.missing(visit)
        if "user" not in visit.state:
            visit.state["waiting"] = product.code
            visit.state["flash"] = f"{self.say['enter']} to use your {self.say['wish'].lower()}."
            return redirect(self.path("/~account/login"))
        till.save(visit.state, product.code)
        return redirect(self.path("/~wish"))

    # --- service -------------------------------------------------------------------------------------

    @page("/~help")
    def service(self, visit: Visit) -> Response:
        """Delivery, returns, gift cards."""
        return self.render("shop/help.html", visit)

    @page("/~stores")
    def branches(self, visit: Visit) -> Response:
        """Stores and their hours."""
        return self.render("shop/stores.html", visit)

    @page("/~contact")
    def contact(self, visit: Visit) -> Response:
        """The contact form."""
        return self.render("shop/contact.html", visit, given={}, errors={}, topics=WORDS.topics)

    @page("/~contact", method="POST")
    def write(self, visit: Visit) -> Response:
        """Take a message."""
        given, errors = till.check_message(self, visit.form, WORDS.topics)
        if errors:
            return self.render(
                "shop/contact.html", visit, status=400, given=given, errors=errors, topics=WORDS.topics
            )
        visit.state["message"] = given
        return redirect(self.path("/~contact/sent"))

    @page("/~contact/sent")
    def sent(self, visit: Visit) -> Response:
        """The message has arrived."""
        return self.render("shop/sent.html", visit, message=visit.state.get("message"))

    @page("/~news", method="POST")
    def subscribe(self, visit: Visit) -> Response:
        """Subscribe to the newsletter."""
        email = visit.form.get("email", "").strip()
        if re.fullmatch(till.EMAIL, email):
            visit.state["news"] = email
        return redirect(self.path("/~news"))

    @page("/~news")
    def subscribed(self, visit: Visit) -> Response:
        """Whether one is subscribed."""
        return self.render("shop/news.html", visit, email=visit.state.get("news"))
