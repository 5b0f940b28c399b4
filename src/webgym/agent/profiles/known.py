"""The families that come with WebGym.

**Qwen3-VL**, Instruct and Thinking, and Qwen3.5 and later point on a 0-1000 grid; patches of 16 pixels are
merged two by two. Sizes after the models' ``preprocessor_config.json`` (shortest and longest edge are areas
there, in pixels), checked against the processor of ``transformers`` 5. The Thinking models' chat template
opens the thinking itself, and that of Qwen3.5 and later as the request asks for it.

**Qwen2.5-VL** and computer-use models trained from it point on the pixels of the picture as its processor
leaves it, with patches of 14 pixels. Of these, UI-TARS 1.5, Fara, OpenCUA, Holo1, GTA1 and GUI-Owl before
1.5 are known by name. The first UI-TARS comes from Qwen2-VL and points on a 0-1000 grid, as
:data:`~webgym.agent.profiles.GENERIC` reads it.

**GPT-class models** point badly and read well, so they use Set-of-Marks (paper §5). Sizes and costs of
pictures after OpenAI's guide to images at ``detail: high``. Reasoning models accept no sampling parameters,
and limit the reply, reasoning included, with ``max_completion_tokens``.

**The tiny policy** (``webgym.study``) has a token per 32 pixels of picture.
"""

from __future__ import annotations

from webgym.agent.image_sizing import MultipleOf, Patches, PictureRule, TiledScaling
from webgym.agent.profile import DEFAULT_SAMPLING, PAPER_SAMPLING, Profile
from webgym.llm.config import Sampling

_PICTURES = MultipleOf(factor=32, min_pixels=65536, max_pixels=16777216)
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
    Profile(
        name="tiny",
        models=(r"^webgym-tiny\b",),
        pictures=MultipleOf(factor=32, min_pixels=1024, max_pixels=393216),
        sampling=Sampling(temperature=1.0, top_p=1.0, max_tokens=64),
        request_tokens=1024,
    ),
)
