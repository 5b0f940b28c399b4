"""What tests of collectors share."""

from collections.abc import AsyncIterator

import pytest
from tests.rollout.running import World, a_world
from tests.rollout.stand_in_judge import ADDRESS


@pytest.fixture
async def world(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[World]:
    """Servers that stand in, of which the judge is asked."""
    async with a_world() as world:
        monkeypatch.setenv(ADDRESS, world.url("judge"))
        yield world
