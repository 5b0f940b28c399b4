"""Training sequences for the tiny policy, made from recorded attempts of demonstrators.

There are two kinds. *Pointing*: a picture and several questions
about it in one sequence, ``red star = 250 375 , 583 125 = next , jam or home or 7 = home``; without them a
model this small never learns to see, nor to find what it sees in what it is told. *Acting*: a step's request
and reply, exactly as the agent asked and the demonstrator answered.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import msgspec

from webgym.core.trajectory import Episode, ImageRef, Message, TextPart
from webgym.inference.rendering import Renderer
from webgym.tiny.tokenizer import CELL, cell_centres

IGNORED = -100
"""The label of a token that is not learned."""


class TrainingSequence(msgspec.Struct, frozen=True):
    """A sequence.

    Attributes:
        picture: the screenshot's name.
        ids: tokens, the picture's expanded.
        labels: the tokens that are learned, :data:`IGNORED` elsewhere.
    """

    picture: str
    ids: tuple[int, ...]
    labels: tuple[int, ...]


class Signs(msgspec.Struct, frozen=True):
    """What a screenshot shows: names with the middles of their cells."""

    picture: str
    places: tuple[tuple[str, tuple[int, int]], ...]


def acting(episode: Episode, renderer: Renderer) -> Iterator[TrainingSequence]:
    """A lesson for every step of an attempt that holds an action.

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
    """What can be asked about a screenshot.

    Args:
        picture: its name.
        shown: what it shows, with left upper corners, pixels.
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
    """Questions about one screenshot: places of names, names at places, which of several names it shows,
    numbers that stand beside names.

    Numbers, words and names of two words are asked for equally often where there are some; what stands in
    several places is not asked for by its name.

    Args:
        signs: of the screenshot.
        renderer: of the model.
        viewport: width and height of the screenshot, pixels.
        rng: chooses the questions.
        count: how many.
        names: of everything that screenshots show, for names that this one does not.
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
    beside = _numbers_beside(signs, viewport)
    for _ in range(count):
        name, (x, y) = rng.choice(kinds[rng.choice(list(kinds))])
        draw = rng.random()
        if beside and draw < 0.25:
            name, answer = rng.choice(beside)
            question = f"number of {name}"
        elif draw < 0.5:
            others = [other for other in rng.sample(names, rng.randint(1, 4)) if other not in times]
            question, answer = " or ".join(rng.sample([name, *others], 1 + len(others))), name
        elif draw < 0.75 and times[name] == 1:
            question, answer = name, f"{x} {y}"
        else:
            question, answer = f"{x} {y}", name
        sides = f"{question} =", answer
        asked, told = (tokens(side, add_special_tokens=False)["input_ids"] for side in sides)
        ids += [*asked, *told, separator]
        labels += [*[IGNORED] * len(asked), *told, IGNORED]
    return TrainingSequence(signs.picture, tuple(ids), tuple(labels))


def _numbers_beside(signs: Signs, viewport: tuple[int, int]) -> list[tuple[str, str]]:
    """Names with the number to the right of them."""
    columns = cell_centres(viewport[0])
    right = dict(pairwise(columns))
    at = {place: name for name, place in signs.places}
    pairs = ((name, at.get((right.get(x, -1), y), "")) for name, (x, y) in signs.places)
    return [(name, other) for name, other in pairs if other.isdecimal() and not name.isdecimal()]
