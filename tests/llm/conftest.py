from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
from tests.llm.endpoint import Endpoint, serve


@pytest.fixture
async def endpoint() -> AsyncIterator[Endpoint]:
    async with serve() as endpoint:
        yield endpoint
