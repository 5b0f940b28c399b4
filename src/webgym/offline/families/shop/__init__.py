"""Shops of one sector: articles with reviews and brands, stores, a cart and an account."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Shop(SpecifiedWebsite):
    """A shop."""

    family: ClassVar[str] = "shop"
