"""A vision tower that computes the same values faster."""

from __future__ import annotations

from typing import Any

import torch
from torch.nn.functional import scaled_dot_product_attention
from transformers.models.qwen3_vl.modeling_qwen3_vl import Qwen3VLVisionAttention, apply_rotary_pos_emb_vision
from transformers.utils.logging import disable_progress_bar

disable_progress_bar()  # weights are loaded and saved while other output is shown


class _PatchConvolution(torch.nn.Conv3d):
    """A convolution whose inputs are single patches, computed as a matrix product."""

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        if input.shape[2:] != self.weight.shape[2:]:
            return super().forward(input)
        product = torch.nn.functional.linear(input.flatten(1), self.weight.flatten(1), self.bias)
        return product[..., None, None, None]


class _BatchedVisionAttention(Qwen3VLVisionAttention):
    """Attention within each picture, computed in one batch for pictures of equal size."""

    def forward(self, hidden_states: Any, cu_seqlens: Any, position_embeddings: Any, **others: Any) -> Any:
        lengths = cu_seqlens.diff()
        if (lengths != lengths[0]).any() or "flash" in self.config._attn_implementation:
            return super().forward(hidden_states, cu_seqlens, position_embeddings, **others)
        parts = self.qkv(hidden_states).unflatten(-1, (3, self.num_heads, -1))
        query, key, value = parts.unbind(1)
        query, key = apply_rotary_pos_emb_vision(query, key, *position_embeddings)
        pictures = (part.unflatten(0, (len(lengths), -1)).transpose(1, 2) for part in (query, key, value))
        attended = scaled_dot_product_attention(*pictures)
        return self.proj(attended.transpose(1, 2).flatten(0, 1).flatten(1))


def speed_up_vision(model: Any) -> Any:
    """Make a vision tower compute the same values faster; weights and their names do not change.

    Patches are embedded by a matrix product: Qwen-VL splits the picture first and convolves every patch on
    its own, and torch's convolution over many tiny volumes is several times slower, especially backward. And
    Qwen3-VL's attention is called once for all pictures if they have equal size.
    """
    for module in model.modules():
        if type(module) is torch.nn.Conv3d and module.kernel_size == module.stride and module.groups == 1:
            module.__class__ = _PatchConvolution
        if type(module) is Qwen3VLVisionAttention:
            module.__class__ = _BatchedVisionAttention
    return model
