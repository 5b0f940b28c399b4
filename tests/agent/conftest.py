from __future__ import annotations

import io
from collections.abc import Awaitable, Callable

import pytest
from PIL import Image
from tests.agent.shop import Shop

from webgym.agent.agent import Agent
from webgym.core.action import Answer
from webgym.core.task import Task
from webgym.core.trajectory import Step

Play = Callable[..., Awaitable[list[Step]]]


@pytest.fixture(scope="session")
def png() -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (1280, 768), "white").save(out, "PNG")
    return out.getvalue()


@pytest.fixture
def play(png: bytes) -> Play:
    """Lets an agent play a task in the shop until it answers or its budget is spent."""

    async def play(agent: Agent, shop: Shop, task: Task, *, seed: int = 0, budget: int = 60) -> list[Step]:
        steps = []
        async with agent:
            conversation = agent.begin(task, seed, budget)
            for index in range(budget):
                step = await conversation.turn(shop.observe(agent.mode), png, float(index))
                steps.append(step)
                if isinstance(step.action, Answer):
                    break
                shop.act(step.action)
        return steps

    return play
