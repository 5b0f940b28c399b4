"""A tiny Qwen3-VL with a tokenizer and chat templates of the real one's structure, made in a second.

transformers is imported by those who make one: every worker of the tests collects all tests, and few need it.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import torch
from PIL import Image
from tokenizers import AddedToken, Tokenizer, decoders, models, pre_tokenizers

from webgym.inference.rendering import Renderer

torch.set_num_threads(1)  # threads that wait for a busy processor make tiny work a hundred times slower

SPECIAL = ["<|endoftext|>", "<|im_start|>", "<|im_end|>", "<|vision_start|>", "<|vision_end|>"]
SPECIAL += ["<|image_pad|>", "<|video_pad|>"]
WORDS = ["<think>", "</think>", "<tool_call>", "</tool_call>"]  # added tokens, but not special: they are text

INSTRUCT = """\
{%- for message in messages %}
{{- '<|im_start|>' + message.role + '\\n' }}
{%- if message.content is string %}{{- message.content }}
{%- else %}
{%- for part in message.content %}
{%- if part.type == 'image' %}{{- '<|vision_start|><|image_pad|><|vision_end|>' }}
{%- else %}{{- part.text }}{%- endif %}
{%- endfor %}
{%- endif %}
{{- '<|im_end|>\\n' }}
{%- endfor %}
{%- if add_generation_prompt %}{{- '<|im_start|>assistant\\n' }}{%- endif %}"""

THINKING = INSTRUCT.replace("'<|im_start|>assistant\\n'", "'<|im_start|>assistant\\n<think>\\n'")
THINKING = THINKING.replace(
    "{%- if message.content is string %}",
    "{%- if message.reasoning_content is defined %}"
    "{{- '<think>\\n' + message.reasoning_content + '\\n</think>\\n\\n' + message.content }}"
    "{%- elif message.content is string %}",
)
"""The thinking is opened by the template, and a reply with its reasoning stands as it was said."""

MERGES = [("Ċ", "Ċ"), ("h", "e"), ("t", "he"), ("o", "n"), ("Ġ", "the"), ("i", "on"), ("e", "r"), (".", "Ċ")]


def tiny_tokenizer(template: str = INSTRUCT) -> Any:
    """Bytes and a few merges, such as two line ends in one token."""
    from transformers import PreTrainedTokenizerFast

    alphabet = sorted(pre_tokenizers.ByteLevel.alphabet())
    vocabulary = {piece: number for number, piece in enumerate(alphabet)}
    for left, right in MERGES:
        vocabulary.setdefault(left + right, len(vocabulary))
    tokenizer = Tokenizer(models.BPE(vocab=vocabulary, merges=MERGES))
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    tokenizer.decoder = decoders.ByteLevel()
    tokenizer.add_special_tokens([AddedToken(name, special=True, normalized=False) for name in SPECIAL])
    tokenizer.add_tokens([AddedToken(name, special=False, normalized=False) for name in WORDS])
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        eos_token="<|im_end|>",
        pad_token="<|endoftext|>",
        chat_template=template,
    )


def tiny_image_processor() -> Any:
    """A token for every 32 x 32 pixels."""
    from transformers.models.qwen2_vl.image_processing_pil_qwen2_vl import Qwen2VLImageProcessorPil

    return Qwen2VLImageProcessorPil(
        patch_size=16, merge_size=2, size={"shortest_edge": 32 * 32, "longest_edge": 512 * 512}
    )


def tiny_renderer(template: str = INSTRUCT) -> Renderer:
    """Both."""
    return Renderer(tiny_tokenizer(template), tiny_image_processor())


def tiny_model(seed: int = 0, width: int = 32, *, tied: bool = True) -> Any:
    """A Qwen3-VL of two layers from random weights, float32."""
    from transformers import GenerationConfig, Qwen3VLConfig, Qwen3VLForConditionalGeneration

    tokenizer = tiny_tokenizer()
    ids = {name: tokenizer.convert_tokens_to_ids(name) for name in SPECIAL}
    heads = width // 16
    text = {
        "vocab_size": len(tokenizer),
        "hidden_size": width,
        "intermediate_size": 2 * width,
        "num_hidden_layers": 2,
        "num_attention_heads": heads,
        "num_key_value_heads": heads,
        "head_dim": 16,
        "max_position_embeddings": 2048,
        "rope_theta": 10000.0,
        "rope_scaling": {"rope_type": "default", "mrope_section": [2, 3, 3], "mrope_interleaved": True},
        "tie_word_embeddings": tied,
        "eos_token_id": ids["<|im_end|>"],
        "pad_token_id": ids["<|endoftext|>"],
    }
    vision = {
        "depth": 2,
        "hidden_size": width,
        "intermediate_size": 2 * width,
        "num_heads": heads,
        "patch_size": 16,
        "spatial_merge_size": 2,
        "temporal_patch_size": 2,
        "out_hidden_size": width,
        "num_position_embeddings": 64,
        "deepstack_visual_indexes": [0],
    }
    config = Qwen3VLConfig(
        text_config=text,
        vision_config=vision,
        image_token_id=ids["<|image_pad|>"],
        video_token_id=ids["<|video_pad|>"],
        vision_start_token_id=ids["<|vision_start|>"],
        vision_end_token_id=ids["<|vision_end|>"],
        tie_word_embeddings=tied,
    )
    torch.manual_seed(seed)
    model = Qwen3VLForConditionalGeneration(config).eval()
    model.generation_config = GenerationConfig(
        eos_token_id=[ids["<|im_end|>"], ids["<|endoftext|>"]], pad_token_id=ids["<|endoftext|>"]
    )
    return model


def write_tiny_model(folder: Path, template: str = INSTRUCT, seed: int = 0, *, tied: bool = True) -> Path:
    """A folder as the hub has them."""
    tiny_model(seed, tied=tied).save_pretrained(folder)
    tiny_tokenizer(template).save_pretrained(folder)
    tiny_image_processor().save_pretrained(folder)
    return folder


def picture(color: str = "red", size: tuple[int, int] = (64, 32)) -> bytes:
    """A PNG of one colour."""
    out = io.BytesIO()
    Image.new("RGB", size, color).save(out, "PNG")
    return out.getvalue()
