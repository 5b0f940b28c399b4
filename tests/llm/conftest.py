from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from tests.llm.endpoint import Endpoint, serve


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "replies.sqlite"


@pytest.fixture
async def endpoint() -> AsyncIterator[Endpoint]:
    async with serve() as endpoint:
        yield endpoint
