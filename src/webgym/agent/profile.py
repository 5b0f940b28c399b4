"""Properties of a model family: image sizes, coordinates, thinking tags, sampling parameters."""

from __future__ import annotations

import re
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.agent.image_sizing import PictureRule, Size, Unscaled, within
from webgym.core.action import GRID, Mode
from webgym.llm.config import Sampling

Thinking: TypeAlias = Literal["tagged", "opened"]
"""``tagged``: thinking in a reply begins with ``<think>``. ``opened``: the chat template has opened the
thinking already, so that a reply without ``</think>`` is thinking that was cut off."""

PAPER_SAMPLING: Final = Sampling(temperature=1.0, top_p=0.99, max_tokens=3072, extra_body={"top_k": 2})
"""The paper's sampling in training (appendix F). vLLM and SGLang support ``top_k``, some endpoints do not."""

DEFAULT_SAMPLING: Final = Sampling(temperature=1.0, top_p=0.99, max_tokens=3072)
"""The paper's sampling without the parameters that some endpoints do not support."""


class Profile(msgspec.Struct, frozen=True, kw_only=True):
    """A family of models.

    Attributes:
        name: the profile's name, as for ``--profile``.
        models: regular expressions, case-insensitive, one of which matches part of every model name of the
            family.
        pictures: how pictures are scaled, and what they cost.
        grid: ``thousand``: points are on a 0-1000 grid over the picture, whatever its size. ``pixels``: they
            are pixels of the picture as the model sees it.
        mode: how a target is named, unless the settings override it.
        thinking: how a reply marks its thinking.
        detail: the ``detail`` of every picture in a request; empty to leave it out.
        sampling: default sampling parameters.
        length_key: the endpoint's name for the parameter that limits the reply's length.
        request_tokens: longest request, in tokens: the usual context length of the model, less the longest
            reply.
        max_images: most pictures in a request; ``None`` if there is no limit.
    """

    name: str
    models: tuple[str, ...] = ()
    pictures: PictureRule = Unscaled()
    grid: Literal["thousand", "pixels"] = "thousand"
    mode: Mode = "coordinates"
    thinking: Thinking = "tagged"
    detail: str = ""
    sampling: Sampling = DEFAULT_SAMPLING
    length_key: Literal["max_tokens", "max_completion_tokens"] = "max_tokens"
    request_tokens: int = 28672
    max_images: int | None = None

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
        return sent if self.grid == "pixels" else (GRID, GRID)

    def sampling_of(self, given: Sampling) -> Sampling:
        """The sampling of a request: the given parameters over the family's, under the family's names."""
        chosen = given.over(self.sampling)
        if self.length_key == "max_tokens" or chosen.max_tokens is None:
            return chosen
        extra = {self.length_key: chosen.max_tokens} | chosen.extra_body
        return chosen.model_copy(update={"max_tokens": None, "extra_body": extra})
