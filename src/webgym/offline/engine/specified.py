"""Websites generated from a specification: a list with filters, a page per item, forms, and a saved list.

A family is a TOML file (see :mod:`webgym.offline.engine.spec`) and a class that may name its items.
Pages, validation, server state, and tasks with solutions (:mod:`webgym.offline.engine.tasks`) are generated.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, timedelta
from typing import Any, ClassVar, Generic, Literal, TypeAlias, TypeVar
from urllib.parse import urlencode

from webgym.core.truth import Choose, Click, Move
from webgym.offline.engine.extras import Extras
from webgym.offline.engine.records import Record, draw_names, draw_sheet, with_implied_values
from webgym.offline.engine.spec import FormSpec, InputSpec, Spec, spec_of
from webgym.offline.engine.spelling import days, times
from webgym.offline.parts import Assignment
from webgym.offline.seeds import number, pick, stream
from webgym.offline.website import TODAY, Response, State, Visit, json_response, page, redirect, slug

CURRENCIES = ("€", "$", "£")
_SUGGESTIONS = 6
_LONGEST_TEXT = 200
_EMAIL = re.compile(r"[^@\s]+@[^@\s]+\.[a-z]{2,}")


# --- the list: filters, sort order and pages ------------------------------------------------------------
# Pages, moves of solutions and evidence of facts all use the same finder, so that they agree on the address
# of a filtered list. Its markup is in finder.html.

Style: TypeAlias = Literal["auto", "button", "links"]
STYLES: tuple[Style, ...] = ("auto", "button", "links")


@dataclass(frozen=True)
class Facet:
    """One filter of a list, or its sort order.

    Attributes:
        name: name of the query parameter.
        label: its label on the page.
        options: pairs of value and text on the page; values need no quoting in an address.
        default: text of the option that does not filter.
    """

    name: str
    label: str
    options: tuple[tuple[str, str], ...]
    default: str = "Any"

    def text(self, value: str) -> str:
        """The text of a value on the page."""
        return dict(self.options)[value]


@dataclass(frozen=True)
class Finder:
    """The filters and the sort order of one list.

    Attributes:
        path: path of the list.
        facets: the filters, in page order.
        sort: the sort order; its first option is the default, without a parameter.
        style: ``auto``: dropdowns that apply at once; ``button``: dropdowns with a button; ``links``: lists
            of links.
        apply: label of the button.
    """

    path: str
    facets: tuple[Facet, ...]
    sort: Facet
    style: Style
    apply: str

    def query(self, visit: Visit) -> dict[str, str]:
        """The valid query parameters of a request, in page order; ``q`` is the search text."""
        words = visit.query.get("q", "").strip()
        query = {"q": words} if words else {}
        for facet in (*self.facets, self.sort):
            value = visit.query.get(facet.name, "")
            if value in dict(facet.options):
                query[facet.name] = value
        return query

    def link(self, query: Mapping[str, str], name: str, value: str) -> str:
        """Address of the list with one parameter changed; an empty value removes it."""
        changed = {**query, name: value}
        order = ["q", *(facet.name for facet in self.facets), self.sort.name]
        parameters = {key: changed[key] for key in order if changed.get(key)}
        return f"{self.path}?{urlencode(parameters)}" if parameters else self.path

    def moves(self, **chosen: str) -> tuple[Move, ...]:
        """Moves from the unfiltered list to the list with these filters and this order."""
        moves: list[Move] = []
        query: dict[str, str] = {}
        for facet in self.facets:
            value = chosen.get(facet.name)
            if value is None:
                continue
            if self.style == "links":
                moves.append(Click(path=self.link(query, facet.name, value)))
            else:
                moves.append(Choose(facet.label, facet.text(value)))
            query[facet.name] = value
        if self.style == "button" and query:
            moves.append(Click(name=self.apply, role="button"))
        order = chosen.get(self.sort.name)
        if order is not None and order != self.sort.options[0][0]:
            moves.append(Choose(self.sort.label, self.sort.text(order)))
        return tuple(moves)

    def regex(self, **chosen: str) -> str:
        """Regular expression for addresses of the list with at least these parameters."""
        lookaheads = "".join(
            f"(?=(?:.*&)?{name}={re.escape(value)}(?:&|$))" for name, value in chosen.items()
        )
        return re.escape(self.path) + (rf"\?{lookaheads}" if lookaheads else r"(?:\?|$)")


T = TypeVar("T")


@dataclass(frozen=True)
class Paged(Generic[T]):
    """One page of a list.

    Attributes:
        items: on this page.
        total: number of items in the whole list.
        number: of this page, from 1.
        count: number of pages.
    """

    items: Sequence[T]
    total: int
    number: int
    count: int


def paged(items: Sequence[T], visit: Visit, size: int) -> Paged[T]:
    """The page of the visit's ``page`` parameter, limited to the existing pages."""
    count = max(1, -(-len(items) // size))
    requested = visit.query.get("page", "1")
    number = min(max(int(requested), 1), count) if requested.isdecimal() and len(requested) < 6 else 1
    return Paged(items[(number - 1) * size : number * size], len(items), number, count)


# --- the website ------------------------------------------------------------------------------------------


@dataclass
class SpecifiedWebsite(Extras):
    """Base class of the specified families.

    ``class Boats(SpecifiedWebsite, spec="boats.toml")`` names the specification beside the module; without a
    name it is ``spec.toml``.

    Attributes:
        says: texts of the pages, by key.
        finder: filters and sort order of the list.
        page_size: number of items on a page of the list.
        has_calendar: whether dates are selected in a calendar; if not, in a dropdown.
        is_endless: whether the list loads more items on scrolling, where it is not split into pages.
        has_sliders: whether numbers are selected with sliders; if not, in dropdowns.
        shadowed: key of the section inside a shadow DOM; ``""`` if there is none.
        framed: key of the section inside an ``iframe``; ``""`` if there is none.
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
    """The family's specification, without the changes of a sector."""

    def __init_subclass__(cls, spec: str = "spec.toml") -> None:
        cls.whole = spec_of(cls.__module__, spec)
        cls.words = cls.whole.paths
        super().__init_subclass__()

    @classmethod
    def spec_for(cls, seed: int) -> Spec:
        """The specification of a website, with the changes of its sector if the family has sectors."""
        names = sorted(cls.whole.variants)
        return cls.whole.variant(pick(names, seed, "variant")) if names else cls.whole

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """Brand and hostname label; the brand's second word comes from the sector."""
        brand = f"{stem} {pick(cls.spec_for(seed).suffixes, seed, 'brand')}"
        return brand, slug(brand)

    def names(self, rng: random.Random, count: int) -> list[str]:
        """Different names of items; by default as ``naming`` in the specification says.

        Args:
            rng: draws them.
            count: number of names.
        """
        assert self.spec.naming is not None, f"{type(self).__name__} has neither naming nor names()"
        return draw_names(self.spec.naming, rng, count)

    # --- records --------------------------------------------------------------------

    def build(self) -> None:
        """Draw texts, fields and items."""
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
        self.items = with_implied_values(draw_sheet(spec.fields, names, self.currency, seed), spec.follows)
        self.groups = {
            name: draw_sheet(group.fields, self._group_names(name), self.currency, seed, name)
            for name, group in spec.groups.items()
        }
        self.finder = self._finder()

    def _group_names(self, group: str) -> list[str]:
        rng, spec = stream(self.seed, "group", group), self.spec.groups[group]
        return draw_names(spec.naming, rng, rng.randint(*spec.count))

    def _finder(self) -> Finder:
        facets = tuple(
            Facet(
                field_name,
                self.items.labels[field_name],
                tuple((slug(text), text) for text in self.items.options[field_name]),
            )
            for field_name in self.items.labels
            if self.items.fields[field_name].having
        )
        orders = [("", self.says["default"])]
        for field_name in self.items.labels:
            up, down = self.items.fields[field_name].orders
            orders += [(f"{field_name}-up", up), (f"{field_name}-down", down)] if up else []
        return Finder(
            path=self.path("/~all"),
            facets=facets,
            sort=Facet("sort", self.says["sort"], tuple(orders)),
            style=pick(STYLES, self.seed, "finder"),
            apply=self.says["apply"],
        )

    def find(self, **query: str) -> list[Record]:
        """The items of the list with these query parameters, in its order."""
        words = query.get("q", "").casefold().split()
        records = list(self.items.records)
        for word in words:
            records = [record for record in records if word in record.name.casefold()]
        for facet in self.finder.facets:
            if (wanted := query.get(facet.name)) is not None:
                records = [record for record in records if slug(record.fields[facet.name].text) == wanted]
        field_name, _, direction = query.get("sort", "").rpartition("-")
        if field_name:
            records.sort(key=lambda record: record.rank(field_name), reverse=direction == "down")
        return records

    def in_section(self, section: str) -> list[str]:
        """The fields in a section; ``""`` is the summary at the top of the page."""
        return [
            field_name for field_name in self.items.labels if self.items.fields[field_name].section == section
        ]

    def prose(self, section: str, record: Record) -> list[str]:
        """The sentences of a section of an item's page: those of its fields and fillers, in random order."""
        sentences = [
            self.items.view(record, field_name)[0]
            for field_name in self.in_section(section)
            if self.items.fields[field_name].prose
        ]
        rng = stream(self.seed, "prose", section, record.name)
        fillers = (
            rng.sample(self.spec.fillers, min(len(sentences) + 2, len(self.spec.fillers)))
            if sentences
            else []
        )
        text = [*sentences, *(filler.format(item=record.name) for filler in fillers)]
        return rng.sample(text, len(text))

    def sections(self) -> list[str]:
        """The sections that have fields."""
        return [section for section in self.spec.sections if self.in_section(section)]

    def menu(self) -> list[tuple[str, str]]:
        """Text and address of every link of the main navigation."""
        first = self.finder.facets[0]
        filters = [(text, self.finder.link({}, first.name, value)) for value, text in first.options[:2]]
        groups = [
            (pick(group.labels, self.seed, "label", name), self.directory(name))
            for name, group in self.spec.groups.items()
        ]
        forms = [
            (self.word(name, "open"), self.address(name, ""))
            for name, form in self.spec.forms.items()
            if not form.is_about_item
        ]
        features = [(self.title_of("map"), self.path("/~map"))] if self.spec.map else []
        features += [(self.title_of("files"), self.path("/~files"))] if self.spec.files else []
        return [(self.says["all"], self.finder.path), *filters, *groups, *features, *forms]

    # --- forms -----------------------------------------------------------------------------------

    def word(self, form: str, kind: str) -> str:
        """A text of a form; ``kind`` is ``open``, ``send``, ``done`` or ``reference``, as in
        :class:`FormSpec`."""
        texts: tuple[str, ...] = getattr(self.spec.forms[form], kind)
        return pick(texts, self.seed, "form", form, kind)

    def input_label(self, form: str, input_name: str) -> str:
        """The label of an input of a form."""
        return pick(self.spec.forms[form].inputs[input_name].labels, self.seed, "input", form, input_name)

    def choices(self, spec: InputSpec) -> list[str]:
        """The options of an input; empty for a text input."""
        steps = range(spec.low, spec.high + 1, spec.step)
        match spec.kind:
            case "choice":
                return list(spec.options)
            case "number":
                return [str(value) for value in steps]
            case "day":
                return [days(TODAY + timedelta(days=value))[0] for value in steps]
            case "time":
                return [times(value)[0] for value in steps]
            case _:
                return []

    def calendar(self, spec: InputSpec) -> list[tuple[str, list[date | None]]]:
        """The months of a calendar, each with its selectable days.

        Each starts with a ``None`` for every weekday before its first selectable day.
        """
        dates = [TODAY + timedelta(days=offset) for offset in range(spec.low, spec.high + 1, spec.step)]
        months: dict[str, list[date | None]] = {}
        for day in dates:
            days_of_month = months.setdefault(
                f"{day:%B %Y}", [None] * day.weekday() if f"{day:%B %Y}" not in months else []
            )
            days_of_month.append(day)
        return list(months.items())

    def _validated(self, form: FormSpec, visit: Visit) -> tuple[dict[str, str], dict[str, str]]:
        """The submitted values, and an error message for every invalid one, by input."""
        values, errors = {}, {}
        for name, spec in form.inputs.items():
            value = values[name] = visit.form.get(name, "").strip()
            choices = self.choices(spec)
            if choices and value not in choices:
                errors[name] = "Please select an option from the list."
            elif not choices and not 2 <= len(value) <= _LONGEST_TEXT:
                errors[name] = "Please fill out this field."
            elif spec.kind == "email" and not _EMAIL.fullmatch(value):
                errors[name] = "Please enter a valid e-mail address."
        return values, errors

    def reference(self, form: str, about: str, values: dict[str, str]) -> str:
        """The reference number of a submitted form; only the confirmation page shows it."""
        digits = number(self.seed, "reference", form, about, sorted(values.items())) % 90_000 + 10_000
        return f"{slug(self.brand)[:2].upper()}-{digits}"

    def report(self, state: State) -> dict[str, Any]:
        """Submitted values by form, item and input; saved items; and :meth:`extras_report`."""
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
        """The front page, with some items."""
        highlights = stream(self.seed, "highlights").sample(self.items.records, 6)
        return self.render("engine/front.html", visit, highlights=highlights)

    @page("/suggest")
    def suggest(self, visit: Visit) -> Response:
        """Suggestions for a search text, as JSON."""
        records = self.find(q=visit.query.get("q", ""))[:_SUGGESTIONS]
        return json_response([{"name": record.name, "path": self.href(record)} for record in records])

    @page("/~all")
    def listing(self, visit: Visit) -> Response:
        """The list, filtered and sorted."""
        query = self.finder.query(visit)
        results = paged(self.find(**query), visit, self.page_size)
        return self.render("engine/list.html", visit, query=query, results=results, shown=self.card_fields())

    def card_fields(self) -> list[str]:
        """The fields that the list shows of every item."""
        return [field_name for field_name in self.items.labels if self.items.fields[field_name].card]

    @page("/~one/{key}")
    def item(self, visit: Visit, key: str) -> Response:
        """The page of an item."""
        record = self.by_key.get(key)
        if record is None:
            return self.missing(visit)
        forms = [name for name, form in self.spec.forms.items() if form.is_about_item]
        return self.render("engine/item.html", visit, record=record, forms=forms)

    @page("/~one/{key}/in/{section}")
    def part(self, visit: Visit, key: str, section: str) -> Response:
        """The document inside the ``iframe`` of an item's page."""
        record = self.by_key.get(key)
        if record is None or not section or section != self.framed:
            return self.missing(visit)
        return self.render("engine/part.html", visit, record=record)

    @page("/~saved")
    def saved(self, visit: Visit) -> Response:
        """The visitor's saved items."""
        records = [self.by_key[key] for key in visit.state.get("saved", [])]
        return self.render("engine/saved.html", visit, records=records)

    @page("/~saved", method="POST")
    def save(self, visit: Visit) -> Response:
        """Save an item, or remove it from the saved items."""
        key = visit.form.get("item", "")
        if key not in self.by_key:
            return self.missing(visit)
        saved = visit.state.setdefault("saved", [])
        if visit.form.get("forget"):
            visit.state["saved"] = [other for other in saved if other != key]
        elif key not in saved:
            saved.append(key)
        return redirect(self.path("/~saved"))

    def address(self, form: str, key: str) -> str:
        """The address of a form; ``key`` is the item's key, ``""`` for a form that is not about an item."""
        return (
            self.path("/~one/{key}", key=key) + f"/{form}" if key else self.path("/~forms/{form}", form=form)
        )

    def _form_spec(self, form: str, key: str) -> FormSpec | None:
        spec = self.spec.forms.get(form)
        is_known = spec is not None and spec.is_about_item == bool(key) and (not key or key in self.by_key)
        return spec if is_known else None

    @page("/~one/{key}/{form}")
    @page("/~forms/{form}")
    def form(self, visit: Visit, form: str, key: str = "", **submitted: dict[str, str]) -> Response:
        """A form about an item, or about none: empty, or with submitted values and their errors."""
        spec = self._form_spec(form, key)
        if spec is None:
            return self.missing(visit)
        status = 422 if submitted else 200
        shown: dict[str, dict[str, str]] = {"values": {}, "errors": {}} | submitted
        return self.render(
            "engine/form.html",
            visit,
            status=status,
            name=form,
            form=spec,
            record=self.by_key.get(key),
            **shown,
        )

    @page("/~one/{key}/{form}", method="POST")
    @page("/~forms/{form}", method="POST")
    def send_form(self, visit: Visit, form: str, key: str = "") -> Response:
        """Store a submitted form, or show its errors."""
        spec = self._form_spec(form, key)
        if spec is None:
            return self.missing(visit)
        values, errors = self._validated(spec, visit)
        if errors:
            return self.form(visit, form, key, values=values, errors=errors)
        about = self.by_key[key].name if key else ""
        visit.state.setdefault("sent", {}).setdefault(form, {})[about] = values
        return redirect(f"{self.address(form, key)}/done")

    @page("/~one/{key}/{form}/done")
    @page("/~forms/{form}/done")
    def form_done(self, visit: Visit, form: str, key: str = "") -> Response:
        """The confirmation page of a form."""
        record = self.by_key.get(key)
        about = record.name if record else ""
        values = visit.state.get("sent", {}).get(form, {}).get(about)
        if self._form_spec(form, key) is None or values is None:
            return self.missing(visit)
        reference = self.reference(form, about, values)
        return self.render(
            "engine/done.html", visit, name=form, record=record, values=values, number=reference
        )
