"""What a family of models needs: image sizes, coordinates, thinking tags, sampling parameters."""

from __future__ import annotations

import re
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.agent.image_sizing import PictureRule, Size, Unscaled, within
from webgym.core.action import GRID, Mode
from webgym.llm.config import Sampling

Thinking: TypeAlias = Literal["tagged", "opened"]
"""``tagged``: if a reply thinks, it says so with ``<think>``. ``opened``: the chat template has opened the
thinking already, so that a reply without ``</think>`` is thinking that was cut off."""

PAPER_SAMPLING: Final = Sampling(temperature=1.0, top_p=0.99, max_tokens=3072, extra_body={"top_k": 2})
"""How the paper samples in training (appendix F). ``top_k`` is known to vLLM and SGLang, not to all."""

DEFAULT_SAMPLING: Final = Sampling(temperature=1.0, top_p=0.99, max_tokens=3072)
"""The paper's sampling as far as every endpoint understands it."""


class Profile(msgspec.Struct, frozen=True, kw_only=True):
    """A family of models.

    Attributes:
        name: what ``--profile`` takes.
        models: patterns, one of which is found in the name of every model of the family, whatever the case.
        pictures: how pictures are scaled, and what they cost.
        grid: ``thousand``: points lie on a 0-1000 grid over the picture, whatever its size. ``pixels``: they
            lie on the pixels of the picture as the model sees it.
        mode: how a target is named, unless the settings say otherwise.
        thinking: how a reply's thinking is told from the reply.
        detail: the ``detail`` of every picture in a request; empty to leave it out.
        sampling: holds for what the settings do not say.
        length_key: what the endpoint calls the longest reply.
        request_tokens: longest request, in tokens: the context that the model is usually served with, less
            the longest reply.
        max_images: pictures in a request at most; ``None`` if there is no limit.
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
        """Whether a model of this name is of the family."""
        return any(re.search(pattern, model, re.IGNORECASE) for pattern in self.models)

    def picture_size(self, viewport: Size, max_side: int | None = None) -> Size:
        """The size, in pixels, at which a picture of this viewport is sent.

        Args:
            viewport: the picture's own size.
            max_side: of the settings, which goes before the family's rule.
        """
        return self.pictures.size(within(viewport, max_side))

    def screen(self, sent: Size) -> Size:
        """Where the points of the family's replies end, given the size at which pictures are sent."""
        return sent if self.grid == "pixels" else (GRID, GRID)

    def sampling_of(self, given: Sampling) -> Sampling:
        """The sampling of a request: what was given over the family's own, in the family's words."""
        chosen = given.over(self.sampling)
        if self.length_key == "max_tokens" or chosen.max_tokens is None:
            return chosen
        extra = {self.length_key: chosen.max_tokens} | chosen.extra_body
        return chosen.model_copy(update={"max_tokens": None, "extra_body": extra})
