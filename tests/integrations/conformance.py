"""Checks of adapters in real browsers, beside :func:`webgym.testing.check_adapter`."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Sequence
from typing import Any
from urllib.parse import urlsplit

import webgym.testing
from webgym import Action, Answer, RunConfig, Scroll
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.run.config import TaskChoice
from webgym.testing import Adapt, Told


def in_browsers() -> tuple[dict[str, Any], list[tuple[str, Sequence[Action | str]]]]:
    """Arguments of a pool of two real browsers on the small websites; and two of their tasks, each with what
    solves it."""
    config = RunConfig(sites=SitesConfig(collection="small", per_family=1), tasks=TaskChoice(count="all"))
    web = OfflineWeb(config.sites.seed, per_family=1, collection="small")
    solved: list[tuple[str, Sequence[Action | str]]] = []
    easy = (task for task in web.tasks() if task.split == "train" and task.difficulty == 1)
    for task in itertools.islice(easy, 2):
        site = web.website(urlsplit(task.website).hostname or "")
        assert site is not None
        steps = webgym.testing.play(site, task, web.collection.viewport).steps
        solved.append((task.id, [step.action for step in steps if step.action is not None]))
    return {"name": "offline-small-v2", "size": 2, "split": "train", "config": config}, solved


async def check_in_browsers(adapt: Adapt) -> list[Told]:
    """Play two tasks in real browsers at the same time, one as it is solved, and one with a wrong answer.

    Args:
        adapt: opens the adapter.

    Returns:
        What was told of them: 1 and 0, if all is well.
    """
    given, [(first, right), (second, _)] = in_browsers()
    async with adapt(given) as adapted:
        both = (adapted.play(first, right), adapted.play(second, [Scroll("down"), Answer("no idea")]))
        return list(await asyncio.gather(*both))
