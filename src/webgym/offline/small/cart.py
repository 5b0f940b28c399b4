"""A shopping cart: its state, and parts of tasks that add things to it."""

from __future__ import annotations

from collections import Counter
from typing import Any

from webgym.core.truth import Click, Evidence, Home, StateCheck
from webgym.offline.engine.table import Record
from webgym.offline.parts import Fact, Part
from webgym.offline.small.questions import Questions, answer_is, field_evidence
from webgym.offline.website import State

BUY = Click("buy")


def add(state: State, name: str) -> None:
    """Add one of a thing to a visitor's cart."""
    cart = state.setdefault("cart", {})
    cart[name] = cart.get(name, 0) + 1


def contents(state: State) -> dict[str, Any]:
    """The number of each thing in a visitor's cart."""
    return dict(Counter(state.get("cart", {})))


def bought_fact(record: Record, path: str) -> Fact:
    """The fact that the cart contains one of this thing, and nothing that the task does not ask for."""
    return Fact(
        f"the {record.name} is put in the cart",
        (Evidence((), path),),
        (StateCheck(("cart",), {record.name: 1}),),
    )


def buy(questions: Questions, record: Record) -> Part:
    """Add a thing to the cart. Placeholders: item."""
    location = questions.guide.locate(record)
    return Part(
        ask=questions.ask("buy", item=record.full_name),
        description=f"The {record.name} in the cart",
        facts=(bought_fact(record, location.path),),
        moves=(*location.moves, BUY),
    )


def buy_and_say(questions: Questions, record: Record, field: str) -> Part:
    """Add a thing to the cart and say the value of a field. Placeholders: item."""
    location, value = questions.guide.locate(record), record.fields[field]
    value_fact = Fact(
        f"the {field} of the {record.name} is given",
        (field_evidence(location, value),),
        answer=value.options,
        wrong=questions.wrong_answers(field, value.text),
    )
    return Part(
        ask=questions.ask("buy_and_say", item=record.full_name),
        description=f"The {record.name} in the cart, and its {field}",
        facts=(value_fact, bought_fact(record, location.path)),
        moves=(*location.moves, answer_is(value.text), BUY),
    )


def buy_smaller(questions: Questions, first: Record, second: Record, field: str) -> Part:
    """Add to the cart the one of two things with the smaller value. Placeholders: item, other."""
    facts, moves, winner = questions.compared(first, second, field, larger=False)
    location = questions.guide.locate(winner)
    if winner is not second:
        moves = (*moves, Home(), *location.moves)
    return Part(
        ask=questions.ask("buy_smaller", item=first.full_name, other=second.full_name),
        description=f"The one with the smaller {field} in the cart: {first.name} or {second.name}",
        facts=(*facts.values(), bought_fact(winner, location.path)),
        moves=(*moves, BUY),
    )
