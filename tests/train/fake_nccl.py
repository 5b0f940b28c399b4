"""vLLM's weight transfer with gloo in place of NCCL, on both sides, as its release 0.32 has it; no GPU.

:class:`FakeWorkers` is a server whose two workers join the group and receive. The trainer's side has vLLM's
names and its order of requests; :func:`install` makes it what ``vllm`` is to the process that sends.
"""

from __future__ import annotations

import datetime
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.train import fake_vllm
from torch.distributed import ProcessGroupGloo, TCPStore

SECONDS = 20
WORKERS = 2
NCCL = {"/get_world_size", "/init_weight_transfer_engine", "/shutdown_weight_transfer_engine"}
NCCL |= {"/start_weight_update", "/update_weights", "/finish_weight_update"}
FOLDER = "folder"
"""The tensor that holds the path of the weights' folder, by which the stand-in for a model knows them."""


def join(address: str, port: int, rank: int, size: int) -> ProcessGroupGloo:
    timeout = datetime.timedelta(seconds=SECONDS)
    store = TCPStore(address, port, size, is_master=rank == 0, timeout=timeout, wait_for_workers=True)
    return ProcessGroupGloo(store, rank, size, timeout)


def broadcast(group: ProcessGroupGloo, tensor: torch.Tensor) -> None:
    group.broadcast(tensor.reshape(-1).view(torch.uint8), 0).wait()


# --- the server's side --------------------------------------------------------------------------------------


class FakeWorkers(fake_vllm.FakeVllm):
    """A server with workers, each with a copy of the weights."""

    def __init__(self, *given: str) -> None:
        super().__init__(*given)
        self.groups: list[ProcessGroupGloo] = []
        self.received: list[dict[str, torch.Tensor]] = [{} for _ in range(WORKERS)]
        self.is_updating = False
        self.go_on_receiving = threading.Event()
        self.go_on_receiving.set()
        self.left_over = False
        """Whether layers keep a part of an update that failed, which the next would be mixed with."""

        self.one_at_a_time = threading.Lock()

    def answer(self, method: str, path: str, body: dict[str, Any]) -> tuple[int, Any]:
        with self.one_at_a_time if path in NCCL and method == "POST" else nullcontext():
            return super().answer(method, path, body)

    def offers(self, path: str) -> bool:
        return (path in NCCL and "nccl" in self.quirks) or super().offers(path)

    def do_init_weight_transfer_engine(self, body: dict[str, Any]) -> tuple[int, Any]:
        if "unconfigured" in self.quirks:
            return 500, {"error": {"message": "Weight transfer not configured."}}
        info = body["init_info"]
        ranks = [info["rank_offset"] + worker for worker in range(WORKERS)]
        members = partial(join, info["master_address"], info["master_port"], size=info["world_size"])
        self.groups = self._by_workers(lambda worker: members(rank=ranks[worker]))
        return 200, {}

    def do_shutdown_weight_transfer_engine(self, _: dict[str, Any]) -> tuple[int, Any]:
        self.groups = []
        return 200, {}

    def do_start_weight_update(self, _: dict[str, Any]) -> tuple[int, Any]:
        assert self.is_paused
        if self.is_updating:
            return 500, {"error": {"message": "a weight update is already active"}}
        self.is_updating = True
        return 200, {}

    def do_update_weights(self, body: dict[str, Any]) -> tuple[int, Any]:
        if not self.groups or not self.is_updating or self.left_over or "refuses" in self.quirks:
            self.quirks.discard("refuses")
            self.is_updating, self.left_over, self.weights = False, True, "half of each"
            return 500, {"error": {"message": "the transfer failed"}}
        info = body["update_info"]
        assert {type(each) for each in info.values()} == {list}

        def receive(worker: int) -> dict[str, torch.Tensor]:
            self.go_on_receiving.wait(SECONDS)
            received = {}
            offset = 0
            for name, dtype, shape in zip(*info.values(), strict=True):
                each = received[name] = torch.empty(shape, dtype=getattr(torch, dtype))
                assert offset % each.element_size() == 0, "as where vLLM takes it out of its buffer"
                offset += each.nbytes
                broadcast(self.groups[worker], each)
            return received

        try:
            self.received = self._by_workers(receive)
        except RuntimeError as error:  # the other side is gone
            self.is_updating, self.left_over, self.weights = False, True, "half of each"
            return 500, {"error": {"message": str(error)}}
        return 200, {}

    def do_finish_weight_update(self, _: dict[str, Any]) -> tuple[int, Any]:
        if not self.is_updating:
            return 500, {"error": {"message": "finish_weight_update called without start_weight_update"}}
        self.is_updating, self.left_over = False, False
        if FOLDER in self.received[0]:
            self.weights = bytes(self.received[0][FOLDER].tolist()).decode().strip()
        return 200, {}

    def do_get_world_size(self, _: dict[str, Any]) -> tuple[int, Any]:
        return 200, {"world_size": WORKERS}

    def _by_workers(self, call: Any) -> list[Any]:
        with ThreadPoolExecutor(WORKERS) as threads:
            return list(threads.map(call, range(WORKERS)))


fake_vllm.GET.add("/get_world_size")


# --- the trainer's side -------------------------------------------------------------------------------------


@dataclass
class NCCLTrainerInitInfo:
    master_address: str
    master_port: int
    world_size: int
    packed_buffer_size_bytes: int
    rank: int


class WeightTransferTrainerFactory:
    """It makes itself, as the engine."""

    @classmethod
    def trainer_init(
        cls, info: NCCLTrainerInitInfo, *, client: Any, source: Any
    ) -> WeightTransferTrainerFactory:
        engine = cls()
        engine.client, engine.source = client, source
        payload = {"master_address": info.master_address, "master_port": info.master_port}
        payload |= {"rank_offset": 1, "world_size": info.world_size}
        asking = threading.Thread(target=client.init_weight_transfer_engine, args=(payload,))
        asking.start()
        engine.group = join(info.master_address, info.master_port, info.rank, info.world_size)
        asking.join()
        return engine

    client: Any
    source: Any
    group: ProcessGroupGloo

    def send_weights(self) -> None:
        described = self.source.metadata()
        payload = {
            "names": [each.name for each in described],
            "dtype_names": [str(each.dtype).removeprefix("torch.") for each in described],
            "shapes": [list(each.shape) for each in described],
        }
        self.client.start_weight_update()
        asking = threading.Thread(target=self.client.update_weights, args=(payload,))
        asking.start()
        for expected, (name, tensor) in zip(described, self.source, strict=True):
            assert (name, tensor.dtype, tuple(tensor.shape)) == (
                expected.name,
                expected.dtype,
                expected.shape,
            )
            broadcast(self.group, tensor.contiguous())
        asking.join()
        self.client.finish_weight_update()


def install(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make this module what ``vllm`` is, here and in processes that are started."""
    package = folder / "vllm/distributed/weight_transfer"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("from tests.train.fake_nccl import WeightTransferTrainerFactory\n")
    (package / "nccl_engine.py").write_text("from tests.train.fake_nccl import NCCLTrainerInitInfo\n")
    monkeypatch.syspath_prepend(str(folder))
