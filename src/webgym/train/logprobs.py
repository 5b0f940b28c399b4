"""Log-probabilities of replies: batches of samples, and a forward pass through the model.

Logits are computed only where a reply token is predicted, in chunks, and recomputed in the backward pass:
with a vocabulary of 150,000 they would otherwise need more memory than everything else together.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Final

import torch
from torch import nn
from torch.utils.checkpoint import checkpoint

from webgym.inference.model import fast_backward_attention
from webgym.inference.rendering import Renderer
from webgym.train.samples import Sample

AHEAD: Final = 4
"""Batches that are made before they are used."""

_WORKERS: Final = 2


@dataclass(frozen=True, slots=True)
class Batch:
    """Samples, padded on the right, and the positions of their reply tokens.

    Attributes:
        input_ids, attention_mask, mm_token_type_ids: (samples, longest), int64.
        pixel_values, image_grid_thw: of all pictures; ``None`` if there are none.
        rows, columns: (reply tokens), int64: the position whose hidden state predicts each of them.
        targets: (reply tokens), int64.
        temperature: (reply tokens), float32: logits are divided by it.
        advantage: (reply tokens), float32.
        behaviour: (reply tokens), float32: log-probabilities when sampled; ``None`` unless requested.
        lengths: number of reply tokens of each sample.
    """

    input_ids: torch.Tensor
    attention_mask: torch.Tensor
    mm_token_type_ids: torch.Tensor
    pixel_values: torch.Tensor | None
    image_grid_thw: torch.Tensor | None
    rows: torch.Tensor
    columns: torch.Tensor
    targets: torch.Tensor
    temperature: torch.Tensor
    advantage: torch.Tensor
    behaviour: torch.Tensor | None
    lengths: list[int]

    def to(self, device: torch.device) -> Batch:
        """A copy on a device."""
        moved = {
            name: value.to(device)
            for name in self.__dataclass_fields__
            if isinstance(value := getattr(self, name), torch.Tensor)
        }
        return replace(self, **moved)


def collate(samples: Sequence[Sample], renderer: Renderer, *, off_policy: bool) -> Batch:
    """Make a batch of samples. This reads their pictures, resizes them and cuts them into patches.

    Args:
        samples: at least one.
        renderer: of the model.
        off_policy: whether the objective needs importance weights: log-probabilities are then computed at
            the temperature that replies were sampled with, otherwise at temperature 1.
    """
    longest = max(map(len, samples))
    ids = torch.full((len(samples), longest), renderer.pad_id, dtype=torch.int64)
    mask = torch.zeros_like(ids)
    rows: list[int] = []
    columns: list[int] = []
    for row, sample in enumerate(samples):
        prompt, length = len(sample.prompt_ids), len(sample)
        ids[row, :length] = torch.cat([sample.prompt_ids, sample.reply_ids])
        mask[row, :length] = 1
        rows += [row] * (length - prompt)
        columns += range(prompt - 1, length - 1)
    lengths = [len(sample.reply_ids) for sample in samples]
    pixels = [sample_pixels for sample in samples if (sample_pixels := sample.pixels(renderer)) is not None]
    logprobs = [sample.logprobs for sample in samples if sample.logprobs is not None]
    return Batch(
        input_ids=ids,
        attention_mask=mask,
        mm_token_type_ids=(ids == renderer.image_id).long() * mask,
        pixel_values=torch.cat([part.values for part in pixels]) if pixels else None,
        image_grid_thw=torch.cat([part.grid for part in pixels]) if pixels else None,
        rows=torch.tensor(rows),
        columns=torch.tensor(columns),
        targets=torch.cat([sample.reply_ids for sample in samples]).long(),
        temperature=_per_token([sample.temperature if off_policy else 1.0 for sample in samples], lengths),
        advantage=_per_token([sample.advantage for sample in samples], lengths),
        behaviour=torch.cat(logprobs) if off_policy else None,
        lengths=lengths,
    )


def batches_ahead(
    groups: Iterable[Sequence[Sample]], renderer: Renderer, *, off_policy: bool
) -> Iterator[Batch]:
    """The batches of groups of samples, in order; threads make the next ones while one is used.

    At most :data:`AHEAD` are in memory beside the one in use, as their pixels are large: 0.28 GB for three
    samples with four pictures of 1280 x 768.
    """
    pool, waiting = ThreadPoolExecutor(_WORKERS), deque[Future[Batch]]()
    try:
        for group in groups:
            if len(waiting) == AHEAD:
                yield waiting.popleft().result()
            waiting.append(pool.submit(collate, group, renderer, off_policy=off_policy))
        while waiting:
            yield waiting.popleft().result()
    finally:  # also if the batches are not wanted any more
        pool.shutdown(cancel_futures=True)


def _per_token(values: Sequence[float], lengths: Sequence[int]) -> torch.Tensor:
    return torch.repeat_interleave(torch.tensor(values), torch.tensor(lengths))


class ReplyLogProbs(nn.Module):
    """A model that returns the log-probability of each reply token of a batch.

    Args:
        policy: a transformers image-text-to-text model, bare or with adapters.
        chunk: number of reply tokens whose logits are in memory at once.
        autocast: compute in bfloat16 where torch considers it safe. Not under FSDP2, which gathers weights in
            bfloat16: autocast would keep a copy of each until the end of the forward pass.
    """

    def __init__(self, policy: nn.Module, chunk: int, *, autocast: bool = False) -> None:
        super().__init__()
        self.policy = policy
        self._autocast = autocast
        self._chunk = chunk

    def forward(self, batch: Batch, *, ranked: bool = False, entropy: bool = False) -> torch.Tensor:
        """Log-probabilities, (reply tokens), float32, with gradients if they are enabled.

        Args:
            batch: of samples.
            entropy: return the entropy at each reply token, too, without gradients: (reply tokens, 2).
            ranked: return the two likeliest tokens at each reply token instead: (reply tokens, 2, 2), their
                log-probabilities and their ids.
        """
        device = batch.input_ids.device
        with (
            torch.autocast(device.type, torch.bfloat16, enabled=self._autocast),
            fast_backward_attention(device),
        ):
            return self._forward(batch, ranked=ranked, entropy=entropy)

    def _forward(self, batch: Batch, *, ranked: bool, entropy: bool) -> torch.Tensor:
        model: Any = self.policy
        model = model.get_base_model() if hasattr(model, "get_base_model") else model
        hidden = model.model(
            input_ids=batch.input_ids,
            attention_mask=batch.attention_mask,
            mm_token_type_ids=batch.mm_token_type_ids,
            pixel_values=batch.pixel_values,
            image_grid_thw=batch.image_grid_thw,
            use_cache=False,
        ).last_hidden_state[batch.rows, batch.columns]
        head = model.get_output_embeddings()
        if ranked:
            best = head(hidden).float().log_softmax(-1).topk(2)
            return torch.stack([best.values, best.indices.float()], dim=1)
        tokens = (hidden, batch.targets, batch.temperature)
        pieces = list(zip(*(tensor.split(self._chunk) for tensor in tokens), strict=True))
        # If they are sharded, every call gathers the head's weights: all processes call it equally often.
        more = _most_of_any_process(len(pieces), hidden.device) - len(pieces)
        pieces += [tuple(tensor[:1] for tensor in tokens)] * more
        found = torch.cat(
            [checkpoint(_logprobs, head, *piece, entropy, use_reentrant=False) for piece in pieces]
        )
        return found[: len(hidden)].clone()  # FSDP2 warns of views: what is done to them in place goes wrong


def _most_of_any_process(count: int, device: torch.device) -> int:
    if not torch.distributed.is_initialized():
        return count
    most = torch.tensor(count, device=device)
    torch.distributed.all_reduce(most, torch.distributed.ReduceOp.MAX)
    return int(most)


def _logprobs(
    head: nn.Module, hidden: torch.Tensor, targets: torch.Tensor, temperature: torch.Tensor, entropy: bool
) -> torch.Tensor:
    logits = head(hidden).float() / temperature[:, None]
    with torch.no_grad():  # first: what it needs is free again before the likelihood keeps as much
        spread = torch.special.entr(logits.softmax(-1)).sum(-1) if entropy else None
    found = -nn.functional.cross_entropy(logits, targets, reduction="none")
    return found if spread is None else torch.stack([found, spread], dim=-1)
