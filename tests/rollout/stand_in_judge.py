"""A judge behind HTTP: every answer is right, if it can be reached."""

from __future__ import annotations

import os

import aiohttp

from webgym.core.task import Task
from webgym.core.trajectory import Episode

ADDRESS = "WEBGYM_TEST_JUDGE"
"""Variable that says where it is; without it there is a verdict at once."""


async def judge(task: Task, episode: Episode) -> bool:
    del task
    if address := os.environ.get(ADDRESS):
        async with aiohttp.ClientSession() as session, session.get(address) as response:
            assert response.status == 200
    return episode.answer is not None
