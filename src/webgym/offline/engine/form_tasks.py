"""Tasks that change what a specified website stores: save items, fill in and send forms."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date

from webgym.core.truth import Choose, Click, Fill, Move, See, StateCheck
from webgym.offline.engine.navigation import Site, go_to_item
from webgym.offline.engine.spec import TYPED, InputSpec
from webgym.offline.engine.spelling import days, first_up, listed
from webgym.offline.engine.table import Record
from webgym.offline.names import person
from webgym.offline.parts import Fact, Part, exactly, shown
from webgym.offline.website import slug


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
