"""How model families scale pictures, and how many tokens a picture costs.

A picture is sent at exactly the size to which the model's own processor would scale it. The processor then
does not change it: the model sees the recorded pixels, and its coordinates refer to them.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import msgspec

Size: TypeAlias = tuple[int, int]
"""Width and height, pixels."""


class PictureRule(msgspec.Struct, frozen=True, kw_only=True, tag_field="rule"):
    """How a model family scales pictures. ``size`` must be idempotent."""

    def size(self, size: Size) -> Size:
        """The size at which the model sees a picture of this size; by default the given one."""
        return size

    def tokens(self, size: Size) -> int:
        """Cost of a picture of this size, in tokens; rather too many than too few."""
        raise NotImplementedError


class Unscaled(PictureRule, frozen=True, kw_only=True, tag="unscaled"):
    """A picture is sent unchanged, and costs a token per square.

    Attributes:
        square: side of the square that counts as one token, pixels.
    """

    square: int = 28

    def tokens(self, size: Size) -> int:
        """One token per square, partial ones included."""
        return math.ceil(size[0] / self.square) * math.ceil(size[1] / self.square)


class CutUp(PictureRule, frozen=True, kw_only=True, tag="cut_up"):
    """A picture is sent unchanged, and the processor stretches it or cuts it into tiles of its own.

    Attributes:
        most_tokens: that a picture of any size may cost.
    """

    most_tokens: int

    def tokens(self, size: Size) -> int:  # noqa: ARG002
        """The most, whatever the size."""
        return self.most_tokens


class MultipleOf(PictureRule, frozen=True, kw_only=True, tag="multiple_of"):
    """Both sides are rounded to multiples of a factor, and the area is kept between two bounds.

    This is ``smart_resize`` of the processors of Qwen-VL and GLM-V: patches of 14 or 16 pixels, of which two
    by two become one token.

    Attributes:
        factor: patch side times merge size, pixels.
        min_pixels, max_pixels: smallest and largest area.
    """

    factor: int
    min_pixels: int
    max_pixels: int

    def size(self, size: Size) -> Size:
        """The nearest multiples; a picture outside of the bounds is scaled to them first."""
        factor, area = self.factor, size[0] * size[1]
        near = [round(side / factor) * factor for side in size]
        if near[0] * near[1] > self.max_pixels:
            scale = math.sqrt(area / self.max_pixels)
            near = [max(factor, math.floor(side / scale / factor) * factor) for side in size]
        elif near[0] * near[1] < self.min_pixels:
            scale = math.sqrt(self.min_pixels / area)
            near = [math.ceil(side * scale / factor) * factor for side in size]
        return near[0], near[1]

    def tokens(self, size: Size) -> int:
        """One token per square of the factor, and one before and after the picture."""
        width, height = self.size(size)
        return (width // self.factor) * (height // self.factor) + 2


class TiledScaling(PictureRule, frozen=True, kw_only=True, tag="tiled_scaling"):
    """A picture is scaled down into a box and to a shortest side, then cut into tiles.

    The rule of GPT-4o, GPT-4.1 and GPT-5 at ``detail: high``, after OpenAI's guide to images.

    Attributes:
        base_tokens: cost of any picture.
        tile_tokens: additional cost of each tile, partial ones included.
        box: upper limit of the longer side, pixels.
        short_side: upper limit of the shorter side, pixels.
        tile: side of a tile, pixels.
    """

    base_tokens: int
    tile_tokens: int
    box: int = 2048
    short_side: int = 768
    tile: int = 512

    def size(self, size: Size) -> Size:
        """Scaled down, never up."""
        scale = min(1.0, self.box / max(size), self.short_side / min(size))
        return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))

    def tokens(self, size: Size) -> int:
        """Cost of the picture and its tiles."""
        width, height = self.size(size)
        tiles = math.ceil(width / self.tile) * math.ceil(height / self.tile)
        return self.base_tokens + self.tile_tokens * tiles


class Patches(PictureRule, frozen=True, kw_only=True, tag="patches"):
    """A picture is scaled down until a limited number of patches cover it.

    The rule of GPT-4.1 mini, GPT-5 mini and o4-mini, after OpenAI's guide to images.

    Attributes:
        patch_tokens: cost of a patch, tokens.
        most: largest number of patches.
        patch: side of a patch, pixels.
    """

    patch_tokens: float
    most: int = 1536
    patch: int = 32

    def size(self, size: Size) -> Size:
        """Scaled down, never up, until whole patches fill one of the sides."""
        if self._patches(size) <= self.most:
            return size
        scale = math.sqrt(self.patch**2 * self.most / (size[0] * size[1]))
        across, down = (side * scale / self.patch for side in size)
        scale *= min(math.floor(across) / across, math.floor(down) / down)
        return max(1, math.floor(size[0] * scale)), max(1, math.floor(size[1] * scale))

    def tokens(self, size: Size) -> int:
        """Cost of the patches."""
        return math.ceil(self._patches(self.size(size)) * self.patch_tokens)

    def _patches(self, size: Size) -> int:
        return math.ceil(size[0] / self.patch) * math.ceil(size[1] / self.patch)


def within(size: Size, max_side: int | None) -> Size:
    """The size, scaled down if its longer side exceeds ``max_side``."""
    width, height = size
    longest = max(width, height)
    if max_side is None or longest <= max_side:
        return size
    return max(1, round(width * max_side / longest)), max(1, round(height * max_side / longest))
