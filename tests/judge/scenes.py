"""Small episodes with real pictures."""

from __future__ import annotations

import functools
import hashlib
import io
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
from PIL import Image, ImageDraw

from webgym.core.action import Action, Answer, LeftClick, Navigate, Target
from webgym.core.observation import Observation
from webgym.core.outcome import Ending
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode, Reply, Step
from webgym.judge.verdicts import NoVerdict, lines_of

SIZE = (320, 192)

TASK = Task(
    id="shop/mug",
    instruction="Find the Blue Mug and say what it costs.",
    website="https://mugs.example/",
    domain="Lifestyle & Leisure",
    subdomain="Shopping",
    rubric=Rubric(
        (
            FactGroup(1, "The Blue Mug", ("The Blue Mug's page is opened", "Its price is found")),
            FactGroup(2, "The cart", ("The cart holds a mug OR a plate",)),
        )
    ),
    source="made-up",
)

PICTURES: dict[str, bytes] = {}


@functools.cache
def picture(text: str) -> str:
    """The name of a picture with this text on it."""
    image = Image.new("RGB", SIZE, "white")
    ImageDraw.Draw(image).text((10, 10), text, fill="black")
    out = io.BytesIO()
    image.save(out, "PNG")
    name = hashlib.sha256(out.getvalue()).hexdigest()
    PICTURES[name] = out.getvalue()
    return name


async def pictures(name: str) -> bytes:
    return PICTURES[name]


def reads(
    read: Callable[..., Any], text: str, *given: Any, finish_reason: str = "", refusal: str = "", **more: Any
) -> Any:
    """What is read of a reply that ended so."""
    lines = lines_of(text, finish_reason, refusal)
    return lines if isinstance(lines, NoVerdict) else read(lines, *given, **more)


def look(text: str, **more: Any) -> Observation:
    fields: dict[str, Any] = {
        "url": "https://mugs.example/",
        "title": "Mugs",
        "viewport": SIZE,
        "status": 200,
        "text": text,
    }
    return Observation(screenshot=picture(text), **fields | more)


def episode(
    seen: Sequence[str | Observation] = ("front", "mug $12.50", "cart"),
    answer: str | None = "The Blue Mug costs $12.50.",
    **more: Any,
) -> Episode:
    """An episode that looked at these, clicked in between, and answered at the last."""
    looks = [each if isinstance(each, Observation) else look(each) for each in seen]
    click: Action = LeftClick(Target(coordinate=(500, 500)))
    steps = []
    for index, observation in enumerate(looks):
        is_last = index == len(looks) - 1
        action = Answer(answer) if is_last and answer is not None else click
        steps.append(Step(index, observation, (), Reply("...", policy="test"), action, changed=True))
    ending = Ending.ANSWERED if answer is not None else Ending.BUDGET_SPENT
    fields: dict[str, Any] = {
        "attempt_id": "shop/mug#0.0",
        "task_id": "shop/mug",
        "sample": 0,
        "retry": 0,
        "seed": 1,
        "policy": "test",
        "started_at": 0.0,
        "seconds": 1.0,
        "steps": tuple(steps),
        "ending": ending,
        "answer": answer,
    }
    return Episode(**fields | more)


def opened_twice(seen: Observation, again: Observation, answer: str | None = "I was kept out.") -> Episode:
    """An episode that opened the front page again, saw no more, and answered."""
    made = episode([seen, again], answer)
    first = msgspec.structs.replace(made.steps[0], action=Navigate(TASK.website))
    return msgspec.structs.replace(made, steps=(first, *made.steps[1:]))
