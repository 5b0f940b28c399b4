"""The specification of a family of large websites: fields, forms and texts.

It is read from a TOML file beside the family's module.
"""

from __future__ import annotations

import string
from collections import Counter
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import field

from webgym.core.errors import SitesError
from webgym.offline.data import Table, load, load_beside

Kind: TypeAlias = Literal["choice", "number", "money", "year", "day", "time", "minutes"]
InputKind: TypeAlias = Literal["choice", "number", "day", "time", "person", "email", "phrase"]
Texts: TypeAlias = Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
"""Alternatives, of which each website uses one."""
LAST_DAY = 36_500


class FieldSpec(Table, frozen=True, kw_only=True):
    """A field of an item.

    Attributes:
        noun: what instructions call it, without an article: ``"monthly rent"``.
        labels: possible labels on pages; each website uses one.
        kind: type of its values.
        section: key of the section of the item's page that shows it; ``""`` for the summary at the top.
        options: possible values of a choice field.
        take: number of the options that each website uses; 0 uses all.
        low, high, step: range of the values, with ``high`` included. ``number`` and ``money``: the amount;
            ``day``: days from today; ``time``: minutes since midnight; ``minutes``: a duration.
        units: units of a number; pages write the first, answers may use any.
        having: clause for items with a value of a choice field, with ``{value}``; the list then has a filter.
        least, most: superlatives for the lowest and the highest value: ``"lowest"``.
        orders: texts of the list's sort options, ascending and descending; empty for none.
        card: whether the list shows the field.
        optional: whether some websites lack the field.
        prose: a sentence with ``{value}`` that shows the value in the section's text, not in its table.
    """

    noun: str
    labels: Texts
    kind: Kind
    section: str = ""
    options: tuple[str, ...] = ()
    take: int = 0
    low: int = 0
    high: int = 0
    step: int = 1
    units: tuple[str, ...] = ()
    having: str = ""
    least: str = ""
    most: str = ""
    orders: tuple[str, str] = ("", "")
    card: bool = False
    optional: bool = False
    prose: str = ""

    def __post_init__(self) -> None:
        wrong = [
            (self.kind == "choice") != bool(self.options) and "options belong to a choice, which needs them",
            len(set(self.options)) < len(self.options) and "an option stands there twice",
            self.kind != "choice" and self.low >= self.high and "low must be less than high",
            self.kind == "day" and self.high > LAST_DAY and f"high must be at most {LAST_DAY} days",
            bool(self.having)
            and _placeholders(self.having) != {"value"}
            and "having must have the placeholder {value} and no other",
            bool(self.prose)
            and _placeholders(self.prose) != {"value"}
            and "prose must have the placeholder {value} and no other",
            bool(self.prose) and not self.section and "prose needs a section",
            bool(self.least) != bool(self.most) and "least and most belong together",
            any(self.orders) and not (self.card and self.least) and "an order needs card, least and most",
        ]
        for message in filter(None, wrong):
            raise ValueError(f"{self.noun}: {message}")


class InputSpec(Table, frozen=True, kw_only=True):
    """An input of a form.

    Attributes:
        labels: possible labels on pages; each website uses one.
        kind: type of the value.
        said: phrase of the instruction, with ``{value}``: ``"on {value}"``.
        options: options of a choice; of a ``phrase``, the texts that tasks enter.
        low, high, step: range of the values, as in :class:`FieldSpec`.
    """

    labels: Texts
    kind: InputKind
    said: str
    options: tuple[str, ...] = ()
    low: int = 0
    high: int = 0
    step: int = 1

    def __post_init__(self) -> None:
        if _placeholders(self.said) != {"value"}:
            raise ValueError(f'"{self.said}" must have the placeholder {{value}} and no other')
        if (self.kind in ("choice", "phrase")) != bool(self.options):
            raise ValueError(f"{self.labels[0]}: options belong to a choice or phrase, which needs them")
        if len(set(self.options)) < len(self.options):
            raise ValueError(f"{self.labels[0]}: an option stands there twice")
        if self.kind in ("number", "day", "time") and self.low >= self.high:
            raise ValueError(f"{self.labels[0]}: low must be less than high")
        if self.kind == "day" and self.high > LAST_DAY:
            raise ValueError(f"{self.labels[0]}: high must be at most {LAST_DAY} days")


class FormSpec(Table, frozen=True, kw_only=True):
    """A form.

    Attributes:
        ask: clause of the instruction; it has ``{item}`` if the form is about an item.
        thing: noun for what is sent: ``"booking"``.
        open: possible texts of the link to the form.
        send: possible labels of the submit button.
        done: possible headings of the confirmation page.
        reference: possible labels of the reference number on that page.
        inputs: inputs by name, in page order; text inputs come last.
    """

    ask: str
    thing: str
    open: Texts
    send: Texts
    done: Texts
    reference: Texts
    inputs: dict[str, InputSpec]

    @property
    def is_about_item(self) -> bool:
        """Whether it is about an item; the link to it then is on the item's page."""
        return "item" in _placeholders(self.ask)

    def __post_init__(self) -> None:
        if not _placeholders(self.ask) <= {"item"}:
            raise ValueError(f'"{self.ask}" may have the placeholder {{item}} and no other')
        typed = [spec.kind in TYPED for spec in self.inputs.values()]
        if typed != sorted(typed):
            raise ValueError(f"{self.thing}: text inputs must come last, because Enter submits the form")


class NamingSpec(Table, frozen=True, kw_only=True):
    """How records are named.

    Attributes:
        kind: ``words`` joins a word of ``first`` and a word of ``second`` with ``between``; ``list`` draws
            from ``first``; ``person``, ``town`` and ``brand`` generate a name and add a word of ``first``
            before it and a word of ``second`` after it, where these are not empty.
        first, second: words; none twice.
        between: separator of ``words``.
    """

    kind: Literal["words", "list", "person", "town", "brand"]
    first: tuple[str, ...] = ()
    second: tuple[str, ...] = ()
    between: str = " "

    def __post_init__(self) -> None:
        for words in (self.first, self.second):
            if twice := [word for word in words if words.count(word) > 1]:
                raise ValueError(f'naming has "{twice[0]}" twice')


class GroupSpec(Table, frozen=True, kw_only=True):
    """Records other than items, with pages of their own: employers, authors, branches.

    Attributes:
        noun: noun for the record that an item links to: ``"employer"``; ``""`` if items link to none.
        singular, plural: noun for the records.
        labels: possible texts of the link to their list.
        count: smallest and largest number on a website.
        naming: how they are named.
        fields: fields by name.
    """

    noun: str = ""
    singular: str
    plural: str
    labels: Texts
    count: tuple[int, int]
    naming: NamingSpec
    fields: dict[str, FieldSpec]


class RowsSpec(Table, frozen=True, kw_only=True):
    """Rows of a table on an item's page: reviews, ingredients, stops.

    Attributes:
        plural: noun for the rows.
        labels: possible headings of their section.
        count: smallest and largest number per item; few enough to be in view together.
        naming: how they are named; by default after people. An item has no name twice.
        fields: fields by name.
        look_up: clause that asks for fields of a row, with ``{item}``, ``{name}`` and ``{fields}``.
        which: clause that asks for the row with the highest or lowest value, with ``{item}`` and ``{order}``,
            such as ``"with the highest rating"``; empty for no such tasks.
        tally: clause that asks for the number of rows with a value, with ``{item}`` and ``{having}``; empty
            for no such tasks.
    """

    plural: str
    labels: Texts
    count: tuple[int, int] = (2, 4)
    naming: NamingSpec = NamingSpec(kind="person")
    fields: dict[str, FieldSpec]
    look_up: str
    which: str = ""
    tally: str = ""

    def __post_init__(self) -> None:
        wanted = {"look_up": "item name fields", "which": "item order", "tally": "item having"}
        for name, placeholders in wanted.items():
            phrase = getattr(self, name)
            if phrase and _placeholders(phrase) != set(placeholders.split()):
                raise ValueError(f'{name}: "{phrase}" must have the placeholders {placeholders}')


class CartSpec(Table, frozen=True, kw_only=True):
    """The shopping cart.

    Attributes:
        price: name of the field with an item's price.
    """

    price: str


class AccountSpec(Table, frozen=True, kw_only=True):
    """An account page that requires signing in.

    Attributes:
        labels: possible titles of the page.
        fields: fields by name.
    """

    labels: Texts
    fields: dict[str, FieldSpec]


class FilesSpec(Table, frozen=True, kw_only=True):
    """A list of files that can be moved to other folders.

    Attributes:
        labels: possible titles of the list.
        count: smallest and largest number of files on a website.
        naming: how files are named.
        folders: names of the folders.
    """

    labels: Texts
    count: tuple[int, int] = (9, 14)
    naming: NamingSpec
    folders: tuple[str, ...]


class ChartSpec(Table, frozen=True, kw_only=True):
    """A bar chart of the last months on an item's page; a click on a bar shows its value.

    Attributes:
        labels: possible headings of its section.
        field: what the bars measure; a number or money.
    """

    labels: Texts
    field: FieldSpec

    def __post_init__(self) -> None:
        if self.field.kind not in ("number", "money") or not (self.field.least and self.field.most):
            raise ValueError(
                f"{self.field.noun}: the field of a chart must have kind number or money, and least and most"
            )


class MapSpec(Table, frozen=True, kw_only=True):
    """A map with pins; a click on a pin shows its item.

    Attributes:
        labels: possible titles of the map.
    """

    labels: Texts


TYPED = ("person", "email", "phrase")
"""Kinds of text inputs."""


class VariantSpec(Table, frozen=True, kw_only=True):
    """The changes of one sector to the family's specification.

    Attributes:
        topic, singular, plural, suffixes, taglines, naming, picture, follows: replace those of the family.
        fields: additional fields, and replacements of the family's.
        options: options by name of a field, or by names of a form and an input: ``"report.kind"``.
        labels: labels by name of a field; the first, in lower case, becomes the field's noun.
        ranges: ``low`` and ``high`` by name of a field.
        groups: naming of records by group.
    """

    topic: tuple[str, str] | None = None
    singular: str | None = None
    plural: str | None = None
    suffixes: tuple[str, ...] | None = None
    taglines: tuple[str, ...] | None = None
    naming: NamingSpec | None = None
    picture: str | None = None
    follows: dict[str, dict[str, tuple[str, ...]]] | None = None
    fields: dict[str, FieldSpec] = field(default_factory=dict)
    options: dict[str, tuple[str, ...]] = field(default_factory=dict)
    labels: dict[str, tuple[str, ...]] = field(default_factory=dict)
    ranges: dict[str, tuple[int, int]] = field(default_factory=dict)
    groups: dict[str, NamingSpec] = field(default_factory=dict)


_OVERRIDABLE = ("topic", "singular", "plural", "suffixes", "taglines", "naming", "picture", "follows")


class Spec(Table, frozen=True, kw_only=True):
    """The specification of a family. Lists of texts are alternatives, of which each website uses one.

    Attributes:
        topic: domain and subdomain of the taxonomy.
        singular, plural: noun for the items.
        count: smallest and largest number of items on a website.
        suffixes: second words of brands.
        taglines: taglines under the brand.
        paths: words of addresses, by kind of page; at least ``all`` (the list) and ``one`` (an item).
        says: texts of pages, by key; ``all`` is the title of the list. They replace those of ``common.toml``.
        sections: headings of the sections of an item's page, by key.
        fields: fields by name, in page order.
        forms: forms by name.
        naming: how items are named; the family's class overrides ``names`` instead if it is empty.
        groups: groups of other records, by name.
        rows: kinds of rows on items' pages, by name.
        cart, account, files, chart, map: optional features.
        follows: values that the last words of an item's name imply, by field: value to endings.
        variants: sectors by name; each website has one of them.
        picture: kind of the items' illustrations.
        fillers: sentences without information between those of ``prose``; may have ``{item}``.
    """

    topic: tuple[str, str]
    singular: str
    plural: str
    count: tuple[int, int]
    suffixes: Texts
    taglines: Texts
    paths: dict[str, Texts]
    sections: dict[str, Texts]
    fields: dict[str, FieldSpec]
    forms: dict[str, FormSpec]
    says: dict[str, Texts]
    naming: NamingSpec | None = None
    groups: dict[str, GroupSpec] = field(default_factory=dict)
    rows: dict[str, RowsSpec] = field(default_factory=dict)
    cart: CartSpec | None = None
    account: AccountSpec | None = None
    files: FilesSpec | None = None
    chart: ChartSpec | None = None
    map: MapSpec | None = None
    follows: dict[str, dict[str, tuple[str, ...]]] = field(default_factory=dict)
    variants: dict[str, VariantSpec] = field(default_factory=dict)
    picture: str = "scene"
    fillers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 3 <= self.count[0] <= self.count[1]:
            raise ValueError("count: the smallest number must be at least 3, and the largest no less")
        if self.cart is not None and self.fields.get(self.cart.price, None) is None:
            raise ValueError(f'cart: there is no field "{self.cart.price}"')
        for name, spec in self.fields.items():
            if spec.section and spec.section not in self.sections:
                raise ValueError(f'fields.{name}: there is no section "{spec.section}"')

    def variant(self, sector: str) -> Spec:
        """The specification with the changes of a sector."""
        change, variant = msgspec.structs.replace, self.variants[sector]
        fields, forms, groups = {**self.fields, **variant.fields}, dict(self.forms), dict(self.groups)
        for key, options in variant.options.items():
            form, _, name = key.rpartition(".")
            if form:
                inputs = forms[form].inputs | {name: change(forms[form].inputs[name], options=options)}
                forms[form] = change(forms[form], inputs=inputs)
            else:
                fields[name] = change(fields[name], options=options)
        for name, labels in variant.labels.items():
            fields[name] = change(fields[name], labels=labels, noun=labels[0].lower())
        for name, (low, high) in variant.ranges.items():
            fields[name] = change(fields[name], low=low, high=high)
        for group, naming in variant.groups.items():
            groups[group] = change(groups[group], naming=naming)
        overrides = {key: getattr(variant, key) for key in _OVERRIDABLE}
        overrides = {key: value for key, value in overrides.items() if value is not None}
        return change(self, **overrides, fields=fields, forms=forms, groups=groups)


class _Common(Table, frozen=True):
    """``common.toml``: what all families share."""

    paths: dict[str, Texts]
    says: dict[str, Texts]
    forms: dict[str, FormSpec]


@lru_cache(maxsize=1)
def _common() -> _Common:
    return load("webgym.offline.engine", "common.toml", _Common)


def spec_of(module: str, file: str = "spec.toml") -> Spec:
    """The specification of a family, a TOML file beside its module merged with ``common.toml``.

    Raises:
        SitesError: the file is not valid; the message names file and key.
    """
    own, common = load_beside(module, file, Spec), _common()

    def merged(
        shared: Mapping[str, tuple[str, ...]], overrides: Mapping[str, tuple[str, ...]]
    ) -> dict[str, tuple[str, ...]]:
        values = {"singular": own.singular, "plural": own.plural}
        return {**{k: tuple(v.format(**values) for v in texts) for k, texts in shared.items()}, **overrides}

    paths = merged(common.paths, own.paths)
    counts = Counter(word for words in paths.values() for word in words)
    if repeated := [word for word, count in counts.items() if count > 1]:
        raise SitesError(
            f'{module}, {file}: "{repeated[0]}" stands for two kinds of pages in paths',
            hint="use different words",
        )
    return msgspec.structs.replace(
        own, paths=paths, says=merged(common.says, own.says), forms={**own.forms, **common.forms}
    )


def _placeholders(phrase: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(phrase) if name is not None}
