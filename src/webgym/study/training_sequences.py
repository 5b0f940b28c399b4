"""Training sequences for the tiny policy, made from recorded attempts of demonstrators.

There are two kinds. *Pointing*: a picture and several questions about it in one sequence,
``red star = 250 375 , 583 125 = next , jam or home or 7 = home``; without them a model this small does not
learn to relate pictures to text. *Acting*: the unchanged request and reply of a demonstrator's step.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import msgspec

from webgym.core.trajectory import Episode, ImageRef, Message, TextPart
from webgym.inference.rendering import Renderer
from webgym.study.tokenizer import CELL, cell_centres

IGNORED = -100
"""The label of a token that is not learned."""


class TrainingSequence(msgspec.Struct, frozen=True):
    """A training sequence.

    Attributes:
        picture: the screenshot's name.
        ids: tokens, the picture's expanded.
        labels: the tokens with a loss; :data:`IGNORED` elsewhere.
    """

    picture: str
    ids: tuple[int, ...]
    labels: tuple[int, ...]


class Signs(msgspec.Struct, frozen=True):
    """What a screenshot shows: names with the centres of their cells."""

    picture: str
    places: tuple[tuple[str, tuple[int, int]], ...]


def acting(episode: Episode, renderer: Renderer) -> Iterator[TrainingSequence]:
    """A sequence for every step of an attempt that has an action.

    Args:
        episode: of a demonstrator.
        renderer: of the model.
    """
    for step in episode.steps:
        if step.action is None:
            continue
        prompt = renderer.prompt_ids(step.messages)
        reply = renderer.tokenizer(step.reply.text, add_special_tokens=False)["input_ids"]
        target = [*reply, renderer.tokenizer.eos_token_id]
        labels = (IGNORED,) * len(prompt) + tuple(target)
        yield TrainingSequence(step.observation.screenshot, (*prompt, *target), labels)


def signs_of(picture: str, shown: Iterable[tuple[str, tuple[int, int]]], viewport: tuple[int, int]) -> Signs:
    """The signs of a screenshot.

    Args:
        picture: its name.
        shown: names on it, with their upper left corners, pixels.
        viewport: its width and height.
    """
    columns, rows = cell_centres(viewport[0]), cell_centres(viewport[1])
    return Signs(picture, tuple((name, (columns[x // CELL], rows[y // CELL])) for name, (x, y) in shown))


def pointing(
    signs: Signs,
    renderer: Renderer,
    viewport: tuple[int, int],
    rng: random.Random,
    count: int,
    names: Sequence[str],
) -> TrainingSequence:
    """A sequence of questions about a screenshot: positions of names, names at positions, which of several
    names it shows, and numbers next to names.

    Numbers, words and names of two words are equally frequent if the screenshot has them. Positions are asked
    only of names that occur once.

    Args:
        signs: of the screenshot.
        renderer: of the model.
        viewport: width and height of the screenshot, pixels.
        rng: chooses the questions.
        count: number of questions.
        names: all names on any screenshot, from which wrong choices are drawn.
    """
    tokens = renderer.tokenizer
    picture = ImageRef(signs.picture, *viewport)
    ids = renderer.prompt_ids((Message("user", (picture, TextPart("say"))),))
    labels = [IGNORED] * len(ids)
    separator = tokens.convert_tokens_to_ids(",")
    kinds: dict[str, list[tuple[str, tuple[int, int]]]] = {}
    for sign in signs.places:
        kinds.setdefault("number" if sign[0].isdecimal() else f"{sign[0].count(' ')}", []).append(sign)
    times = Counter(name for name, _ in signs.places)
    adjacent_numbers = _adjacent_numbers(signs, viewport)
    for _ in range(count):
        name, (x, y) = rng.choice(kinds[rng.choice(list(kinds))])
        draw = rng.random()
        if adjacent_numbers and draw < 0.25:
            name, answer = rng.choice(adjacent_numbers)
            question = f"number of {name}"
        elif draw < 0.5:
            others = [other for other in rng.sample(names, rng.randint(1, 4)) if other not in times]
            question, answer = " or ".join(rng.sample([name, *others], 1 + len(others))), name
        elif draw < 0.75 and times[name] == 1:
            question, answer = name, f"{x} {y}"
        else:
            question, answer = f"{x} {y}", name
        sides = f"{question} =", answer
        question_ids, answer_ids = (tokens(side, add_special_tokens=False)["input_ids"] for side in sides)
        ids += [*question_ids, *answer_ids, separator]
        labels += [*[IGNORED] * len(question_ids), *answer_ids, IGNORED]
    return TrainingSequence(signs.picture, tuple(ids), tuple(labels))


def _adjacent_numbers(signs: Signs, viewport: tuple[int, int]) -> list[tuple[str, str]]:
    """Names with the number to their right."""
    columns = cell_centres(viewport[0])
    right = dict(pairwise(columns))
    at = {place: name for name, place in signs.places}
    pairs = ((name, at.get((right.get(x, -1), y), "")) for name, (x, y) in signs.places)
    return [(name, other) for name, other in pairs if other.isdecimal() and not name.isdecimal()]
