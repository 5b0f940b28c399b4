"""Qwen2.5-VL: points on the pixels of the picture as its processor leaves it, patches of 14 pixels."""

from __future__ import annotations

from webgym.agent.image_sizing import MultipleOf
from webgym.agent.profile import PAPER_SAMPLING, Profile

PROFILES = (
    Profile(
        name="qwen2.5-vl",
        models=(r"qwen2[._p-]?5[-_ ]?vl",),
        pictures=MultipleOf(factor=28, min_pixels=3136, max_pixels=12845056),
        grid="pixels",
        sampling=PAPER_SAMPLING,
    ),
)
