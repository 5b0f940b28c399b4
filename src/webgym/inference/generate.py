"""Generates replies to a batch of requests: one prefill, then one token per unfinished reply in every
pass, sampled from the logits with its log-probability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import torch

from webgym.inference.model import Loaded
from webgym.inference.rendering import Encoded

LONGEST_REPLY: Final = 256
"""Default limit of a reply's length, in tokens."""


@dataclass(frozen=True, slots=True)
class SamplingParameters:
    """How replies are sampled.

    Attributes:
        temperature: 0 chooses the likeliest token, with its log-probability at temperature 1.
        top_p: see :func:`webgym.inference.generate.processed_logprobs`; 1 keeps all tokens.
        top_k: likewise; 0 keeps all tokens.
        max_tokens: longest reply, in tokens.
    """

    temperature: float = 1.0
    top_p: float = 1.0
    top_k: int = 0
    max_tokens: int = LONGEST_REPLY


@dataclass(frozen=True, slots=True)
class Generated:
    """One reply.

    Attributes:
        ids: the sampled token ids, including the end token if it was sampled.
        logprobs: log-probability of each id under the distribution it was sampled from; at temperature 0
            under the model's.
        is_cut: whether the reply reached the longest length without an end token.
    """

    ids: list[int]
    logprobs: list[float]
    is_cut: bool


@torch.inference_mode()
def generate(
    loaded: Loaded, requests: Sequence[Encoded], seeds: Sequence[int], parameters: SamplingParameters
) -> list[Generated]:
    """Generate a reply to each request.

    Args:
        loaded: a Qwen-VL model.
        requests: the rendered requests.
        seeds: seed of each reply's random numbers.
        parameters: how tokens are sampled.

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
    token_types = (ids == loaded.renderer.image_id).int()
    positions, deltas = model.model.get_rope_index(
        ids, mm_token_type_ids=token_types, image_grid_thw=vision.get("image_grid_thw"), attention_mask=mask
    )
    output = model(
        input_ids=ids,
        attention_mask=mask,
        position_ids=positions,
        mm_token_type_ids=token_types,
        use_cache=True,
        logits_to_keep=1,
        **vision,
    )
    lengths = mask.sum(dim=-1, keepdim=True)
    tokens: list[torch.Tensor] = []
    scores: list[torch.Tensor] = []
    finished = torch.zeros(len(requests), dtype=torch.bool, device=device)
    for position in range(parameters.max_tokens):
        token, logprob = _next(output.logits[:, -1], generators, parameters)
        tokens.append(token)
        scores.append(logprob)
        finished |= torch.isin(token, ends)
        if position + 1 == parameters.max_tokens or bool(finished.all()):
            break
        mask = torch.cat([mask, mask.new_ones(len(requests), 1)], dim=-1)
        token_positions = (lengths + position + deltas.to(device))[None].expand(3, -1, -1)
        output = model(
            input_ids=token[:, None],
            attention_mask=mask,
            position_ids=token_positions,
            past_key_values=output.past_key_values,
            use_cache=True,
        )
    return _until_end(torch.stack(tokens, dim=1), torch.stack(scores, dim=1), loaded.renderer.end_ids)


def _next(
    logits: torch.Tensor, generators: Sequence[torch.Generator], parameters: SamplingParameters
) -> tuple[torch.Tensor, torch.Tensor]:
    if parameters.temperature == 0:
        best = logits.float().log_softmax(dim=-1).max(dim=-1)
        return best.indices, best.values
    logprobs = processed_logprobs(
        logits, temperature=parameters.temperature, top_p=parameters.top_p, top_k=parameters.top_k
    )
    token = draw(logprobs, generators)
    return token, logprobs.gather(-1, token[:, None]).squeeze(-1)


def _left_padded(rows: Sequence[list[int]], device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
    """Pad rows on the left: (rows, longest) ids and mask, int64."""
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
        end = next((position for position, token in enumerate(ids) if token in ends), None)
        length = len(ids) if end is None else end + 1
        replies.append(Generated(ids[:length], logprobs[:length], end is None))
    return replies


def processed_logprobs(
    logits: torch.Tensor, *, temperature: float = 1.0, top_p: float = 1.0, top_k: int = 0
) -> torch.Tensor:
    """Log-probabilities after temperature, top-k and top-p, in the order that vLLM applies them.

    Args:
        logits: (rows, vocabulary).
        temperature: above 0.
        top_p: the smallest set of likeliest tokens whose probabilities sum to this is kept; 1 keeps all.
        top_k: this many likeliest tokens are kept; 0 keeps all.

    Returns:
        (rows, vocabulary), float32; minus infinity for excluded tokens.
    """
    scores = logits.float() / temperature
    if 0 < top_k < scores.shape[-1]:
        least = scores.topk(top_k, dim=-1).values[:, -1:]
        scores = scores.masked_fill(scores < least, float("-inf"))
    if top_p < 1.0:
        ordered, places = scores.sort(dim=-1, descending=True)
        probabilities = ordered.softmax(dim=-1)
        # The probability of all likelier tokens, without the token itself: the likeliest is always kept.
        beyond = probabilities.cumsum(dim=-1) - probabilities >= top_p
        scores = scores.masked_fill(beyond.scatter(-1, places, beyond), float("-inf"))
    return scores.log_softmax(dim=-1)


def draw(logprobs: torch.Tensor, generators: Sequence[torch.Generator]) -> torch.Tensor:
    """Sample one token for each row with the row's own generator, so that rows do not influence each other.

    Args:
        logprobs: (rows, vocabulary), on any device.
        generators: one for each row, on the CPU.

    Returns:
        (rows,), int64.
    """
    uniform = torch.stack([torch.rand((), generator=generator) for generator in generators])
    cumulated = logprobs.exp().cumsum(dim=-1)
    thresholds = uniform.to(logprobs.device, logprobs.dtype)[:, None] * cumulated[:, -1:]
    drawn = torch.searchsorted(cumulated, thresholds, right=True).squeeze(-1)
    # Rounding may lead past the last token with a probability above 0.
    possible = logprobs.isfinite()
    last = possible.shape[-1] - 1 - possible.flip(-1).int().argmax(dim=-1)
    return torch.minimum(drawn, last)
