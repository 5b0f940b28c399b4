"""Trajectories, runs and samples to train on, made in memory."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import torch
from tests.inference.tiny import picture

from webgym.core.action import Action, Answer, LeftClick, Target
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import Episode, ImageRef, Message, Reply, Step, TextPart, Trajectory
from webgym.inference.rendering import Renderer
from webgym.store.runs import RunReader, RunWriter
from webgym.train.samples import Sample

PICTURES = {hashlib.sha256(data).hexdigest(): data for data in map(picture, ("red", "blue", "lime", "gray"))}
NAMES = list(PICTURES)
CLICK = LeftClick(Target(coordinate=(1.0, 2.0)))


def task(name: str = "a", split: Literal["train", "test"] | None = "train") -> Task:
    return Task(
        id=f"t/{name}",
        instruction="find it",
        website=f"http://{name}.test/",
        domain="Shopping",
        subdomain="Books",
        rubric=Rubric((FactGroup(1, "all", ("the price",)),)),
        source="offline",
        split=split,
    )


def request(look: int = 0, *, width: int = 64, height: int = 32) -> tuple[Message, ...]:
    return (
        Message("system", (TextPart("act"),)),
        Message("user", (TextPart("see"), ImageRef(NAMES[look], width, height), TextPart(" now"))),
    )


def step(
    index: int = 0,
    *,
    reply: Reply | None = None,
    action: Action | None = CLICK,
    changed: bool | None = True,
    messages: tuple[Message, ...] | None = None,
) -> Step:
    return Step(
        index=index,
        observation=Observation(NAMES[index % len(NAMES)], "http://a.test/", "A", (64, 32)),
        messages=messages or request(index % len(NAMES)),
        reply=reply or Reply("click", "p"),
        action=action,
        parse_error="" if action else "no tool call",
        changed=changed,
    )


def trajectory(
    number: int = 0,
    *,
    of: str = "a",
    outcome: Outcome = Outcome.SUCCESS,
    changed: Sequence[bool] = (True, True),
    reply: Reply | None = None,
) -> Trajectory:
    """Clicks that changed the screen or did not, then an answer."""
    steps = [step(index, changed=each, reply=reply) for index, each in enumerate(changed)]
    steps.append(step(len(steps), action=Answer("4"), changed=None, reply=reply))
    name = f"t/{of}"
    episode = Episode(
        f"{name}#{number}.0", name, number, 0, 7, "p", 100.0, 2.5, tuple(steps), Ending.ANSWERED
    )
    return Trajectory(episode, outcome)


class Made:
    """Reads like a run folder."""

    def __init__(self, trajectories: Sequence[Trajectory], tasks: Sequence[Task] = ()) -> None:
        names = sorted({each.episode.task_id for each in trajectories})
        made = tasks or [task(name.removeprefix("t/")) for name in names]
        self._trajectories = trajectories
        self.tasks = {each.id: each for each in made}
        planned = {(each.episode.task_id, each.episode.sample) for each in trajectories}
        self.drawn = [self.tasks[name] for name, _ in sorted(planned)]
        self.samples = 1

    def trajectories(self) -> Iterator[Trajectory]:
        return iter(self._trajectories)

    def write(self, path: Path) -> RunReader:
        """The same as a run folder."""

        async def write() -> None:
            async with await RunWriter.create(path, {"seed": 7}, list(self.tasks.values())) as writer:
                for name, data in PICTURES.items():
                    await writer.put_image(name, data)
                for each in self._trajectories:
                    await writer.append(each)

        asyncio.run(write())
        return RunReader(path)


def sample(renderer: Renderer, reply: str, look: int = 0, **others: Any) -> Sample:
    """A step whose reply was sampled as it is written, and ended by itself."""
    messages = request(look)
    reply_ids = [*renderer.tokenizer(reply)["input_ids"], renderer.tokenizer.eos_token_id]
    given: dict[str, Any] = {"logprobs": None, "temperature": 1.0, "version": ""} | others
    return Sample(
        torch.tensor(renderer.prompt_ids(messages), dtype=torch.int32),
        torch.tensor(reply_ids, dtype=torch.int32),
        messages=messages,
        picture=PICTURES.__getitem__,
        **given,
    )


def stored(renderer: Renderer, text: str, **others: Any) -> Reply:
    """A reply with its tokens, as an endpoint that tells them gives it."""
    ids = [*renderer.tokenizer(text)["input_ids"], renderer.tokenizer.eos_token_id]
    given: dict[str, Any] = {
        "prompt_ids": renderer.prompt_ids(request()),
        "reply_ids": ids,
        "logprobs": [-1.0] * len(ids),
    }
    fields: dict[str, Any] = {"text": text, "policy": "p"}
    for name, value in others.items():
        (given if name in given else fields)[name] = value
    if "reply_ids" in others and "logprobs" not in others:
        given["logprobs"] = [-1.0] * len(given["reply_ids"])
    return Reply(tokens=ReplyTokens.of(**given), **fields)
