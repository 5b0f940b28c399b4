"""Pretraining reads screenshots by a way of its own, which must be the model's."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("torch")

from webgym.core.trajectory import ImageRef, Message
from webgym.study.model import TinyConfig, make_model
from webgym.study.pretrain import to_patches, to_pixel_values


def test_patches_are_those_of_the_image_processor() -> None:
    rng = np.random.default_rng(3)
    data = io.BytesIO()
    Image.fromarray(rng.integers(0, 256, (128, 192, 3), dtype=np.uint8)).save(data, "PNG")
    renderer = make_model([], TinyConfig(width=32, text_layers=1, vision_layers=2)).renderer
    pixels = renderer.pixels([Message("user", (ImageRef("a", 192, 128),))], {"a": data.getvalue()})
    assert pixels is not None
    assert pixels.grid.tolist() == [[1, 8, 12]]
    assert np.allclose(to_pixel_values(to_patches(data.getvalue())), pixels.values.numpy(), atol=1e-6)
