"""verl (tested with verl 0.9.1), its V1 trainer, which takes several outputs of one agent loop. In a file
that ``actor_rollout_ref.rollout.agent.agent_loop_config_path`` names::

    - name: webgym
      _target_: webgym.integrations.verl.WebGymAgentLoop
      tasks: offline-v2
      size: 64

and use a dataset written by :func:`write_dataset`. An episode gives one output per step, all with the
episode's reward: the prompt has a window of the history, so no two steps share a prompt. An episode without a
reward, or without a usable step, gives no output, and verl leaves its session out of the group. Steps without
an output are counted in :data:`dropped`, and logged.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from verl.experimental.agent_loop.agent_loop import AgentLoopBase, AgentLoopMetrics, AgentLoopOutput
from verl.workers.rollout.replica import TokenOutput

from webgym import EnvironmentPool, Renderer, Sampled, TokenRequest, TokenRollout, roll_out, task_rows

log = logging.getLogger(__name__)
_ABORTED: Final = ("abort", "aborted")
"""Stop reasons of replies that the engine broke off."""

dropped: Counter[str] = Counter()
"""Number of steps without an output in this worker process so far, by reason."""

_pools: dict[tuple[object, ...], EnvironmentPool] = {}
"""Pools of this worker process, shared because verl creates an agent loop for every episode."""


class WebGymAgentLoop(AgentLoopBase):
    """Plays one episode in a browser, of the task in the row's ``task_id``.

    Args:
        tasks: name of the tasks, as for :func:`webgym.make`.
        size: number of browsers of this worker process, and so of its concurrent episodes.
        split: of the tasks.
        pool: an existing pool to use instead of one made from the arguments above.
        options: verl's own arguments.
    """

    def __init__(
        self,
        *,
        tasks: str = "offline-v2",
        size: int = 8,
        split: str = "train",
        pool: EnvironmentPool | None = None,
        **options: Any,
    ) -> None:
        super().__init__(**options)
        if pool is None:
            key = (tasks, size, split)
            any_split: Any = split
            pool = _pools.get(key) or _pools.setdefault(
                key, EnvironmentPool(tasks, size=size, split=any_split)
            )
        self._pool = pool
        self._renderer = Renderer(self.tokenizer, self.processor.image_processor)

    async def run(self, sampling_params: dict[str, Any], **kwargs: Any) -> list[AgentLoopOutput]:
        """Play the task.

        Args:
            sampling_params: verl's sampling parameters.
            kwargs: fields of the dataset's row, with ``task_id`` directly or in ``extra_info``.

        Returns:
            An output for each step that can be trained on; none for an episode without a reward. The
            ``reward_extra_info`` of each has the number of the episode's other steps as ``dropped``.
        """
        replies: list[TokenOutput] = []

        async def generate(request: TokenRequest) -> Sampled:
            replies.append(
                await self.server_manager.generate(
                    request.id,
                    prompt_ids=request.prompt_ids,
                    sampling_params=dict(sampling_params),
                    image_data=request.pil_images(),
                )
            )
            reply = replies[-1]
            has_ended = bool(reply.token_ids) and reply.token_ids[-1] in self._renderer.end_ids
            version = reply.extra_fields.get("max_global_steps")
            return Sampled(
                reply.token_ids,
                reply.log_probs,
                finish_reason="abort" if reply.stop_reason in _ABORTED else "stop" if has_ended else "length",
                weight_version="" if version is None else str(version),
                sampling=dict(sampling_params),
            )

        # A validation, or a greedy baseline, has other parameters; nothing is trained on it.
        trains = all(
            sampling_params.get(name) == self.rollout_config.get(name)
            for name in ("temperature", "top_p", "top_k")
        )
        task_id = kwargs.get("task_id") or kwargs.get("extra_info", {}).get("task_id")
        async with self._pool.environment() as env:
            rollout = await roll_out(
                env,
                generate,
                self._renderer,
                task_id=task_id,
                cutoff_tokens=self.rollout_config.prompt_length + self.rollout_config.response_length,
                needs_logprobs=trains and bool(sampling_params.get("logprobs")),
            )
        if rollout.dropped:
            dropped.update(rollout.dropped)
            log.warning("%s: steps without an output: %s", rollout.task_id, dict(rollout.dropped))
        return self._outputs(rollout, replies)

    def _outputs(self, rollout: TokenRollout, replies: Sequence[TokenOutput]) -> list[AgentLoopOutput]:
        reward_info = {  # verl requires the same keys of all outputs
            "outcome": str(rollout.outcome),
            "task_id": rollout.task_id,
            "dropped": rollout.dropped.total(),
        }
        return [
            AgentLoopOutput(
                prompt_ids=row.prompt_ids,
                response_ids=row.reply_ids,
                response_mask=[1] * len(row.reply_ids),
                response_logprobs=row.logprobs,
                multi_modal_data={"images": TokenRequest("", [], [], row.images, ()).pil_images()},
                reward_score=rollout.reward,
                num_turns=2,
                metrics=AgentLoopMetrics(
                    num_preempted=-1 if reply.num_preempted is None else reply.num_preempted
                ),
                extra_fields={**reply.extra_fields, "reward_extra_info": reward_info},
            )
            for row in rollout.rows
            for reply in [replies[row.step]]
        ]


def write_dataset(
    path: Path | str, name: str = "offline-v2", *, agent: str = "webgym", **options: Any
) -> None:
    """Write tasks as a Parquet file for ``data.train_files``.

    Args:
        path: of the file.
        name: name of the tasks, as for :func:`webgym.make`.
        agent: name of the agent loop's entry; its ``tasks`` and ``split`` must be those of these tasks.
        options: further arguments of :func:`webgym.task_rows`, such as ``count`` and ``split``.

    Raises:
        ConfigError: there are no tasks of this name.
        OSError: the file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = [
        {
            "prompt": [{"role": "user", "content": row["instruction"]}],
            "data_source": name,
            "agent_name": agent,
            "reward_model": {"style": "environment", "ground_truth": ""},
            "extra_info": {"index": number, "task_id": row["task_id"]},
        }
        for number, row in enumerate(task_rows(name, **options))
    ]
    pq.write_table(pa.Table.from_pylist(rows), path)
