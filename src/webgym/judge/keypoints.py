"""Selection of the screenshots that are judged (paper §3.4), and their division into requests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, Final

from webgym.core.errors import JudgeError
from webgym.core.observation import Observation
from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.judge import prompts
from webgym.judge.config import CHARS_PER_TOKEN, JudgeConfig, Stage
from webgym.judge.images import tokens_of
from webgym.judge.model_client import (
    JudgeModelClient,
    LabelledScreenshot,
    Question,
    Write,
    gather,
    result_or_error,
)
from webgym.judge.untrusted import shorten

LABEL_TOKENS: Final = 24
"""Tokens of a screenshot's number, label and verdict line; an upper estimate."""


async def select(
    task: Task, episode: Episode, client: JudgeModelClient, config: JudgeConfig
) -> tuple[int, ...]:
    """Indices of the observations whose screenshots matter, in order.

    A screenshot that occurs several times is judged once, at its latest index. The last screenshot of the
    episode is always selected without asking. So is one that the model gives no clear verdict about: when in
    doubt, a screenshot matters.
    """
    observations = episode.observations
    if not observations:
        return ()
    latest = {observation.screenshot: index for index, observation in enumerate(observations)}
    last = latest.pop(observations[-1].screenshot)
    candidates = sorted(latest.values())
    batch_size = _capacity(
        episode, candidates, "keypoint", _question(task, episode, [], config).write, config
    )
    batches = [candidates[start : start + batch_size] for start in range(0, len(candidates), batch_size)]
    questions = [_question(task, episode, batch, config) for batch in batches]
    verdicts = await gather(result_or_error(client.ask_per_image(question)) for question in questions)
    relevant = [
        index
        for batch, verdict_or_error in zip(batches, verdicts, strict=True)
        for number, index in enumerate(batch)
        if isinstance(verdict_or_error, JudgeError) or verdict_or_error[number]
    ]
    return (*relevant, last)


def _question(task: Task, episode: Episode, batch: Sequence[int], config: JudgeConfig) -> Question:
    seen = episode.observations
    instruction = shorten(task.instruction, config.texts.instruction_chars)
    facts = tuple(fact for _, _, fact in task.rubric.facts())
    labels = [f"screenshot {number}" for number in range(1, len(batch) + 1)]
    write = partial(prompts.keypoint, instruction=instruction, facts=facts, labels=labels)
    shots = tuple(
        LabelledScreenshot(label, seen[index].screenshot) for label, index in zip(labels, batch, strict=True)
    )
    return Question("keypoint", "question", write, shots, (instruction, *facts, *page_texts(seen, batch)))


def page_texts(seen: Sequence[Observation], indices: Sequence[int]) -> tuple[str | None, ...]:
    """The visible texts of these observations and of the fields in them, so that echoes are not mistaken for
    verdicts; ``None`` for a text that was not recorded."""
    return tuple(text for index in indices for text in (seen[index].text, *seen[index].fields))


def label(episode: Episode, index: int) -> str:
    """The name of an observation in prompts: its step, counted from 1."""
    return f"step {index + 1}" if index < len(episode.steps) else f"step {index + 1} (the end)"


def evenly_spaced(indices: Sequence[int], limit: int) -> tuple[int, ...]:
    """At most ``limit`` of the indices, evenly spaced, first and last included. A limit of 1 keeps the
    last."""
    if len(indices) <= limit:
        return tuple(indices)
    if limit == 1:
        return (indices[-1],)
    step = (len(indices) - 1) / (limit - 1)
    return tuple(indices[round(number * step)] for number in range(limit))


def split_into_requests(
    episode: Episode, indices: Sequence[int], stage: Stage, config: JudgeConfig, write: Callable[..., Any]
) -> list[tuple[int, ...]]:
    """Divide observations into as few requests of about equal size as can show all of them.

    Args:
        episode: the recorded steps.
        indices: of the observations to show.
        stage: which model is asked.
        config: the judge's settings.
        write: a function of :mod:`webgym.judge.prompts` with all arguments bound but ``labels`` and ``part``.

    Returns:
        The indices of each request, in order.
    """
    if len(indices) <= _capacity(episode, indices, stage, partial(write, labels=()), config):
        return [tuple(indices)]
    longest = f"{len(indices)} of {len(indices)}"
    size = _capacity(episode, indices, stage, partial(write, labels=(), part=longest), config)
    count = -(-len(indices) // size)
    bounds = [number * len(indices) // count for number in range(count + 1)]
    return [tuple(indices[start:end]) for start, end in pairwise(bounds)]


def fit_in_request(
    episode: Episode, indices: Sequence[int], stage: Stage, config: JudgeConfig, write: Callable[..., Any]
) -> tuple[Write, tuple[LabelledScreenshot, ...], tuple[int, ...]]:
    """A question with as many screenshots as fit in one request.

    The text is never shortened; screenshots are left out evenly, but the last one is always sent, because the
    estimate of its tokens may be too high.

    Args:
        episode: the recorded steps.
        indices: of the observations to show.
        stage: which model is asked.
        config: the judge's settings.
        write: a function of :mod:`webgym.judge.prompts` with all arguments bound but ``labels``.

    Returns:
        The function that writes the texts, the screenshots, and the indices of the observations shown.
    """
    chosen = tuple(indices)
    chosen = evenly_spaced(chosen, _capacity(episode, chosen, stage, partial(write, labels=()), config))
    seen, labels = episode.observations, [label(episode, index) for index in chosen]
    shots = tuple(
        LabelledScreenshot(name, seen[index].screenshot) for name, index in zip(labels, chosen, strict=True)
    )
    return partial(write, labels=labels), shots, chosen


def _capacity(
    episode: Episode, indices: Sequence[int], stage: Stage, write: Write, config: JudgeConfig
) -> int:
    """How many of these screenshots fit in one request of a stage together with its text; at least 1."""
    settings = config.stage(stage)
    if not indices:
        return 1
    text_tokens = sum(map(len, write(""))) / CHARS_PER_TOKEN
    remaining = settings.request_tokens - text_tokens - (settings.sampling.max_tokens or 0)
    viewports = [episode.observations[index].viewport for index in indices]
    image_tokens = max(tokens_of(size, config.images) for size in viewports) + LABEL_TOKENS
    return max(1, min(settings.images_per_call, int(remaining // image_tokens)))
