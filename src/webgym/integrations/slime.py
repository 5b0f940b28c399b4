"""slime (git version of October 2026; the class of samples is that of the sample that it passes)::

    --custom-generate-function-path webgym.integrations.slime.generate
    --dynamic-sampling-filter-path webgym.integrations.slime.has_rewards

An episode gives one sample per step, all with the episode's reward and the rollout id of the prompt's sample:
the prompt has a window of the history, so no two steps share a prompt. slime requires a number as reward, so
for an episode without one the prompt's sample is returned as aborted and marked for removal, and the filter
drops its group. The same holds if SGLang aborts a request, as slime has it do at the end of a rollout; what
slime then keeps (``--partial-rollout``) starts again from its prompt.

The environment variables ``WEBGYM_TASKS`` (default ``offline-v2``) and ``WEBGYM_SPLIT`` select the tasks, and
``WEBGYM_BROWSERS`` sets the number of browsers of each process.
"""

from __future__ import annotations

import copy
from typing import Any

import aiohttp

from webgym import EnvironmentPool, Renderer, Sampled, TokenRequest, TokenRollout, TokenRow, roll_out
from webgym.integrations.shared import chosen_by_environment, data_url

_pool: EnvironmentPool | None = None
_renderers: dict[str, Renderer] = {}


def the_pool() -> EnvironmentPool:
    """The browsers of this process, created at the first call."""
    global _pool  # slime calls a function and has no place for shared state
    if _pool is None:
        _pool = EnvironmentPool(**chosen_by_environment())
    return _pool


def the_renderer(args: Any) -> Renderer:
    """The renderer of the model in ``args.hf_checkpoint``, loaded once."""
    path = args.hf_checkpoint
    if path not in _renderers:
        from transformers import AutoProcessor

        processor = AutoProcessor.from_pretrained(path)
        _renderers[path] = Renderer(processor.tokenizer, processor.image_processor)
    return _renderers[path]


async def generate(args: Any, sample: Any, sampling_params: dict[str, Any], evaluation: bool = False) -> Any:
    """Play one episode of ``sample.metadata["task_id"]``.

    Args:
        args: slime's arguments: ``hf_checkpoint``, ``sglang_router_ip``, ``sglang_router_port``,
            ``rollout_max_context_len``.
        sample: the prompt's sample.
        sampling_params: sampling parameters of SGLang.
        evaluation: nothing is trained on, so that any parameters will do.

    Returns:
        A list with a sample for each step, or the prompt's sample marked for removal.

    Raises:
        aiohttp.ClientError: SGLang does not respond.
    """
    renderer = the_renderer(args)
    url = f"http://{args.sglang_router_ip}:{args.sglang_router_port}/generate"

    async with aiohttp.ClientSession(raise_for_status=True) as http:

        async def ask(request: TokenRequest) -> Sampled:
            payload = {
                "input_ids": request.short_prompt_ids,
                "image_data": [data_url(image) for image in request.images],
                "sampling_params": sampling_params,
                "return_logprob": True,
            }
            async with http.post(url, json=payload) as response:
                reply = await response.json()
            meta = reply["meta_info"]
            ended = meta["finish_reason"]["type"]
            pairs = meta["output_token_logprobs"] if ended != "abort" else []
            return Sampled(
                [pair[1] for pair in pairs],
                [pair[0] for pair in pairs],
                finish_reason=ended if ended in ("length", "abort") else "stop",
                weight_version=str(meta.get("weight_version", "")),
                sampling=dict(sampling_params),
            )

        async with the_pool().environment() as env:
            rollout = await roll_out(
                env,
                ask,
                renderer,
                task_id=sample.metadata["task_id"],
                cutoff_tokens=getattr(args, "rollout_max_context_len", None) or 16384,
                needs_logprobs=not evaluation,
            )
    return samples_of(sample, rollout, renderer)


def has_rewards(args: Any, samples: list[Any], **_: Any) -> bool:
    """Whether all episodes of a group have a reward: a group filter for slime."""
    return all(
        has_rewards(args, sample) if isinstance(sample, list) else sample.reward is not None
        for sample in samples
    )


def samples_of(sample: Any, rollout: TokenRollout, renderer: Renderer) -> Any:
    """An episode as slime's samples: a list, or the prompt's own, the one form that slime can queue again.

    Args:
        sample: the prompt's sample; the results are copies of it, with its index, group and rollout id.
        rollout: of the episode.
        renderer: of the model.
    """
    status = type(sample).Status
    if not rollout.rows:
        sample.status, sample.remove_sample, sample.reward = status.ABORTED, True, None
        sample.metadata = {**sample.metadata, **_episode_metadata(rollout)}
        return sample
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
    sample.reward, sample.remove_sample = rollout.reward, False  # an aborted sample may be tried again
    if getattr(sample, "rollout_id", 0) is None:  # in versions that have it, the steps of an episode share it
        sample.rollout_id = sample.index
    ended = row.reply_ids[-1] in renderer.end_ids
    sample.status = status.COMPLETED if ended else status.TRUNCATED
    sample.metadata = {**sample.metadata, **_episode_metadata(rollout), "step": row.step}
    return sample


def _episode_metadata(rollout: TokenRollout) -> dict[str, Any]:
    return {"outcome": str(rollout.outcome), "dropped": dict(rollout.dropped)}
