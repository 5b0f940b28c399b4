"""The differences between DeepSpeed's ZeRO and one process, DDP and FSDP2.

accelerate hides most of it. Left are settings that must follow from ours, and the optimizer's state, which
ZeRO keeps in flat pieces: it is read and written here by the names of parameters, whole, in the form that
torch's ``get_optimizer_state_dict`` has. So a training can continue with other processes, or another backend.

The engine clips and steps by itself, when accelerate's ``sync_gradients`` says that gradients are complete; a
step whose gradient is no finite number it skips, and tells an infinite norm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from accelerate import Accelerator
from transformers.integrations import unset_hf_deepspeed_config

from webgym.core.errors import ConfigError
from webgym.train.config import UpdateConfig

MOMENTS = ("exp_avg", "exp_avg_sq")


def configure(accelerator: Accelerator, config: UpdateConfig) -> None:
    """Give ZeRO what it wants to know before it prepares a model.

    Raises:
        ConfigError: it is to keep something elsewhere than on the GPUs.
    """
    plugin = accelerator.state.deepspeed_plugin
    if plugin.hf_ds_config.is_offload():
        raise ConfigError(
            "DeepSpeed's offloading is not supported", hint="take offload_* out of the launch settings"
        )
    # Models are loaded whole, and the engine takes them apart: what transformers loads into stage 3 by itself
    # it saves under other names.
    unset_hf_deepspeed_config()
    accelerator.gradient_accumulation_steps = 1  # the update says which micro-batch is the last
    plugin.deepspeed_config.update(
        train_micro_batch_size_per_gpu=config.micro_batch,
        gradient_accumulation_steps=1,
        train_batch_size=config.micro_batch * accelerator.num_processes,
        gradient_clipping=config.max_grad_norm,
    )


def named_groups(module: torch.nn.Module, optimizer: torch.optim.Optimizer) -> list[dict[str, Any]]:
    """The optimizer's groups with names in place of parameters; to be asked before ZeRO takes it apart."""
    names = {id(each): name for name, each in module.named_parameters()}
    return [
        group | {"params": [names[id(each)] for each in group["params"]]} for group in optimizer.param_groups
    ]


def weights(engine: Any) -> dict[str, torch.Tensor]:
    """The whole weights, on the CPU, in the first process; all processes call this.

    accelerate's way copies tied weights apart, and without a GPU leaves stage 3's to be overwritten.
    """
    from deepspeed.runtime.zero import GatheredParameters

    found = {}
    for name, each in engine.module.named_parameters():
        with GatheredParameters([each]):
            if engine.global_rank == 0:
                found[name] = each.detach().to("cpu", copy=True)
    return found


def optimizer_state(engine: Any, groups: Sequence[dict[str, Any]], step: int) -> dict[str, Any]:
    """The whole state, on the CPU; all processes call this.

    Args:
        engine: DeepSpeed's, with a model in it.
        groups: of the optimizer, with names in place of parameters.
        step: optimizer steps so far.
    """
    from deepspeed.utils import safe_get_full_optimizer_state

    state = {
        name: {"step": torch.tensor(float(step))}
        | {moment: safe_get_full_optimizer_state(each, moment).cpu() for moment in MOMENTS}
        for name, each in _trained(engine)
    }
    return {"state": state, "param_groups": list(groups)}


def set_optimizer_state(engine: Any, saved: dict[str, Any] | None, step: int) -> None:
    """Make the state before the first step; whole ones that were saved are taken apart.

    ZeRO would leave it to the optimizer, and then finds the moments of the first group alone: of all others
    there are none yet when it looks.
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
    for name, each in _trained(engine):
        for moment in MOMENTS:
            value = saved["state"][name][moment].to(engine.device)
            if not is_stage_3:
                safe_set_full_optimizer_state(each, value, moment)
                continue
            size, rank = each.ds_tensor.numel(), engine.global_rank
            mine = value.new_zeros(size)  # the last process's piece is filled up
            piece = value.flatten()[size * rank : size * (rank + 1)]
            mine[: len(piece)] = piece
            safe_set_local_optimizer_state(each, mine, moment)


def _trained(engine: Any) -> list[tuple[str, Any]]:
    return [(name, each) for name, each in engine.module.named_parameters() if each.requires_grad]
