"""The tiny policy that comes with the package (``webgym.study``): a token per 32 pixels of picture."""

from __future__ import annotations

from webgym.agent.image_sizing import MultipleOf
from webgym.agent.profile import Profile
from webgym.llm.config import Sampling

PROFILES = (
    Profile(
        name="tiny",
        models=(r"^webgym-tiny\b",),
        pictures=MultipleOf(factor=32, min_pixels=1024, max_pixels=393216),
        sampling=Sampling(temperature=1.0, top_p=1.0, max_tokens=64),
        request_tokens=1024,
    ),
)
