"""GPT-class models, which point badly and read well, so that they use Set-of-Marks (paper §5).

Sizes and costs of pictures after OpenAI's guide to images at ``detail: high``. Reasoning models accept no
sampling parameters, and limit the reply, reasoning included, with ``max_completion_tokens``.
"""

from __future__ import annotations

from webgym.agent.image_sizing import Patches, PictureRule, TiledScaling
from webgym.agent.profile import DEFAULT_SAMPLING, Profile
from webgym.llm.config import Sampling

_START = r"(^|[/:])"


def _chat_model(name: str, pattern: str, pictures: PictureRule) -> Profile:
    return Profile(
        name=name,
        models=(_START + pattern,),
        pictures=pictures,
        mode="marks",
        detail="high",
        sampling=DEFAULT_SAMPLING,
        request_tokens=120_000,
    )


def _reasoning_model(name: str, pattern: str, pictures: PictureRule) -> Profile:
    return Profile(
        name=name,
        models=(_START + pattern,),
        pictures=pictures,
        mode="marks",
        detail="high",
        sampling=Sampling(max_tokens=16384),
        length_key="max_completion_tokens",
        request_tokens=180_000,
    )


PROFILES = (
    _chat_model(
        "gpt-4",
        r"(chatgpt-4o|gpt-4o(?!-mini)|gpt-4\.1(?!-mini|-nano)|gpt-4-turbo)",
        TiledScaling(base_tokens=85, tile_tokens=170),
    ),
    _chat_model("gpt-4o-mini", r"gpt-4o-mini", TiledScaling(base_tokens=2833, tile_tokens=5667)),
    _chat_model("gpt-4.1-mini", r"gpt-4\.1-(mini|nano)", Patches(patch_tokens=2.46)),
    _reasoning_model(
        "gpt-5", r"(gpt-5(?!.*-(mini|nano))|o[13](?!-mini))", TiledScaling(base_tokens=75, tile_tokens=150)
    ),
    _reasoning_model("gpt-5-mini", r"(gpt-5.*-(mini|nano)|o4-mini)", Patches(patch_tokens=2.46)),
)
