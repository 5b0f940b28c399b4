"""Gloo in place of NCCL, and no streams, in vLLM's own weight transfer: a plugin of vLLM's processes.

Everything else is vLLM's: requests, workers, packing, and how layers take their weights.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Mapping
from contextlib import nullcontext
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import torch

from webgym.inference.nccl import _send_weights

BREAKS = "GLOO_FOR_NCCL_BREAKS"
"""The variable with the name of a file, whose existence breaks off one transfer at its third buffer."""


class Group:
    """What vLLM uses of a communicator of NCCL's."""

    def __init__(self, host: str, port: int, rank: int, size: int, device: object) -> None:
        timeout = datetime.timedelta(seconds=60)
        store = torch.distributed.TCPStore(host, port, size, is_master=rank == 0, timeout=timeout)
        self._group = torch.distributed.ProcessGroupGloo(store, rank, size, timeout)
        self._left = 2

    def broadcast(self, tensor: torch.Tensor, src: int) -> None:
        if self._group.rank() == src and (breaks := Path(os.environ[BREAKS])).exists():
            if not self._left:
                breaks.unlink()
                raise RuntimeError("broken off")
            self._left -= 1
        self._group.broadcast(tensor, src).wait()

    def destroy(self) -> None:
        del self._group


class _Stream:
    def synchronize(self) -> None:
        return


def register() -> None:
    """vLLM calls this in each of its processes."""
    from vllm.distributed.weight_transfer import nccl_common, packed_tensor

    nccl_common.stateless_init_process_group = Group
    packed_tensor._get_streams = lambda _, count: [_Stream()] * count
    torch.cuda.stream = lambda _: nullcontext()
    torch.accelerator.current_device_index = lambda: 0
    torch.accelerator.synchronize = lambda *_: None


def send_weights(pipe: Connection, group: Mapping[str, Any]) -> None:
    """What our process does that sends weights."""
    register()
    _send_weights(pipe, group)


def install(folder: Path) -> str:
    """Write what makes :func:`register` a plugin; returns the path for imports that it needs."""
    written = folder / "gloo_for_nccl-1.dist-info"
    written.mkdir(parents=True)
    (written / "METADATA").write_text("Metadata-Version: 2.1\nName: gloo-for-nccl\nVersion: 1\n")
    (written / "entry_points.txt").write_text(f"[vllm.general_plugins]\ngloo = {__name__}:register\n")
    return f"{folder}:{Path(__file__).parents[2]}"
