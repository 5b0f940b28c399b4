"""Properties of a model family: image sizes, coordinates, thinking tags, sampling parameters."""

from __future__ import annotations

import re
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.agent.image_sizing import (
    CutUp,
    MultipleOf,
    Patches,
    Size,
    TiledScaling,
    Unscaled,
    within,
)
from webgym.core.action import GRID, Mode
from webgym.llm.config import Sampling

Thinking: TypeAlias = Literal["tagged", "opened"]
"""``tagged``: thinking in a reply begins with ``<think>``. ``opened``: the chat template has opened the
thinking already, so that a reply without ``</think>`` is thinking that was cut off."""

Grid: TypeAlias = Literal["thousand", "pixels", "percent", "unit"]

SCALES: Final[dict[Grid, str]] = {
    "thousand": "on a 0-1000 grid",
    "pixels": "in pixels of the picture",
    "percent": "in per cent of the picture",
    "unit": "in shares of the picture from 0 to 1",
}
"""What points of a family refer to, in words."""

_SCREENS: Final[dict[Grid, Size]] = {"thousand": (GRID, GRID), "percent": (100, 100), "unit": (1, 1)}

DEFAULT_SAMPLING: Final = Sampling(temperature=1.0, top_p=0.99, max_tokens=3072)
"""The paper's sampling (appendix F) without ``top_k``, which some endpoints do not support."""


class Profile(msgspec.Struct, frozen=True, kw_only=True):
    """A family of models.

    Attributes:
        name: the profile's name, as for ``--profile``.
        models: regular expressions, case-insensitive, one of which matches part of every model name of the
            family.
        pictures: how pictures are scaled, and what they cost.
        grid: what points refer to: a 0-1000 grid over the picture, whatever its size (``thousand``), pixels
            of the picture as the model sees it (``pixels``), ``percent`` of it, or shares from 0 to 1
            (``unit``).
        mode: how a target is named, unless the settings override it.
        thinking: how a reply marks its thinking.
        detail: the ``detail`` of every picture in a request; empty to leave it out.
        sampling: default sampling parameters.
        length_key: the endpoint's name for the parameter that limits the reply's length.
        request_tokens: longest request, in tokens: the usual context length of the model, less the longest
            reply.
        max_images: most pictures in a request; ``None`` if there is no limit.
        unverified: what of this neither the family's own code nor its documentation confirms, in words; the
            check before a run shows it when it fails.
    """

    name: str
    models: tuple[str, ...] = ()
    pictures: Unscaled | CutUp | MultipleOf | TiledScaling | Patches = Unscaled()
    grid: Grid = "thousand"
    mode: Mode = "coordinates"
    thinking: Thinking = "tagged"
    detail: str = ""
    sampling: Sampling = DEFAULT_SAMPLING
    length_key: Literal["max_tokens", "max_completion_tokens"] = "max_tokens"
    request_tokens: int = 28672
    max_images: int | None = None
    unverified: str = ""

    def fits(self, model: str) -> bool:
        """Whether a model of this name belongs to the family."""
        return any(re.search(pattern, model, re.IGNORECASE) for pattern in self.models)

    def picture_size(self, size: Size, max_side: int | None = None) -> Size:
        """The size, in pixels, at which a picture is sent.

        Args:
            size: the picture's own size.
            max_side: longest side from the settings, applied before the family's rule; ``None`` for no limit.
        """
        return self.pictures.size(within(size, max_side))

    def screen(self, sent: Size) -> Size:
        """Largest x and y of points in the family's replies, given the size at which pictures are sent."""
        return _SCREENS.get(self.grid, sent)

    def sampling_of(self, given: Sampling) -> Sampling:
        """The sampling of a request: the given parameters over the family's, under the family's names."""
        chosen = given.over(self.sampling)
        if self.length_key == "max_tokens" or chosen.max_tokens is None:
            return chosen
        extra = {self.length_key: chosen.max_tokens} | chosen.extra_body
        return chosen.model_copy(update={"max_tokens": None, "extra_body": extra})
