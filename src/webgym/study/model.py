"""The tiny policy's model: Qwen3-VL's architecture with few layers, and a tokenizer with a token per word.

The vocabulary is closed: the words of the small websites, the keywords of the compact format
(:mod:`webgym.study.compact`), numbers, and the coordinates of the screen's cells. Any other word is an
unknown token. How an instruction asks for the answer, in brackets at its end, is left out: on the small
websites it is always the same. Special tokens and chat template follow Qwen's.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from pydantic import Field

from webgym.core.action import GRID
from webgym.core.settings import Settings
from webgym.inference.model import Loaded
from webgym.inference.rendering import Renderer

# --- the tokenizer ----------------------------------------------------------------------------------------

CELL: Final = 32
"""Side of a screen cell, pixels: two by two patches of 16, which is one image token."""

MOST_NUMBER: Final = 99
"""Largest number in the vocabulary."""

SPECIAL: Final = (
    "<|endoftext|>",  # padding
    "<|im_start|>",
    "<|im_end|>",
    "<|vision_start|>",
    "<|vision_end|>",
    "<|image_pad|>",
    "<unk>",
)
ROLES: Final = ("system", "user", "assistant")
GRAMMAR: Final = (
    *"act with memory task progress intention last nothing unreadable changed unchanged step of note".split(),
    *"left_click type scroll up down wait go_back navigate answer , ; = + -".split(),
)

_TEMPLATE = """\
{%- for message in messages -%}
<|im_start|>{{ message.role + '\\n' }}
{%- if message.content is string -%}{{ message.content }}{%- else -%}
{%- for part in message.content -%}
{%- if part.type == 'text' -%}{{ part.text }}{%- endif -%}
{%- if part.type == 'image' -%}<|vision_start|><|image_pad|><|vision_end|>{%- endif -%}
{%- endfor -%}
{%- endif -%}
<|im_end|>{{ '\\n' }}
{%- endfor -%}
{%- if add_generation_prompt -%}<|im_start|>{{ 'assistant\\n' }}{%- endif -%}"""


def cell_centres(length: int) -> list[int]:
    """The centres of the cells along a side of ``length`` pixels, on the grid of coordinates."""
    count = length // CELL
    return [round((index + 0.5) / count * GRID) for index in range(count)]


def vocabulary(words: Iterable[str], viewport: tuple[int, int]) -> list[str]:
    """All tokens in order, the special ones first.

    Args:
        words: of the websites and their tasks.
        viewport: width and height, multiples of :data:`CELL`.
    """
    points = {str(value) for side in viewport for value in cell_centres(side)}
    numbers = [str(number) for number in range(MOST_NUMBER + 1)]
    words_of_format = [*ROLES, *GRAMMAR, *numbers, *sorted(points - set(numbers), key=int)]
    return list(dict.fromkeys([*SPECIAL, *words_of_format, *sorted(set(words))]))


def make_tokenizer(words: Iterable[str], viewport: tuple[int, int]) -> Any:
    """Make a transformers tokenizer with a chat template.

    Args:
        words: of the websites and their tasks.
        viewport: width and height, multiples of :data:`CELL`.
    """
    from tokenizers import AddedToken, Regex, Tokenizer, models, normalizers, pre_tokenizers
    from transformers import PreTrainedTokenizerFast

    ids = {token: number for number, token in enumerate(vocabulary(words, viewport))}
    tokenizer = Tokenizer(models.WordLevel(ids, unk_token="<unk>"))  # noqa: S106
    tokenizer.normalizer = normalizers.Replace(Regex(r" \(answer [^)]*\)"), "")
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence(
        [pre_tokenizers.WhitespaceSplit(), pre_tokenizers.Split(Regex("[,;=]"), "isolated")]
    )
    tokenizer.add_special_tokens([AddedToken(token, special=True, normalized=False) for token in SPECIAL])
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        unk_token="<unk>",  # noqa: S106
        pad_token="<|endoftext|>",  # noqa: S106
        eos_token="<|im_end|>",  # noqa: S106
        chat_template=_TEMPLATE,
        clean_up_tokenization_spaces=False,
    )


# --- the model --------------------------------------------------------------------------------------------

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
