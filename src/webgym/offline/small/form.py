"""A form as a specification: what is chosen, what the server holds, and how it is proven.

The pages that show a form's inputs belong to a website; what they do to a visitor's state, and what a task
can ask of it, is here. What is asked for may be told outright or have to be read on another page first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from webgym.core.truth import Click, Evidence, Home, Move, Remember, StateCheck
from webgym.offline.engine.table import Record, Shown
from webgym.offline.parts import Fact
from webgym.offline.website import State

SEND = Click("send")


@dataclass(frozen=True)
class Input:
    """One thing to choose.

    Attributes:
        name: of the input, and of the field of a record that an answer may be read from.
        options: to choose from.
    """

    name: str
    options: tuple[str, ...]


@dataclass(frozen=True)
class Form:
    """A form of choices.

    Attributes:
        name: as pages and instructions call it.
        inputs: in the order of the page.
    """

    name: str
    inputs: tuple[Input, ...]

    def input(self, name: str) -> Input | None:
        """The input of this name, if there is one."""
        return next((each for each in self.inputs if each.name == name), None)

    # --- a visitor's state ------------------------------------------------------------------------

    def draft(self, state: State) -> dict[str, str]:
        """What is chosen so far."""
        found: dict[str, str] = state.setdefault("draft", {}).setdefault(self.name, {})
        return found

    def choose(self, state: State, name: str, option: str) -> bool:
        """Choose an option; whether there is such a one."""
        found = self.input(name)
        if found is None or option not in found.options:
            return False
        self.draft(state)[name] = option
        return True

    def is_complete(self, state: State) -> bool:
        """Whether everything is chosen."""
        return len(self.draft(state)) == len(self.inputs)

    def send(self, state: State) -> bool:
        """Send what is chosen, if that is everything; the draft is empty afterwards."""
        if not self.is_complete(state):
            return False
        state.setdefault("sent", {})[self.name] = self.draft(state)
        state["draft"][self.name] = {}
        return True

    def sent(self, state: State) -> dict[str, str] | None:
        """What was sent last."""
        found: dict[str, str] | None = state.get("sent", {}).get(self.name)
        return found


def report(state: State) -> dict[str, Any]:
    """What the server holds of all forms: what was sent, by form and input."""
    return {"sent": state.get("sent", {})}


@dataclass(frozen=True)
class Wanted:
    """What a task wants in an input.

    Attributes:
        input: the input.
        option: to be chosen.
        source: the record whose field of the input's name says so, where the task does not.
        shown: where that record can be seen.
    """

    input: Input
    option: str
    source: Record | None = None
    shown: Shown | None = None

    @property
    def called(self) -> str:
        """What the instruction says: the option, or where it can be read."""
        return self.option if self.source is None else f"the {self.input.name} of {self.source.name}"


def looked_up(wanted: Sequence[Wanted]) -> tuple[list[Fact], list[Move]]:
    """Reading what the task does not say: facts, and moves that end on the front page."""
    facts, moves = list[Fact](), list[Move]()
    for each in wanted:
        if each.source is None or each.shown is None:
            continue
        value = each.source.fields[each.input.name]
        texts = (value.text,) if value.is_text else ()
        facts.append(
            Fact(f"the {each.input.name} of {each.source.name} is seen", (Evidence(texts, each.shown.path),))
        )
        key = f"{each.source.name} {each.input.name}"
        moves += [*each.shown.moves, Remember(key, each.option), Home()]
    return facts, moves


def chosen(form: Form, wanted: Sequence[Wanted], path: str) -> list[Fact]:
    """One fact for every input: it was sent with the wanted option.

    Args:
        form: the form.
        wanted: what its inputs must hold.
        path: of the page that says that it was sent.
    """
    everything = StateCheck(("sent",), {form.name: {each.input.name: each.option for each in wanted}})
    facts = []
    for nth, each in enumerate(wanted):
        own = StateCheck(("sent", form.name, each.input.name), each.option)
        # Once per form: what is sent is this and nothing else, but for other parts' forms.
        state = (own, everything) if nth == 0 else (own,)
        text = f"the {each.input.name} in {form.name} is sent as wanted"
        facts.append(Fact(text, (Evidence((), path),), state))
    return facts
