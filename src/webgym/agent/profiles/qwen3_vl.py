"""Qwen3-VL, Instruct and Thinking, and Qwen3.5 and later: points on a 0-1000 grid, patches of 16 pixels
merged two by two.

Sizes after the models' ``preprocessor_config.json`` (shortest and longest edge are areas there, in pixels);
checked against the processor of ``transformers`` 5 (tests/agent/test_patches.py). The Thinking models' chat
template opens the thinking itself, and that of Qwen3.5 and later as the request asks for it.
"""

from __future__ import annotations

from webgym.agent.image_sizing import MultipleOf
from webgym.agent.profile import PAPER_SAMPLING, Profile

_PICTURES = MultipleOf(factor=32, min_pixels=65536, max_pixels=16777216)

PROFILES = (
    Profile(
        name="qwen3-vl", models=(r"qwen3[-_ ]?vl(?!.*thinking)",), pictures=_PICTURES, sampling=PAPER_SAMPLING
    ),
    Profile(
        name="qwen3-vl-thinking",
        models=(r"qwen3[-_ ]?vl.*thinking",),
        pictures=_PICTURES,
        thinking="opened",
        sampling=PAPER_SAMPLING.model_copy(update={"max_tokens": 8192}),
        request_tokens=24576,
    ),
    Profile(
        name="qwen3.5",
        models=(r"qwen3[._p][5-9]",),
        pictures=_PICTURES,
        sampling=PAPER_SAMPLING.model_copy(update={"max_tokens": 8192}),
        request_tokens=24576,
    ),
)
