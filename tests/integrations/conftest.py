"""What tests of adapters share."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def _frameworks_garbage(request: pytest.FixtureRequest) -> Iterator[None]:
    """What a framework leaves open is found while its warnings are ignored, not when all tests are over."""
    yield
    if request.node.get_closest_marker("filterwarnings"):
        gc.collect()
