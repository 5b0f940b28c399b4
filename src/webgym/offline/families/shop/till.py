"""The till of a shop: lines, bills, orders, and the checks of its forms.

State of a visitor: ``cart`` (list of ``{code, options, count}``), ``code``, ``address``, ``orders`` (by
number), ``wish`` and ``compare`` (article numbers), ``user``, ``accounts``, ``news``, ``message``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from webgym.offline.families.shop.catalogue import Product
from webgym.offline.seeds import number, pick
from webgym.offline.website import State

if TYPE_CHECKING:
    from webgym.offline.families.shop import Shop

PAYMENTS = ("Invoice", "Bank transfer", "Card on delivery")
EMAIL = r"[^@\s]+@[^@\s]+\.[^@\s.]+"
SHORTEST_PASSWORD = 8
MOST_PIECES = 9
"""Of one product in a cart."""


@dataclass(frozen=True)
class Line:
    """A line of the cart; money in cents."""

    place: int
    product: Product
    options: Mapping[str, str]
    count: int

    @property
    def variant(self) -> str:
        """The choices in words: ``"Colour: red, Size: M"``."""
        return ", ".join(f"{label}: {value}" for label, value in self.options.items())

    @property
    def cents(self) -> int:
        """What the line costs."""
        return self.product.cents * self.count


@dataclass(frozen=True)
class Bill:
    """What a cart costs; money in cents."""

    lines: tuple[Line, ...]
    subtotal: int
    discount: int
    delivery: int
    method: str

    @property
    def total(self) -> int:
        """What is to be paid."""
        return self.subtotal - self.discount + self.delivery


def bill_for(shop: Shop, lines: Sequence[Line], *, code: bool = False, method: str | None = None) -> Bill:
    """The bill for some lines; the first delivery method costs nothing from a certain value on."""
    subtotal = sum(line.cents for line in lines)
    names = [name for name, _, _ in shop.terms.methods]
    chosen = method if method in names else names[0]
    price = next(price for name, price, _ in shop.terms.methods if name == chosen)
    if chosen == names[0] and subtotal >= shop.terms.free_from:
        price = 0
    discount = round(subtotal * shop.terms.percent / 100) if code else 0
    return Bill(tuple(lines), subtotal, discount, price if lines else 0, chosen)


def bill(shop: Shop, state: State, method: str | None = None) -> Bill:
    """The bill for a visitor's cart."""
    lines = [
        Line(place, shop.product(line["code"]), line["options"], line["count"])
        for place, line in enumerate(state.get("cart", []))
    ]
    return bill_for(shop, lines, code="code" in state, method=method)


def add(state: State, product: Product, form: Mapping[str, str]) -> str | None:
    """Put a product in the cart; what is wrong with the form, or ``None``."""
    if not product.stock:
        return "This product is sold out."
    options: dict[str, str] = {}
    for label, values in product.options:
        value = form.get(label, "")
        if value not in values:
            return f"Please choose: {label}."
        options[label] = value
    asked = form.get("count", "1").strip()
    if not asked.isdecimal() or not 1 <= int(asked[:4]) <= MOST_PIECES:
        return f"Please choose between 1 and {MOST_PIECES} pieces."
    lines: list[dict[str, Any]] = state.setdefault("cart", [])
    for line in lines:
        if line["code"] == product.code and line["options"] == options:
            line["count"] = min(line["count"] + int(asked), MOST_PIECES)
            return None
    lines.append({"code": product.code, "options": options, "count": int(asked)})
    return None


def change(state: State, form: Mapping[str, str]) -> None:
    """Change or remove the line that the form names; a form that names none changes nothing."""
    lines = state.get("cart", [])
    place, count = form.get("line", ""), form.get("count", "")
    if not place.isdecimal() or int(place[:4]) >= len(lines):
        return
    if "remove" in form or count == "0":
        del lines[int(place)]
    elif count.isdecimal():
        lines[int(place)]["count"] = min(max(int(count[:4]), 1), MOST_PIECES)


def save(state: State, code: int) -> None:
    """Put a product on the wish list, or take it off."""
    saved: list[int] = state.setdefault("wish", [])
    if code in saved:
        saved.remove(code)
    else:
        saved.append(code)


def order_number(shop: Shop, lines: Sequence[Line]) -> str:
    """The number of an order: it follows from what was ordered."""
    what = sorted((line.product.code, line.variant, line.count) for line in lines)
    prefix = pick(("WEB", "ORD", shop.brand[:2].upper(), "N"), shop.seed, "prefix")
    return f"{prefix}-{number(shop.seed, 'order', what) % 900_000 + 100_000}"


def place(shop: Shop, state: State) -> str:
    """Turn the cart into an order; its number."""
    address = state["address"]
    made = bill(shop, state, address["delivery"])
    name = order_number(shop, made.lines)
    state.setdefault("orders", {})[name] = {
        **address,
        "items": [[line.product.name, line.variant, line.count, line.cents] for line in made.lines],
        "discount": made.discount,
        "shipping": made.delivery,
        "total": made.total,
    }
    state["cart"] = []
    state.pop("code", None)
    return name


def needs_email(shop: Shop) -> bool:
    """Whether the checkout asks for an e-mail address."""
    return number(shop.seed, "asks for e-mail") % 2 == 0


def address_fields(shop: Shop) -> list[str]:
    """The text fields of the checkout, in its order."""
    fields = ["person", "street", "postcode", "town"]
    if number(shop.seed, "town first") % 2:
        fields = ["person", "street", "town", "postcode"]
    return [*fields, "email"] if needs_email(shop) else fields


def check_address(shop: Shop, form: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """What was typed, and what is wrong with it, by field."""
    fields = address_fields(shop)
    given = {name: form.get(name, "").strip() for name in (*fields, "delivery", "payment")}
    errors: dict[str, str] = {}
    if len(given["person"].split()) < 2:
        errors["person"] = "Please give a first and a last name."
    if not re.search(r"\d", given["street"]):
        errors["street"] = "Please give a street and a number."
    if not re.fullmatch(r"\d{5}", given["postcode"]):
        errors["postcode"] = "A postcode has five digits."
    if not given["town"]:
        errors["town"] = "Please give a town."
    if "email" in fields and not re.fullmatch(EMAIL, given["email"]):
        errors["email"] = "This is not an e-mail address."
    if given["delivery"] not in [name for name, _, _ in shop.terms.methods]:
        errors["delivery"] = "Please choose how it should reach you."
    if given["payment"] not in PAYMENTS:
        errors["payment"] = "Please choose how you want to pay."
    return given, errors


def check_registration(shop: Shop, form: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """What was typed for a new account, and what is wrong with it."""
    given = {name: form.get(name, "").strip() for name in ("person", "email", "password")}
    given["email"] = given["email"].lower()
    errors: dict[str, str] = {}
    if not given["person"]:
        errors["person"] = "Please give a name."
    if not re.fullmatch(EMAIL, given["email"]):
        errors["email"] = "This is not an e-mail address."
    elif given["email"] == shop.account.email:
        errors["email"] = "There is an account with this address already."
    if len(given["password"]) < SHORTEST_PASSWORD:
        errors["password"] = f"A password has at least {SHORTEST_PASSWORD} characters."
    return given, errors


def open_account(state: State, given: Mapping[str, str]) -> None:
    """Open an account, and sign in with it."""
    state.setdefault("accounts", {})[given["email"]] = given["password"]
    state.setdefault("people", {})[given["email"]] = given["person"]
    state["user"] = given["email"]


def passwords(shop: Shop, state: State) -> dict[str, str]:
    """The password of every account, by e-mail address."""
    opened: dict[str, str] = state.get("accounts", {})
    return {shop.account.email: shop.account.password} | opened


def check_message(
    shop: Shop, form: Mapping[str, str], topics: Sequence[str]
) -> tuple[dict[str, str], dict[str, str]]:
    """What was written to the shop, and what is wrong with it."""
    del shop
    given = {name: form.get(name, "").strip() for name in ("topic", "person", "email", "text")}
    errors: dict[str, str] = {}
    if given["topic"] not in topics:
        errors["topic"] = "Please choose a topic."
    if not given["person"]:
        errors["person"] = "Please give a name."
    if not re.fullmatch(EMAIL, given["email"]):
        errors["email"] = "This is not an e-mail address."
    if len(given["text"]) < 5:
        errors["text"] = "Please write a few words."
    return given, errors


def report(shop: Shop, state: State) -> dict[str, Any]:
    """What the server holds for a visitor, by names instead of article numbers.

    ``cart``: product name to ``{"quantity": n, option: value}``; ``pieces``: in the cart; ``orders``:
    number to what was given; ``wish`` and ``compare``: product name to ``True``.
    """
    cart: dict[str, dict[str, Any]] = {}
    for line in bill(shop, state).lines:
        cart[line.product.name] = {**line.options, "quantity": line.count}
    orders = {
        name: {**order, "items": {item: count for item, _, count, _ in order["items"]}}
        for name, order in state.get("orders", {}).items()
    }
    return {
        "cart": cart,
        "pieces": shop.in_cart(state),
        "code": state.get("code"),
        "orders": orders,
        "wish": {shop.product(code).name: True for code in state.get("wish", [])},
        "compare": {shop.product(code).name: True for code in state.get("compare", [])},
        "user": state.get("user"),
        "people": state.get("people", {}),
        "newsletter": state.get("news"),
        "message": state.get("message", {}),
    }
