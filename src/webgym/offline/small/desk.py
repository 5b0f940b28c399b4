"""Desks: forms of options, and pages that say which options to select.

A task gives the option of an input itself, or names another page on which to read it.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar
from urllib.parse import quote

from webgym.core.truth import Click, Evidence, Home, Move, Remember, StateCheck
from webgym.offline.engine.records import Record, Value
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import number, pick, stream
from webgym.offline.small.design import Sign, control, numbers
from webgym.offline.small.questions import (
    NAME,
    ListPage,
    Location,
    Questions,
    answer_is,
    field_evidence,
    phrases,
)
from webgym.offline.small.screen import Block, Tile, capacity, singles
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, State, Visit, page, redirect

SEND = Click("send")


@dataclass(frozen=True)
class Form:
    """A form.

    Attributes:
        name: its name on pages and in instructions.
        inputs: the options of its inputs, by name, in page order; a record may say the option in the field
            of this name.
    """

    name: str
    inputs: Mapping[str, tuple[str, ...]]

    def draft(self, state: State) -> dict[str, str]:
        """The options that a visitor has selected, by input."""
        draft: dict[str, str] = state.setdefault("draft", {}).setdefault(self.name, {})
        return draft

    def is_complete(self, state: State) -> bool:
        """Whether every input has a selected option."""
        return len(self.draft(state)) == len(self.inputs)


@dataclass(frozen=True)
class Selection:
    """The option that a task requests for an input.

    Attributes:
        input: name of the input.
        option: the option.
        source: the record that says the option in the field of the input's name; ``None`` if the task gives
            it.
    """

    input: str
    option: str
    source: Record | None = None

    @property
    def phrase(self) -> str:
        """What the instruction says: the option, or the record on which to read it."""
        return self.option if self.source is None else f"the {self.input} of {self.source.name}"


def sent_facts(form: Form, selections: Sequence[Selection], path: str) -> list[Fact]:
    """One fact per input: it was submitted with the requested option.

    Args:
        form: the form.
        selections: the options of its inputs.
        path: regular expression for the address of the confirmation page.
    """
    whole_form = StateCheck(("sent",), {form.name: {each.input: each.option for each in selections}})
    facts = []
    for nth, selection in enumerate(selections):
        input_check = StateCheck(("sent", form.name, selection.input), selection.option)
        # Once per form: nothing else was submitted, except the forms of other parts.
        state = (input_check, whole_form) if nth == 0 else (input_check,)
        text = f"the {selection.input} in {form.name} is sent as wanted"
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
            form = Form(words.pop(), {kind: options[kind][:limit] for kind in kinds})
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
        """The server state: submitted values by form and input."""
        return {"sent": state.get("sent", {})}

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
        inputs = list(form.inputs.items())
        inputs = inputs[index : index + 1] if self.in_steps else inputs
        blocks: list[Block] = [
            (
                Tile(
                    self.sign(name, option),
                    post=f"/choose/{token}/{index}/{name}/{quote(option)}",
                    chosen=draft.get(name) == option,
                ),
            )
            for name, options in inputs
            for option in options
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
        if form is None or not step.isdecimal() or option not in form.inputs.get(name, ()):
            return self.missing(visit)
        form.draft(visit.state)[name] = option
        return redirect(self._form_path(form.name, int(step) + 1 if self.in_steps else 0))

    @page("/send/{token}", method="POST")
    def send(self, visit: Visit, token: str) -> Response:
        """Submit the form, or go back to it if it is not complete."""
        form = self._form_of(token)
        if form is None:
            return self.missing(visit)
        if not form.is_complete(visit.state):
            return redirect(self._form_path(form.name, 0))
        visit.state.setdefault("sent", {})[form.name] = form.draft(visit.state)
        visit.state["draft"][form.name] = {}
        return redirect(f"/sent/{token}")

    @page("/sent/{token}")
    def sent_page(self, visit: Visit, token: str) -> Response:
        """The confirmation page, with the number of the submitted form."""
        form = self._form_of(token)
        sent = visit.state.get("sent", {}).get(form.name) if form is not None else None
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
        selections = [Selection(name, rng.choice(options)) for name, options in form.inputs.items()]
        readable = [
            (nth, Selection(name, record.fields[name].text, record))
            for nth, (name, options) in enumerate(form.inputs.items())
            for record in self.infos.values()
            if name in record.fields and record.fields[name].text in options
        ]
        if reads and readable:
            nth, selection = rng.choice(readable)
            selections[nth] = selection
        return selections

    def _look_up(self, selections: Sequence[Selection]) -> tuple[list[Fact], list[Move]]:
        """Facts and moves for reading the options that the task does not give; the moves end on the front
        page."""
        facts, moves = list[Fact](), list[Move]()
        for selection in selections:
            if selection.source is None:
                continue
            source, location = selection.source, self.locate(selection.source)
            view = field_evidence(location, source.fields[selection.input])
            facts.append(Fact(f"the {selection.input} of {source.name} is seen", (view,)))
            key = f"{source.name} {selection.input}"
            moves += [*location.moves, Remember(key, selection.option), Home()]
        return facts, moves

    def _part(self, questions: Questions, form: Form, selections: Sequence[Selection], *, says: bool) -> Part:
        """Submit a form; if ``says``, also say its number."""
        facts_read, moves_read = self._look_up(selections)
        path = f"/sent/{self.token(form.name)}$"
        facts = [*facts_read, *sent_facts(form, selections, path)]
        moves: list[Move] = [
            *moves_read,
            Click(form.name),
            *(Click(selection.option) for selection in selections),
            SEND,
        ]
        ticket = str(self.ticket(form, {selection.input: selection.option for selection in selections}))
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
