"""A cart: what is put into it, and how that is proven."""

from __future__ import annotations

from collections import Counter
from typing import Any

from webgym.core.truth import Click, Evidence, Home, StateCheck
from webgym.offline.engine.table import Record
from webgym.offline.parts import Fact, Part
from webgym.offline.small.questions import Questions, answer_is, seen
from webgym.offline.website import State

BUY = Click("buy")


def put(state: State, name: str) -> None:
    """Put one more of a thing into a visitor's cart."""
    cart = state.setdefault("cart", {})
    cart[name] = cart.get(name, 0) + 1


def held(state: State) -> dict[str, Any]:
    """What a visitor's cart holds: how many of what."""
    return dict(Counter(state.get("cart", {})))


def bought(record: Record, path: str) -> Fact:
    """The cart holds one of this record, and nothing that the task does not ask for."""
    return Fact(
        f"the {record.name} is put in the cart",
        (Evidence((), path),),
        (StateCheck(("cart",), {record.name: 1}),),
    )


def buy(questions: Questions, record: Record) -> Part:
    """Put a thing in the cart. Placeholders: item."""
    shown = questions.guide.way(record)
    return Part(
        ask=questions.ask("buy", item=record.called),
        description=f"The {record.name} in the cart",
        facts=(bought(record, shown.path),),
        moves=(*shown.moves, BUY),
    )


def buy_and_say(questions: Questions, record: Record, of: str) -> Part:
    """Put a thing in the cart and say its value. Placeholders: item."""
    shown, value = questions.guide.way(record), record.fields[of]
    said = Fact(
        f"the {of} of the {record.name} is given",
        (seen(shown, value),),
        answer=value.options,
        wrong=questions.others(of, value.text),
    )
    return Part(
        ask=questions.ask("buy_and_say", item=record.called),
        description=f"The {record.name} in the cart, and its {of}",
        facts=(said, bought(record, shown.path)),
        moves=(*shown.moves, answer_is(value.text), BUY),
        says=value.text,
    )


def buy_smaller(questions: Questions, first: Record, second: Record, of: str) -> Part:
    """Put the one with the smaller value in the cart. Placeholders: item, other."""
    looked, moves, winner = questions.compared(first, second, of, larger=False)
    shown = questions.guide.way(winner)
    if winner is not second:
        moves = (*moves, Home(), *shown.moves)
    return Part(
        ask=questions.ask("buy_smaller", item=first.called, other=second.called),
        description=f"The one with the smaller {of} in the cart: {first.name} or {second.name}",
        facts=(*looked.values(), bought(winner, shown.path)),
        moves=(*moves, BUY),
    )
