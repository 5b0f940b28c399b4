"""Forms of options: their server state, and the facts of tasks about them.

The pages that show a form belong to a website. A task gives the option of an input itself, or names another
page on which to read it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from webgym.core.truth import Click, Evidence, Home, Move, Remember, StateCheck
from webgym.offline.engine.table import Location, Record
from webgym.offline.parts import Fact
from webgym.offline.website import State

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
