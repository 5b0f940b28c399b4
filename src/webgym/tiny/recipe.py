"""The recipe of the tiny policy: demonstrate, pretrain, evaluate. One seed, one command, resumable.

    out/pictures/*.png    pages of the training websites, each drawn once
    out/demonstrations.msgpack   what the demonstrators did and what could be pointed at
    out/checkpoint.pt     the training so far
    out/model/            the model
    out/examination.json  its success on training and on test websites

Only training websites are looked at before the examination.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

import msgspec
from pydantic import Field

from webgym.agent.agent import Agent
from webgym.agent.config import AgentConfig, PromptFormat
from webgym.agent.policy import Policy
from webgym.agent.profiles import choose_profile
from webgym.core.errors import ConfigError
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Trajectory
from webgym.inference.local import LocalConfig, LocalPolicy
from webgym.inference.model import Loaded
from webgym.judge.offline import OfflineJudge
from webgym.offline.small.wording import small_vocabulary
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.rollout.files import write_whole
from webgym.rollout.judging import judge_episode
from webgym.rollout.plan import Planned
from webgym.rollout.summary import Tally, digest_of
from webgym.settings import Settings
from webgym.static_browsers import StaticBrowsers, StaticCollector
from webgym.tiny.demonstrators import Demonstrators
from webgym.tiny.model import make_model
from webgym.tiny.pretrain import PretrainConfig, Tell, TrainingSet, pretrain
from webgym.tiny.training_sequences import Signs, TrainingSequence, acting, signs_of

PROFILE: Final = "tiny"
"""Pictures and sampling of the tiny policy."""

Advance: TypeAlias = Callable[[str, int, int], None]


class RecipeConfig(Settings):
    """How the first weights are made."""

    seed: int = 7
    """Of the websites, the demonstrators, the weights and the training sequences."""

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

    @property
    def attempt(self) -> AttemptConfig:
        """How attempts are made."""
        easy, medium, hard = self.budget
        return AttemptConfig(budget_easy=easy, budget_medium=medium, budget_hard=hard)


class _Told(msgspec.Struct):
    """``demonstrations.msgpack``."""

    settings: dict[str, Any]
    acting: list[TrainingSequence]
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
    async with StaticBrowsers(web, out / "pictures") as browsers:
        told = await _demonstrate(config, out, browsers, loaded, advance)
        if not (out / "model").exists():
            assert browsers.page_images is not None
            pictures = browsers.page_images.pictures()
            training_set = TrainingSet(
                told.acting, told.signs, pictures, loaded.renderer, web.collection.viewport
            )
            await asyncio.to_thread(pretrain, training_set, loaded, out, config.pretrain, tell)
        examined = {
            split: await examine(
                browsers,
                out / "model",
                _tasks(web, split, config.seed)[: config.examined],
                config.attempt,
                advance,
            )
            for split in ("train", "test")
        }
    write_whole(out / "examination.json", msgspec.json.format(msgspec.json.encode(examined)))
    return examined


def _tasks(web: OfflineWeb, split: str, seed: int) -> list[Task]:
    tasks = [task for task in web.tasks() if task.split == split]
    random.Random(f"{seed}\n{split}").shuffle(tasks)
    return tasks


async def _demonstrate(
    config: RecipeConfig, out: Path, browsers: StaticBrowsers, loaded: Loaded, advance: Advance
) -> _Told:
    """The demonstrations, which a folder may hold already.

    Raises:
        ConfigError: it holds those of other settings.
    """
    path = out / "demonstrations.msgpack"
    settings = config.model_dump(mode="json", exclude={"pretrain", "examined"})
    if path.exists():
        held = msgspec.msgpack.decode(path.read_bytes())
        if held.get("settings") != settings:
            raise ConfigError(f"{path} is of other settings", hint="choose another folder")
        return msgspec.convert(held, _Told)
    tasks = _tasks(browsers.web, "train", config.seed)
    policy, rng = Demonstrators(), random.Random(config.seed)
    kinds: tuple[PromptFormat, ...] = ("compact", "compact_official")
    collectors = {
        kind: StaticCollector(browsers, agent_of(policy, kind), config.attempt, config.seed) for kind in kinds
    }
    told = _Told(settings, [], [])
    for number in range(config.attempts):
        kind = kinds[rng.random() < config.without_memory]
        sample, place = divmod(number, len(tasks))
        episode = await collectors[kind].make(Planned(tasks[place], sample))
        told.acting += acting(episode, loaded.renderer)
        advance("demonstrations", number + 1, config.attempts)
    viewport = browsers.web.collection.viewport
    told.signs = [signs_of(name, shown, viewport) for name, shown in browsers.signs.items()]
    write_whole(path, msgspec.msgpack.encode(told))
    return told


def agent_of(policy: Policy, prompt_format: PromptFormat = "compact") -> Agent:
    """The agent as the tiny policy is asked: the newest screenshot alone, in few words."""
    return Agent(policy, AgentConfig(prompt_format=prompt_format, rounds=0, profile=PROFILE))


async def examine(
    browsers: StaticBrowsers,
    model: Path,
    tasks: Sequence[Task],
    config: AttemptConfig,
    advance: Advance,
    *,
    prompt_format: PromptFormat = "compact",
    seed: int = 0,
    together: int = 16,
) -> dict[str, Any]:
    """One attempt at each task by a model; see :func:`score`.

    Args:
        browsers: where.
        model: its folder.
        tasks: what is attempted.
        config: limits of an attempt.
        advance: is told how far it is.
        prompt_format: how it is asked.
        seed: of its replies.
        together: attempts at a time, so that the model replies to several at once.
    """
    policy = LocalPolicy(LocalConfig(path=str(model), threads=1), choose_profile(PROFILE, model.name))
    agent = agent_of(policy, prompt_format)
    collectors = StaticCollector(browsers, agent, config, seed)
    places, done = asyncio.Semaphore(together), list[Episode]()

    async def attempt(task: Task) -> Episode:
        async with places:
            episode = await collectors.make(Planned(task, 0))
        done.append(episode)
        advance("examination", len(done), len(tasks))
        return episode

    async with agent:
        episodes = await asyncio.gather(*map(attempt, tasks))
    return await score(tasks, episodes)


async def score(tasks: Sequence[Task], episodes: Sequence[Episode]) -> dict[str, Any]:
    """Success of attempts at tasks, and how they ended; keys as in ``summary.json``."""
    judge, tally, seconds = OfflineJudge(), Tally(tasks), CollectorConfig().judge_seconds
    for task, episode in zip(tasks, episodes, strict=True):
        found = await judge_episode(judge, task, episode, _no_picture, seconds)
        tally.add(digest_of(Trajectory(episode, found.outcome, found.verdict, found.failure)))
    summary = tally.summary()
    unread = sum(step.action is None for episode in episodes for step in episode.steps)
    return {
        "attempts": summary["attempts"],
        "outcomes": summary["outcomes"],
        "success_rate": summary["success_rate"],
        "success_interval": summary["success_interval"],
        "planned": summary["planned"],
        "steps": summary["steps"],
        "unreadable_replies": unread,
    }


async def _no_picture(name: str) -> bytes:
    raise LookupError(f"the picture {name} is not available")
