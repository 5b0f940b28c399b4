"""Optional features of specified websites: groups, rows, a cart, an account, files, charts and a map.

Every website has the routes; a website without the feature answers with 404.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from datetime import date
from functools import cached_property
from typing import Any, Literal, NamedTuple

from webgym.offline import names
from webgym.offline.engine.records import Record, Sheet, Value, draw_names, draw_sheet, numeric_value
from webgym.offline.engine.spec import Spec
from webgym.offline.seeds import number, pick, stream
from webgym.offline.website import Response, State, Visit, Website, page, redirect, slug

MOST_PIECES = 6
MONTHS = tuple(f"{date(2025 + month // 12, month % 12 + 1, 1):%b %Y}" for month in range(8, 16))
"""Months of charts: the eight before today's date of the offline web."""
PINS = 12
"""Number of items on a map."""


class Pin(NamedTuple):
    """An item on a map; ``left`` and ``top`` are distances from the map's edges, in percent of its size."""

    record: Record
    left: int
    top: int


@dataclass
class Extras(Website):
    """Pages, records and server state of the optional features.

    Attributes:
        spec: the specification, with the changes of the website's sector.
        currency: sign before amounts of money.
        items: the items, in the order of the unfiltered list.
        groups: the records of each group.
    """

    spec: Spec = field(init=False)
    currency: str = field(init=False)
    items: Sheet = field(init=False)
    groups: dict[str, Sheet] = field(init=False)

    def href(self, record: Record) -> str:
        """The address of an item's page."""
        return self.path("/~one/{key}", key=slug(record.name))

    def extras_report(self, state: State) -> dict[str, Any]:
        """The state of the optional features: number of each item in the cart, files in another folder than
        at first, signed-in user."""
        report: dict[str, Any] = {}
        if self.spec.cart:
            report["cart"] = {self.by_key[key].name: count for key, count in state.get("cart", {}).items()}
        if self.spec.files:
            moved = state.get("files", {})
            report["files"] = {name: folder for name, folder in moved.items() if folder != self.files[name]}
        if self.spec.account:
            report["signed in"] = self.user if state.get("signed in") else None
        return report

    @cached_property
    def by_key(self) -> dict[str, Record]:
        """Items, by the part of their address that names them."""
        return {slug(record.name): record for record in self.items.records}

    def title_of(self, feature: Literal["account", "files", "chart", "map"]) -> str:
        """The title of an optional feature."""
        seeds = (feature,) if feature == "account" else (f"{feature} label",)
        labels: tuple[str, ...] = getattr(self.spec, feature).labels
        return pick(labels, self.seed, *seeds)

    # --- groups ----------------------------------------------------------------------------------

    def directory(self, group: str) -> str:
        """Address of the list of a group."""
        return self.path("/~more/{group}", group=slug(self.spec.groups[group].plural))

    def group_href(self, group: str, record: Record) -> str:
        """Address of a record of a group."""
        return f"{self.directory(group)}/{slug(record.name)}"

    def related(self, group: str, record: Record) -> Record:
        """The record of a group that an item links to."""
        return pick(self.groups[group].records, self.seed, group, "of", record.name)

    def related_records(self, record: Record) -> list[tuple[str, Record]]:
        """All records that an item links to, with their groups."""
        return [(name, self.related(name, record)) for name, spec in self.spec.groups.items() if spec.noun]

    def relation_label(self, group: str) -> str:
        """The label of that link on an item's page."""
        return self.spec.groups[group].noun.capitalize()

    def _group(self, word: str) -> str | None:
        return next((name for name, spec in self.spec.groups.items() if slug(spec.plural) == word), None)

    @page("/~more/{group}")
    def group_list(self, visit: Visit, group: str) -> Response:
        """All records of a group."""
        name = self._group(group)
        return self.missing(visit) if name is None else self.render("engine/group.html", visit, name=name)

    @page("/~more/{group}/{key}")
    def group_page(self, visit: Visit, group: str, key: str) -> Response:
        """One record of a group."""
        name = self._group(group)
        records = self.groups[name].records if name else ()
        record = next((record for record in records if slug(record.name) == key), None)
        if record is None:
            return self.missing(visit)
        return self.render("engine/member.html", visit, name=name, record=record)

    # --- rows ------------------------------------------------------------------------------------

    def rows(self, kind: str, record: Record) -> Sheet:
        """The rows of an item."""
        spec, rng = self.spec.rows[kind], stream(self.seed, kind, record.name)
        row_names = draw_names(spec.naming, rng, rng.randint(*spec.count))
        return draw_sheet(
            spec.fields, row_names, self.currency, self.seed, kind, record.name, labelled_by=(self.seed, kind)
        )

    def rows_label(self, kind: str) -> str:
        """Heading of the section that shows the rows."""
        return pick(self.spec.rows[kind].labels, self.seed, "rows", kind)

    # --- cart ------------------------------------------------------------------------------------

    def price(self, record: Record) -> int:
        """The price of an item."""
        assert self.spec.cart is not None
        return int(record.rank(self.spec.cart.price))

    def money(self, amount: int) -> str:
        """An amount of money as text, with its currency."""
        return f"{self.currency}{amount:,}"

    @page("/~cart")
    def cart(self, visit: Visit) -> Response:
        """The cart."""
        if self.spec.cart is None:
            return self.missing(visit)
        lines = [(self.by_key[key], count) for key, count in visit.state.get("cart", {}).items()]
        total = sum(self.price(record) * count for record, count in lines)
        return self.render("engine/cart.html", visit, lines=lines, total=total)

    @page("/~cart", method="POST")
    def change_cart(self, visit: Visit) -> Response:
        """Set the number of an item in the cart; 0 removes it."""
        key, count = visit.form.get("item", ""), visit.form.get("count", "")
        allowed = [str(pieces) for pieces in range(MOST_PIECES + 1)]
        if self.spec.cart is None or key not in self.by_key or count not in allowed:
            return self.missing(visit)
        cart = visit.state.setdefault("cart", {})
        if count == "0":
            cart.pop(key, None)
        else:
            cart[key] = int(count)
        return redirect(self.path("/~cart"))

    # --- account ---------------------------------------------------------------------------------

    @cached_property
    def user(self) -> str:
        """Name of the one user who has an account."""
        given, family = names.person(stream(self.seed, "user")).split(" ")
        return f"{given}{family[:3]}{number(self.seed, 'user number') % 90 + 10}"

    @cached_property
    def password(self) -> str:
        """That user's password."""
        rng: random.Random = stream(self.seed, "password")
        return f"{rng.choice(names.FIRST).lower()}-{rng.randint(100, 999)}"

    @cached_property
    def account_sheet(self) -> Sheet:
        """The fields of the account page, as a sheet of one record."""
        assert self.spec.account is not None
        return draw_sheet(self.spec.account.fields, [self.user], self.currency, self.seed, "account")

    @page("/~account")
    def account(self, visit: Visit) -> Response:
        """The account page, or the sign-in form for a visitor who is not signed in."""
        if self.spec.account is None:
            return self.missing(visit)
        if not visit.state.get("signed in"):
            return self.render("engine/sign_in.html", visit, error="")
        return self.render("engine/account.html", visit)

    @page("/~account", method="POST")
    def sign_in(self, visit: Visit) -> Response:
        """Sign the user in, or show the form with an error."""
        if self.spec.account is None:
            return self.missing(visit)
        if (visit.form.get("user"), visit.form.get("password")) != (self.user, self.password):
            error = "Incorrect user name or password."
            return self.render("engine/sign_in.html", visit, status=422, error=error)
        visit.state["signed in"] = True
        return redirect(self.path("/~account"))

    # --- files -----------------------------------------------------------------------------------

    @cached_property
    def files(self) -> dict[str, str]:
        """The initial folder of every file, by the file's name."""
        spec, rng = self.spec.files, stream(self.seed, "files")
        assert spec is not None
        return {
            name: rng.choice(spec.folders) for name in draw_names(spec.naming, rng, rng.randint(*spec.count))
        }

    @page("/~files")
    def file_list(self, visit: Visit) -> Response:
        """The list of files, with a checkbox each."""
        if self.spec.files is None:
            return self.missing(visit)
        return self.render("engine/files.html", visit, files=self.files | visit.state.get("files", {}))

    @page("/~files", method="POST")
    def move_files(self, visit: Visit) -> Response:
        """Move the selected files into a folder."""
        if self.spec.files is None or visit.form.get("folder") not in self.spec.files.folders:
            return self.missing(visit)
        moved = visit.state.setdefault("files", {})
        for name in self.files:
            if f"file-{slug(name)}" in visit.form:
                moved[name] = visit.form["folder"]
        return redirect(self.path("/~files"))

    # --- charts and the map ----------------------------------------------------------------------

    def chart(self, record: Record) -> dict[str, Value]:
        """The values of an item's chart, by month; all different."""
        assert self.spec.chart is not None
        spec, rng = self.spec.chart.field, stream(self.seed, "chart", record.name)
        numbers = rng.sample(range(spec.low, spec.high + 1, spec.step), len(MONTHS))
        values = [numeric_value(spec, number, self.currency) for number in numbers]
        return dict(zip(MONTHS, values, strict=True))

    @cached_property
    def pins(self) -> list[Pin]:
        """The items on the map."""
        rng = stream(self.seed, "map")
        cells = rng.sample([(column, row) for column in range(6) for row in range(5)], PINS)
        jitter = [(rng.randint(-4, 4), rng.randint(-4, 4)) for _ in cells]
        return [
            Pin(record, 9 + 16 * column + dx, 12 + 18 * row + dy)
            for record, (column, row), (dx, dy) in zip(
                rng.sample(self.items.records, PINS), cells, jitter, strict=True
            )
        ]

    @page("/~map")
    def map(self, visit: Visit) -> Response:
        """The map page."""
        return self.missing(visit) if self.spec.map is None else self.render("engine/map.html", visit)
