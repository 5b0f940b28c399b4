"""Qwen's own image processor and our pictures: beside the other tests that import transformers."""

from __future__ import annotations

import io

import pytest
from PIL import Image
from tests.agent.test_profiles import QWEN3

from webgym.agent.image_codec import fit
from webgym.agent.image_sizing import MultipleOf
from webgym.agent.profiles import all_profiles


@pytest.mark.parametrize("name", ["qwen3-vl", "qwen2.5-vl"])
def test_the_real_processor_leaves_our_pictures_alone(name: str) -> None:
    """Size for size, and pixel for pixel: the model sees what was sent."""
    processors = pytest.importorskip(
        "transformers.models.qwen2_vl.image_processing_pil_qwen2_vl", reason="transformers is not installed"
    )
    rule = all_profiles()[name].pictures
    assert isinstance(rule, MultipleOf)
    patch = {"patch_size": rule.factor // 2, "merge_size": 2}
    area = {"shortest_edge": rule.min_pixels, "longest_edge": rule.max_pixels}
    processor = processors.Qwen2VLImageProcessorPil(**patch, size=area)
    for size in [*QWEN3, (641, 400)]:
        bounds = {"min_pixels": rule.min_pixels, "max_pixels": rule.max_pixels}
        height, width = processors.smart_resize(size[1], size[0], factor=rule.factor, **bounds)
        assert rule.size(size) == (width, height)
    for size in [(1280, 768), (768, 1280), (1366, 768), (641, 400)]:
        picture = Image.effect_noise(size, 90).convert("RGB")
        out = io.BytesIO()
        picture.save(out, "PNG", compress_level=1)
        ours = Image.open(io.BytesIO(fit(out.getvalue(), rule.size(size))))
        there, here = (processor(images=[each], return_tensors="np") for each in (picture, ours))
        assert (there["pixel_values"] == here["pixel_values"]).all()
        assert rule.tokens(size) == there["image_grid_thw"].prod() // 4 + 2
