"""Websites that follow from a specification: a list with filters, a page per item, forms, and a saved list.

A family is a ``spec.toml`` (see :mod:`webgym.offline.engine.spec`) and a class that names its items. Pages,
validation, what the server holds, and tasks with solutions follow; see :mod:`webgym.offline.engine.tasks`.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import date, timedelta
from typing import Any, ClassVar

from webgym.offline.engine.extras import Extras
from webgym.offline.engine.finder import STYLES, Facet, Finder
from webgym.offline.engine.records import following, named, sheet
from webgym.offline.engine.spec import FormSpec, InputSpec, Spec, spec_of
from webgym.offline.engine.spelling import days, times
from webgym.offline.engine.table import Record
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import number, pick, stream
from webgym.offline.website import (
    TODAY,
    Response,
    State,
    Visit,
    json_response,
    page,
    redirect,
    slug,
)

CURRENCIES = ("€", "$", "£")
_SUGGESTIONS = 6
_LONGEST_TEXT = 200
_EMAIL = re.compile(r"[^@\s]+@[^@\s]+\.[a-z]{2,}")


@dataclass
class SpecifiedWebsite(Extras):
    """Base of the specified families; a family's package has a ``spec.toml``, and its class :meth:`names`.

    Attributes:
        says: what the website calls things.
        finder: filters and orders of the list.
        page_size: items on a page of the list.
        has_calendar: whether days are chosen in a calendar, or from a dropdown.
        is_endless: whether more of the list loads by itself, where it loads at all.
        has_sliders: whether numbers are chosen with sliders, or from dropdowns.
        shadowed: the section that is a web component of its own; ``""`` if there is none.
        framed: the section that stands in a frame; ``""`` if there is none.
    """

    says: dict[str, str] = field(init=False)
    finder: Finder = field(init=False)
    page_size: int = field(init=False)
    has_calendar: bool = field(init=False)
    is_endless: bool = field(init=False)
    has_sliders: bool = field(init=False)
    shadowed: str = field(init=False)
    framed: str = field(init=False)

    whole: ClassVar[Spec]
    """The family's specification, with all its sectors."""

    def __init_subclass__(cls) -> None:
        cls.whole = spec_of(cls.__module__)
        cls.words = cls.whole.paths
        super().__init_subclass__()

    @classmethod
    def spec_for(cls, seed: int) -> Spec:
        """The specification of a website: of its sector, where the family has sectors."""
        names = sorted(cls.whole.variants)
        return cls.whole.variant(pick(names, seed, "variant")) if names else cls.whole

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """Brand and hostname label; the second word fits the sector."""
        brand = f"{stem} {pick(cls.spec_for(seed).suffixes, seed, 'brand')}"
        return brand, slug(brand)

    def names(self, rng: random.Random, count: int) -> list[str]:
        """So many different names of items."""
        assert self.spec.naming is not None, f"{type(self).__name__} has neither naming nor names()"
        return named(self.spec.naming, rng, count)

    # --- what the website knows --------------------------------------------------------------------

    def build(self) -> None:
        """Draw words, fields and items."""
        spec = self.spec = self.spec_for(self.seed)
        seed = self.seed
        self.domain, self.subdomain = spec.topic
        self.tagline = pick(spec.taglines, seed, "tagline")
        self.says = {name: pick(texts, seed, "says", name) for name, texts in spec.says.items()}
        self.says |= {name: pick(texts, seed, "section", name) for name, texts in spec.sections.items()}
        self.currency = pick(CURRENCIES, seed, "currency")
        self.page_size = pick((8, 10, 12), seed, "page size")
        self.has_calendar = pick((True, False), seed, "calendar")
        self.is_endless = pick((True, False), seed, "endless")
        self.has_sliders = pick((True, False), seed, "sliders")
        self.shadowed = pick((*spec.sections, ""), seed, "shadow")
        framed = pick((*spec.sections, ""), seed, "frame")
        self.framed = "" if framed == self.shadowed else framed
        rng = stream(seed, "items")
        names = self.names(rng, rng.randint(*spec.count))
        self.items = following(sheet(spec.fields, names, self.currency, seed), spec.follows)
        self.groups = {
            name: sheet(each.fields, self._group_names(name), self.currency, seed, name)
            for name, each in spec.groups.items()
        }
        self.finder = self._finder()

    def _group_names(self, group: str) -> list[str]:
        rng, spec = stream(self.seed, "group", group), self.spec.groups[group]
        return named(spec.naming, rng, rng.randint(*spec.count))

    def _finder(self) -> Finder:
        facets = tuple(
            Facet(of, self.items.labels[of], tuple((slug(text), text) for text in self.items.options[of]))
            for of in self.items.labels
            if self.items.fields[of].having
        )
        orders = [("", self.says["default"])]
        for of in self.items.labels:
            up, down = self.items.fields[of].orders
            orders += [(f"{of}-up", up), (f"{of}-down", down)] if up else []
        return Finder(
            path=self.path("/~all"),
            facets=facets,
            sort=Facet("sort", self.says["sort"], tuple(orders)),
            style=pick(STYLES, self.seed, "finder"),
            apply=self.says["apply"],
        )

    def find(self, **asked: str) -> list[Record]:
        """The items that the list with these choices shows, in its order."""
        words = asked.get("q", "").casefold().split()
        facets = [facet.name for facet in self.finder.facets]
        found = [
            record
            for record in self.items.records
            if all(word in record.name.casefold() for word in words)
            and all(asked.get(of) in (None, slug(record.fields[of].text)) for of in facets)
        ]
        of, _, way = asked.get("sort", "").rpartition("-")
        if of:
            found.sort(key=lambda record: record.rank(of), reverse=way == "down")
        return found

    def in_section(self, section: str) -> list[str]:
        """The fields that a section shows; of ``""``, the summary."""
        return [of for of in self.items.labels if self.items.fields[of].section == section]

    def prose(self, section: str, record: Record) -> list[str]:
        """The text of a section of an item's page: what its fields say, and sentences around it."""
        said = [
            self.items.view(record, of)[0] for of in self.in_section(section) if self.items.fields[of].prose
        ]
        rng = stream(self.seed, "prose", section, record.name)
        around = rng.sample(self.spec.fillers, min(len(said) + 2, len(self.spec.fillers))) if said else []
        text = [*said, *(filler.format(item=record.name) for filler in around)]
        return rng.sample(text, len(text))

    def sections(self) -> list[str]:
        """The sections that show something."""
        return [section for section in self.spec.sections if self.in_section(section)]

    def menu(self) -> list[tuple[str, str]]:
        """The main navigation: the list, some of its filters, and what is not about an item."""
        first = self.finder.facets[0]
        filters = [(text, self.finder.link({}, first.name, value)) for value, text in first.options[:2]]
        groups = [
            (pick(each.labels, self.seed, "label", name), self.directory(name))
            for name, each in self.spec.groups.items()
        ]
        forms = [
            (self.word(name, "open"), self.address(name, ""))
            for name, form in self.spec.forms.items()
            if not form.is_about_item
        ]
        beside = [(self.map_label(), self.path("/~map"))] if self.spec.map else []
        beside += [(self.files_label(), self.path("/~files"))] if self.spec.files else []
        return [(self.says["all"], self.finder.path), *filters, *groups, *beside, *forms]

    # --- forms -----------------------------------------------------------------------------------

    def word(self, form: str, of: str) -> str:
        """What the website calls something of a form: ``open``, ``send``, ``done`` or ``reference``."""
        texts: tuple[str, ...] = getattr(self.spec.forms[form], of)
        return pick(texts, self.seed, "form", form, of)

    def input_label(self, form: str, of: str) -> str:
        """What it calls an input."""
        return pick(self.spec.forms[form].inputs[of].labels, self.seed, "input", form, of)

    def choices(self, given: InputSpec) -> list[str]:
        """What can be chosen in an input; empty where it is typed into."""
        steps = range(given.low, given.high + 1, given.step)
        match given.kind:
            case "choice":
                return list(given.options)
            case "number":
                return [str(each) for each in steps]
            case "day":
                return [days(TODAY + timedelta(days=each))[0] for each in steps]
            case "time":
                return [times(each)[0] for each in steps]
            case _:
                return []

    def calendar(self, given: InputSpec) -> list[tuple[str, list[date | None]]]:
        """Months with the days that can be chosen, behind ``None`` for the weekdays before the first."""
        chosen = [TODAY + timedelta(days=each) for each in range(given.low, given.high + 1, given.step)]
        months: dict[str, list[date | None]] = {}
        for day in chosen:
            first = months.setdefault(
                f"{day:%B %Y}", [None] * day.weekday() if f"{day:%B %Y}" not in months else []
            )
            first.append(day)
        return list(months.items())

    def _accepted(self, form: FormSpec, visit: Visit) -> tuple[dict[str, str], dict[str, str]]:
        """What was entered, and what is wrong with it."""
        values, errors = {}, {}
        for name, given in form.inputs.items():
            value = values[name] = visit.form.get(name, "").strip()
            choices = self.choices(given)
            if choices and value not in choices:
                errors[name] = "Please select an option from the list."
            elif not choices and not 2 <= len(value) <= _LONGEST_TEXT:
                errors[name] = "Please fill out this field."
            elif given.kind == "email" and not _EMAIL.fullmatch(value):
                errors[name] = "Please enter a valid e-mail address."
        return values, errors

    def reference(self, form: str, about: str, values: dict[str, str]) -> str:
        """The number of what was sent; it cannot be known without having sent it."""
        digits = number(self.seed, "reference", form, about, sorted(values.items())) % 90_000 + 10_000
        return f"{slug(self.brand)[:2].upper()}-{digits}"

    def report(self, state: State) -> dict[str, Any]:
        """What was sent, by form, item and input; what is saved; and see :meth:`extras_report`."""
        return {
            "sent": state.get("sent", {}),
            "saved": {self.by_key[key].name: True for key in state.get("saved", [])},
            **self.extras_report(state),
        }

    def assignments(self) -> Iterable[Assignment]:
        """The tasks."""
        from webgym.offline.engine.tasks import assignments

        return assignments(self)

    # --- pages -----------------------------------------------------------------------------------

    @page("/")
    def front(self, visit: Visit) -> Response:
        """Highlights, and ways in."""
        highlights = stream(self.seed, "highlights").sample(self.items.records, 6)
        return self.render("engine/front.html", visit, highlights=highlights)

    @page("/suggest")
    def suggest(self, visit: Visit) -> Response:
        """Names for what is typed into the search."""
        found = self.find(q=visit.query.get("q", ""))[:_SUGGESTIONS]
        return json_response([{"name": record.name, "path": self.href(record)} for record in found])

    @page("/~all")
    def listing(self, visit: Visit) -> Response:
        """The filtered list."""
        asked = self.finder.asked(visit)
        found = paged(self.find(**asked), visit, self.page_size)
        return self.render("engine/list.html", visit, asked=asked, found=found, shown=self.on_cards())

    def on_cards(self) -> list[str]:
        """The fields that the list shows."""
        return [of for of in self.items.labels if self.items.fields[of].card]

    @page("/~one/{key}")
    def item(self, visit: Visit, key: str) -> Response:
        """One item."""
        record = self.by_key.get(key)
        if record is None:
            return self.missing(visit)
        forms = [name for name, form in self.spec.forms.items() if form.is_about_item]
        return self.render("engine/item.html", visit, record=record, forms=forms)

    @page("/~one/{key}/in/{section}")
    def part(self, visit: Visit, key: str, section: str) -> Response:
        """A section of an item's page, for the frame in it."""
        record = self.by_key.get(key)
        if record is None or not section or section != self.framed:
            return self.missing(visit)
        return self.render("engine/part.html", visit, record=record)

    @page("/~saved")
    def saved(self, visit: Visit) -> Response:
        """What the visitor has saved."""
        found = [self.by_key[key] for key in visit.state.get("saved", [])]
        return self.render("engine/saved.html", visit, found=found)

    @page("/~saved", method="POST")
    def save(self, visit: Visit) -> Response:
        """Save an item, or forget it."""
        key = visit.form.get("item", "")
        if key not in self.by_key:
            return self.missing(visit)
        saved = visit.state.setdefault("saved", [])
        if visit.form.get("forget"):
            visit.state["saved"] = [each for each in saved if each != key]
        elif key not in saved:
            saved.append(key)
        return redirect(self.path("/~saved"))

    @page("/~one/{key}/{form}")
    def item_form(self, visit: Visit, key: str, form: str) -> Response:
        """An empty form about an item."""
        return self._form(visit, form, key)

    @page("/~one/{key}/{form}", method="POST")
    def send_item_form(self, visit: Visit, key: str, form: str) -> Response:
        """Take a form about an item, or say what is wrong with it."""
        return self._send(visit, form, key)

    @page("/~one/{key}/{form}/done")
    def item_form_done(self, visit: Visit, key: str, form: str) -> Response:
        """What was sent about an item."""
        return self._done(visit, form, key)

    @page("/~forms/{form}")
    def form(self, visit: Visit, form: str) -> Response:
        """An empty form that is about no item."""
        return self._form(visit, form, "")

    @page("/~forms/{form}", method="POST")
    def send_form(self, visit: Visit, form: str) -> Response:
        """Take such a form, or say what is wrong with it."""
        return self._send(visit, form, "")

    @page("/~forms/{form}/done")
    def form_done(self, visit: Visit, form: str) -> Response:
        """What was sent."""
        return self._done(visit, form, "")

    def address(self, form: str, key: str) -> str:
        """Of a form; ``key`` is of the item that it is about."""
        return (
            self.path("/~one/{key}", key=key) + f"/{form}" if key else self.path("/~forms/{form}", form=form)
        )

    def _known(self, form: str, key: str) -> FormSpec | None:
        found = self.spec.forms.get(form)
        is_known = found is not None and found.is_about_item == bool(key) and (not key or key in self.by_key)
        return found if is_known else None

    def _form(self, visit: Visit, form: str, key: str, **given: dict[str, str]) -> Response:
        found = self._known(form, key)
        if found is None:
            return self.missing(visit)
        status = 422 if given else 200
        shown: dict[str, dict[str, str]] = {"values": {}, "errors": {}} | given
        return self.render(
            "engine/form.html",
            visit,
            status=status,
            name=form,
            form=found,
            record=self.by_key.get(key),
            **shown,
        )

    def _send(self, visit: Visit, form: str, key: str) -> Response:
        found = self._known(form, key)
        if found is None:
            return self.missing(visit)
        values, errors = self._accepted(found, visit)
        if errors:
            return self._form(visit, form, key, values=values, errors=errors)
        about = self.by_key[key].name if key else ""
        visit.state.setdefault("sent", {}).setdefault(form, {})[about] = values
        return redirect(f"{self.address(form, key)}/done")

    def _done(self, visit: Visit, form: str, key: str) -> Response:
        record = self.by_key.get(key)
        about = record.name if record else ""
        values = visit.state.get("sent", {}).get(form, {}).get(about)
        if self._known(form, key) is None or values is None:
            return self.missing(visit)
        number_ = self.reference(form, about, values)
        return self.render("engine/done.html", visit, name=form, record=record, values=values, number=number_)
