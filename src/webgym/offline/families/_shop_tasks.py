"""The tasks of a shop."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from webgym.offline.parts import Assignment

if TYPE_CHECKING:
    from webgym.offline.families.shop import Shop


def assignments(shop: Shop) -> Iterable[Assignment]:
    """The tasks of a shop, before decomposition."""
    del shop
    return ()
