"""Qwen2.5-VL and computer-use models trained from it: points on the pixels of the picture as its processor
leaves it, patches of 14 pixels.

Of these, UI-TARS 1.5, Fara, OpenCUA, Holo1, GTA1 and GUI-Owl before 1.5 are known by name. The first UI-TARS
comes from Qwen2-VL and points on a 0-1000 grid, as :data:`~webgym.agent.profiles.GENERIC` reads it.
"""

from __future__ import annotations

from webgym.agent.image_sizing import MultipleOf
from webgym.agent.profile import PAPER_SAMPLING, Profile

PROFILES = (
    Profile(
        name="qwen2.5-vl",
        models=(
            r"qwen2[._p-]?5[-_ ]?vl",
            r"ui-?tars-1[._p-]5",
            r"(^|[/:])(fara|opencua|holo1|gta1)\b",
            r"gui-owl(?!-1[._p-]5)",
        ),
        pictures=MultipleOf(factor=28, min_pixels=3136, max_pixels=12845056),
        grid="pixels",
        sampling=PAPER_SAMPLING,
    ),
)
