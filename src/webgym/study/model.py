"""The tiny policy's model: Qwen3-VL's architecture with few layers, and random initial weights."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import Field

from webgym.core.settings import Settings
from webgym.inference.model import Loaded
from webgym.inference.rendering import Renderer
from webgym.study.tokenizer import CELL, make_tokenizer

PATCH = 16
MERGE = CELL // PATCH


class TinyConfig(Settings):
    """Sizes. The defaults have about three million weights."""

    width: int = Field(default=128, multiple_of=32)
    """Width of the hidden states of both towers."""

    text_layers: int = Field(default=4, ge=1)
    """Layers of the language model."""

    vision_layers: int = Field(default=3, ge=2)
    """Layers of the vision tower; features of its first and middle layer are added to the language
    model's."""

    viewport: tuple[int, int] = (192, 128)
    """Width and height of the pictures, pixels, multiples of a cell."""


def make_model(words: Iterable[str], config: TinyConfig | None = None, *, seed: int = 0) -> Loaded:
    """A model with random weights, its tokenizer and its image processor.

    Args:
        words: of the websites and their tasks.
        config: sizes.
        seed: of the weights.
    """
    import torch
    from transformers import Qwen3VLForConditionalGeneration
    from transformers.models.qwen2_vl.image_processing_pil_qwen2_vl import Qwen2VLImageProcessorPil

    from webgym.inference.vision import speed_up_vision

    config = config or TinyConfig()
    tokenizer = make_tokenizer(words, config.viewport)
    pixels = config.viewport[0] * config.viewport[1]
    processor = Qwen2VLImageProcessorPil(
        patch_size=PATCH,
        merge_size=MERGE,
        temporal_patch_size=2,
        size={"shortest_edge": CELL * CELL, "longest_edge": 16 * pixels},
        image_mean=[0.5] * 3,
        image_std=[0.5] * 3,
    )
    torch.manual_seed(seed)
    model = Qwen3VLForConditionalGeneration(architecture(config, tokenizer)).eval()
    model.generation_config.eos_token_id = tokenizer.eos_token_id
    model.generation_config.pad_token_id = tokenizer.pad_token_id
    return Loaded(speed_up_vision(model), Renderer(tokenizer, processor))


def architecture(config: TinyConfig, tokenizer: Any) -> Any:
    """The configuration of the transformers model."""
    from transformers import Qwen3VLConfig

    width, heads = config.width, config.width // 32
    tokens = tokenizer.convert_tokens_to_ids
    return Qwen3VLConfig(
        text_config={
            "vocab_size": len(tokenizer),
            "hidden_size": width,
            "intermediate_size": 3 * width,
            "num_hidden_layers": config.text_layers,
            "num_attention_heads": heads,
            "num_key_value_heads": heads,
            "head_dim": 32,
            "max_position_embeddings": 2048,
            "rope_theta": 10_000.0,
            "rope_scaling": {"rope_type": "default", "mrope_section": [4, 6, 6], "mrope_interleaved": True},
            "tie_word_embeddings": True,
        },
        vision_config={
            "depth": config.vision_layers,
            "hidden_size": width,
            "intermediate_size": 3 * width,
            "num_heads": heads,
            "patch_size": PATCH,
            "spatial_merge_size": MERGE,
            "temporal_patch_size": 2,
            "out_hidden_size": width,
            "num_position_embeddings": 256,
            "deepstack_visual_indexes": [0, config.vision_layers // 2],
        },
        image_token_id=tokens("<|image_pad|>"),
        # There are no videos; the id must be unused.
        video_token_id=len(tokenizer) + 1,
        vision_start_token_id=tokens("<|vision_start|>"),
        vision_end_token_id=tokens("<|vision_end|>"),
        tie_word_embeddings=True,
    )


def save_model(loaded: Loaded, folder: Path) -> None:
    """Write weights (safetensors), tokenizer and image processor in transformers' format."""
    loaded.model.save_pretrained(folder)
    loaded.tokenizer.save_pretrained(folder)
    loaded.image_processor.save_pretrained(folder)
