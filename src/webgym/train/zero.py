"""The differences between DeepSpeed's ZeRO and one process, DDP and FSDP2.

accelerate hides most of them. This module derives ZeRO's settings from ours, and converts the optimizer
state, which ZeRO stores in flat shards, from and to the full state by parameter names that torch's
``get_optimizer_state_dict`` returns. So a training can continue with another number of processes or backend.

The engine clips gradients and steps by itself once accelerate's ``sync_gradients`` is set. It skips steps
whose gradient is not finite and reports an infinite norm for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from accelerate import Accelerator

from webgym.core.errors import ConfigError
from webgym.train.config import UpdateConfig

MOMENTS = ("exp_avg", "exp_avg_sq")


def configure(accelerator: Accelerator, config: UpdateConfig) -> None:
    """Set ZeRO's settings before it prepares a model.

    Raises:
        ConfigError: it is set to offload.
    """
    from transformers.integrations import unset_hf_deepspeed_config

    plugin = accelerator.state.deepspeed_plugin
    if plugin.hf_ds_config.is_offload():
        raise ConfigError(
            "DeepSpeed's offloading is not supported", hint="remove offload_* from the launch settings"
        )
    # Load full models, which the engine then shards: models that transformers loads into stage 3 directly are
    # saved under other names.
    unset_hf_deepspeed_config()
    plugin.deepspeed_config.update(
        train_micro_batch_size_per_gpu=config.micro_batch,
        gradient_accumulation_steps=1,
        train_batch_size=config.micro_batch * accelerator.num_processes,
        gradient_clipping=config.max_grad_norm,
    )


def named_groups(module: torch.nn.Module, optimizer: torch.optim.Optimizer) -> list[dict[str, Any]]:
    """The optimizer's groups with names in place of parameters; call this before ZeRO shards it."""
    names = {id(parameter): name for name, parameter in module.named_parameters()}
    return [
        group | {"params": [names[id(parameter)] for parameter in group["params"]]}
        for group in optimizer.param_groups
    ]


def weights(engine: Any) -> dict[str, torch.Tensor]:
    """The full weights, on the CPU, in the first process; all processes must call this.

    accelerate's own function unties tied weights, and without a GPU returns stage 3's buffers uncopied.
    """
    from deepspeed.runtime.zero import GatheredParameters

    found = {}
    for name, parameter in engine.module.named_parameters():
        with GatheredParameters([parameter]):
            if engine.global_rank == 0:
                found[name] = parameter.detach().to("cpu", copy=True)
    return found


def optimizer_state(engine: Any, groups: Sequence[dict[str, Any]], step: int) -> dict[str, Any]:
    """The full optimizer state, on the CPU; all processes must call this.

    Args:
        engine: DeepSpeed's, with a model in it.
        groups: of the optimizer, with names in place of parameters.
        step: optimizer steps so far.
    """
    from deepspeed.utils import safe_get_full_optimizer_state

    state = {
        name: {"step": torch.tensor(float(step))}
        | {moment: safe_get_full_optimizer_state(parameter, moment).cpu() for moment in MOMENTS}
        for name, parameter in _trained(engine)
    }
    return {"state": state, "param_groups": list(groups)}


def set_optimizer_state(engine: Any, saved: dict[str, Any] | None, step: int) -> None:
    """Initialise the optimizer state before the first step, from a saved full state if there is one.

    If this were left to the optimizer, ZeRO would find the moments of the first group only, because those of
    the others do not exist yet when it looks for them.
    """
    from deepspeed.utils import safe_set_full_optimizer_state, safe_set_local_optimizer_state

    sharded = engine.optimizer
    is_stage_3 = hasattr(sharded, "fp32_partitioned_groups_flat")
    pieces = "fp32_partitioned_groups_flat" if is_stage_3 else "single_partition_of_fp32_groups"
    for flat in getattr(sharded, pieces):
        moments = {moment: torch.zeros_like(flat) for moment in MOMENTS}
        sharded.optimizer.state[flat] = {"step": torch.tensor(float(step))} | moments
    if not is_stage_3:
        sharded._lazy_init_hp_params_optimizer_state()
    if saved is None:
        return
    for name, parameter in _trained(engine):
        for moment in MOMENTS:
            value = saved["state"][name][moment].to(engine.device)
            if not is_stage_3:
                safe_set_full_optimizer_state(parameter, value, moment)
                continue
            size, rank = parameter.ds_tensor.numel(), engine.global_rank
            own = value.new_zeros(size)  # the last process's shard is padded
            piece = value.flatten()[size * rank : size * (rank + 1)]
            own[: len(piece)] = piece
            safe_set_local_optimizer_state(parameter, own, moment)


def _trained(engine: Any) -> list[tuple[str, Any]]:
    return [
        (name, parameter) for name, parameter in engine.module.named_parameters() if parameter.requires_grad
    ]
