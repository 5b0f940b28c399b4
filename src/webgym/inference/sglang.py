"""An SGLang server: its command line, and its HTTP API besides replies.

Names of flags, endpoints and fields are those of its release 0.5.23. Replies come by the chat API as from
vLLM, with token ids and the version of the weights.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import ClassVar, Final

from pydantic import SecretStr

from webgym.inference.vllm import HOST, PublishMethod, VllmApi, VllmConfig


class SglangApi(VllmApi):
    """See :class:`~webgym.inference.vllm.VllmApi`."""

    needed: ClassVar[dict[PublishMethod, tuple[str, ...]]] = {
        "lora": ("/load_lora_adapter", "/unload_lora_adapter"),
        "in_place": ("/pause_generation", "/continue_generation", "/update_weights_from_disk"),
        "restart": (),
    }
    flags: ClassVar[dict[PublishMethod, str]] = {
        "lora": "--enable-lora --lora-target-modules all --max-loras-per-batch 2",
        "in_place": "a release that has it",
    }
    labels: ClassVar[str] = "/update_weight_version"
    processed_logprobs: ClassVar[bool] = False

    @classmethod
    def command(
        cls,
        config: VllmConfig,
        model: str,
        name: str,
        port: int,
        method: PublishMethod,
        lora_rank: int,
        key: SecretStr,
        log: Path,
    ) -> list[str]:
        """``sglang serve`` and its arguments. The key is in a file, as other users see arguments."""
        settings = log.with_name(f"{log.stem}.yaml")
        _write_key(settings, key)
        arguments = [config.program, "serve", "--config", str(settings), "--model-path", model]
        arguments += ["--served-model-name", name, "--host", HOST, "--port", str(port)]
        arguments += ["--tp-size", str(config.tensor_parallel_size)]
        arguments += ["--dp-size", str(config.data_parallel_size)]
        arguments += ["--mem-fraction-static", str(config.gpu_memory_utilization)]
        arguments += ["--context-length", str(config.max_model_len)] if config.max_model_len else []
        if method == "lora":
            arguments += ["--enable-lora", "--max-lora-rank", str(lora_rank)]
            arguments += ["--lora-target-modules", "all", "--max-loras-per-batch", "2"]
        return [*arguments, *config.extra_args]

    async def weight_version(self) -> str:
        """The version label of the current weights."""
        return str((await self._request("GET", "/model_info")).get("weight_version", ""))

    async def load_adapter(self, name: str, folder: str) -> str:
        """Load an adapter; requests name it after the model."""
        await self._request("POST", "/load_lora_adapter", {"lora_name": name, "lora_path": folder})
        return f"{(await self.models())[0]}:{name}"

    async def unload_adapter(self, name: str) -> None:
        """Unload an adapter, by its own name or by that in requests."""
        await self._request("POST", "/unload_lora_adapter", {"lora_name": name.rpartition(":")[2]})

    async def update_weights(self, folder: str, version: str) -> None:
        """Load weights into the running server, which is paused meanwhile; if that fails, it stays paused."""
        await self._request("POST", "/pause_generation", {"mode": "retract"})
        body = {"model_path": folder, "weight_version": version, "flush_cache": True}
        await self._request("POST", "/update_weights_from_disk", body)
        await self.resume()

    async def is_paused(self) -> bool:
        """Whether it is paused: it does not tell."""
        return False

    async def resume(self) -> None:
        """End a pause; nothing happens if there is none."""
        await self._request("POST", "/continue_generation", {})

    async def checksums(self) -> dict[str, dict[str, str]]:
        """A checksum of every parameter, by rank and name; empty if the server has none to give."""
        if not await self.offers("/weights_checker"):
            return {}
        answer = await self._request("POST", "/weights_checker", {"action": "checksum"})
        ranks = answer.get("ranks") or []
        return {
            f"0:rank{rank}": found["checksums"] for rank, found in enumerate(ranks) if "checksums" in found
        }

    async def label(self, version: str) -> None:
        """Set the version label of the server's weights."""
        if await self.weight_version() != version:
            body = {"new_version": version, "abort_all_requests": False}
            await self._request("POST", "/update_weight_version", body)


def _write_key(path: Path, key: SecretStr) -> None:
    """Write a settings file with a server's key, which only this user can read."""
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(f"api-key: {json.dumps(key.get_secret_value())}\n")


ENGINES: Final[dict[str, type[VllmApi]]] = {"vllm": VllmApi, "sglang": SglangApi}
"""The API of each engine, with what else differs."""
