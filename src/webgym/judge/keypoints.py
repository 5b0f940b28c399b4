"""Selection of the screenshots that are judged (paper §3.4), in parts that fit into requests."""

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
from webgym.judge.config import JudgeConfig, Stage
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
"""What a screenshot's number, its label and its verdict line take, generously."""


async def select(
    task: Task, episode: Episode, client: JudgeModelClient, config: JudgeConfig
) -> tuple[int, ...]:
    """Indices of the observations whose screenshots matter, in order.

    Each different screenshot is judged once; of equal ones the latest stands for all. The last one is
    always kept and never asked about. So are those that there is no clear verdict about: when in doubt, a
    screenshot matters.
    """
    seen = episode.observations
    if not seen:
        return ()
    latest = {observation.screenshot: index for index, observation in enumerate(seen)}
    last = latest.pop(seen[-1].screenshot)
    candidates = sorted(latest.values())
    if not config.select_keypoints:
        return (*candidates, last)
    size = _room(episode, candidates, "keypoint", _question(task, episode, [], config).write, config)
    batches = [candidates[start : start + size] for start in range(0, len(candidates), size)]
    questions = [_question(task, episode, batch, config) for batch in batches]
    findings = await gather(result_or_error(client.ask_per_image(question)) for question in questions)
    kept = [
        index
        for batch, found in zip(batches, findings, strict=True)
        for place, index in enumerate(batch)
        if isinstance(found, JudgeError) or found[place]
    ]
    return (*kept, last)


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


def page_texts(seen: Sequence[Observation], indices: Sequence[int]) -> tuple[str, ...]:
    """The known texts of these screenshots, so that echoes of them are not taken for verdicts."""
    return tuple(seen[index].text or "" for index in indices)


def label(episode: Episode, index: int) -> str:
    """What an observation is called: the step that it was seen at, counted from 1."""
    return f"step {index + 1}" if index < len(episode.steps) else f"step {index + 1} (the end)"


def thin(indices: Sequence[int], limit: int) -> tuple[int, ...]:
    """At most ``limit`` of the indices: the first, the last, and evenly between. One alone is the last."""
    if len(indices) <= limit:
        return tuple(indices)
    if limit == 1:
        return (indices[-1],)
    step = (len(indices) - 1) / (limit - 1)
    return tuple(indices[round(place * step)] for place in range(limit))


def parts(
    episode: Episode, indices: Sequence[int], stage: Stage, config: JudgeConfig, write: Callable[..., Any]
) -> list[tuple[int, ...]]:
    """The observations in as few parts of about equal size as it takes to show every one of them.

    Args:
        episode: what happened.
        indices: of the observations that are to be shown.
        stage: which model is asked.
        config: of the judge.
        write: a function of :mod:`webgym.judge.prompts` that lacks ``labels`` and takes ``part``.
    """
    if len(indices) <= _room(episode, indices, stage, partial(write, labels=()), config):
        return [tuple(indices)]
    longest = f"{len(indices)} of {len(indices)}"
    size = _room(episode, indices, stage, partial(write, labels=(), part=longest), config)
    count = -(-len(indices) // size)
    bounds = [number * len(indices) // count for number in range(count + 1)]
    return [tuple(indices[start:end]) for start, end in pairwise(bounds)]


def shown(
    episode: Episode, indices: Sequence[int], stage: Stage, config: JudgeConfig, write: Callable[..., Any]
) -> tuple[Write, tuple[LabelledScreenshot, ...], tuple[int, ...]]:
    """A question's text and screenshots within what one request takes, and the observations' indices.

    Screenshots give way to the text; at least the last one is kept: an estimate may be wrong about it.

    Args:
        episode: what happened.
        indices: of the observations that may be shown.
        stage: which model is asked.
        config: of the judge.
        write: a function of :mod:`webgym.judge.prompts` that lacks ``labels``.
    """
    chosen = tuple(indices)
    chosen = thin(chosen, _room(episode, chosen, stage, partial(write, labels=()), config))
    seen, labels = episode.observations, [label(episode, index) for index in chosen]
    shots = tuple(
        LabelledScreenshot(name, seen[index].screenshot) for name, index in zip(labels, chosen, strict=True)
    )
    return partial(write, labels=labels), shots, chosen


def _room(episode: Episode, indices: Sequence[int], stage: Stage, write: Write, config: JudgeConfig) -> int:
    """How many of these screenshots one request of a stage takes beside its text; at least one."""
    settings = config.stage(stage)
    if not indices:
        return 1
    text = sum(map(len, write(""))) / config.texts.chars_per_token
    left = settings.request_tokens - text - (settings.sampling.max_tokens or 0)
    seen = [episode.observations[index].viewport for index in indices]
    each = max(tokens_of(size, config.images) for size in seen) + LABEL_TOKENS
    return max(1, min(settings.images_per_call, int(left // each)))
