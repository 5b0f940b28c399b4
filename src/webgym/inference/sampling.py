"""Samples tokens from a model's logits, with the log-probabilities of the sampled tokens."""

from __future__ import annotations

from collections.abc import Sequence

import torch


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
