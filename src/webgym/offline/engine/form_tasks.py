"""What is asked to be done on a specified website: items saved, forms filled in and sent."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date

from webgym.core.truth import Choose, Click, Fill, Move, See, StateCheck
from webgym.offline.engine.navigation import Site, go
from webgym.offline.engine.spec import TYPED, InputSpec
from webgym.offline.engine.spelling import days, first_up, listed
from webgym.offline.engine.table import Record
from webgym.offline.names import person
from webgym.offline.parts import Fact, Part, exactly, shown
from webgym.offline.website import slug


def save(site: Site, rng: random.Random, size: int) -> Part | None:
    """Some items on the saved list."""
    if size > 3:
        return None
    chosen = rng.sample(site.items.records, size)
    held = StateCheck(("saved",), {record.name: True for record in chosen})
    place, title = exactly(site.path("/~saved")), site.says["saved"]
    moves: list[Move] = []
    for record in chosen:
        moves += [*go(site, record), Click(name=site.says["save"], role="button"), See((title, record.name))]
    return Part(
        f"save {listed([record.name for record in chosen])} for later",
        f"Saved: {listed([record.name for record in chosen])}",
        tuple(
            Fact(
                f"{record.name} is saved",
                (shown(place, title, record.name),),
                (StateCheck(("saved", record.name), True), *((held,) if not nth else ())),
            )
            for nth, record in enumerate(chosen)
        ),
        tuple(moves),
    )


def send(site: Site, rng: random.Random, size: int) -> Part | None:
    """A form, filled in and sent; with the number of what was sent, where one more fact is wanted."""
    fitting = [name for name, form in site.spec.forms.items() if size - len(form.inputs) in (0, 1)]
    if not fitting:
        return None
    name = rng.choice(fitting)
    form, record = site.spec.forms[name], rng.choice(site.items.records)
    values = {of: entry(site, given, rng) for of, given in form.inputs.items()}
    sent = filled(site, name, record, values, values)
    ask, facts, moves, says = sent.ask, list(sent.facts), list(sent.moves), ""
    if size > len(values):
        title, number = site.word(name, "reference"), site.reference(name, sent.about, values)
        view = shown(sent.place, title, number)
        facts.append(Fact(f"The number of {sent.what} is given", (view,), answer=(number,)))
        moves.append(See((title, number)))
        ask, says = f"{ask}; then give the number of the {form.thing}", f"The number is {number}."
    return Part(ask, first_up(sent.what), tuple(facts), tuple(moves), says)


@dataclass(frozen=True)
class Filled:
    """A form that is filled in and sent.

    Attributes:
        ask: the clause that asks for it.
        about: name of the item that it is about; ``""`` for none.
        what: ``"the booking for Millham Rock"``.
        place: pattern of the address that shows what was sent.
        facts, moves: of it.
    """

    ask: str
    about: str
    what: str
    place: str
    facts: tuple[Fact, ...]
    moves: tuple[Move, ...]


def filled(
    site: Site, name: str, record: Record, values: Mapping[str, str], called: Mapping[str, str]
) -> Filled:
    """A form, filled in and sent.

    Args:
        site: the website.
        name: of the form.
        record: the item that it is about, if it is about one.
        values: to enter, by input.
        called: what the task calls each value: the value, or words from which it is found out.
    """
    form = site.spec.forms[name]
    key, about = (slug(record.name), record.name) if form.is_about_item else ("", "")
    place = exactly(f"{site.address(name, key)}/done")
    what = f"the {form.thing}{f' for {about}' if about else ''}"
    everything = StateCheck(("sent", name), {about: dict(values)})
    facts = [
        Fact(
            f"{first_up(what)} {form.inputs[of].said.format(value=called[of])} is sent",
            (shown(place, site.input_label(name, of), value),),
            (StateCheck(("sent", name, about, of), value), *((everything,) if not nth else ())),
        )
        for nth, (of, value) in enumerate(values.items())
    ]
    said = listed([form.inputs[of].said.format(value=value) for of, value in called.items()])
    moves: list[Move] = [*(go(site, record) if about else ()), Click(path=site.address(name, key))]
    for of, given in form.inputs.items():
        moves += _enter(site, name, of, given, values[of])
    moves += [Click(name=site.word(name, "send"), role="button"), See((site.word(name, "done"),))]
    moves += [See((site.input_label(name, of), value)) for of, value in values.items()]
    return Filled(f"{form.ask.format(item=about)} {said}", about, what, place, tuple(facts), tuple(moves))


def entry(site: Site, given: InputSpec, rng: random.Random) -> str:
    """What a task enters."""
    match given.kind:
        case "person":
            return person(rng)
        case "email":
            first, last = person(rng).lower().split(" ")
            return f"{first}.{last}@{rng.choice(('mailbox', 'postal', 'letters'))}.example"
        case "phrase":
            return rng.choice(given.options)
        case _:
            return rng.choice(site.choices(given))


def _enter(site: Site, form: str, of: str, given: InputSpec, value: str) -> Iterator[Move]:
    label = site.input_label(form, of)
    if given.kind in TYPED or (given.kind == "number" and site.has_sliders):
        yield Fill(label, value)
    elif given.kind == "day" and site.has_calendar:
        yield Click(name=label, role="button")
        months = site.calendar(given)
        at = next(nth for nth, (_, month) in enumerate(months) if _day(value, month))
        yield from [Click(name="Next month", role="button")] * at
        yield Click(name=value, role="button")
    else:
        yield Choose(label, value)


def _day(text: str, month: Sequence[date | None]) -> bool:
    return any(day is not None and days(day)[0] == text for day in month)
