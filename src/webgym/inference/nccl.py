"""New weights for a vLLM server by NCCL, with the trainer's side of vLLM's own weight transfer (0.32).

A process of its own, on the first GPU of the learner, forms a group with the server's workers, once for each
server. It then sends the weights that an update has saved, one tensor after another. What hangs in NCCL ends
only with its process, so this is not the learner's: after any failure it is killed, and the next update
begins with a new one. vLLM's side says when the server is to get which request; :class:`NcclApi` sends it.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import multiprocessing
import os
import socket
from collections.abc import Iterator, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, Final
from urllib.parse import urlsplit

import torch
from huggingface_hub import snapshot_download
from pydantic import SecretStr
from safetensors import safe_open

from webgym.core.errors import ConfigError, LLMError, PublishError
from webgym.inference.sglang import ENGINES
from webgym.inference.vllm import UPDATE_SECONDS, PublishMethod, VllmApi, VllmConfig, free_port
from webgym.llm.completion import first_line

_BUFFER_BYTES: Final = 2**28
"""Tensors are sent together until they exceed this; two such buffers are on each GPU."""
_CONTEXT: multiprocessing.context.BaseContext = multiprocessing.get_context("spawn")


def api_of(config: VllmConfig, *, lora: bool) -> type[VllmApi]:
    """The API of a server that is to get adapters or all weights.

    Raises:
        ConfigError: it cannot get them in the configured way.
    """
    if config.transfer == "folder":
        return ENGINES[config.engine]
    if lora:
        raise ConfigError(
            "vllm.transfer: nccl sends whole weights, and update.lora trains adapters",
            hint="leave vllm.transfer out: the server reads adapters, which are small, from their folder",
        )
    if importlib.util.find_spec("vllm") is None:
        raise ConfigError(
            "vllm.transfer: nccl needs vLLM beside the training, too",
            hint="pip install vllm there, or leave vllm.transfer out",
        )
    return NcclApi


class NcclApi(VllmApi):
    """See :class:`~webgym.inference.vllm.VllmApi`."""

    needed: ClassVar[dict[PublishMethod, tuple[str, ...]]] = {
        "in_place": (
            *("/pause", "/resume", "/get_world_size", "/init_weight_transfer_engine"),
            *("/start_weight_update", "/update_weights", "/finish_weight_update"),
        ),
    }
    flags: ClassVar[dict[PublishMethod, str]] = {
        "in_place": """VLLM_SERVER_DEV_MODE=1 and --weight-transfer-config '{"backend": "nccl"}'"""
    }

    def __init__(self, base_url: str, key: SecretStr) -> None:
        super().__init__(base_url, key)
        self._sender: tuple[multiprocessing.process.BaseProcess, Connection] | None = None

    async def close(self) -> None:
        """Close its connections, and end the process that sends weights."""
        self._end_sender()
        await super().close()

    async def prepare(self) -> None:
        """Form the group with the server's workers, unless that is done.

        Raises:
            LLMError: the server cannot be reached, or refuses.
            PublishError: the process that sends weights failed.
        """
        if self._sender is not None and self._sender[0].is_alive():
            return
        if await self.is_paused():  # an earlier update may have been cut off, of which layers keep a part
            for path in ("/start_weight_update", "/finish_weight_update", "/shutdown_weight_transfer_engine"):
                with contextlib.suppress(LLMError):
                    await self._request("POST", path, once=True)
        workers = int((await self._request("GET", "/get_world_size"))["world_size"])
        try:
            address = _own_address(self.base_url)
        except OSError as error:
            raise self._unreachable(error) from error
        group = {"master_address": address, "master_port": free_port(address, None), "rank": 0}
        group |= {"world_size": workers + 1, "packed_buffer_size_bytes": _BUFFER_BYTES}
        pipe, theirs = _CONTEXT.Pipe()
        process = _CONTEXT.Process(target=_send_weights, args=(theirs, group), daemon=True)  # type: ignore[attr-defined]
        process.start()
        theirs.close()
        self._sender = process, pipe
        await self._serve_sender()

    async def _load(self, folder: str) -> None:
        await self.prepare()
        await self._serve_sender(folder)

    async def _serve_sender(self, *folder: str) -> None:
        """Have the process send the weights of a folder. Sends the requests that it asks for meanwhile."""
        assert self._sender is not None
        pipe = self._sender[1]
        try:
            async with asyncio.timeout(UPDATE_SECONDS), asyncio.TaskGroup() as requests:
                for each in folder:
                    pipe.send(each)
                while (asked := await asyncio.to_thread(pipe.recv)) is not None:
                    if isinstance(asked, str):
                        raise PublishError(f"the process that sends weights failed: {asked}")
                    requests.create_task(self._answer(pipe, *asked))
        except BaseException as error:
            self._end_sender()
            first = error.exceptions[0] if isinstance(error, BaseExceptionGroup) else error
            if isinstance(first, EOFError | OSError):  # an expired deadline is one, too
                raise PublishError("the process that sends weights ended, or took too long") from error
            raise first from None

    async def _answer(self, pipe: Connection, path: str, body: Mapping[str, Any] | None) -> None:
        await self._request("POST", path, body, once=True)
        pipe.send(None)

    def _end_sender(self) -> None:
        if self._sender is not None:
            self._sender[0].kill()
            self._sender = None


def _own_address(url: str) -> str:
    """This machine's address in the network through which it reaches a server."""
    server = urlsplit(url)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((server.hostname, server.port or 80))  # sends nothing
        return str(probe.getsockname()[0])


# --- in the process that sends ------------------------------------------------------------------------------


def _send_weights(pipe: Connection, group: Mapping[str, Any]) -> None:
    """Form the group; then send the weights of every folder that comes through the pipe.

    Answers with ``None`` for what was done, with path and body of a request that the server is to get, and
    with the message of an error.
    """
    os.environ.setdefault("VLLM_LOGGING_LEVEL", "WARNING")
    try:
        from vllm.distributed.weight_transfer import WeightTransferTrainerFactory
        from vllm.distributed.weight_transfer.nccl_engine import NCCLTrainerInitInfo

        source, requests = _Saved(), _Requests(pipe)
        engine = WeightTransferTrainerFactory.trainer_init(
            NCCLTrainerInitInfo(**group), client=requests, source=source
        )
        pipe.send(None)
        while True:
            source.folder = pipe.recv()
            engine.send_weights()
            if torch.cuda.is_available():
                torch.cuda.empty_cache()  # the learner needs the memory
            pipe.send(None)
    except EOFError:
        return  # the training has ended
    except Exception as error:
        pipe.send(f"{type(error).__name__}: {first_line(str(error))}")


class _Requests:
    """What vLLM's side asks the server for (its ``VLLMWeightSyncClient``); other threads call it."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def _ask(self, path: str, body: dict[str, Any] | None = None) -> None:
        try:
            self._pipe.send((path, body))
            self._pipe.recv()
        except (EOFError, OSError):
            os._exit(1)  # the training has ended, and NCCL in another thread may wait for ever

    def init_weight_transfer_engine(self, init_info: dict[str, Any]) -> None:
        self._ask("/init_weight_transfer_engine", {"init_info": init_info})

    def start_weight_update(self) -> None:
        self._ask("/start_weight_update")

    def update_weights(self, update_info: dict[str, Any]) -> None:
        self._ask("/update_weights", {"update_info": update_info})

    def finish_weight_update(self, weight_version: str | None = None) -> None:  # noqa: ARG002
        self._ask("/finish_weight_update")  # the label follows once caches are empty


class _Saved:
    """Saved weights, tensor by tensor (a ``WeightSource`` of vLLM's side)."""

    folder: str

    def metadata(self) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(name=name, dtype=each.dtype, shape=tuple(each.shape))
            for name, each in self._tensors()
        ]

    def __iter__(self) -> Iterator[tuple[str, torch.Tensor]]:
        device = "cuda" if torch.cuda.is_available() else "cpu"
        return ((name, each.to(device)) for name, each in self._tensors())

    def _tensors(self) -> list[tuple[str, torch.Tensor]]:
        """They are mapped into memory, and read when they are used. The widest types come first, because
        vLLM puts tensors into a buffer without gaps, and float32 cannot begin at every byte there."""
        folder = Path(self.folder)
        folder = folder if folder.is_dir() else Path(snapshot_download(self.folder))
        found = []
        for path in sorted(folder.glob("model*.safetensors")):
            with safe_open(path, "pt") as file:
                found += [(name, file.get_tensor(name)) for name in file.keys()]  # noqa: SIM118
        return sorted(found, key=lambda pair: -pair[1].element_size())
