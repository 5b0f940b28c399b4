"""Cooking websites of one cuisine: recipes, cooks, charts."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Recipes(SpecifiedWebsite):
    """A cooking website."""

    family: ClassVar[str] = "recipes"
