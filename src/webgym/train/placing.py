"""Chooses where the GPUs of one machine go, describes that, and has the processes started there.

By itself, the judge's model gets the GPUs that it needs, the learner the fewest on which an update fits, and
policy servers the rest. Where GPUs are too few for that, the policy replies in the learner's first process.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Final
from urllib.parse import urlsplit

import torch

from webgym.core.errors import ConfigError, UsageError
from webgym.core.settings import configs_folder
from webgym.inference.vllm import REQUEST_TOKENS, VllmConfig
from webgym.judge.config import MODEL_JUDGES
from webgym.llm.config import ChatConfig
from webgym.run.config import viewport_of
from webgym.train.estimate import GIB, KNOWN_GPUS, Estimate, Gpus, Workload, estimate, shapes_of
from webgym.train.layout import Layout
from webgym.train.loop import TrainConfig

_REQUESTS: Final = 4
"""Whole requests for which a server must have memory beside the weights, or it replies to few at once."""

_MIX: Final = {"easy": 25, "medium": 5, "hard": 1}
"""Tasks of each level in the published set, roughly, where the ratio is not set."""


def gpus_of(text: str) -> Gpus:
    """The GPUs that are written as ``8``, ``8xh100`` or ``h100``. Without a type, their memory is that of
    this machine's first, if there is one, else an H100's.

    Raises:
        UsageError: there is no such type.
    """
    found = re.fullmatch(rf"(?:([1-9]\d*)(?:x|$))?({'|'.join(KNOWN_GPUS)})?", text.lower())
    if not text or found is None:
        raise UsageError(
            f"unknown GPUs {text!r}", hint=f"such as 8 or 8xh100; types: {', '.join(KNOWN_GPUS)}"
        )
    count, kind = int(found[1] or 1), found[2]
    if kind is None and torch.cuda.is_available():
        return Gpus(count, torch.cuda.get_device_properties(0).total_memory / GIB)
    return replace(KNOWN_GPUS[kind or "h100"], count=count)


def choose(config: TrainConfig, gpus: Gpus) -> Layout:
    """A layout of these GPUs for a training.

    Raises:
        ConfigError: the memory of an update cannot be estimated.
    """
    judge = _gpus_for(chat.model, gpus) if (chat := _judge_here(config)) else 0
    each = 0 if _replies_elsewhere(config) else _gpus_for(config.learn.model, gpus)
    if gpus.count < 1 + each + judge:
        judge = 0
    left = gpus.count - judge
    if not each or left < 1 + each:
        return Layout(left, judge=judge)
    fewest = range(1, left - each + 1)
    learner = next(
        (count for count in fewest if _update(config, gpus, Layout(count, 1)).fits), fewest.stop - 1
    )
    servers = (left - learner) // each
    return Layout(left - servers * each, servers, each, judge)


def placed(config: TrainConfig) -> tuple[TrainConfig, ChatConfig | None, list[str]]:
    """A training on the GPUs of this machine: its settings, with policy servers that are started there, and
    the judge's model, with its GPUs, if that is to be started, too.

    Raises:
        ConfigError: the layout does not fit the machine or the settings.
    """
    if config.layout is None:
        return config, None, []
    layout = Layout.parse(config.layout)
    gpus = _gpus_here(layout)
    judge = _judge_here(config) if layout.judge else None
    if layout.judge and judge is None:
        raise ConfigError(
            f"the layout {layout} has GPUs for a judge, and no model of this machine judges",
            hint="set rollout.judge.rubric.chat.base_url to http://127.0.0.1:8001/v1, or end it in +0",
        )
    if layout.servers:
        if config.vllm is not None and config.vllm.base_url is not None:
            raise ConfigError(
                f"the layout {layout} starts policy servers, and vllm.base_url names one",
                hint="leave out either",
            )
        places = [gpus[place] for place in layout.replying]
        config = config.model_copy(update={"local": None, "vllm": _servers(config, layout, places)})
    return config, judge, [gpus[place] for place in layout.judging]


def _servers(config: TrainConfig, layout: Layout, gpus: Sequence[str]) -> VllmConfig:
    """The policy servers of a layout; a model that would reply in this process is served by vLLM instead."""
    base, local = config.vllm, config.local
    if base is None:
        base = VllmConfig(max_model_len=REQUEST_TOKENS)
        base = base.model_copy(update={"model": local.path, "sampling": local.sampling} if local else {})
    here = {
        "replicas": layout.servers,
        "tensor_parallel_size": layout.server_gpus,
        "data_parallel_size": 1,
        "env": base.env | {"CUDA_VISIBLE_DEVICES": ",".join(gpus)},
    }
    return base.model_copy(update=here)


def launch(config: TrainConfig, arguments: Sequence[str]) -> None:
    """Become what starts a process for every GPU that learns, unless this is one of them already.

    All GPUs stay visible to them; each process learns on the one of its rank.

    Args:
        config: of the training.
        arguments: of ``webgym``, for each process.

    Raises:
        ConfigError: another number of processes was launched.
    """
    if config.layout is None:
        return
    layout, launched = Layout.parse(config.layout), int(os.environ.get("WORLD_SIZE") or 0)
    if "RANK" in os.environ and launched != layout.learner:
        raise ConfigError(
            f"{launched} processes were launched, and of the layout {layout} {layout.learner} learn",
            hint="start webgym train without a launcher, or leave out the layout",
        )
    if layout.learner == 1 or "RANK" in os.environ:
        return
    way = "fsdp2" if _is_sharded(config) else "ddp"
    command = [sys.executable, "-m", "accelerate.commands.accelerate_cli", "launch"]
    command += ["--config_file", str(configs_folder() / "accelerate" / f"{way}.yaml")]
    command += ["--num_processes", str(layout.learner), "--main_process_port", "0", "-m", "webgym"]
    os.execv(sys.executable, [*command, *arguments])  # noqa: S606 (no shell is wanted)


def explain(config: TrainConfig, layout: Layout, gpus: Gpus) -> list[str]:
    """Lines that say where the GPUs go, and what an update and the servers take there."""
    found = _update(config, gpus, layout)
    lines = [f"layout     {layout} of {gpus.count} x {gpus.memory_gib:g} GiB: {_purposes(layout)}"]
    if layout.servers:
        lines.append(
            f"servers    {layout.servers} of {_served(config.learn.model, layout.server_gpus, gpus)}"
        )
    if layout.judge and (chat := _judge_here(config)):
        lines.append(f"judge      {chat.model} on {_served(chat.model, layout.judge, gpus)}")
    if waits := waiting(config, found, layout.learner if not layout.servers else 1):
        lines.append(f"collecting {waits}")
    return [*lines, *found.lines()]


def waiting(config: TrainConfig, found: Estimate, learners: int) -> str:
    """What it costs that the first of several processes collects alone; empty if it does not.

    Args:
        config: of the training, with the model that replies.
        found: the estimate of an update.
        learners: processes of the launch.
    """
    if learners == 1 or not found.reply_seconds:
        return ""
    attempt, ratio = config.rollout.attempt, config.sampler.ratio
    shares = {str(level): share for level, share in (ratio or _MIX).items()}
    budgets = {"easy": attempt.budget_easy, "medium": attempt.budget_medium, "hard": attempt.budget_hard}
    steps = sum(share * budgets[level] for level, share in shares.items()) / sum(shares.values())
    hours = config.loop.tasks * config.rollout.samples * steps * found.reply_seconds / 3600
    return (
        f"the first of {learners} processes replies with transformers, which is for small models: about "
        f"{hours:.1f} h per iteration, while {learners - 1} GPUs wait; --layout can start servers"
    )


def _update(config: TrainConfig, gpus: Gpus, layout: Layout) -> Estimate:
    learning = replace(gpus, count=layout.learner, sharded=_is_sharded(config))
    local = None if layout.servers else config.local
    width, height = viewport_of(config.rollout)
    work = Workload(pictures=config.rollout.agent.rounds + 1, picture_patches=width * height // 16**2)
    return estimate(config.learn, learning, work, local=local, keep=config.loop.keep_weights)


def _is_sharded(config: TrainConfig) -> bool:
    return config.learn.update.lora is None


def _replies_elsewhere(config: TrainConfig) -> bool:
    """Whether the policy replies where the layout decides nothing: on another server, or on processors."""
    if config.vllm is not None:
        return config.vllm.base_url is not None
    return config.local is not None and config.local.device == "cpu"


def _judge_here(config: TrainConfig) -> ChatConfig | None:
    """The model that judges at an address of this machine, if one does."""
    choice = config.rollout.judge
    if choice.name not in MODEL_JUDGES or choice.rubric is None:
        return None
    chat = choice.rubric.chat
    return chat if urlsplit(chat.base_url).hostname in ("127.0.0.1", "localhost") else None


@cache
def _model_bytes(model: str) -> tuple[int, int] | None:
    """Bytes of a model's weights in bfloat16, and of a token in the cache of its keys and values; ``None`` if
    its configuration cannot be read, or is of another family."""
    try:
        size = shapes_of(model)
    except (ConfigError, AttributeError):
        return None
    return 2 * size.parameters, 2 * 2 * size.text.layers * size.text.keys


def _gpus_for(model: str, gpus: Gpus) -> int:
    """The fewest GPUs, a power of two, whose memory holds a model and some requests."""
    if (known := _model_bytes(model)) is None:
        return 1
    needed = known[0] + _REQUESTS * REQUEST_TOKENS * known[1]
    return next((count for count in (1, 2, 4) if count * _usable(gpus) >= needed), 8)


def _usable(gpus: Gpus) -> float:
    return float(VllmConfig().gpu_memory_utilization * gpus.memory_gib * GIB)


def _served(model: str, count: int, gpus: Gpus) -> str:
    where = f"{count} GPU{'s' * (count > 1)}"
    if (known := _model_bytes(model)) is None:
        return f"{where}; its size is not known here"
    left = _usable(gpus) - known[0] / count
    return f"{where}: {known[0] / count / GIB:.1f} GiB of weights per GPU, {left / GIB:.1f} for requests"


def _purposes(layout: Layout) -> str:
    parts = {"learner": range(layout.learner), "policy": layout.replying, "judge": layout.judging}
    return ", ".join(
        f"{what} {where[0]}{f'-{where[-1]}' if len(where) > 1 else ''}"
        for what, where in parts.items()
        if where
    )


def _gpus_here(layout: Layout) -> list[str]:
    """The ids of this machine's GPUs, as CUDA_VISIBLE_DEVICES lists them.

    Raises:
        ConfigError: they are too few.
    """
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible is None:
        gpus = [str(number) for number in range(torch.cuda.device_count())]
    else:
        gpus = [gpu.strip() for gpu in visible.split(",") if gpu.strip()]
    if len(gpus) < layout.total:
        raise ConfigError(
            f"the layout {layout} takes {layout.total} GPUs, and this machine has {len(gpus)}",
            hint="give --gpus or --layout for this one, if CUDA_VISIBLE_DEVICES does not hide some",
        )
    return gpus
