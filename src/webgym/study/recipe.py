"""The recipe of the tiny policy: demonstrate, pretrain, evaluate. One seed, one command, resumable.

    out/pictures/*.png    screenshots of the training websites' pages
    out/demonstrations.msgpack   training data from the demonstrators' attempts
    out/pretraining.json  settings of the pretraining
    out/checkpoint.pt     the latest checkpoint of the pretraining
    out/model/            the model
    out/examination.json  the model's success on training and test websites

Only training websites are used before the examination.
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
from webgym.core.settings import Settings
from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.inference.local import LocalConfig, LocalPolicy
from webgym.inference.model import Loaded
from webgym.judge.base import no_picture
from webgym.judge.offline import OfflineJudge
from webgym.offline.small import small_vocabulary
from webgym.offline.web import OfflineWeb
from webgym.results.summary import Tally, digest_of
from webgym.rollout.config import AttemptConfig, CollectorConfig
from webgym.rollout.judging import judge_episode
from webgym.rollout.plan import Planned
from webgym.store.files import make_folder, write_whole
from webgym.study.demonstrators import Demonstrators
from webgym.study.model import make_model
from webgym.study.pretrain import (
    CHECKPOINT,
    PretrainConfig,
    Signs,
    Tell,
    TrainingSequence,
    TrainingSet,
    acting,
    pretrain,
    signs_of,
)
from webgym.study.static_browsers import StaticBrowsers, StaticCollector

PROFILE: Final = "tiny"
"""Name of the tiny policy's profile, which sets pictures and sampling."""

Advance: TypeAlias = Callable[[str, int, int], None]

WITHOUT_MEMORY = 0.2
"""Share of attempts with the prompt without a memory, for comparison in the study."""

EXAMINED = 300
"""Number of tasks of each split in the examination."""


class RecipeConfig(Settings):
    """Settings of the recipe."""

    seed: int = 7
    """Seed of the websites, the demonstrators, the weights and the training sequences."""

    per_family: int | None = Field(default=None, ge=5)
    """Number of websites of each family; by default all."""

    attempts: int = Field(default=9300, ge=1)
    """Attempts of the demonstrators, at training tasks in random order."""

    budget: tuple[int, int, int] = (10, 20, 30)
    """Step budgets of easy, medium and hard tasks."""

    pretrain: PretrainConfig = PretrainConfig()
    """The pretraining."""

    @property
    def attempt(self) -> AttemptConfig:
        """Settings of the attempts."""
        easy, medium, hard = self.budget
        return AttemptConfig(budget_easy=easy, budget_medium=medium, budget_hard=hard)


class _Demonstrations(msgspec.Struct):
    """The content of ``demonstrations.msgpack``."""

    settings: dict[str, Any]
    acting: list[TrainingSequence]
    signs: list[Signs]


async def follow(config: RecipeConfig, out: Path, *, tell: Tell, advance: Advance) -> dict[str, Any]:
    """Train the tiny policy, and return the results of its examination.

    Args:
        config: of the recipe.
        out: output folder; steps whose results are in it are not repeated.
        tell: called with figures of the training.
        advance: called with the current phase, the number of items done, and their total.

    Raises:
        ConfigError: demonstrations, checkpoint or model in the folder were made with other settings.
    """
    make_folder(out)
    _keep_settings(config.pretrain, out)
    web = OfflineWeb(config.seed, per_family=config.per_family, collection="small")
    loaded = make_model(small_vocabulary(), config.pretrain.model, seed=config.seed)
    async with StaticBrowsers(web, out / "pictures") as browsers:
        demonstrations = await _demonstrate(config, out, browsers, loaded, advance)
        if not (out / "model").exists():
            assert browsers.page_images is not None
            pictures = browsers.page_images.pictures()
            viewport = web.collection.viewport
            training_set = TrainingSet(
                demonstrations.acting, demonstrations.signs, pictures, loaded.renderer, viewport
            )
            await asyncio.to_thread(pretrain, training_set, loaded, out, config.pretrain, tell)
        examined = {
            split: await examine(
                browsers,
                out / "model",
                _tasks(web, split, config.seed)[:EXAMINED],
                config.attempt,
                advance,
            )
            for split in ("train", "test")
        }
    write_whole(out / "examination.json", msgspec.json.format(msgspec.json.encode(examined)))
    return examined


def _keep_settings(config: PretrainConfig, out: Path) -> None:
    """Write the settings of the pretraining that the model depends on.

    Raises:
        ConfigError: there are a checkpoint or a model of other settings.
    """
    path = out / "pretraining.json"
    free = {"threads", "device"}
    settings = config.model_dump(mode="json", exclude=free)
    if not any((out / made).exists() for made in (CHECKPOINT, "model")):
        write_whole(path, msgspec.json.format(msgspec.json.encode(settings)))
    elif path.exists() and msgspec.json.decode(path.read_bytes()) != settings:
        raise ConfigError(f"the model in {out} was made with other settings", hint="choose another folder")


def _tasks(web: OfflineWeb, split: str, seed: int) -> list[Task]:
    tasks = [task for task in web.tasks() if task.split == split]
    random.Random(f"{seed}\n{split}").shuffle(tasks)
    return tasks


async def _demonstrate(
    config: RecipeConfig, out: Path, browsers: StaticBrowsers, loaded: Loaded, advance: Advance
) -> _Demonstrations:
    """Make the demonstrations, or read them from the folder.

    Raises:
        ConfigError: those in the folder were made with other settings.
    """
    path = out / "demonstrations.msgpack"
    settings = config.model_dump(mode="json", exclude={"pretrain"})
    if path.exists():
        stored = msgspec.msgpack.decode(path.read_bytes())
        if stored.get("settings") != settings:
            raise ConfigError(f"{path} was made with other settings", hint="choose another folder")
        return msgspec.convert(stored, _Demonstrations)
    tasks = _tasks(browsers.web, "train", config.seed)
    policy, rng = Demonstrators(), random.Random(config.seed)
    kinds: tuple[PromptFormat, ...] = ("compact", "compact_official")
    collectors = {
        kind: StaticCollector(browsers, agent_of(policy, kind), config.attempt, config.seed) for kind in kinds
    }
    demonstrations = _Demonstrations(settings, [], [])
    for number in range(config.attempts):
        kind = kinds[rng.random() < WITHOUT_MEMORY]
        sample, index = divmod(number, len(tasks))
        episode = await collectors[kind].make(Planned(tasks[index], sample))
        demonstrations.acting += acting(episode, loaded.renderer)
        advance("demonstrations", number + 1, config.attempts)
    viewport = browsers.web.collection.viewport
    demonstrations.signs = [signs_of(name, shown, viewport) for name, shown in browsers.signs.items()]
    write_whole(path, msgspec.msgpack.encode(demonstrations))
    return demonstrations


def agent_of(policy: Policy, prompt_format: PromptFormat = "compact") -> Agent:
    """An agent for the tiny policy: its compact prompts show only the newest screenshot."""
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
    """Make an attempt at each task with a model; returns the figures of :func:`score`.

    Args:
        browsers: of the websites.
        model: its folder.
        tasks: to attempt.
        config: limits of an attempt.
        advance: called with the progress.
        prompt_format: of the requests.
        seed: of the sampling.
        together: number of concurrent attempts, whose requests are batched.
    """
    policy = LocalPolicy(LocalConfig(path=str(model), threads=1), choose_profile(PROFILE, model.name))
    agent = agent_of(policy, prompt_format)
    collectors = StaticCollector(browsers, agent, config, seed)
    slots, done = asyncio.Semaphore(together), list[Episode]()

    async def attempt(task: Task) -> Episode:
        async with slots:
            episode = await collectors.make(Planned(task, 0))
        done.append(episode)
        advance("examination", len(done), len(tasks))
        return episode

    async with agent:
        episodes = await asyncio.gather(*map(attempt, tasks))
    return await score(tasks, episodes)


async def score(tasks: Sequence[Task], episodes: Sequence[Episode]) -> dict[str, Any]:
    """Figures of attempts at tasks, with the keys of ``summary.json``."""
    judge, tally, seconds = OfflineJudge(), Tally(tasks), CollectorConfig().judge_seconds
    for task, episode in zip(tasks, episodes, strict=True):
        result = await judge_episode(judge, task, episode, no_picture, seconds)
        tally.add(digest_of(result.of(episode)))
    summary = tally.summary()
    unreadable = sum(step.action is None for episode in episodes for step in episode.steps)
    return {
        "attempts": summary["attempts"],
        "outcomes": summary["outcomes"],
        "success_rate": summary["success_rate"],
        "success_interval": summary["success_interval"],
        "planned": summary["planned"],
        "steps": summary["steps"],
        "unreadable_replies": unreadable,
    }
