"""Replies to many requests at once: one prefill, then a token for every unfinished reply per forward pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import torch

from webgym.inference.model import Loaded
from webgym.inference.rendering import Encoded
from webgym.inference.sampling import draw, processed_logprobs

LONGEST_REPLY: Final = 256
"""In tokens, where no setting says otherwise."""


@dataclass(frozen=True, slots=True)
class Draws:
    """How replies are sampled.

    Attributes:
        temperature: 0 takes the likeliest token, and gives its log-probability at temperature 1.
        top_p: see :func:`webgym.inference.sampling.processed_logprobs`; 1 keeps all.
        top_k: likewise; 0 keeps all.
        max_tokens: longest reply.
    """

    temperature: float = 1.0
    top_p: float = 1.0
    top_k: int = 0
    max_tokens: int = LONGEST_REPLY


@dataclass(frozen=True, slots=True)
class Generated:
    """One reply.

    Attributes:
        ids: the tokens, the end token included if it was drawn.
        logprobs: of each under the distribution that it was drawn from; at temperature 0 under the model's.
        is_cut: whether the reply reached its longest length without an end.
    """

    ids: list[int]
    logprobs: list[float]
    is_cut: bool


@torch.inference_mode()
def generate(
    loaded: Loaded, requests: Sequence[Encoded], seeds: Sequence[int], draws: Draws
) -> list[Generated]:
    """A reply to each request.

    Args:
        loaded: a model of the Qwen-VL kind.
        requests: rendered.
        seeds: of each reply's own random numbers.
        draws: how tokens are drawn.

    Returns:
        One reply for each request, in order.
    """
    model, device = loaded.model, loaded.model.device
    ends = torch.tensor(sorted(loaded.renderer.end_ids), device=device)
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]
    ids, mask = _left_padded([request.prompt_ids for request in requests], device)
    images = [request.pixels for request in requests if request.pixels is not None]
    vision: dict[str, torch.Tensor] = {}
    if images:
        vision = {
            "pixel_values": torch.cat([pixels.values for pixels in images]).to(device, model.dtype),
            "image_grid_thw": torch.cat([pixels.grid for pixels in images]).to(device),
        }
    kinds = (ids == loaded.renderer.image_id).int()
    positions, deltas = model.model.get_rope_index(
        ids, mm_token_type_ids=kinds, image_grid_thw=vision.get("image_grid_thw"), attention_mask=mask
    )
    made = model(
        input_ids=ids,
        attention_mask=mask,
        position_ids=positions,
        mm_token_type_ids=kinds,
        use_cache=True,
        logits_to_keep=1,
        **vision,
    )
    lengths = mask.sum(dim=-1, keepdim=True)
    tokens: list[torch.Tensor] = []
    scores: list[torch.Tensor] = []
    finished = torch.zeros(len(requests), dtype=torch.bool, device=device)
    for place in range(draws.max_tokens):
        token, logprob = _next(made.logits[:, -1], generators, draws)
        tokens.append(token)
        scores.append(logprob)
        finished |= torch.isin(token, ends)
        if place + 1 == draws.max_tokens or bool(finished.all()):
            break
        mask = torch.cat([mask, mask.new_ones(len(requests), 1)], dim=-1)
        here = (lengths + place + deltas.to(device))[None].expand(3, -1, -1)
        made = model(
            input_ids=token[:, None],
            attention_mask=mask,
            position_ids=here,
            past_key_values=made.past_key_values,
            use_cache=True,
        )
    return _until_end(torch.stack(tokens, dim=1), torch.stack(scores, dim=1), loaded.renderer.end_ids)


def _next(
    logits: torch.Tensor, generators: Sequence[torch.Generator], draws: Draws
) -> tuple[torch.Tensor, torch.Tensor]:
    if draws.temperature == 0:
        best = logits.float().log_softmax(dim=-1).max(dim=-1)
        return best.indices, best.values
    logprobs = processed_logprobs(logits, temperature=draws.temperature, top_p=draws.top_p, top_k=draws.top_k)
    token = draw(logprobs, generators)
    return token, logprobs.gather(-1, token[:, None]).squeeze(-1)


def _left_padded(rows: Sequence[list[int]], device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
    """(rows, longest) ids and mask, int64; every row ends at the right edge."""
    longest = max(len(row) for row in rows)
    ids = torch.zeros(len(rows), longest, dtype=torch.int64)
    mask = torch.zeros_like(ids)
    for number, row in enumerate(rows):
        ids[number, longest - len(row) :] = torch.tensor(row)
        mask[number, longest - len(row) :] = 1
    return ids.to(device), mask.to(device)


def _until_end(tokens: torch.Tensor, scores: torch.Tensor, ends: frozenset[int]) -> list[Generated]:
    replies = []
    for ids, logprobs in zip(tokens.tolist(), scores.tolist(), strict=True):
        end = next((place for place, token in enumerate(ids) if token in ends), None)
        length = len(ids) if end is None else end + 1
        replies.append(Generated(ids[:length], logprobs[:length], end is None))
    return replies
