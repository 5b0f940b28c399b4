"""DeepSpeed's ZeRO gives the update of one process: here on processors, over gloo, never run on GPUs."""

from __future__ import annotations

import multiprocessing
import os
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file
from tests.inference.tiny import write_tiny_model
from tests.train.test_update import assert_same
from tests.train.updating import CASES, run_case, samples, updater

from webgym.core.errors import TrainingError
from webgym.train.folder import TRAINING
from webgym.train.objectives import FilteredBC

pytest.importorskip("deepspeed", reason="the extra deepspeed is not installed")

HALVES: dict[str, Any] = {"batch": 4, "micro_batch": 1}


def update_in_one_of_two(rank: int, port: int, stage: int, source: Path, folder: Path) -> None:
    """All cases, and one that is stopped and gone on with."""
    where = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "WORLD_SIZE": 2, "LOCAL_WORLD_SIZE": 2}
    own = {"RANK": rank, "LOCAL_RANK": rank, "OMP_NUM_THREADS": 1, "DS_ACCELERATOR": "cpu"}
    chosen = {"ACCELERATE_USE_DEEPSPEED": "true", "ACCELERATE_DEEPSPEED_ZERO_STAGE": stage}
    chosen |= {"ACCELERATE_DEEPSPEED_ZERO3_INIT": "false"}
    os.environ.update({name: str(value) for name, value in (where | own | chosen).items()})
    import deepspeed
    from accelerate import PartialState

    deepspeed.ops.__compatible_ops__["deepspeed_shm_comm"] = False  # it would be compiled first
    PartialState(backend="gloo")  # accelerate by itself knows DeepSpeed on GPUs alone
    for name in CASES:
        run_case(name, source, folder / name)
    half = updater(source, **HALVES)
    half.update(samples(FilteredBC()))
    half.save(folder / "half")
    again = updater(source, resume=folder / "half", **HALVES)
    again.update(samples(FilteredBC()))
    again.save(folder / "again")
    with pytest.raises(TrainingError, match="its gradient inf"):  # ZeRO's word for no number; it made no step
        again.update([replace(each, advantage=float("nan")) for each in samples(FilteredBC())])


@pytest.mark.parametrize("stage", [2, 3])
def test_two_processes_of_zero_give_the_update_of_one(tmp_path: Path, stage: int) -> None:
    model = write_tiny_model(tmp_path / "model")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    context = multiprocessing.get_context("spawn")
    given = (port, stage, model, tmp_path / "two")
    processes = [context.Process(target=update_in_one_of_two, args=(rank, *given)) for rank in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(280)
        process.kill()
    assert [process.exitcode for process in processes] == [0, 0]
    for case in CASES:
        one, two = tmp_path / "one" / case, tmp_path / "two" / case
        run_case(case, model, one)
        assert_same(model, one, two)
        saved = [load_file(next((each / TRAINING).iterdir())) for each in (one, two)]
        torch.testing.assert_close(saved[1], saved[0], rtol=1e-3, atol=1e-3)
    # What ZeRO saved it goes on from, and so does one process.
    for folder, resume in (("straight", None), ("alone", tmp_path / "two" / "half")):
        made = updater(model, resume=resume, **HALVES)
        made.update(samples(FilteredBC()))
        if resume is None:
            made.update(samples(FilteredBC()))
        made.save(tmp_path / folder)
    assert_same(model, tmp_path / "straight", tmp_path / "two" / "again")
    assert_same(model, tmp_path / "straight", tmp_path / "alone")
