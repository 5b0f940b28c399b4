"""Desks: forms of choices, and pages that say what to choose."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, ClassVar
from urllib.parse import quote

from webgym.core.truth import Click, Move
from webgym.offline.data import load
from webgym.offline.engine.table import ListPage, Record, Shown, Value
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import number, pick, stream
from webgym.offline.small import form as forms
from webgym.offline.small.form import Form, Input, Wanted
from webgym.offline.small.questions import NAME, Phrases, Questions, answer_is
from webgym.offline.small.screen import Block, Tile, capacity, singles
from webgym.offline.small.signs import Sign, control, numbers
from webgym.offline.small.site import SmallWebsite
from webgym.offline.website import Response, State, Visit, page, redirect

KINDS = ("color", "icon", "number", "word")
INFO_PAGES = 3


class DeskPhrases(Phrases, frozen=True, forbid_unknown_fields=True):
    """How a desk's tasks are asked."""

    fill: tuple[str, ...] = ()
    fill_and_say: tuple[str, ...] = ()

    placeholders: ClassVar[dict[str, str]] = {
        **Phrases.placeholders,
        "fill": "form choices",
        "fill_and_say": "form choices",
    }


@lru_cache(maxsize=1)
def phrases() -> DeskPhrases:
    """How a desk's tasks are asked."""
    return load("webgym.offline.small", "desk.toml", DeskPhrases)


class Desk(SmallWebsite):
    """A website with forms.

    Attributes:
        forms: by name.
        infos: pages that say something, by name.
        in_steps: whether a form has a page for every input, or one page for all.
    """

    family: ClassVar[str] = "desk"
    topic: ClassVar[tuple[str, str]] = ("Misc.", "Legal & Government Services")
    forms: dict[str, Form]
    infos: dict[str, Record]
    in_steps: bool

    def fill(self) -> None:
        """Draw forms, and pages that say what could be chosen in them."""
        rng, stock = stream(self.seed, "desk"), self.design.stock
        self.in_steps = rng.random() < 0.5
        room = capacity(self.design.layout, 1) - 1
        everything: dict[str, Sequence[str]] = {
            "color": stock.colors,
            "icon": stock.icons,
            "number": numbers()[1:],
            "word": stock.words[8:],
        }
        options = {kind: tuple(rng.sample(list(everything[kind]), rng.randint(3, 5))) for kind in KINDS}
        words = list(stock.words[:7])
        self.forms = {}
        for size in rng.sample((1, 2, 2, 3, 3, 4), 3):
            kinds = rng.sample(KINDS, size)
            shares = room if self.in_steps else room // size
            inputs = tuple(Input(kind, options[kind][:shares]) for kind in kinds)
            form = Form(words.pop(), inputs)
            self.forms[form.name] = form
        # Every page says another thing of each kind, as far as there are options.
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
        """What an option looks like."""
        return {"color": Sign(color=option), "icon": Sign(icon=option)}.get(kind, Sign(text=option))

    def ticket(self, form: Form, sent: dict[str, str]) -> int:
        """The number that the page after sending shows: it cannot be known without having sent."""
        return 1 + number(self.seed, "ticket", form.name, sorted(sent.items())) % (len(numbers()) - 1)

    # --- the guide --------------------------------------------------------------------------------

    def way(self, record: Record) -> Shown:
        """A page that says something."""
        return Shown((Click(record.name),), f"/page/{self.token(record.name)}$")

    def pages(self, place: str) -> Sequence[ListPage]:
        """There are no lists."""
        raise NotImplementedError(place)

    def candidates(self, of: str) -> Sequence[str]:
        """All options of a kind."""
        stock = self.design.stock
        return {NAME: tuple(self.infos), "color": stock.colors, "icon": stock.icons, "word": stock.words}.get(
            of, numbers()
        )

    # --- pages ------------------------------------------------------------------------------------

    def report(self, state: State) -> dict[str, Any]:
        """What was sent."""
        return forms.report(state)

    @page("/")
    def front(self, visit: Visit) -> Response:
        """All forms and pages, mixed."""
        tiles = [Tile(Sign(text=name), self._form(name, 0)) for name in self.forms]
        tiles += [Tile(Sign(text=name), f"/page/{self.token(name)}") for name in self.infos]
        stream(self.seed, "front").shuffle(tiles)
        return self.show(visit, singles(tiles))

    @page("/page/{token}")
    def info_page(self, visit: Visit, token: str) -> Response:
        """What a page says."""
        record = next((each for each in self.infos.values() if self.token(each.name) == token), None)
        if record is None:
            return self.missing(visit)
        tiles = [Tile(self.sign(kind, value.text)) for kind, value in record.fields.items()]
        return self.show(visit, singles(tiles), mark=Sign(text=record.name))

    def _form(self, name: str, step: int) -> str:
        return f"/form/{self.token(name)}/{step}"

    def _asked(self, token: str) -> Form | None:
        return next((form for form in self.forms.values() if self.token(form.name) == token), None)

    @page("/form/{token}/{step}")
    def form_page(self, visit: Visit, token: str, step: str) -> Response:
        """One input, or all of them; then the button that sends."""
        form = self._asked(token)
        if form is None or not step.isdecimal() or int(step) > len(form.inputs):
            return self.missing(visit)
        at, draft = int(step), form.draft(visit.state)
        inputs = form.inputs[at : at + 1] if self.in_steps else form.inputs
        blocks: list[Block] = [
            (
                Tile(
                    self.sign(each.name, option),
                    post=f"/choose/{token}/{at}/{each.name}/{quote(option)}",
                    chosen=draft.get(each.name) == option,
                ),
            )
            for each in inputs
            for option in each.options
        ]
        if not inputs:  # all steps are done: what was chosen
            blocks += singles([Tile(self.sign(name, option)) for name, option in draft.items()])
        if not self.in_steps or not inputs:
            # Until everything is chosen, the button does nothing.
            send = f"/send/{token}" if form.is_complete(visit.state) else None
            blocks.append((Tile(control("send"), post=send),))
        return self.show(visit, blocks, mark=Sign(text=form.name))

    @page("/choose/{token}/{step}/{name}/{option}", method="POST")
    def choose(self, visit: Visit, token: str, step: str, name: str, option: str) -> Response:
        """Choose an option, and on to the next input where each has its page."""
        form = self._asked(token)
        if form is None or not step.isdecimal() or not form.choose(visit.state, name, option):
            return self.missing(visit)
        return redirect(self._form(form.name, int(step) + 1 if self.in_steps else 0))

    @page("/send/{token}", method="POST")
    def send(self, visit: Visit, token: str) -> Response:
        """Send the form."""
        form = self._asked(token)
        if form is None:
            return self.missing(visit)
        if not form.send(visit.state):
            return redirect(self._form(form.name, 0))
        return redirect(f"/sent/{token}")

    @page("/sent/{token}")
    def sent_page(self, visit: Visit, token: str) -> Response:
        """What was sent, and its number."""
        form = self._asked(token)
        sent = form.sent(visit.state) if form is not None else None
        if form is None or sent is None:
            return self.missing(visit)
        return self.show(
            visit, singles([Tile(Sign(text=str(self.ticket(form, sent))))]), mark=Sign(text=form.name)
        )

    # --- tasks ------------------------------------------------------------------------------------

    def parts(self) -> Iterator[Part]:
        """Fill forms; read pages."""
        rng = stream(self.seed, "parts")
        ask, infos = Questions(self, phrases(), rng), list(self.infos.values())
        seen = set[tuple[object, ...]]()
        for nth in range(30):
            form = list(self.forms.values())[nth % len(self.forms)]
            wanted = self._wanted(rng, form, reads=rng.random() < 0.4)
            key = (form.name, *(each.called for each in wanted))
            if key not in seen:
                seen.add(key)
                yield self._filled(ask, form, wanted, says=rng.random() < 0.35)
        for record in infos:
            for kind in record.fields:
                yield ask.look_up(record, kind)
        ranked = [record for record in infos if "number" in record.fields]
        for record in ranked:
            value = record.fields["number"].text
            yield ask.either(record, "number", rng.choice([each for each in numbers() if each != value]))
        for one, two in pairwise(ranked):
            if one.rank("number") != two.rank("number"):
                yield ask.compare(one, two, "number", larger=pick((True, False), self.seed, one.name))

    def _wanted(self, rng: random.Random, form: Form, *, reads: bool) -> list[Wanted]:
        """An option for every input; one of them is to be read on a page, where ``reads``."""
        wanted = [Wanted(each, rng.choice(each.options)) for each in form.inputs]
        readable = [
            (nth, record)
            for nth, each in enumerate(form.inputs)
            for record in self.infos.values()
            if each.name in record.fields and record.fields[each.name].text in each.options
        ]
        if reads and readable:
            nth, record = rng.choice(readable)
            asked = form.inputs[nth]
            wanted[nth] = Wanted(asked, record.fields[asked.name].text, record, self.way(record))
        return wanted

    def _filled(self, ask: Questions, form: Form, wanted: Sequence[Wanted], *, says: bool) -> Part:
        """A form filled and sent; its number, if that is asked for."""
        read, way = forms.looked_up(wanted)
        path = f"/sent/{self.token(form.name)}$"
        facts = [*read, *forms.chosen(form, wanted, path)]
        moves: list[Move] = [*way, Click(form.name), *(Click(each.option) for each in wanted), forms.SEND]
        number_ = str(self.ticket(form, {each.input.name: each.option for each in wanted}))
        if says:
            last = facts[-1]
            facts[-1] = Fact(
                f"{last.text}, and the number is given",
                tuple(type(view)((number_,), view.path) for view in last.evidence),
                last.state,
                (number_,),
                ask.others("number", number_),
            )
            moves.append(answer_is(number_))
        kind = "fill_and_say" if says else "fill"
        choices = " and ".join(each.called for each in wanted)
        return Part(
            ask=ask.ask(kind, form=form.name, choices=choices),
            description=f"The form {form.name}",
            facts=tuple(facts),
            moves=tuple(moves),
            says=number_ if says else "",
        )
