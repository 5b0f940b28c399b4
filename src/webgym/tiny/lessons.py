"""What the tiny policy is taught from recorded attempts: where signs are, what they say, and what was done.

Two kinds of lessons are made of a run of the demonstrators. *Pointing*: a picture and several questions
about it in one sequence, ``red star = 250 375 , 583 125 = next``; without them a model this small never
learns to see. *Acting*: a step's request and reply, exactly as the agent asked and the demonstrator
answered.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from webgym.core.observation import Element, Observation
from webgym.core.trajectory import ImageRef, Message, TextPart, Trajectory
from webgym.inference.rendering import Renderer
from webgym.rollout.store import RunReader
from webgym.tiny.tokenizer import CELL, cell_centres

IGNORED = -100
"""The label of a token that is not learned."""


@dataclass(frozen=True, slots=True)
class Lesson:
    """A sequence.

    Attributes:
        picture: the screenshot's name.
        ids: tokens, the picture's expanded.
        labels: the tokens that are learned, :data:`IGNORED` elsewhere.
    """

    picture: str
    ids: tuple[int, ...]
    labels: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Signs:
    """What can be pointed at in a screenshot: names with the middles of their cells, each name once."""

    picture: str
    places: tuple[tuple[str, tuple[int, int]], ...]


def acting(run: Path, renderer: Renderer, image_tokens: int) -> list[Lesson]:
    """A lesson for every step of a run that holds an action.

    Args:
        run: a run folder.
        renderer: of the model.
        image_tokens: that every picture takes.
    """
    reader = RunReader(run)
    lessons = []
    for trajectory in reader.trajectories():
        for step in trajectory.episode.steps:
            if step.action is None:
                continue
            prompt = _prompt(step.messages, renderer, image_tokens)
            reply = renderer.tokenizer(step.reply.text, add_special_tokens=False)["input_ids"]
            target = [*reply, renderer.tokenizer.eos_token_id]
            labels = (IGNORED,) * len(prompt) + tuple(target)
            lessons.append(Lesson(step.observation.screenshot, (*prompt, *target), labels))
    return lessons


def signs_of(run: Path) -> list[Signs]:
    """Every screenshot of a run with what it shows, each once."""
    return list({seen.picture: seen for seen in _all_signs(RunReader(run).trajectories())}.values())


def _all_signs(trajectories: Iterable[Trajectory]) -> Iterable[Signs]:
    for trajectory in trajectories:
        for observation in trajectory.episode.observations:
            if places := _places(observation):
                yield Signs(observation.screenshot, places)


def _places(observation: Observation) -> tuple[tuple[str, tuple[int, int]], ...]:
    found: dict[str, tuple[int, int]] = {}
    doubled: set[str] = set()
    for element in observation.elements or ():
        if element.name in found:
            doubled.add(element.name)
        found[element.name] = _middle(element, observation.viewport)
    return tuple((name, place) for name, place in found.items() if name and name not in doubled)


def _middle(element: Element, viewport: tuple[int, int]) -> tuple[int, int]:
    x, y, width, height = element.box
    columns, rows = cell_centres(viewport[0]), cell_centres(viewport[1])
    column = min(int((x + min(width, CELL) / 2) // CELL), len(columns) - 1)
    row = min(int((y + min(height, CELL) / 2) // CELL), len(rows) - 1)
    return columns[column], rows[row]


def pointing(signs: Signs, renderer: Renderer, image_tokens: int, rng: random.Random, count: int) -> Lesson:
    """Questions about one screenshot: names to places, and places to names.

    Args:
        signs: of the screenshot.
        renderer: of the model.
        image_tokens: that every picture takes.
        rng: chooses the questions.
        count: how many.
    """
    tokens = renderer.tokenizer
    ids = list(_prompt(_asked(signs.picture), renderer, image_tokens))
    labels = [IGNORED] * len(ids)
    separator = tokens.convert_tokens_to_ids(",")
    for name, (x, y) in rng.choices(signs.places, k=count):
        sides = [f"{name} =", f"{x} {y}"] if rng.random() < 0.6 else [f"{x} {y} =", name]
        question, answer = (tokens(side, add_special_tokens=False)["input_ids"] for side in sides)
        ids += [*question, *answer, separator]
        labels += [*[IGNORED] * len(question), *answer, IGNORED]
    return Lesson(signs.picture, tuple(ids), tuple(labels))


def _asked(picture: str) -> tuple[Message, ...]:
    return (Message("user", (ImageRef(picture, CELL, CELL), TextPart("say"))),)


def _prompt(messages: Sequence[Message], renderer: Renderer, image_tokens: int) -> list[int]:
    ids: list[int] = []
    for token in renderer.tokenizer(renderer.text(messages), add_special_tokens=False)["input_ids"]:
        ids += [token] * (image_tokens if token == renderer.image_id else 1)
    return ids
