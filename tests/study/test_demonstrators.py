"""Who the tiny policy learns from: right where they are careful, wrong where they are not, never
clairvoyant."""

from __future__ import annotations

import random

import msgspec
import pytest

pytest.importorskip("torch")

from webgym.agent.config import PromptFormat
from webgym.core.action import LeftClick
from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.judge.base import no_picture
from webgym.judge.offline import OfflineJudge
from webgym.offline.small import small_vocabulary
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import AttemptConfig
from webgym.rollout.plan import Planned
from webgym.study.demonstrators import DEMONSTRATORS, Demonstrators, Habits
from webgym.study.model import cell_centres, make_tokenizer
from webgym.study.recipe import agent_of
from webgym.study.static_browsers import StaticBrowsers, StaticCollector

WEB = OfflineWeb(7, per_family=6, collection="small")
VIEWPORT = WEB.collection.viewport


def some_tasks(count: int, *, parts: int = 1) -> list[Task]:
    """Tasks that ask for an answer, from all families."""
    tasks = [task for task in WEB.tasks() if task.truth and len(task.truth.answer.required) >= parts]
    return random.Random(1).sample(tasks, count)


async def attempt(task: Task, policy: Demonstrators, prompt_format: PromptFormat = "compact") -> Episode:
    agent = agent_of(policy, prompt_format)
    config = AttemptConfig(budget_easy=12, budget_medium=24, budget_hard=36)
    return await StaticCollector(StaticBrowsers(WEB, None), agent, config, seed=5).make(Planned(task, 0))


async def successes(
    tasks: list[Task], habits: dict[str, Habits], prompt_format: PromptFormat = "compact"
) -> float:
    judge, passed = OfflineJudge(), 0
    for task in tasks:
        episode = await attempt(task, Demonstrators(habits), prompt_format)
        passed += (await judge.judge(task, episode, no_picture)).reward == 1
    return passed / len(tasks)


async def test_the_careful_one_succeeds_and_the_mixture_sometimes() -> None:
    tasks = some_tasks(40)
    assert await successes(tasks, {"careful": Habits()}) == 1
    assert 0.25 < await successes(tasks, dict(DEMONSTRATORS)) < 0.8


async def test_what_was_not_written_down_is_not_answered() -> None:
    tasks = some_tasks(30, parts=2)
    assert await successes(tasks, {"careful": Habits()}) == 1
    assert await successes(tasks, {"forgetful": Habits(forgets=1.0)}) < 0.25
    assert await successes(tasks, {"careful": Habits()}, "compact_official") < 0.25


async def test_replies_are_in_the_tiny_policys_words_and_clicks_in_its_cells() -> None:
    tokenizer = make_tokenizer(small_vocabulary(), VIEWPORT)
    columns, rows = map(cell_centres, VIEWPORT)
    for task in some_tasks(25):
        for step in (await attempt(task, Demonstrators())).steps:
            told = "\n".join(part.text for part in step.messages[-1].content if hasattr(part, "text"))
            for text in (told, step.reply.text):
                ids = tokenizer(text, add_special_tokens=False)["input_ids"]
                assert tokenizer.unk_token_id not in ids, text
            assert tokenizer.decode(tokenizer(step.reply.text)["input_ids"]).split() == (
                step.reply.text.replace(",", " , ").split()
            )
            if isinstance(step.action, LeftClick):
                assert step.action.target.coordinate is not None
                x, y = step.action.target.coordinate
                assert x in columns
                assert y in rows


async def test_the_same_seed_makes_the_same_attempt() -> None:
    task = some_tasks(1, parts=2)[0]
    episodes = [await attempt(task, Demonstrators()) for _ in range(2)]
    one, two = ([msgspec.structs.replace(step, at=0.0) for step in each.steps] for each in episodes)
    assert msgspec.json.encode(one) == msgspec.json.encode(two)
