"""AReaL (tested with areal 1.0.4): a workflow that plays episodes of WebGym::

    workflow = WebGymWorkflow(gconfig, tokenizer, processor, size=64)
    trainer.train(workflow=workflow, ...)  # the dataset: webgym.task_rows("offline-v2", count="all")

An episode gives one row per step, all with the episode's reward: the prompt has a window of the history, so
no two steps share a prompt. An episode without a reward, or without a usable row, is rejected (``None``).

With SGLang, the model reads exactly the token ids in the row. vLLM is sent messages by AReaL and does not
return the ids that it renders them to, so such rows are correct only if both renderings agree.
"""

from __future__ import annotations

import base64
import uuid
from typing import Any

import torch
from areal.api.cli_args import GenerationHyperparameters
from areal.api.io_struct import ModelRequest
from areal.api.workflow_api import RolloutWorkflow
from areal.infra import workflow_context
from areal.utils.data import concat_padded_tensors

from webgym import EnvironmentPool, Renderer, Sampled, TokenRequest, TokenRow, roll_out


class WebGymWorkflow(RolloutWorkflow):
    """Plays an episode in a browser for each row of the dataset, which has a ``task_id``.

    Args:
        gconfig: sampling parameters; ``n_samples`` is set to 1.
        tokenizer: of the model, with its chat template.
        processor: of the model.
        name: name of the tasks, as for :func:`webgym.make`.
        size: number of browsers, and so of concurrent episodes.
        cutoff_tokens: most tokens of prompt and reply together; longer rows are dropped.
        options: further arguments of :class:`webgym.EnvironmentPool`.

    Attributes:
        pool: the environments; close it at the end.
        dropped: number of steps without a row so far, by reason.
    """

    def __init__(
        self,
        gconfig: GenerationHyperparameters,
        tokenizer: Any,
        processor: Any,
        *,
        name: str = "offline-v2",
        size: int = 8,
        cutoff_tokens: int = 16384,
        **options: Any,
    ) -> None:
        self.gconfig = gconfig.new(n_samples=1)
        self.tokenizer, self.processor = tokenizer, processor
        self.renderer = Renderer(tokenizer, processor.image_processor)
        self.cutoff_tokens = cutoff_tokens
        self.pool = EnvironmentPool(name, size=size, **options)
        self.dropped: dict[str, int] = {}

    async def arun_episode(self, engine: Any, data: dict[str, Any]) -> dict[str, Any] | None:
        """Play the row's task.

        Returns:
            Tensors of ``(rows, longest row)``, padded on the right, and ``rewards`` of ``(rows,)``; ``None``
            if there is nothing to train on.
        """
        versions: dict[int, list[int]] = {}

        async def generate(request: TokenRequest) -> Sampled:
            model_request = ModelRequest(
                rid=uuid.uuid4().hex,
                input_ids=request.prompt_ids,
                image_data=[base64.b64encode(image).decode() for image in request.images],
                vision_msg_vllm=[_chat(request)],
                gconfig=self.gconfig,
                tokenizer=self.tokenizer,
                processor=self.processor,
            )
            response = await engine.agenerate(model_request)
            versions[len(versions)] = list(response.output_versions)
            ended = response.stop_reason
            return Sampled(
                response.output_tokens,
                response.output_logprobs,
                finish_reason=ended if ended in ("length", "abort") else "stop",
                weight_version=str(min(response.output_versions, default="")),
                prompt_ids=response.input_tokens,
                sampling=_sampling(self.gconfig),
            )

        async with self.pool.environment() as env:
            rollout = await roll_out(
                env,
                generate,
                self.renderer,
                task_id=data["task_id"],
                cutoff_tokens=self.cutoff_tokens,
                needs_logprobs=not workflow_context.get().is_eval,
            )
        for reason, count in rollout.dropped.items():
            self.dropped[reason] = self.dropped.get(reason, 0) + count
        rows = [self._row(row, versions[row.step], rollout.reward) for row in rollout.rows]
        return concat_padded_tensors(rows) if rows else None

    def _row(self, row: TokenRow, versions: list[int], reward: float | None) -> dict[str, Any]:
        assert reward is not None, "an episode without a reward has no rows"
        assert row.logprobs is not None, "a row without them is dropped"
        prompt, ids = len(row.prompt_ids), [*row.prompt_ids, *row.reply_ids]
        pixels = row.pixels(self.renderer)
        image = [int(token == self.renderer.image_id) for token in row.prompt_ids]
        pictures = {} if pixels is None else {"pixel_values": pixels.values, "image_grid_thw": pixels.grid}
        reply = len(row.reply_ids)
        return {
            "input_ids": torch.tensor([ids]),
            "mm_token_type_ids": torch.tensor([[*image, *[0] * reply]]),
            "loss_mask": torch.tensor([[0] * prompt + [1] * reply], dtype=torch.int32),
            "logprobs": torch.tensor([[0.0] * prompt + row.logprobs]),
            "versions": torch.tensor([[-1] * prompt + versions], dtype=torch.int32),
            "attention_mask": torch.ones(1, len(ids), dtype=torch.bool),
            "rewards": torch.tensor([reward]),
            "multi_modal_input": [pictures],
        }


def _sampling(gconfig: GenerationHyperparameters) -> dict[str, Any]:
    names = ("top_p", "frequency_penalty", "min_new_tokens", "ignore_eos", "use_beam_search")
    return {name: getattr(gconfig, name) for name in names} | {
        "temperature": 0.0 if gconfig.greedy else gconfig.temperature,
        "top_k": gconfig.top_k if gconfig.top_k < 10**8 else -1,  # AReaL's default is 10**8
    }


def _chat(request: TokenRequest) -> list[dict[str, Any]]:
    """The request as chat messages for vLLM, which renders them itself; the engine inserts the images."""
    chat = []
    for message in request.messages:
        content: list[dict[str, Any]] = []
        for part in message.content:
            text = getattr(part, "text", None)
            picture = {"type": "image_url", "image_url": {"url": ""}}
            content.append(picture if text is None else {"type": "text", "text": text})
        chat.append({"role": message.role, "content": content})
    return chat
