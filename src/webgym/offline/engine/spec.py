"""A large website as a specification: fields, forms and words, read from a TOML file beside the family."""

from __future__ import annotations

import string
from collections import Counter
from collections.abc import Mapping
from functools import lru_cache
from typing import Literal, TypeAlias

import msgspec
from msgspec import field

from webgym.core.errors import SitesError
from webgym.offline.data import Table, load, load_beside

Kind: TypeAlias = Literal["choice", "number", "money", "year", "day", "time", "minutes"]
InputKind: TypeAlias = Literal["choice", "number", "day", "time", "person", "email", "phrase"]


class FieldSpec(Table, frozen=True, kw_only=True):
    """A field of an item.

    Attributes:
        noun: what instructions call it, without an article: ``"monthly rent"``.
        labels: what pages call it; each website takes one.
        kind: what its values are.
        section: key of the section of the item's page that shows it; ``""`` for the summary at the top.
        options: of a choice.
        take: so many of the options are on one website; 0 takes all.
        low, high, step: of numbers and money; days from today; minutes of a day or of a duration.
        units: of a number; pages write the first, answers may use any.
        having: clause for items with a value of this choice, with ``{value}``; the list has a filter for it.
        least, most: superlatives: ``"cheapest"``.
        orders: what the list calls its orders by this field.
        card: whether the list shows it.
        optional: whether some websites do without it.
        prose: a sentence with ``{value}`` that says it in the section's text, instead of a row of its table.
    """

    noun: str
    labels: tuple[str, ...]
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
            self.kind != "choice" and self.low >= self.high and "low must be less than high",
            bool(self.having)
            and _placeholders(self.having) != {"value"}
            and "having must have {value} alone",
            bool(self.prose) and _placeholders(self.prose) != {"value"} and "prose must have {value} alone",
            bool(self.prose) and not self.section and "prose needs a section",
            bool(self.least) != bool(self.most) and "least and most belong together",
            any(self.orders) and not (self.card and self.least) and "an order needs card, least and most",
        ]
        for message in filter(None, wrong):
            raise ValueError(f"{self.noun}: {message}")


class InputSpec(Table, frozen=True, kw_only=True):
    """An input of a form.

    Attributes:
        labels: what pages call it.
        kind: what is entered.
        said: how an instruction gives it, with ``{value}``: ``"on {value}"``.
        options: of a choice, or phrases to be typed.
        low, high, step: of numbers, days from today, and minutes of a day.
    """

    labels: tuple[str, ...]
    kind: InputKind
    said: str
    options: tuple[str, ...] = ()
    low: int = 0
    high: int = 0
    step: int = 1

    def __post_init__(self) -> None:
        if _placeholders(self.said) != {"value"}:
            raise ValueError(f'"{self.said}" must have {{value}} alone')
        if (self.kind in ("choice", "phrase")) != bool(self.options):
            raise ValueError(f"{self.labels[0]}: options belong to a choice or phrase, which needs them")


class FormSpec(Table, frozen=True, kw_only=True):
    """A form.

    Attributes:
        ask: the clause that asks for it, with ``{item}`` where it is about an item.
        thing: what is sent: ``"booking"``.
        open: names of the link that leads to it.
        send: names of the button that sends it.
        done: headings of the page after it.
        reference: what that page calls the number of what was sent.
        inputs: by name, in the order of the page: those that are typed into come last.
    """

    ask: str
    thing: str
    open: tuple[str, ...]
    send: tuple[str, ...]
    done: tuple[str, ...]
    reference: tuple[str, ...]
    inputs: dict[str, InputSpec]

    @property
    def is_about_item(self) -> bool:
        """Whether it is sent for an item, and its link stands on the item's page."""
        return "item" in _placeholders(self.ask)

    def __post_init__(self) -> None:
        if not _placeholders(self.ask) <= {"item"}:
            raise ValueError(f'"{self.ask}" may have {{item}} alone')
        typed = [each.kind in TYPED for each in self.inputs.values()]
        if typed != sorted(typed):
            raise ValueError(f"{self.thing}: inputs that are typed into come last: Enter sends the form")


class NamingSpec(Table, frozen=True, kw_only=True):
    """How records are called.

    Attributes:
        kind: ``words`` joins one of ``first`` and one of ``second`` by ``between``; ``list`` takes
            ``first``; ``person``, ``town`` and ``brand`` make up a name, with one of ``first`` before it
            and one of ``second`` behind it, if there are any.
        first, second: words.
        between: stands between two words.
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
    """Other records with pages of their own, which items may lead to: employers, authors, branches.

    Attributes:
        noun: what it is to an item: ``"employer"``; ``""`` where items do not lead to it.
        singular, plural: what one is called.
        labels: of the link to their list.
        count: least and most of a website.
        naming: how they are called.
        fields: by name.
    """

    noun: str = ""
    singular: str
    plural: str
    labels: tuple[str, ...]
    count: tuple[int, int]
    naming: NamingSpec
    fields: dict[str, FieldSpec]


class RowsSpec(Table, frozen=True, kw_only=True):
    """Lines that belong to an item and stand on its page: reviews, ingredients, stops.

    Attributes:
        plural: what they are called.
        labels: of the section that shows them.
        count: least and most of an item; few enough to be in view together.
        naming: how they are called, by their authors unless it says otherwise; an item has no name twice.
        fields: by name.
        look_up: asks for fields of one, with ``{item}``, ``{name}`` and ``{fields}``.
        which: asks for the first in an order, with ``{item}`` and ``{order}``: ``"with the highest rating"``.
        tally: asks how many there are of a kind, with ``{item}`` and ``{having}``.
    """

    plural: str
    labels: tuple[str, ...]
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
    """That items can be put into a cart.

    Attributes:
        price: the field that says what one costs.
    """

    price: str


class AccountSpec(Table, frozen=True, kw_only=True):
    """A page behind a sign-in.

    Attributes:
        labels: of the link to it.
        fields: what it tells, by name.
    """

    labels: tuple[str, ...]
    fields: dict[str, FieldSpec]


class FilesSpec(Table, frozen=True, kw_only=True):
    """A list of files that can be put into other folders.

    Attributes:
        labels: of the link to it.
        count: least and most of a website.
        naming: how they are called.
        folders: to put them into.
    """

    labels: tuple[str, ...]
    count: tuple[int, int] = (9, 14)
    naming: NamingSpec
    folders: tuple[str, ...]


class ChartSpec(Table, frozen=True, kw_only=True):
    """A bar for each of the last months on an item's page; a bar that is clicked tells its value.

    Attributes:
        labels: of the section that shows it.
        field: what a bar is; a number or money.
    """

    labels: tuple[str, ...]
    field: FieldSpec

    def __post_init__(self) -> None:
        if self.field.kind not in ("number", "money") or not (self.field.least and self.field.most):
            raise ValueError(f"{self.field.noun}: a chart is of numbers or money, with least and most")


class MapSpec(Table, frozen=True, kw_only=True):
    """A map with pins; a pin that is clicked tells which item is there.

    Attributes:
        labels: of the link to it.
    """

    labels: tuple[str, ...]


TYPED = ("person", "email", "phrase")
"""Kinds of inputs that are typed into."""


class VariantSpec(Table, frozen=True, kw_only=True):
    """What websites of one sector have in place of the family's own.

    Attributes:
        topic, singular, plural, suffixes, taglines, naming, picture, follows: as of the family.
        fields: more fields, or others in place of the family's.
        options: of choices, by the name of a field, or of a form and its input: ``"report.kind"``.
        labels: what pages call fields, by name; the first, in small letters, is their noun.
        ranges: low and high, by the name of a field.
        groups: how their records are called.
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


_OWN = ("topic", "singular", "plural", "suffixes", "taglines", "naming", "picture", "follows")


class Spec(Table, frozen=True, kw_only=True):
    """A family.

    Attributes:
        topic: domain and subdomain of the taxonomy.
        singular, plural: what an item is called.
        count: least and most items of a website.
        suffixes: second words of brands.
        taglines: under the brand.
        paths: words of addresses; ``all`` and ``one`` at least.
        says: what websites call things: ``all``, the list; others in place of those in ``common.toml``.
        sections: of an item's page, with what websites call them.
        fields: by name, in the order of the page.
        forms: by name.
        naming: how items are called, unless the family's class says so.
        groups: other records, by name.
        rows: what people left on items' pages, by name.
        cart, account, files, chart, map: where there is one.
        follows: values of choices that follow from how an item's name ends, by field and value.
        variants: sectors, of which every website has one.
        picture: kind of the items' illustrations.
        fillers: sentences that stand around those that say something, with ``{item}``.
    """

    topic: tuple[str, str]
    singular: str
    plural: str
    count: tuple[int, int]
    suffixes: tuple[str, ...]
    taglines: tuple[str, ...]
    paths: dict[str, tuple[str, ...]]
    sections: dict[str, tuple[str, ...]]
    fields: dict[str, FieldSpec]
    forms: dict[str, FormSpec]
    says: dict[str, tuple[str, ...]]
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
        if self.cart is not None and self.fields.get(self.cart.price, None) is None:
            raise ValueError(f'cart: there is no field "{self.cart.price}"')
        for name, each in self.fields.items():
            if each.section and each.section not in self.sections:
                raise ValueError(f'fields.{name}: there is no section "{each.section}"')

    def variant(self, name: str) -> Spec:
        """The specification of a sector's websites."""
        change, own = msgspec.structs.replace, self.variants[name]
        fields, forms, groups = {**self.fields, **own.fields}, dict(self.forms), dict(self.groups)
        for key, options in own.options.items():
            form, _, of = key.rpartition(".")
            if form:
                inputs = forms[form].inputs | {of: change(forms[form].inputs[of], options=options)}
                forms[form] = change(forms[form], inputs=inputs)
            else:
                fields[of] = change(fields[of], options=options)
        for of, labels in own.labels.items():
            fields[of] = change(fields[of], labels=labels, noun=labels[0].lower())
        for of, (low, high) in own.ranges.items():
            fields[of] = change(fields[of], low=low, high=high)
        for group, naming in own.groups.items():
            groups[group] = change(groups[group], naming=naming)
        given = {of: getattr(own, of) for of in _OWN}
        instead = {of: value for of, value in given.items() if value is not None}
        return change(self, **instead, fields=fields, forms=forms, groups=groups)


class _Common(Table, frozen=True):
    """What all families share."""

    paths: dict[str, tuple[str, ...]]
    says: dict[str, tuple[str, ...]]
    forms: dict[str, FormSpec]


@lru_cache(maxsize=1)
def _common() -> _Common:
    return load("webgym.offline.engine", "common.toml", _Common)


def spec_of(module: str) -> Spec:
    """The specification ``spec.toml`` beside a family's module, with what all families share.

    Raises:
        SitesError: it does not fit; the message names file and key.
    """
    own, common = load_beside(module, "spec.toml", Spec), _common()

    def both(
        shared: Mapping[str, tuple[str, ...]], given: Mapping[str, tuple[str, ...]]
    ) -> dict[str, tuple[str, ...]]:
        values = {"singular": own.singular, "plural": own.plural}
        return {**{k: tuple(v.format(**values) for v in texts) for k, texts in shared.items()}, **given}

    paths = both(common.paths, own.paths)
    twice = [
        word
        for word, times in Counter(word for words in paths.values() for word in words).items()
        if times > 1
    ]
    if twice:
        raise SitesError(
            f'{module}: "{twice[0]}" is the word for two kinds of pages', hint="take another in paths"
        )
    return msgspec.structs.replace(
        own,
        paths=paths,
        says=both(common.says, own.says),
        forms={**own.forms, **common.forms},
    )


def _placeholders(phrase: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(phrase) if name is not None}
