"""Tasks on the items of a specified website: ways to them and what proves that they were seen; look up and
compare fields; save items, fill in and send forms.

Functions that take the website, a random generator and a number of facts return a part with that many facts,
or ``None`` if the draw gives no well-posed part.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date

import msgspec

from webgym.core.truth import Choose, Click, Fill, Home, Move, See, StateCheck
from webgym.offline.engine.records import Record, numeric_value
from webgym.offline.engine.spec import TYPED, InputSpec
from webgym.offline.engine.specified import SpecifiedWebsite
from webgym.offline.engine.spelling import days, first_up, listed
from webgym.offline.names import person
from webgym.offline.parts import Fact, Part, exactly, shown
from webgym.offline.website import slug

Site = SpecifiedWebsite


def go_to_item(site: Site, record: Record) -> tuple[Move, ...]:
    """Moves from any page to the page of an item, through the search."""
    return Fill(site.says["search"], record.name), Click(path=site.href(record))


def unfold(site: Site, title: str, *, is_first: bool = False) -> tuple[Move, ...]:
    """Moves that open a section of an item's page; none where it is open already."""
    if is_first or site.look.detail == "plain":
        return ()
    return (Click(name=title, role="tab" if site.look.detail == "tabs" else None),)


def read_bar(site: Site, record: Record, month: str) -> tuple[Move, ...]:
    """Moves that show the value of a month's bar on an item's page."""
    is_first = not site.sections() and not site.spec.rows
    return (
        *unfold(site, site.title_of("chart"), is_first=is_first),
        Click(name=month, role="button"),
        See((f"{month}: {site.chart(record)[month].text}",)),
    )


def view_fields(site: Site, record: Record, fields: Sequence[str]) -> tuple[Move, ...]:
    """Moves that bring each of these fields of an item into view on its page."""
    moves: list[Move] = []
    sections = site.sections()
    for section in ("", *sections):
        wanted = [field for field in fields if site.items.fields[field].section == section]
        if wanted and section:
            moves += unfold(site, site.says[section], is_first=section == sections[0])
        moves += [See(site.items.view(record, field)) for field in wanted]
    return tuple(moves)


def row_view(site: Site, record: Record, field: str) -> tuple[str, ...]:
    """The texts by which the list shows a field of an item: its name and all values up to the field, with
    their labels; those of a table are in its first line."""
    fields = site.card_fields()
    fields = fields[: fields.index(field) + 1]
    labels, values = site.items.labels, record.fields
    if site.look.listing != "table":
        return (" ".join((record.name, *(f"{labels[each]} {values[each].text}" for each in fields))),)
    heading = " ".join((site.spec.singular, *(labels[each] for each in fields)))
    return heading, " ".join((record.name, *(values[each].text for each in fields)))


def field_fact(site: Site, record: Record, field: str, *, about: str = "", in_answer: bool = True) -> Fact:
    """The fact that a field of an item was found, on its page or in the list; see
    :meth:`~webgym.offline.engine.records.Sheet.fact`."""
    fact = site.items.fact(record, field, exactly(site.href(record)), about=about, in_answer=in_answer)
    if field not in site.card_fields():
        return fact
    listed = shown(exactly(site.finder.path), *row_view(site, record, field))
    return replace(fact, evidence=(*fact.evidence, listed))


@dataclass(frozen=True)
class Subject:
    """An item that a task is about.

    Attributes:
        site: its website.
        record: the item.
        names_website: whether instructions name the website too, as tasks on several websites must.
    """

    site: Site
    record: Record
    names_website: bool = False

    @property
    def full_name(self) -> str:
        """Its name in instructions."""
        return f"{self.record.name} on {self.site.brand}" if self.names_website else self.record.name

    def fact(self, field: str, *, in_answer: bool = True) -> Fact:
        """The fact that a field of it was found; ``in_answer`` if the answer must contain the value."""
        fact = field_fact(self.site, self.record, field, about=self.full_name, in_answer=in_answer)
        if not self.names_website:
            return fact
        views = (msgspec.structs.replace(view, host=self.site.host) for view in fact.evidence)
        return replace(fact, evidence=tuple(views))

    def moves(self, field: str) -> tuple[Move, ...]:
        """The moves that bring a field of it into view."""
        there = (Home(self.site.start),) if self.names_website else ()
        return (*there, *go_to_item(self.site, self.record), *view_fields(self.site, self.record, [field]))


# --- look up and compare ----------------------------------------------------------------------------------


def ranked(site: Site, *kinds: str) -> list[str]:
    """The fields of these kinds; without kinds, all whose values can be ordered."""
    return [
        field
        for field in site.items.labels
        if site.items.fields[field].kind in (kinds or ("number", "money", "year", "minutes", "day"))
    ]


def facts(site: Site, rng: random.Random, size: int) -> Part | None:
    """Look up fields of an item."""
    if size > min(3, len(site.items.labels)):
        return None
    record, fields = rng.choice(site.items.records), site.items.draw_fields(rng, size)
    return Part(
        f"look up {site.items.nouns(fields)} of {record.name}",
        f"{record.name}: {site.items.nouns(fields)}",
        tuple(field_fact(site, record, field) for field in fields),
        (*go_to_item(site, record), *view_fields(site, record, fields)),
    )


def either(site: Site, rng: random.Random, size: int) -> Part | None:
    """Decide which of two values a choice field of an item has."""
    choices = [field for field in site.items.labels if len(site.items.options[field]) > 1]
    if size != 1 or not choices:
        return None
    record, field = rng.choice(site.items.records), rng.choice(choices)
    value = record.fields[field].text
    other = rng.choice([option for option in site.items.options[field] if option != value])
    one, two = rng.sample([value, other], 2)
    noun = site.items.fields[field].noun
    return Part(
        f'check whether the {noun} of {record.name} is "{one}" or "{two}"',
        f"{record.name}: {noun}",
        (field_fact(site, record, field),),
        (*go_to_item(site, record), *view_fields(site, record, [field])),
    )


def compare(site: Site, rng: random.Random, size: int) -> Part | None:
    """Compare a field of two items."""
    if size != 3:
        return None
    comparable = [field for field in site.items.labels if site.items.fields[field].least]
    field, is_most = rng.choice(comparable), rng.random() < 0.5
    first, second = rng.sample(site.items.records, 2)
    return comparison(Subject(site, first), Subject(site, second), field, is_most=is_most)


def comparison(first: Subject, second: Subject, field: str, *, is_most: bool) -> Part | None:
    """A part that compares a field of two items; ``None`` if the values are equal."""
    if first.record.rank(field) == second.record.rank(field):
        return None
    spec = first.site.items.fields[field]
    word = spec.most if is_most else spec.least
    best, other = sorted((first, second), key=lambda subject: subject.record.rank(field), reverse=is_most)
    named = Fact(
        f"The one with the {word} {spec.noun} is named",
        best.fact(field, in_answer=False).evidence,
        answer=(best.record.name,),
        what=f"the name of the one with the {word} {spec.noun}",
        wrong=(other.record.name,),
    )
    return Part(
        f"look up the {spec.noun} of both {first.full_name} and {second.full_name}, "
        f"and name only the one with the {word} {spec.noun}",
        f"{spec.noun}: {first.full_name} or {second.full_name}",
        (first.fact(field, in_answer=False), second.fact(field, in_answer=False), named),
        (*first.moves(field), *second.moves(field)),
    )


def difference(site: Site, rng: random.Random, size: int) -> Part | None:
    """Report a field of two items, and the difference."""
    fields = ranked(site, "money", "number", "minutes")
    if size != 3 or not fields:
        return None
    field = rng.choice(fields)
    first, second = rng.sample(site.items.records, 2)
    return numeric_difference(Subject(site, first), Subject(site, second), field)


def numeric_difference(first: Subject, second: Subject, field: str) -> Part | None:
    """A part on the difference of a field of two items; ``None`` if it is 0 or equals one of the values."""
    ranks = first.record.rank(field), second.record.rank(field)
    distance = int(abs(ranks[0] - ranks[1]))
    if distance in (0, *ranks):
        return None
    spec = first.site.items.fields[field]
    value = numeric_value(spec, distance, first.site.currency)
    facts = first.fact(field), second.fact(field)
    views = tuple(view for fact in facts for view in fact.evidence)
    return Part(
        f"report the {spec.noun} of {first.full_name} and of {second.full_name}, and the difference",
        f"{spec.noun} of {first.full_name} and {second.full_name}",
        (
            *facts,
            Fact(
                f"The difference in {spec.noun} is worked out",
                views,
                answer=value.options,
                what="the difference",
            ),
        ),
        (*first.moves(field), *second.moves(field)),
    )


# --- save and send ----------------------------------------------------------------------------------------


def save(site: Site, rng: random.Random, size: int) -> Part | None:
    """Save items."""
    if size > 3:
        return None
    chosen = rng.sample(site.items.records, size)
    whole_list = StateCheck(("saved",), {record.name: True for record in chosen})
    place, title = exactly(site.path("/~saved")), site.says["saved"]
    moves: list[Move] = []
    for record in chosen:
        moves += [
            *go_to_item(site, record),
            Click(name=site.says["save"], role="button"),
            See((title, record.name)),
        ]
    return Part(
        f"save {listed([record.name for record in chosen])} for later",
        f"Saved: {listed([record.name for record in chosen])}",
        tuple(
            Fact(
                f"{record.name} is saved",
                (shown(place, title, record.name),),
                (StateCheck(("saved", record.name), True), *((whole_list,) if not nth else ())),
            )
            for nth, record in enumerate(chosen)
        ),
        tuple(moves),
    )


def send(site: Site, rng: random.Random, size: int) -> Part | None:
    """Fill in and send a form, and say its reference number where ``size`` has room for one more fact."""
    fitting = [name for name, form in site.spec.forms.items() if size - len(form.inputs) in (0, 1)]
    if not fitting:
        return None
    name = rng.choice(fitting)
    form, record = site.spec.forms[name], rng.choice(site.items.records)
    values = {input_name: draw_value(site, spec, rng) for input_name, spec in form.inputs.items()}
    sent = fill_form(site, name, record, values, values)
    ask, facts, moves = sent.ask, list(sent.facts), list(sent.moves)
    if size > len(values):
        title, number = site.word(name, "reference"), site.reference(name, sent.about, values)
        view = shown(sent.place, title, number)
        what = f"the number of {sent.what}"
        facts.append(Fact(f"{first_up(what)} is given", (view,), answer=(number,), what=what))
        moves.append(See((title, number)))
        ask = f"{ask}; then give the number of the {form.thing}"
    return Part(ask, first_up(sent.what), tuple(facts), tuple(moves))


@dataclass(frozen=True)
class FilledForm:
    """The parts of a task that fills in and sends a form.

    Attributes:
        ask: the clause that asks for it.
        about: name of the item that the form is about; ``""`` for none.
        what: what is sent: ``"the booking for Millham Rock"``.
        place: regular expression for the address of the confirmation page.
        facts, moves: of the task.
    """

    ask: str
    about: str
    what: str
    place: str
    facts: tuple[Fact, ...]
    moves: tuple[Move, ...]


def fill_form(
    site: Site, name: str, record: Record, values: Mapping[str, str], wording: Mapping[str, str]
) -> FilledForm:
    """A task that fills in and sends a form.

    Args:
        site: the website.
        name: of the form.
        record: the item that it is about, if it is about one.
        values: to enter, by input.
        wording: what the instruction says for each value: the value, or a phrase that refers to it.
    """
    form = site.spec.forms[name]
    key, about = (slug(record.name), record.name) if form.is_about_item else ("", "")
    place = exactly(f"{site.address(name, key)}/done")
    what = f"the {form.thing}{f' for {about}' if about else ''}"
    all_sent = StateCheck(("sent",), {name: {about: dict(values)}})
    facts = [
        Fact(
            f"{first_up(what)} {form.inputs[input_name].said.format(value=wording[input_name])} is sent",
            (shown(place, site.input_label(name, input_name), value),),
            (StateCheck(("sent", name, about, input_name), value), *((all_sent,) if not nth else ())),
        )
        for nth, (input_name, value) in enumerate(values.items())
    ]
    clauses = listed(
        [form.inputs[input_name].said.format(value=value) for input_name, value in wording.items()]
    )
    moves: list[Move] = [*(go_to_item(site, record) if about else ()), Click(path=site.address(name, key))]
    for input_name, spec in form.inputs.items():
        moves += _enter(site, name, input_name, spec, values[input_name])
    moves += [Click(name=site.word(name, "send"), role="button"), See((site.word(name, "done"),))]
    moves += [See((site.input_label(name, input_name), value)) for input_name, value in values.items()]
    return FilledForm(
        f"{form.ask.format(item=about)} {clauses}", about, what, place, tuple(facts), tuple(moves)
    )


def draw_value(site: Site, spec: InputSpec, rng: random.Random) -> str:
    """What a task enters."""
    match spec.kind:
        case "person":
            return person(rng)
        case "email":
            first, last = person(rng).lower().split(" ")
            return f"{first}.{last}@{rng.choice(('mailbox', 'postal', 'letters'))}.example"
        case "phrase":
            return rng.choice(spec.options)
        case _:
            return rng.choice(site.choices(spec))


def _enter(site: Site, form: str, input_name: str, spec: InputSpec, value: str) -> Iterator[Move]:
    label = site.input_label(form, input_name)
    if spec.kind in TYPED or (spec.kind == "number" and site.has_sliders):
        yield Fill(label, value)
    elif spec.kind == "day" and site.has_calendar:
        yield Click(name=label, role="button")
        months = site.calendar(spec)
        months_ahead = next(nth for nth, (_, month) in enumerate(months) if _day(value, month))
        yield from [Click(name="Next month", role="button")] * months_ahead
        yield Click(name=value, role="button")
    else:
        yield Choose(label, value)


def _day(text: str, month: Sequence[date | None]) -> bool:
    return any(day is not None and days(day)[0] == text for day in month)
