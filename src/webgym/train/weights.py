"""Weights and optimizer state on disk: loaded for training, saved atomically.

FOLDER/
  *.safetensors, config.json   all weights, for load_model and servers, in the precision of the computation;
                               or adapter_model.safetensors, adapter_config.json: adapters
  tokenizer*, preprocessor_config.json, chat_template.jinja, and other files that a server's processor reads
  training/*.safetensors       weights and the optimizer's moments as they are trained, each process's part in
                               files of its own (torch.distributed.checkpoint); the newest iteration alone
  selftest.json                these weights' reply to a known request (webgym.train.selftest)
  state.json                   {"step": optimizer steps so far, "source": "...", "lora": false}
"""

from __future__ import annotations

import os
import re
import shutil
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeAlias

import msgspec
import torch
from accelerate import PartialState
from huggingface_hub import try_to_load_from_cache

from webgym.core.errors import ConfigError, TrainingError
from webgym.inference.model import Loaded, load_model, loading
from webgym.store.files import TORN, disk_errors, sync_folder
from webgym.train.config import LoraConfig, UpdateConfig
from webgym.train.folder import TRAINING
from webgym.train.selftest import SELFTEST, SelfTest

STATE = "state.json"
Tensors: TypeAlias = Mapping[str, torch.Tensor]

_FILE_BYTES: Final = 2 * 2**30
"""Size of a file over all processes, each of which has its part of it twice in memory while it writes."""


class UpdateState(msgspec.Struct, frozen=True):
    """The state of learning, apart from weights and optimizer.

    Attributes:
        step: optimizer steps so far.
        source: the initial weights; adapters need them.
        lora: whether the folder holds adapters.
    """

    step: int
    source: str
    lora: bool


def load_trainable(config: UpdateConfig, source: str | Path | Loaded, resume: Path | None) -> Loaded:
    """Load a model, and make the configured parameters trainable.

    Args:
        config: what is trained: all weights or adapters, with or without the vision tower.
        source: folder or hub id of the initial weights, or a loaded model.
        resume: a folder to resume from, with the same kind of weights.

    Raises:
        ConfigError: there is no such model, or ``lora.targets`` matches no module.
        TrainingError: the folder to resume from holds the other kind, or other adapters.
    """
    if resume is not None and read_state(resume).lora != (config.lora is not None):
        raise TrainingError(
            f"{resume} was trained {'without' if config.lora else 'with'} adapters",
            hint="continue with the same update.lora, or start a new training",
        )
    if resume is not None and config.lora is None:
        source = resume
    loaded = source if isinstance(source, Loaded) else load_model(source, dtype=config.weights)
    model = loaded.model
    if config.gradient_checkpointing:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # about the name that versions to come have for it
            model.gradient_checkpointing_enable({"use_reentrant": False})
    if config.freeze_vision:
        model.model.visual.requires_grad_(requires_grad=False)
    if config.lora is None:
        return loaded
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of transformers, about what peft calls
        return Loaded(_adapted(model, config.lora, resume), loaded.renderer)


def check_targets(config: LoraConfig, source: str) -> None:
    """Check that there are modules to adapt, on the model without its weights.

    Raises:
        ConfigError: ``lora.targets`` matches no module.
    """
    from transformers import AutoConfig, AutoModelForImageTextToText

    if (Path(source) / "adapter_config.json").is_file():
        return  # the shapes are those of another model
    with loading(source) as where, torch.device("meta"):
        empty = AutoModelForImageTextToText.from_config(AutoConfig.from_pretrained(where))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # as above
        _adapted(empty, config, None)


def _adapted(model: Any, config: LoraConfig, resume: Path | None) -> Any:
    import peft  # only where there are adapters

    if resume is not None:
        saved = peft.PeftConfig.from_pretrained(str(resume))
        for name, field in (("rank", "r"), ("alpha", "lora_alpha"), ("targets", "target_modules")):
            if (before := getattr(saved, field)) != (now := getattr(config, name)):
                raise TrainingError(
                    f"{resume} was trained with update.lora.{name} {before}, not {now}",
                    hint="continue with the same value, or start a new training",
                )
        saved.lora_dropout = config.dropout
        return peft.PeftModel.from_pretrained(model, str(resume), is_trainable=True, config=saved)
    settings = peft.LoraConfig(
        r=config.rank, lora_alpha=config.alpha, lora_dropout=config.dropout, target_modules=config.targets
    )
    try:
        return peft.get_peft_model(model, settings)
    except ValueError as error:
        raise ConfigError("update.lora.targets matches no module of the model", hint=str(error)) from error


def save(
    folder: Path,
    loaded: Loaded,
    weights: dict[str, torch.Tensor],
    training: Tensors,
    state: UpdateState,
    selftest: SelfTest,
    *,
    processes: PartialState,
    sharded: bool,
) -> None:
    """Write a folder atomically; an existing one is replaced. All processes must call this.

    Args:
        folder: of the weights; its parent is created if missing.
        loaded: the model (for its configuration), tokenizer and image processor.
        weights: of the model, by name, on the CPU; only the first process needs them.
        training: what training goes on from, by name.
        state: of learning.
        selftest: of these weights.
        processes: all of them.
        sharded: whether each process has its parts of ``training``; otherwise the first has all.

    Raises:
        StoreError: it cannot be written; an existing folder is intact.
    """
    torn = folder.with_name(f".{folder.name}.new{TORN}")
    old = folder.with_name(f".{folder.name}.old{TORN}")
    is_first = processes.is_main_process
    with disk_errors(f"saving weights to {folder}"):
        try:
            if is_first:
                for left in (torn, old):  # leftovers of a crash while saving
                    shutil.rmtree(left, ignore_errors=True)
                torn.mkdir(parents=True)
                _save_whole(torn, loaded, weights, state, selftest)
            processes.wait_for_everyone()
            if sharded or is_first:
                _save_training(torn / TRAINING, training, sharded=sharded)
            if is_first:
                mode = (torn / STATE).stat().st_mode  # as the umask has it; safetensors lets nobody else read
                for path in torn.iterdir():
                    if path.is_file():
                        path.chmod(mode)
                        with path.open("rb") as file:
                            os.fsync(file.fileno())
                sync_folder(torn / TRAINING)
                sync_folder(torn)
                if folder.exists():
                    folder.rename(old)
                torn.rename(folder)
                sync_folder(folder.parent)
                shutil.rmtree(old, ignore_errors=True)
        except BaseException as error:
            if is_first:
                shutil.rmtree(torn, ignore_errors=True)
            if (number := _disk_error(error)) is not None:
                raise OSError(number, os.strerror(number)) from error
            raise
    processes.wait_for_everyone()


def _save_whole(
    folder: Path, loaded: Loaded, weights: dict[str, torch.Tensor], state: UpdateState, selftest: SelfTest
) -> None:
    loaded.model.save_pretrained(folder, state_dict=weights)
    loaded.tokenizer.save_pretrained(folder)
    loaded.image_processor.save_pretrained(folder)
    _copy_processor(state.source, folder)
    (folder / SELFTEST).write_bytes(msgspec.json.encode(selftest))
    (folder / STATE).write_bytes(msgspec.json.encode(state))


def _save_training(folder: Path, tensors: Tensors, *, sharded: bool) -> None:
    import torch.distributed.checkpoint as dcp  # imports for more than a second

    files, size = {}, 0
    for name, tensor in tensors.items():
        size += tensor.numel() * tensor.element_size()
        files[name] = size // _FILE_BYTES + 1
    writer = dcp.HuggingFaceStorageWriter(str(folder), files, save_distributed=True)
    with _errors_of_checkpoints():
        dcp.save(dict(tensors), storage_writer=writer, no_dist=not sharded)


def load_training(folder: Path, tensors: Tensors) -> None:
    """Fill tensors with what was saved by their names, however many processes saved it.

    Args:
        folder: of the weights.
        tensors: whole or sharded, by name; of the latter each process reads its parts.

    Raises:
        TrainingError: the folder does not hold them.
    """
    import torch.distributed.checkpoint as dcp

    if not (folder / TRAINING).is_dir():
        raise TrainingError(
            f"{folder} holds weights, but no optimizer state: that stays of the newest iteration alone",
            hint="begin a new training from them: learn.model",
        )
    reader = dcp.HuggingFaceStorageReader(str(folder / TRAINING))
    with _errors_of_checkpoints():
        dcp.load(dict(tensors), storage_reader=reader, no_dist=True)


@contextmanager
def _errors_of_checkpoints() -> Iterator[None]:
    """Raises errors of torch.distributed.checkpoint as those of the process that failed first."""
    from torch.distributed.checkpoint.api import CheckpointException

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that a single process saves
        try:
            yield
        except CheckpointException as error:  # no Exception: it would pass all handlers
            raise next(iter(error.failures.values()))[0] from error


def _disk_error(error: BaseException) -> int | None:
    """The system's error number of an error from safetensors or torch; ``None`` if there is none."""
    if found := re.search(r"\(os error (\d+)\)", str(error)):
        return int(found[1])
    cause = error.__cause__ or error.__context__
    if isinstance(error, RuntimeError) and isinstance(cause, OSError):
        return cause.errno
    return None


def _copy_processor(source: str, folder: Path) -> None:
    """Copy files that a server needs to load the model's processor; this package does not read them."""
    for name in ("processor_config.json", "video_preprocessor_config.json"):
        found = Path(source, name) if Path(source).is_dir() else try_to_load_from_cache(source, name)
        if isinstance(found, str | Path) and Path(found).is_file() and not (folder / name).exists():
            shutil.copyfile(found, folder / name)


def read_state(folder: Path) -> UpdateState:
    """Read the state of learning of a saved folder.

    Raises:
        TrainingError: it was not saved by an update.
    """
    try:
        return msgspec.json.decode((folder / STATE).read_bytes(), type=UpdateState)
    except (OSError, ValueError) as error:
        raise TrainingError(f"{folder} holds no update to resume from: {error}") from error
