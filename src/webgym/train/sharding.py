"""Splitting a model over processes: PyTorch's FSDP2, and DeepSpeed's ZeRO.

FSDP2 (:func:`shard`) keeps a part of every weight, gradient and moment in each process. A layer's weights are
gathered, in the precision of the computation, while the layer computes; its gradients are summed in float32
and split again in every backward pass, so that no process ever has all of either.

accelerate hides most of ZeRO. Its settings follow from ours here, and its optimizer state, which it keeps in
flat shards, is converted from and to tensors by the names of parameters. The engine clips gradients and steps
by itself once accelerate's ``sync_gradients`` is set. It skips steps whose gradient is not finite and reports
an infinite norm for them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from accelerate import Accelerator
from torch import nn

from webgym.core.errors import ConfigError
from webgym.train.config import UpdateConfig

MOMENTS = ("exp_avg", "exp_avg_sq")


def is_fsdp(processes: int) -> bool:
    """Whether ``accelerate launch`` asks for FSDP.

    Args:
        processes: of the launch.

    Raises:
        ConfigError: it is set to offload.
    """
    if processes == 1 or os.environ.get("ACCELERATE_USE_FSDP") != "true":
        return False
    if os.environ.get("FSDP_OFFLOAD_PARAMS") == "true":
        raise ConfigError("FSDP's offloading is not supported", hint="set fsdp_offload_params to false")
    return True


def shard(module: nn.Module, model: Any, device: torch.device, *, bf16: bool) -> None:
    """Shard a model over all processes with FSDP2, in place; all processes must call this.

    Weights come from the first process; those of the others may be on the meta device, where transformers
    leaves them if only one process of a machine is to load the model (``cpu_ram_efficient_loading``).

    Args:
        module: that holds the model, and is called in its place.
        model: a transformers model, bare or with adapters.
        device: to compute on.
        bf16: compute in bfloat16. Weights, gradients and optimizer keep their type.
    """
    from torch.distributed.checkpoint.state_dict import StateDictOptions, set_model_state_dict
    from torch.distributed.fsdp import MixedPrecisionPolicy, fully_shard

    precision = MixedPrecisionPolicy(torch.bfloat16, torch.float32) if bf16 else MixedPrecisionPolicy()
    base = model.get_base_model() if hasattr(model, "get_base_model") else model
    is_first = torch.distributed.get_rank() == 0
    whole, buffers = module.state_dict() if is_first else {}, dict(module.named_buffers())
    # Tied on the meta device, so that the table of input and output is one parameter when it is sharded.
    module.to("meta")
    base.tie_weights()
    for layer in [each for each in base.modules() if type(each).__name__ in base._no_split_modules]:
        fully_shard(layer, mp_policy=precision)
    tables = base.get_input_embeddings(), base.get_output_embeddings()
    if tables[0].weight is not tables[1].weight:  # tied, they stay with what else is gathered throughout
        for table in tables:
            fully_shard(table, mp_policy=precision)
    fully_shard(module, mp_policy=precision)
    module.to_empty(device=device)
    base.tie_weights()  # moving has made two parameters of it
    for name, buffer in module.named_buffers():
        buffer.copy_(buffers[name])
    set_model_state_dict(
        module, whole, options=StateDictOptions(full_state_dict=True, broadcast_from_rank0=True)
    )


def whole_weights(
    parameters: Iterable[tuple[str, Any]], dtype: torch.dtype | None, *, keep: bool
) -> dict[str, torch.Tensor]:
    """Whole weights by name, on the CPU; all processes must call this.

    Args:
        parameters: sharded or not, with their names.
        dtype: to convert them to; ``None`` for their own.
        keep: whether this process wants them; the others get an empty dictionary.
    """
    found = {}
    for name, parameter in parameters:
        with _gathered(parameter):
            value = parameter.detach().to(dtype or parameter.dtype)
            value = value.full_tensor() if hasattr(value, "full_tensor") else value
            if keep:
                found[name] = value.to("cpu", copy=True)
    return found


def _gathered(parameter: Any) -> AbstractContextManager[Any]:
    """Context in which a parameter is whole that ZeRO's stage 3 has split; others are as they are."""
    if not hasattr(parameter, "ds_id"):
        return nullcontext()
    from deepspeed.runtime.zero import GatheredParameters

    context: AbstractContextManager[Any] = GatheredParameters([parameter])
    return context


def configure_zero(accelerator: Accelerator, config: UpdateConfig) -> None:
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


def zero_tensors(parameters: Sequence[tuple[str, Any]], *, keep: bool) -> dict[str, torch.Tensor]:
    """Whole weights and moments, as :func:`webgym.train.weights.load_training` names them, on the CPU.

    All processes must call this; without ``keep`` they get an empty dictionary.
    """
    from deepspeed.utils import safe_get_full_optimizer_state

    weights = whole_weights(parameters, None, keep=keep)
    found = {f"weights/{name}": weight for name, weight in weights.items()}
    for name, parameter in parameters:
        for moment in MOMENTS * parameter.requires_grad:
            whole = safe_get_full_optimizer_state(parameter, moment)
            if keep:
                found[f"{moment}/{name}"] = whole.cpu()
    return found


def begin_zero(
    engine: Any,
    parameters: Sequence[tuple[str, Any]],
    step: int,
    load: Callable[[dict[str, torch.Tensor]], None] | None,
) -> None:
    """Initialise the optimizer's moments before the first step.

    If this were left to the optimizer, ZeRO would find the moments of the first group only, because those of
    the others do not exist yet when it looks for them.

    Args:
        engine: DeepSpeed's.
        parameters: of its model, with their names.
        step: optimizer steps so far.
        load: fills tensors with what was saved by their names; ``None`` to begin at 0.
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
    if load is None:
        return
    for name, parameter in parameters:
        for moment in MOMENTS * parameter.requires_grad:
            whole = torch.empty(getattr(parameter, "ds_shape", parameter.shape))
            load({f"{moment}/{name}": whole})
            value = whole.to(engine.device)
            if not is_stage_3:
                safe_set_full_optimizer_state(parameter, value, moment)
                continue
            size, rank = parameter.ds_tensor.numel(), engine.global_rank
            own = value.new_zeros(size)  # the last process's shard is padded
            piece = value.flatten()[size * rank : size * (rank + 1)]
            own[: len(piece)] = piece
            safe_set_local_optimizer_state(parameter, own, moment)
