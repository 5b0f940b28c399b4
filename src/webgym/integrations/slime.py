"""slime (its git version of October 2026; the class of its samples is taken from the sample that it gives)::

    --custom-generate-function-path webgym.integrations.slime.generate
    --dynamic-sampling-filter-path webgym.integrations.slime.has_rewards

An episode gives one sample per step, all with its reward and the rollout id of the prompt's sample: the
history is a window, so no two steps share a prompt. An episode without a reward gives the prompt's sample
back, aborted and marked for removal, and the filter drops its group: slime has no reward but a number, and
none is invented.

The environment variables ``WEBGYM_TASKS`` (default ``offline-v1``), ``WEBGYM_SPLIT`` and ``WEBGYM_BROWSERS``
say which tasks, and how many browsers each process has.
"""

from __future__ import annotations

import base64
import copy
import os
from typing import Any

import aiohttp

from webgym import EnvironmentPool, Renderer, Sampled, TokenRequest, TokenRollout, TokenRow, roll_out

_pool: EnvironmentPool | None = None
_renderers: dict[str, Renderer] = {}


def the_pool() -> EnvironmentPool:
    """Of this process, made when it is first asked for."""
    global _pool  # slime calls a function, and keeps nothing for it
    if _pool is None:
        split: Any = os.environ.get("WEBGYM_SPLIT", "train")
        size = int(os.environ.get("WEBGYM_BROWSERS", "8"))
        _pool = EnvironmentPool(os.environ.get("WEBGYM_TASKS", "offline-v1"), size=size, split=split)
    return _pool


def the_renderer(args: Any) -> Renderer:
    """Of the model that ``args.hf_checkpoint`` names, loaded once."""
    path = args.hf_checkpoint
    if path not in _renderers:
        from transformers import AutoProcessor

        processor = AutoProcessor.from_pretrained(path)
        _renderers[path] = Renderer(processor.tokenizer, processor.image_processor)
    return _renderers[path]


async def generate(args: Any, sample: Any, sampling_params: dict[str, Any]) -> list[Any]:
    """Play one episode of ``sample.metadata["task_id"]``.

    Args:
        args: slime's: ``hf_checkpoint``, ``sglang_router_ip``, ``sglang_router_port``,
            ``rollout_max_context_len``.
        sample: of the prompt.
        sampling_params: of SGLang.

    Returns:
        A sample for each step, or the prompt's own, marked for removal.

    Raises:
        aiohttp.ClientError: SGLang does not answer.
    """
    renderer = the_renderer(args)
    url = f"http://{args.sglang_router_ip}:{args.sglang_router_port}/generate"

    async with aiohttp.ClientSession(raise_for_status=True) as http:

        async def ask(request: TokenRequest) -> Sampled:
            asked = {
                "input_ids": request.short_prompt_ids,
                "image_data": [_data_url(image) for image in request.images],
                "sampling_params": sampling_params,
                "return_logprob": True,
            }
            async with http.post(url, json=asked) as answered:
                reply = await answered.json()
            told = reply["meta_info"]
            pairs = told["output_token_logprobs"]
            return Sampled(
                [pair[1] for pair in pairs],
                [pair[0] for pair in pairs],
                finish_reason="length" if told["finish_reason"]["type"] == "length" else "stop",
                weight_version=str(told.get("weight_version", "")),
            )

        async with the_pool().environment() as env:
            rollout = await roll_out(
                env,
                ask,
                renderer,
                task_id=sample.metadata["task_id"],
                cutoff_tokens=getattr(args, "rollout_max_context_len", None) or 16384,
                needs_logprobs=True,
            )
    return samples_of(sample, rollout, renderer)


def has_rewards(args: Any, samples: list[Any], **_: Any) -> bool:
    """Whether all episodes of a group have a reward: slime's filter of groups."""
    return all(
        has_rewards(args, each) if isinstance(each, list) else each.reward is not None for each in samples
    )


def samples_of(sample: Any, rollout: TokenRollout, renderer: Renderer) -> list[Any]:
    """An episode as slime's samples.

    Args:
        sample: of the prompt, which they are copies of: index, group and rollout id are its own.
        rollout: of the episode.
        renderer: of the model.
    """
    status = type(sample).Status
    if not rollout.rows:
        sample.status, sample.remove_sample, sample.reward = status.ABORTED, True, None
        sample.metadata = {**sample.metadata, **_told(rollout)}
        return [sample]
    return [_filled(copy.deepcopy(sample), row, rollout, renderer) for row in rollout.rows]


def _filled(sample: Any, row: TokenRow, rollout: TokenRollout, renderer: Renderer) -> Any:
    status = type(sample).Status
    sample.tokens = [*row.prompt_ids, *row.reply_ids]
    sample.response = renderer.decode(row.reply_ids)
    sample.response_length = len(row.reply_ids)
    sample.loss_mask = [1] * len(row.reply_ids)
    sample.rollout_log_probs = row.logprobs
    sample.weight_versions = [row.weight_version]
    sample.multimodal_inputs = {"images": TokenRequest("", [], [], row.images, ()).pil_images()}
    pixels = row.pixels(renderer)
    if pixels is not None:
        sample.multimodal_train_inputs = {"pixel_values": pixels.values, "image_grid_thw": pixels.grid}
    sample.reward = rollout.reward
    if getattr(sample, "rollout_id", 0) is None:  # versions that have it: steps of one episode share it
        sample.rollout_id = sample.index
    ended = row.reply_ids[-1] in renderer.end_ids
    sample.status = status.COMPLETED if ended else status.TRUNCATED
    sample.metadata = {**sample.metadata, **_told(rollout), "step": row.step}
    return sample


def _told(rollout: TokenRollout) -> dict[str, Any]:
    return {"outcome": str(rollout.outcome), "dropped": dict(rollout.dropped)}


def _data_url(image: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(image).decode()}"
