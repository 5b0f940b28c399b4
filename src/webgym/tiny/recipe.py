"""The recipe of the tiny policy's first weights: rehearse, teach, examine. One seed, one command, resumable.

    out/pictures/*.png    pages of the training websites, each drawn once
    out/lessons.msgpack   what the demonstrators did and what could be pointed at
    out/checkpoint.pt     the training so far
    out/model/            the model
    out/examination.json  its success on training and on test websites

Only training websites are looked at before the examination.
"""

from __future__ import annotations

import asyncio
import random
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
from pydantic import BaseModel, ConfigDict, Field

from webgym.agent.agent import Agent
from webgym.agent.config import AgentConfig, PromptFormat
from webgym.agent.policy import Policy
from webgym.core.task import LEVELS, StepBudget, Task
from webgym.core.trajectory import Episode
from webgym.inference.local import LocalConfig, LocalPolicy
from webgym.inference.model import Loaded
from webgym.judge import OfflineJudge
from webgym.offline.small.wording import small_vocabulary
from webgym.offline.web import OfflineWeb
from webgym.rehearsal import Drawings
from webgym.rollout.rates import wilson
from webgym.tiny.demonstrators import Demonstrators
from webgym.tiny.lessons import Lesson, Signs, acting
from webgym.tiny.model import make_model
from webgym.tiny.pretrain import Lessons, PretrainConfig, Tell, pretrain
from webgym.tiny.rehearsal import Stage

Advance: TypeAlias = Callable[[str, int, int], None]


class RecipeConfig(BaseModel):
    """How the first weights are made."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    seed: int = 7
    """Of the websites, the demonstrators, the weights and the lessons."""

    per_family: int | None = Field(default=None, ge=5)
    """Websites of each family; by default all that the collection has."""

    attempts: int = Field(default=9300, ge=1)
    """Of the demonstrators, at training tasks in random order."""

    without_memory: float = Field(default=0.2, ge=0, le=1)
    """Share of them under the prompt without a memory, which the study compares with."""

    budget: tuple[int, int, int] = (10, 20, 30)
    """Steps for easy, medium and hard tasks."""

    pretrain: PretrainConfig = PretrainConfig()
    """How it is taught."""

    examined: int = Field(default=300, ge=0)
    """Tasks of each split that it is examined on."""


class _Told(msgspec.Struct):
    """``lessons.msgpack``."""

    acting: list[Lesson]
    signs: list[Signs]


async def follow(config: RecipeConfig, out: Path, *, tell: Tell, advance: Advance) -> dict[str, Any]:
    """Make the first weights; what the examination says.

    Args:
        config: how.
        out: a folder; what is in it is gone on from.
        tell: is told figures of the training.
        advance: is told what goes on, how much of it is done, and of how much.
    """
    web = OfflineWeb(config.seed, per_family=config.per_family, collection="small")
    loaded = make_model(small_vocabulary(), config.pretrain.model, seed=config.seed)
    async with Drawings(out / "pictures", web.collection.viewport) as drawings:
        stage = Stage(web, drawings, StepBudget(*config.budget))
        if not (out / "model").exists():
            told = await _rehearse(config, out, stage, _tasks(web, "train", config.seed), loaded, advance)
            lessons = Lessons(
                told.acting, told.signs, drawings.pictures(), loaded.renderer, web.collection.viewport
            )
            await asyncio.to_thread(pretrain, lessons, loaded, out, config.pretrain, tell)
        examined = {
            split: await examine(
                stage, out / "model", _tasks(web, split, config.seed)[: config.examined], advance
            )
            for split in ("train", "test")
        }
    (out / "examination.json").write_bytes(msgspec.json.format(msgspec.json.encode(examined)))
    return examined


def _tasks(web: OfflineWeb, split: str, seed: int) -> list[Task]:
    tasks = [task for task in web.tasks() if task.split == split]
    random.Random(f"{seed}\n{split}").shuffle(tasks)
    return tasks


async def _rehearse(
    config: RecipeConfig, out: Path, stage: Stage, tasks: Sequence[Task], loaded: Loaded, advance: Advance
) -> _Told:
    path = out / "lessons.msgpack"
    if path.exists():
        return msgspec.msgpack.decode(path.read_bytes(), type=_Told)
    policy, rng = Demonstrators(), random.Random(config.seed)
    kinds: tuple[PromptFormat, ...] = ("compact", "compact_official")
    agents = {kind: agent_of(policy, kind) for kind in kinds}
    told = _Told([], [])
    for number in range(config.attempts):
        task = tasks[number % len(tasks)]
        kind = kinds[rng.random() < config.without_memory]
        episode = await stage.rehearse(agents[kind], task, number)
        told.acting += acting(episode, loaded.renderer)
        advance("demonstrations", number + 1, config.attempts)
    told.signs = list(stage.signs.values())
    path.write_bytes(msgspec.msgpack.encode(told))
    return told


def agent_of(policy: Policy, prompt_format: PromptFormat = "compact") -> Agent:
    """The agent as the tiny policy is asked: the newest screenshot alone, in few words."""
    return Agent(policy, AgentConfig(prompt_format=prompt_format, rounds=0, profile="tiny"))


async def examine(
    stage: Stage,
    model: Path,
    tasks: Sequence[Task],
    advance: Advance,
    *,
    prompt_format: PromptFormat = "compact",
    seed: int = 0,
    together: int = 16,
) -> dict[str, Any]:
    """One attempt at each task by a model: success overall and by level, with 95 % intervals.

    Args:
        stage: where.
        model: its folder.
        tasks: what is attempted.
        advance: is told how far it is.
        prompt_format: how it is asked.
        seed: of its replies.
        together: attempts at a time, so that the model replies to several at once.
    """
    policy = LocalPolicy(LocalConfig(path=str(model), threads=1))
    agent, places, done = agent_of(policy, prompt_format), asyncio.Semaphore(together), list[Episode]()

    async def attempt(number: int, task: Task) -> Episode:
        async with places:
            episode = await stage.rehearse(agent, task, seed * 1_000_003 + number)
        done.append(episode)
        advance("examination", len(done), len(tasks))
        return episode

    async with agent:
        episodes = await asyncio.gather(*(attempt(*each) for each in enumerate(tasks)))
    return await score(tasks, episodes)


async def score(tasks: Sequence[Task], episodes: Sequence[Episode]) -> dict[str, Any]:
    """Success of attempts at tasks, overall and by level, and how they ended."""
    judge, solved, tried, ends = OfflineJudge(), Counter[str](), Counter[str](), Counter[str]()
    for task, episode in zip(tasks, episodes, strict=True):
        judged = await judge.judge(task, episode, _no_picture)
        for group in ("overall", task.level):
            tried[group] += 1
            solved[group] += judged.reward == 1
        ends[str(episode.ending)] += 1
    rates = {group: _rate(solved[group], tried[group]) for group in ("overall", *LEVELS) if tried[group]}
    steps = sum(len(episode.steps) for episode in episodes)
    unread = sum(step.action is None for episode in episodes for step in episode.steps)
    return {"success": rates, "endings": dict(ends), "steps": steps, "unreadable_replies": unread}


def _rate(solved: int, tried: int) -> Mapping[str, Any]:
    return {"solved": solved, "tried": tried, "rate": solved / tried, "interval": wilson(solved, tried)}


async def _no_picture(name: str) -> bytes:
    raise LookupError(f"the picture {name} is not at hand")
