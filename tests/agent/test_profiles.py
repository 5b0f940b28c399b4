"""Families of models: who is of which, what size their pictures have, how they are sampled."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.agent.config import AgentConfig
from webgym.agent.image_sizing import MultipleOf, Patches, TiledScaling
from webgym.agent.profile import DEFAULT_SAMPLING
from webgym.agent.profiles import GENERIC, all_profiles, choose_profile, profile_of
from webgym.agent.prompts import tool_declaration
from webgym.core.errors import ConfigError
from webgym.llm.config import ChatConfig, Sampling
from webgym.run.config import PolicyChoice, RunConfig, resolved

DOCS = Path(__file__).parents[2] / "docs" / "agent.md"
PAPER_SAMPLING = Sampling(temperature=1.0, top_p=0.99, max_tokens=3072, extra_body={"top_k": 2})

# As transformers 5.23 has them (`smart_resize` of its Qwen2VL processor), width first.
QWEN3 = {
    (1280, 768): (1280, 768),
    (768, 1280): (768, 1280),
    (1920, 1080): (1920, 1088),
    (1366, 768): (1376, 768),
    (1000, 1000): (992, 992),
    (393, 851): (384, 864),
    (200, 120): (352, 224),
    (4096, 4097): (4096, 4096),
    (8000, 4000): (5792, 2880),
    (33, 47): (224, 320),
}
QWEN25 = {
    (1280, 768): (1288, 756),
    (768, 1280): (756, 1288),
    (1920, 1080): (1932, 1092),
    (1366, 768): (1372, 756),
    (1000, 1000): (1008, 1008),
    (200, 120): (196, 112),
    (4096, 4097): (3556, 3584),
    (8000, 4000): (5068, 2520),
    (33, 47): (56, 84),
}


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("Qwen/Qwen3-VL-8B-Instruct", "qwen3-vl"),
        ("qwen3-vl-235b-a22b-instruct-fp8", "qwen3-vl"),
        ("/models/my-qwen3_vl-step-400", "qwen3-vl"),
        ("Qwen/Qwen3-VL-8B-Thinking", "qwen3-vl-thinking"),
        ("qwen3-vl-plus-thinking", "qwen3-vl-thinking"),
        ("Qwen/Qwen2.5-VL-7B-Instruct", "qwen2.5-vl"),
        ("accounts/fireworks/models/qwen2p5-vl-32b-instruct", "qwen2.5-vl"),
        ("qwen25-vl-7b", "qwen2.5-vl"),
        ("qwen2-5-vl", "qwen2.5-vl"),
        ("ByteDance-Seed/UI-TARS-1.5-7B", "ui-tars-1.5"),
        ("ui-tars-1-5-7b-4bit", "ui-tars-1.5"),
        ("microsoft/Fara-7B", "fara-7b"),
        ("microsoft/Fara1.5-9B", "qwen3.5"),
        ("fara-1.5-9b", "qwen3.5"),
        ("xlangai/OpenCUA-32B", "qwen2.5-vl"),
        ("Hcompany/Holo1.5-7B", "qwen2.5-vl"),
        ("Salesforce/GTA1-7B", "qwen2.5-vl"),
        ("mPLUG/GUI-Owl-32B", "qwen2.5-vl"),
        ("Qwen/Qwen3.5-9B", "qwen3.5"),
        ("qwen3.8-plus", "qwen3.5"),
        ("Qwen/Qwen4-8B", "qwen3.5"),
        ("zai-org/GLM-4.1V-9B-Thinking", "glm-v"),
        ("zai-org/GLM-4.5V-FP8", "glm-v"),
        ("glm-4.6v-flash", "glm-v"),
        ("OpenGVLab/InternVL3-8B", "internvl3"),
        ("OpenGVLab/InternVL3_5-38B", "internvl3"),
        ("google/gemma-3-27b-it", "gemma-3"),
        ("allenai/MolmoWeb-8B", "molmoweb"),
        ("gpt-4o", "gpt-4"),
        ("openai/gpt-4o-2024-08-06", "gpt-4"),
        ("gpt-4.1", "gpt-4"),
        ("gpt-4o-mini", "gpt-4o-mini"),
        ("gpt-4.1-nano", "gpt-4.1-mini"),
        ("gpt-5", "gpt-5"),
        ("gpt-5.1-2025-11-13", "gpt-5"),
        ("o3", "gpt-5"),
        ("azure:o1-2024-12-17", "gpt-5"),
        ("gpt-5-mini-2025-08-07", "gpt-5-mini"),
        ("o4-mini", "gpt-5-mini"),
    ],
)
def test_a_family_is_known_by_the_models_name(model: str, name: str) -> None:
    assert [profile.name for profile in all_profiles().values() if profile.fits(model)] == [name]
    assert choose_profile(None, model).name == name


@pytest.mark.parametrize(
    "model",
    [
        *("tiny", "scripted", "gpt-oss-20b", "Qwen/Qwen3-8B", "foo3", "turbo1", "UI-TARS-7B-DPO", "safara-1"),
        *("glm-4.5-air", "google/gemma-3n-E4B-it", "allenai/Molmo2-8B", "OpenGVLab/InternVL2-8B"),
    ],
)
def test_other_models_are_of_no_family(model: str) -> None:
    assert profile_of(model) is None
    assert choose_profile(None, model) is GENERIC


def test_a_profile_may_be_chosen_and_its_mode_changed() -> None:
    assert choose_profile("qwen3-vl", "my-model").name == "qwen3-vl"
    assert choose_profile(None, "gpt-4o").mode == "marks"
    assert choose_profile(None, "gpt-4o", "coordinates").mode == "coordinates"
    assert choose_profile(None, "gpt-4o").name == choose_profile(None, "gpt-4o", "coordinates").name
    with pytest.raises(ConfigError, match="unknown profile 'qwen9'") as caught:
        choose_profile("qwen9", "my-model")
    assert "generic, gpt-4" in caught.value.hint


@pytest.mark.parametrize(("name", "sizes"), [("qwen3-vl", QWEN3), ("qwen2.5-vl", QWEN25)])
def test_pictures_get_the_size_that_the_processor_makes(
    name: str, sizes: dict[tuple[int, int], tuple[int, int]]
) -> None:
    rule = all_profiles()[name].pictures
    assert {size: rule.size(size) for size in sizes} == sizes


def test_glms_own_processor_leaves_its_pictures_as_they_are_sent() -> None:
    smart_resize: Any = pytest.importorskip(
        "transformers.models.glm4v.image_processing_pil_glm4v", exc_type=ImportError
    ).smart_resize
    rule = all_profiles()["glm-v"].pictures
    for width, height in (*QWEN25, (3000, 2000), (60, 60)):
        high, wide = smart_resize(2, height, width, factor=28, min_pixels=12544, max_pixels=9633792)
        assert rule.size((width, height)) == (wide, high)


@pytest.mark.parametrize(
    ("name", "module", "processor", "settings", "each"),
    [
        (
            "internvl3",
            "got_ocr2.image_processing_pil_got_ocr2",
            "GotOcr2ImageProcessorPil",
            {"size": {"height": 448, "width": 448}, "crop_to_patches": True, "max_patches": 12},
            256,
        ),
        ("molmoweb", "molmo2.image_processing_molmo2", "Molmo2ImageProcessor", {}, 1),
    ],
)
def test_a_picture_that_the_processor_cuts_up_costs_no_more_than_the_profile_says(
    name: str, module: str, processor: str, settings: dict[str, Any], each: int
) -> None:
    found = pytest.importorskip(f"transformers.models.{module}", exc_type=ImportError)
    if not hasattr(found, processor):
        pytest.skip(f"transformers has no {processor} here")
    patches = getattr(found, processor)().get_number_of_image_patches
    costs = [each * patches(height, width, settings) for width, height in (*QWEN3, *QWEN25)]
    most = all_profiles()[name].pictures.tokens((1280, 768))
    assert most / 2 < max(costs) <= most
    assert all_profiles()[name].picture_size((1280, 768)) == (1280, 768)


@given(st.sampled_from(sorted(all_profiles())), st.integers(30, 6000), st.integers(30, 6000))
def test_what_a_rule_has_made_it_leaves_alone(name: str, width: int, height: int) -> None:
    rule = all_profiles()[name].pictures
    size = rule.size((width, height))
    assert rule.size(size) == size
    assert rule.tokens((width, height)) == rule.tokens(size) > 0
    if isinstance(rule, MultipleOf):
        assert {side % rule.factor for side in size} == {0}
        assert rule.min_pixels <= size[0] * size[1] <= rule.max_pixels


@pytest.mark.parametrize(
    ("rule", "size", "sent", "tokens"),
    [  # the examples of OpenAI's guide to images
        (TiledScaling(base_tokens=85, tile_tokens=170), (1024, 1024), (768, 768), 765),
        (TiledScaling(base_tokens=85, tile_tokens=170), (2048, 4096), (768, 1536), 1105),
        (TiledScaling(base_tokens=85, tile_tokens=170), (1280, 768), (1280, 768), 1105),
        (Patches(patch_tokens=1), (1024, 1024), (1024, 1024), 1024),
        (Patches(patch_tokens=1), (1800, 2400), (1056, 1408), 1452),
    ],
)
def test_what_pictures_cost(
    rule: TiledScaling | Patches, size: tuple[int, int], sent: tuple[int, int], tokens: int
) -> None:
    assert (rule.size(size), rule.tokens(size)) == (sent, tokens)


def test_a_largest_side_goes_before_the_rule() -> None:
    qwen = all_profiles()["qwen3-vl"]
    assert qwen.picture_size((1280, 768), 640) == (640, 384)
    assert qwen.picture_size((1280, 768), 5000) == (1280, 768)
    assert GENERIC.picture_size((1280, 768), 320) == (320, 192)


def test_sampling_in_the_familys_words() -> None:
    families = all_profiles()
    assert families["qwen3-vl"].sampling_of(Sampling()) == PAPER_SAMPLING
    assert GENERIC.sampling_of(Sampling()) == DEFAULT_SAMPLING
    mine = Sampling(temperature=0, max_tokens=100, extra_body={"seed": 1})
    told = families["qwen3-vl"].sampling_of(mine).body()
    assert told == {"temperature": 0, "top_p": 0.99, "max_tokens": 100, "top_k": 2, "seed": 1}
    thinks = families["gpt-5"]
    assert thinks.sampling_of(mine).body() == {"temperature": 0, "max_completion_tokens": 100, "seed": 1}
    assert set(thinks.sampling_of(Sampling()).body()) == {"max_completion_tokens"}
    once = thinks.sampling_of(mine)
    assert thinks.sampling_of(once) == once


def test_a_model_that_points_at_pixels_is_told_its_screen() -> None:
    qwen = all_profiles()["qwen2.5-vl"]
    screen = qwen.screen(qwen.picture_size((1280, 768)))
    assert screen == (1288, 756)
    declared = json.dumps(tool_declaration("coordinates", screen))
    assert "The screen is 1288x756" in declared
    assert '"maximum": 1288' in declared


@pytest.mark.parametrize(
    ("name", "screen"), [("molmoweb", (100, 100)), ("glm-v", (1000, 1000)), ("ui-tars-1.5", (1288, 756))]
)
def test_points_refer_to_what_the_familys_own_code_reads_in_them(name: str, screen: tuple[int, int]) -> None:
    family = all_profiles()[name]
    assert family.screen(family.picture_size((1280, 768))) == screen
    assert family.unverified


def test_a_new_family_is_one_file(tmp_path: Path) -> None:
    """The file that the documentation shows is a family as it stands."""
    shown = DOCS.read_text().partition("<!-- a family -->\n```toml\n")[2].partition("```")[0]
    (tmp_path / "own.toml").write_text(shown)
    found = all_profiles(tmp_path)["looker"]
    assert found.fits("acme/Looker-2-7B")
    assert found.picture_size((1280, 768)) == (1280, 768)
    assert found.sampling_of(Sampling()).body()["top_k"] == 20


def test_no_two_profiles_share_a_name(tmp_path: Path) -> None:
    (tmp_path / "twice.toml").write_text("[generic]\n")
    with pytest.raises(ValueError, match="two profiles 'generic'"):
        all_profiles(tmp_path)


@pytest.mark.parametrize("text", ["[a]\npictures = {rule = 'none'}\n", "[a]\nsampling = {top_q = 1}\n", "[a"])
def test_a_file_that_holds_no_profiles_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "wrong.toml").write_text(text)
    with pytest.raises(ValueError):  # noqa: PT011 - the libraries' own
        all_profiles(tmp_path)


@pytest.mark.parametrize(
    ("model", "chosen", "name", "told"),
    [
        ("Qwen/Qwen3-VL-8B-Thinking", None, "qwen3-vl-thinking", 0),
        ("my-model", None, "generic", 1),
        ("my-model", "qwen3-vl", "qwen3-vl", 0),
        ("gpt-4o", None, "gpt-4", 0),
    ],
)
def test_a_run_says_what_it_uses(model: str, chosen: str | None, name: str, told: int) -> None:
    """In its folder, and to the person who starts it where no profile knows the model."""
    chat = ChatConfig(base_url="http://127.0.0.1:1/v1", model=model)
    asked = RunConfig(policy=PolicyChoice(name="openai", chat=chat), agent=AgentConfig(profile=chosen))
    lines: list[str] = []
    config = resolved(asked, None, lines.append)
    profile = all_profiles()[name]
    assert (config.agent.profile, config.agent.mode) == (name, profile.mode)
    assert config.policy.chat is not None
    assert config.policy.chat.sampling == profile.sampling_of(Sampling())
    assert resolved(config, None, None) == config
    assert len(lines) == told
    assert all("my-model" in line and "--profile" in line for line in lines)
