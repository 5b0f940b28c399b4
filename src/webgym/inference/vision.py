"""A vision tower that computes the same values faster."""

from __future__ import annotations

import hashlib
from typing import Any, Final

import torch
from torch.nn.functional import scaled_dot_product_attention
from transformers.models.qwen3_vl.modeling_qwen3_vl import (
    BaseModelOutputWithDeepstackFeatures,
    Qwen3VLVisionAttention,
    Qwen3VLVisionModel,
    apply_rotary_pos_emb_vision,
)
from transformers.utils.logging import disable_progress_bar

disable_progress_bar()  # weights are loaded and saved while other output is shown

_REMEMBERED: Final = 2048
"""Number of pictures whose features are kept."""

_SMALL: Final = 256
"""Most patches of such a picture: the features of one take 0.3 MB at the width of the tiny policy."""


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


class _RememberingVision(Qwen3VLVisionModel):
    """A tower that computes a small picture once per version of its weights: most steps on a small website
    show a page that was seen before."""

    def forward(self, hidden_states: Any, grid_thw: Any, **others: Any) -> Any:
        weights = list(self.parameters())
        is_trained = torch.is_grad_enabled() and any(weight.requires_grad for weight in weights)
        # Sharded weights are gathered by all processes together, so that none may skip the computation.
        is_plain = all(
            type(weight.data) is torch.Tensor and weight.device.type == "cpu" for weight in weights
        )
        sizes = grid_thw.prod(-1).tolist()
        if is_trained or not is_plain or max(sizes) > _SMALL:
            return super().forward(hidden_states, grid_thw, **others)

        # Which pictures are known: by their patches, their grid and the version of the weights.
        version = (sum(weight._version for weight in weights), torch.is_inference_mode_enabled())
        if version not in (versions := self.__dict__.setdefault("_known", {})):
            versions.clear()
        known = versions.setdefault(version, {})
        parts = hidden_states.split(sizes)
        keys = [
            (hashlib.sha256(part.float().contiguous().numpy()).digest(), *grid)
            for part, grid in zip(parts, grid_thw.tolist(), strict=True)
        ]
        new = {key: number for number, key in enumerate(keys) if key not in known}

        # The others are computed in one batch.
        if new:
            numbers = list(new.values())
            found = super().forward(torch.cat([parts[number] for number in numbers]), grid_thw[numbers])
            merged = [sizes[number] // self.spatial_merge_unit for number in numbers]
            columns = [
                found.last_hidden_state.split([sizes[number] for number in numbers]),
                *(each.split(merged) for each in (found.pooler_output, *found.deepstack_features)),
            ]
            known.update(zip(new, zip(*columns, strict=True), strict=True))
        last, pooled, *deep = (torch.cat(column) for column in zip(*map(known.get, keys), strict=True))
        for key in list(known)[: max(0, len(known) - _REMEMBERED)]:
            del known[key]
        return BaseModelOutputWithDeepstackFeatures(last, pooler_output=pooled, deepstack_features=deep)


def speed_up_vision(model: Any) -> Any:
    """Make a vision tower compute the same values faster; weights and their names do not change.

    Patches are embedded by a matrix product: Qwen-VL splits the picture first and convolves every patch on
    its own, and torch's convolution over many tiny volumes is several times slower, especially backward.
    Qwen3-VL's attention is called once for all pictures if they have equal size. And its tower remembers
    small pictures, on a CPU, unless it is trained.
    """
    for module in model.modules():
        if type(module) is torch.nn.Conv3d and module.kernel_size == module.stride and module.groups == 1:
            module.__class__ = _PatchConvolution
        if type(module) is Qwen3VLVisionAttention:
            module.__class__ = _BatchedVisionAttention
        if type(module) is Qwen3VLVisionModel:
            module.__class__ = _RememberingVision
    return model
