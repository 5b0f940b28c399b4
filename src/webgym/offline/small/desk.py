"""Desks: forms of options, and pages that say which options to select.

A task gives the option of an input itself, or names another page on which to read it.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar
from urllib.parse import quote

from webgym.core.truth import Click, Evidence, Home, Move, Remember, StateCheck
from webgym.offline.engine.records import Record, Value
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import number, pick, stream
from webgym.offline.small.design import Sign, control, numbers
from webgym.offline.small.questions import NAME, ListPage, Location, Questions, answer_is, phrases
from webgym.offline.small.screen import Block, Tile, capacity, singles
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, State, Visit, page, redirect

SEND = Click("send")


@dataclass(frozen=True)
class Input:
    """An input of a form.

    Attributes:
        name: its name; a record may say the option in the field of this name.
        options: its options.
    """

    name: str
    options: tuple[str, ...]


@dataclass(frozen=True)
class Form:
    """A form.

    Attributes:
        name: its name on pages and in instructions.
        inputs: its inputs, in page order.
    """

    name: str
    inputs: tuple[Input, ...]

    def input(self, name: str) -> Input | None:
        """The input of this name, or ``None``."""
        return next((item for item in self.inputs if item.name == name), None)

    # --- a visitor's state ------------------------------------------------------------------------

    def draft(self, state: State) -> dict[str, str]:
        """The selected options, by input."""
        draft: dict[str, str] = state.setdefault("draft", {}).setdefault(self.name, {})
        return draft

    def choose(self, state: State, name: str, option: str) -> bool:
        """Select an option; return whether the input has it."""
        item = self.input(name)
        if item is None or option not in item.options:
            return False
        self.draft(state)[name] = option
        return True

    def is_complete(self, state: State) -> bool:
        """Whether every input has a selected option."""
        return len(self.draft(state)) == len(self.inputs)

    def send(self, state: State) -> bool:
        """Submit the form if it is complete, and clear its draft; return whether it was submitted."""
        if not self.is_complete(state):
            return False
        state.setdefault("sent", {})[self.name] = self.draft(state)
        state["draft"][self.name] = {}
        return True

    def sent(self, state: State) -> dict[str, str] | None:
        """The values submitted last, by input; ``None`` if there are none."""
        values: dict[str, str] | None = state.get("sent", {}).get(self.name)
        return values


def report(state: State) -> dict[str, Any]:
    """The server state of all forms: submitted values by form and input."""
    return {"sent": state.get("sent", {})}


@dataclass(frozen=True)
class Selection:
    """The option that a task requests for an input.

    Attributes:
        input: the input.
        option: the option.
        source: the record that says the option in the field of the input's name; ``None`` if the task gives
            it.
        location: where that record can be seen.
    """

    input: Input
    option: str
    source: Record | None = None
    location: Location | None = None

    @property
    def phrase(self) -> str:
        """What the instruction says: the option, or the record on which to read it."""
        return self.option if self.source is None else f"the {self.input.name} of {self.source.name}"


def look_up_facts(selections: Sequence[Selection]) -> tuple[list[Fact], list[Move]]:
    """Facts and moves for reading the options that the task does not give; the moves end on the front
    page."""
    facts, moves = list[Fact](), list[Move]()
    for selection in selections:
        if selection.source is None or selection.location is None:
            continue
        value = selection.source.fields[selection.input.name]
        texts = (value.text,) if value.is_text else ()
        facts.append(
            Fact(
                f"the {selection.input.name} of {selection.source.name} is seen",
                (Evidence(texts, selection.location.path),),
            )
        )
        key = f"{selection.source.name} {selection.input.name}"
        moves += [*selection.location.moves, Remember(key, selection.option), Home()]
    return facts, moves


def sent_facts(form: Form, selections: Sequence[Selection], path: str) -> list[Fact]:
    """One fact per input: it was submitted with the requested option.

    Args:
        form: the form.
        selections: the options of its inputs.
        path: regular expression for the address of the confirmation page.
    """
    whole_form = StateCheck(
        ("sent",), {form.name: {selection.input.name: selection.option for selection in selections}}
    )
    facts = []
    for nth, selection in enumerate(selections):
        input_check = StateCheck(("sent", form.name, selection.input.name), selection.option)
        # Once per form: nothing else was submitted, except the forms of other parts.
        state = (input_check, whole_form) if nth == 0 else (input_check,)
        text = f"the {selection.input.name} in {form.name} is sent as wanted"
        facts.append(Fact(text, (Evidence((), path),), state))
    return facts


KINDS = ("color", "icon", "number", "word")
INFO_PAGES = 3


class Desk(SmallWebsite):
    """A website with forms.

    Attributes:
        forms: the forms, by name.
        infos: records of the information pages, by name.
        in_steps: whether every input of a form has a page of its own; if not, all are on one page.
    """

    family: ClassVar[str] = "desk"
    topic: ClassVar[tuple[str, str]] = ("Misc.", "Legal & Government Services")
    forms: dict[str, Form]
    infos: dict[str, Record]
    in_steps: bool

    def fill(self) -> None:
        """Draw the forms, and the information pages with options of their inputs."""
        rng, stock = stream(self.seed, "desk"), self.design.stock
        self.in_steps = rng.random() < 0.5
        room = capacity(self.design.layout, 1) - 1
        all_options: dict[str, Sequence[str]] = {
            "color": stock.colors,
            "icon": stock.icons,
            "number": numbers()[1:],
            "word": stock.words[8:],
        }
        options = {kind: tuple(rng.sample(list(all_options[kind]), rng.randint(3, 5))) for kind in KINDS}
        words = list(stock.words[:7])
        self.forms = {}
        for size in rng.sample((1, 2, 2, 3, 3, 4), 3):
            kinds = rng.sample(KINDS, size)
            limit = room if self.in_steps else room // size
            inputs = tuple(Input(kind, options[kind][:limit]) for kind in kinds)
            form = Form(words.pop(), inputs)
            self.forms[form.name] = form
        # Every page has a different option of each kind, as far as there are enough.
        self.infos = {}
        for nth in range(INFO_PAGES):
            values = {kind: options[kind][nth % min(3, len(options[kind]))] for kind in KINDS}
            name = words.pop()
            shown = rng.sample(KINDS, rng.randint(2, 3))
            self.infos[name] = Record(
                name,
                {
                    kind: Value(
                        values[kind],
                        rank=int(values[kind]) if kind == "number" else None,
                        is_text=kind in ("number", "word"),
                    )
                    for kind in shown
                },
            )

    @staticmethod
    def sign(kind: str, option: str) -> Sign:
        """The sign of an option."""
        return {"color": Sign(color=option), "icon": Sign(icon=option)}.get(kind, Sign(text=option))

    def ticket(self, form: Form, sent: dict[str, str]) -> int:
        """The number of a submitted form; only the confirmation page shows it."""
        return 1 + number(self.seed, "ticket", form.name, sorted(sent.items())) % (len(numbers()) - 1)

    # --- where records are --------------------------------------------------------------------------------

    def locate(self, record: Record) -> Location:
        """The information page of a record."""
        return Location((Click(record.name),), f"/page/{self.token(record.name)}$")

    def pages(self, place: str) -> Sequence[ListPage]:
        """Not available: a desk has no lists."""
        raise NotImplementedError(place)

    def candidates(self, field: str) -> Sequence[str]:
        """All possible options of a kind; for names, the names of all information pages."""
        stock = self.design.stock
        return {NAME: tuple(self.infos), "color": stock.colors, "icon": stock.icons, "word": stock.words}.get(
            field, numbers()
        )

    # --- pages ------------------------------------------------------------------------------------

    def report(self, state: State) -> dict[str, Any]:
        """The server state: submitted forms."""
        return report(state)

    @page("/")
    def front(self, visit: Visit) -> Response:
        """The front page: all forms and information pages, in random order."""
        tiles = [Tile(Sign(text=name), self._form_path(name, 0)) for name in self.forms]
        tiles += [Tile(Sign(text=name), f"/page/{self.token(name)}") for name in self.infos]
        stream(self.seed, "front").shuffle(tiles)
        return self.show(visit, singles(tiles))

    @page("/page/{token}")
    def info_page(self, visit: Visit, token: str) -> Response:
        """An information page."""
        record = next((record for record in self.infos.values() if self.token(record.name) == token), None)
        if record is None:
            return self.missing(visit)
        tiles = [Tile(self.sign(kind, value.text)) for kind, value in record.fields.items()]
        return self.show(visit, singles(tiles), mark=Sign(text=record.name))

    def _form_path(self, name: str, step: int) -> str:
        return f"/form/{self.token(name)}/{step}"

    def _form_of(self, token: str) -> Form | None:
        return next((form for form in self.forms.values() if self.token(form.name) == token), None)

    @page("/form/{token}/{step}")
    def form_page(self, visit: Visit, token: str, step: str) -> Response:
        """One input, or all; the submit button is on the last page."""
        form = self._form_of(token)
        if form is None or not step.isdecimal() or int(step) > len(form.inputs):
            return self.missing(visit)
        index, draft = int(step), form.draft(visit.state)
        inputs = form.inputs[index : index + 1] if self.in_steps else form.inputs
        blocks: list[Block] = [
            (
                Tile(
                    self.sign(form_input.name, option),
                    post=f"/choose/{token}/{index}/{form_input.name}/{quote(option)}",
                    chosen=draft.get(form_input.name) == option,
                ),
            )
            for form_input in inputs
            for option in form_input.options
        ]
        if not inputs:  # after the last step: the selected options
            blocks += singles([Tile(self.sign(name, option)) for name, option in draft.items()])
        if not self.in_steps or not inputs:
            # The button does nothing until the form is complete.
            send = f"/send/{token}" if form.is_complete(visit.state) else None
            blocks.append((Tile(control("send"), post=send),))
        return self.show(visit, blocks, mark=Sign(text=form.name))

    @page("/choose/{token}/{step}/{name}/{option}", method="POST")
    def choose(self, visit: Visit, token: str, step: str, name: str, option: str) -> Response:
        """Select an option, and go to the next input if each has a page of its own."""
        form = self._form_of(token)
        if form is None or not step.isdecimal() or not form.choose(visit.state, name, option):
            return self.missing(visit)
        return redirect(self._form_path(form.name, int(step) + 1 if self.in_steps else 0))

    @page("/send/{token}", method="POST")
    def send(self, visit: Visit, token: str) -> Response:
        """Submit the form, or go back to it if it is not complete."""
        form = self._form_of(token)
        if form is None:
            return self.missing(visit)
        if not form.send(visit.state):
            return redirect(self._form_path(form.name, 0))
        return redirect(f"/sent/{token}")

    @page("/sent/{token}")
    def sent_page(self, visit: Visit, token: str) -> Response:
        """The confirmation page, with the number of the submitted form."""
        form = self._form_of(token)
        sent = form.sent(visit.state) if form is not None else None
        if form is None or sent is None:
            return self.missing(visit)
        return self.show(
            visit, singles([Tile(Sign(text=str(self.ticket(form, sent))))]), mark=Sign(text=form.name)
        )

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Parts that submit forms, and parts that read information pages."""
        rng = stream(self.seed, "parts")
        questions, infos = Questions(self, phrases(self.family), rng), list(self.infos.values())
        used_keys = set[tuple[object, ...]]()
        for nth in range(30):
            form = list(self.forms.values())[nth % len(self.forms)]
            selections = self._selections(rng, form, reads=rng.random() < 0.4)
            key = (form.name, *(selection.phrase for selection in selections))
            if key not in used_keys:
                used_keys.add(key)
                yield self._part(questions, form, selections, says=rng.random() < 0.35)
        for record in infos:
            for kind in record.fields:
                yield questions.look_up(record, kind)
        ranked = [record for record in infos if "number" in record.fields]
        for record in ranked:
            value = record.fields["number"].text
            yield questions.either(
                record, "number", rng.choice([other for other in numbers() if other != value])
            )
        for first, second in pairwise(ranked):
            if first.rank("number") != second.rank("number"):
                yield questions.compare(
                    first, second, "number", larger=pick((True, False), self.seed, first.name)
                )

    def _selections(self, rng: random.Random, form: Form, *, reads: bool) -> list[Selection]:
        """Draw an option for every input; if ``reads``, one of them must be read on an information page if
        possible."""
        selections = [Selection(form_input, rng.choice(form_input.options)) for form_input in form.inputs]
        readable = [
            (nth, record)
            for nth, form_input in enumerate(form.inputs)
            for record in self.infos.values()
            if form_input.name in record.fields and record.fields[form_input.name].text in form_input.options
        ]
        if reads and readable:
            nth, record = rng.choice(readable)
            chosen_input = form.inputs[nth]
            selections[nth] = Selection(
                chosen_input, record.fields[chosen_input.name].text, record, self.locate(record)
            )
        return selections

    def _part(self, questions: Questions, form: Form, selections: Sequence[Selection], *, says: bool) -> Part:
        """Submit a form; if ``says``, also say its number."""
        facts_read, moves_read = look_up_facts(selections)
        path = f"/sent/{self.token(form.name)}$"
        facts = [*facts_read, *sent_facts(form, selections, path)]
        moves: list[Move] = [
            *moves_read,
            Click(form.name),
            *(Click(selection.option) for selection in selections),
            SEND,
        ]
        ticket = str(self.ticket(form, {selection.input.name: selection.option for selection in selections}))
        if says:
            last = facts[-1]
            facts[-1] = Fact(
                f"{last.text}, and the number is given",
                tuple(type(view)((ticket,), view.path) for view in last.evidence),
                last.state,
                answer=(ticket,),
                wrong=questions.wrong_answers("number", ticket),
            )
            moves.append(answer_is(ticket))
        kind = "fill_and_say" if says else "fill"
        choices = " and ".join(selection.phrase for selection in selections)
        return Part(
            ask=questions.ask(kind, form=form.name, choices=choices),
            description=f"The form {form.name}",
            facts=tuple(facts),
            moves=tuple(moves),
        )
