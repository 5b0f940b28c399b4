"""A vLLM server: its settings and command line, its process, and its HTTP API besides replies.

Names of flags, endpoints and fields are those of vLLM's documentation (0.33): LoRA adapters
(``features/lora``), weight transfer and asynchronous RL (``training/``), the chat API's own extensions
(``return_token_ids``). Endpoints beyond the chat API are optional: see :meth:`VllmApi.offers`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import secrets
import shutil
import signal
import socket
import time
from asyncio.subprocess import PIPE, STDOUT, Process
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, Self, TypeAlias
from urllib.parse import urlsplit

import aiohttp
from pydantic import Field, SecretStr, field_validator, model_validator

from webgym.core.background import running_in_background
from webgym.core.child import watched
from webgym.core.errors import ConfigError, LLMBadReply, LLMError, LLMUnreachable, StoreError, TrainingError
from webgym.core.settings import Settings
from webgym.llm.client import open_session
from webgym.llm.completion import error_message, first_line, quote
from webgym.llm.config import ChatConfig, Sampling

logger = logging.getLogger(__name__)

PublishMethod: TypeAlias = Literal["lora", "in_place", "restart"]
"""How new weights are published: as a LoRA adapter, into the running server, or by restarting it."""

HOST: Final = "127.0.0.1"
"""Where a server of ours listens."""
_LORA_RANKS: Final = (8, 16, 32, 64, 128, 256, 320, 512)
"""Values that ``--max-lora-rank`` accepts."""

EXPLICIT: Final = Sampling(
    temperature=1.0,
    top_p=1.0,
    extra_body={
        "top_k": -1,
        "min_p": 0.0,
        "repetition_penalty": 1.0,
        "return_token_ids": True,
        "return_weight_versions": True,
        "logprobs": True,
    },
)
"""Every parameter is set, because a server takes missing ones from the model's ``generation_config.json``."""

UPDATE_SECONDS: Final = 600.0
"""Deadline for loading new weights, after the last reply with the old ones."""

REQUEST_TOKENS: Final = 32768
"""Longest request and reply of a server for which nothing else is set."""

_POLL_SECONDS: Final = 0.5
_RESTARTS: Final = 3
_ANSWER_SECONDS: Final = 10.0
"""Deadline for connecting, and for answers to queries."""
_LOG_TAIL_BYTES: Final = 16 * 1024
_QUOTED_CHARS: Final = 300


class VllmConfig(Settings):
    """Settings of a vLLM or SGLang server for training. Fields with vLLM's names mean the same as there."""

    engine: Literal["vllm", "sglang"] = "vllm"
    """Which of the two it is."""

    transfer: Literal["folder", "nccl"] = "folder"
    """How all weights reach a running server: it reads them from a folder, or by NCCL (vLLM)."""

    base_url: str | tuple[str, ...] | None = None
    """Base URL of a running server, e.g. ``http://127.0.0.1:8000/v1``, or of several; ``None`` starts one on
    this machine."""

    replicas: int = Field(default=1, ge=1)
    """Number of servers to start here, among which the GPUs of ``env: {CUDA_VISIBLE_DEVICES: ...}`` are
    divided. They fail one by one, unlike the copies of ``data_parallel_size``."""

    model: str | None = None
    """For a server started here, the first model that it serves: a folder or hub id, by default
    ``learn.model``. For a running server, its name for that model, by default the only one that it lists."""

    tensor_parallel_size: int = Field(default=1, ge=1)
    """Number of GPUs over which the weights are distributed."""

    data_parallel_size: int = Field(default=1, ge=1)
    """Number of copies of the weights."""

    max_model_len: int | None = Field(default=None, ge=1)
    """Longest request and reply together, in tokens; by default the model's own limit."""

    gpu_memory_utilization: float = Field(default=0.9, gt=0, le=1)
    """Share of each GPU's memory to use. Set it lower if the learner is on the same GPU."""

    executable: str | None = None
    """The command: a name on the PATH, or a path; by default the engine's name."""

    extra_args: tuple[str, ...] = ()
    """Further arguments of ``vllm serve``, e.g. ``--enforce-eager``."""

    env: dict[str, str] = Field(default_factory=dict)
    """Further environment variables, e.g. ``CUDA_VISIBLE_DEVICES``."""

    port: int | None = Field(default=None, ge=1, le=65535)
    """Port on this machine; by default any free one."""

    start_seconds: float = Field(default=1800.0, gt=0)
    """Deadline for starting: weights are read, and kernels compiled."""

    restarts: int = Field(default=3, ge=0)
    """How often a server that ended is started again between two publications."""

    api_key_env: str = "WEBGYM_API_KEY"
    """Environment variable with the key of a running server. A server started here gets a random key."""

    concurrency: int = Field(default=80, ge=1)
    """Most requests in flight (paper, appendix F: 80)."""

    total_seconds: float = Field(default=600.0, gt=0)
    """Deadline of a reply."""

    sampling: Sampling = Sampling()
    """Sampling parameters; those not set come from the model's profile."""

    @field_validator("base_url")
    @classmethod
    def _are_urls(cls, value: str | tuple[str, ...] | None) -> str | tuple[str, ...] | None:
        if isinstance(value, tuple):
            urls = tuple(ChatConfig(base_url=url, model="any").base_url for url in value)
            if not urls or len(set(urls)) < len(urls):
                raise ValueError("base_url must name servers, each once")
            return urls if len(urls) > 1 else urls[0]
        return None if value is None else ChatConfig(base_url=value, model="any").base_url

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        if self.transfer == "nccl" and self.engine != "vllm":
            raise ValueError("transfer: nccl is for engine: vllm")
        needed = self.replicas * self.tensor_parallel_size * self.data_parallel_size
        if self.replicas > 1 and (self.base_url is not None or len(self._gpus) != needed):
            raise ValueError(
                f"{self.replicas} replicas are started here and need {needed} GPUs: env.CUDA_VISIBLE_DEVICES"
            )
        return self

    @property
    def _gpus(self) -> list[str]:
        return [gpu.strip() for gpu in self.env.get("CUDA_VISIBLE_DEVICES", "").split(",") if gpu.strip()]

    def each(self) -> list[VllmConfig]:
        """The settings of each server."""
        if isinstance(self.base_url, tuple):
            return [self.model_copy(update={"base_url": url}) for url in self.base_url]
        if self.replicas == 1:
            return [self]
        share = len(self._gpus) // self.replicas
        return [
            self.model_copy(
                update={
                    "replicas": 1,
                    "port": self.port and self.port + number,
                    "env": self.env
                    | {"CUDA_VISIBLE_DEVICES": ",".join(self._gpus[number * share : (number + 1) * share])},
                }
            )
            for number in range(self.replicas)
        ]

    @field_validator("extra_args")
    @classmethod
    def _sets_no_reserved_option(cls, arguments: tuple[str, ...]) -> tuple[str, ...]:
        reserved = {
            "--host",
            "--port",
            "--served-model-name",
            "--api-key",
            "--config",
            "--logprobs-mode",
            "--generation-config",
        }
        if conflicts := sorted(reserved & {argument.split("=", 1)[0] for argument in arguments}):
            raise ValueError(f"extra_args must not set {', '.join(conflicts)}")
        return arguments

    @property
    def program(self) -> str:
        """The command."""
        return self.executable or self.engine

    def command(
        self, model: str, name: str, port: int, publish_method: PublishMethod, lora_rank: int
    ) -> list[str]:
        """``vllm serve`` and its arguments.

        Args:
            model: folder or hub id.
            name: the model's name in requests.
            port: port to listen on.
            publish_method: how weights will be published.
            lora_rank: rank of adapters.
        """
        arguments = [self.program, "serve", model, "--served-model-name", name]
        arguments += ["--host", HOST, "--port", str(port)]
        arguments += ["--tensor-parallel-size", str(self.tensor_parallel_size)]
        arguments += (
            ["--data-parallel-size", str(self.data_parallel_size)] if self.data_parallel_size > 1 else []
        )
        arguments += ["--gpu-memory-utilization", str(self.gpu_memory_utilization)]
        arguments += ["--max-model-len", str(self.max_model_len)] if self.max_model_len else []
        arguments += ["--logprobs-mode", "processed_logprobs", "--generation-config", "vllm"]
        if publish_method == "lora":
            largest = next((rank for rank in _LORA_RANKS if rank >= lora_rank), lora_rank)
            # Two adapters at once: the new one is loaded and tested while the old one still replies.
            arguments += ["--enable-lora", "--max-lora-rank", str(largest), "--max-loras", "2"]
            # Each of several API servers would only know its own adapters, so vLLM allows only one.
            arguments += ["--api-server-count", "1"] if self.data_parallel_size > 1 else []
        if self.transfer == "nccl":
            arguments += ["--weight-transfer-config", '{"backend": "nccl"}']
        return [*arguments, *self.extra_args]

    def environment(self, key: SecretStr, publish_method: PublishMethod) -> dict[str, str]:
        """Environment variables of a server that is started here."""
        variables = {"VLLM_API_KEY": key.get_secret_value()}
        if publish_method == "lora":
            variables["VLLM_ALLOW_RUNTIME_LORA_UPDATING"] = "True"
        if publish_method == "in_place":
            variables["VLLM_SERVER_DEV_MODE"] = "1"
        return variables | self.env

    def chat(self, base_url: str, model: str) -> ChatConfig:
        """The config of the policy's client for this endpoint."""
        return ChatConfig(
            base_url=base_url,
            model=model,
            api_key_env=self.api_key_env,
            sampling=self.sampling,
            concurrency=self.concurrency,
            read_seconds=self.total_seconds,
            total_seconds=self.total_seconds,
        )


class VllmApi:
    """The server's HTTP API besides replies.

    Args:
        base_url: the server's base URL, with ``/v1``.
        key: its API key; empty for none.

    Attributes:
        needed: the endpoints that each method of publication needs.
        flags: how a server is started for each.
        labels: an endpoint that a server has whose weights bear a label.
        processed_logprobs: whether a server of ours gives those after temperature and top-p.
    """

    needed: ClassVar[dict[PublishMethod, tuple[str, ...]]] = {
        "lora": ("/v1/load_lora_adapter", "/v1/unload_lora_adapter"),
        "in_place": ("/pause", "/resume", "/collective_rpc"),
        "restart": (),
    }
    flags: ClassVar[dict[PublishMethod, str]] = {
        "lora": "VLLM_ALLOW_RUNTIME_LORA_UPDATING=True and --enable-lora --max-loras 2",
        "in_place": "VLLM_SERVER_DEV_MODE=1",
    }
    labels: ClassVar[str] = "/weight_info"
    processed_logprobs: ClassVar[bool] = True

    @classmethod
    def command(
        cls,
        config: VllmConfig,
        model: str,
        name: str,
        port: int,
        method: PublishMethod,
        lora_rank: int,
        key: SecretStr,  # noqa: ARG003 (it is in the environment)
        log: Path,  # noqa: ARG003
    ) -> list[str]:
        """The command that starts a server of ours.

        Args:
            config: of the server.
            model: folder or hub id.
            name: the model's name in requests.
            port: port to listen on.
            method: how weights will be published.
            lora_rank: rank of adapters.
            key: the server's key.
            log: file of its output, beside which a file of settings may be written.
        """
        return config.command(model, name, port, method, lora_rank)

    def __init__(self, base_url: str, key: SecretStr) -> None:
        self.base_url = base_url
        self.key = key
        self._root = base_url.removesuffix("/v1")
        secret = key.get_secret_value()
        headers = {"Authorization": f"Bearer {secret}"} if secret else {}
        self._http = open_session(base_url, headers, connect_seconds=_ANSWER_SECONDS)

    async def close(self) -> None:
        """Close its connections."""
        await self._http.close()

    async def is_up(self) -> bool:
        """Whether it answers requests."""
        try:
            await self.models()
        except LLMError:
            return False
        return True

    async def models(self) -> list[str]:
        """The names of its models, without adapters."""
        return [str(card["id"]) for card in await self._cards() if not card.get("parent")]

    async def adapters(self) -> dict[str, Path]:
        """The folders of its adapters, by name."""
        cards = await self._cards()
        return {str(card["id"]): Path(str(card.get("root"))) for card in cards if card.get("parent")}

    async def _cards(self) -> list[dict[str, Any]]:
        answer = await self._request("GET", "/v1/models")
        return [card for card in answer.get("data", []) if isinstance(card, dict) and "id" in card]

    async def offers(self, path: str) -> bool:
        """Whether the server has an endpoint. It is not called: endpoints for POST refuse GET with another
        status."""
        status, _ = await self._exchange("GET", path)
        return status not in (404, 501)

    async def weight_version(self) -> str:
        """The version label of the current weights."""
        return str((await self._request("GET", "/weight_info")).get("weight_version", ""))

    async def load_adapter(self, name: str, folder: str) -> str:
        """Load an adapter under a name that was never used, because caches are keyed by the name (vLLM
        #42125). Returns its name in requests."""
        await self._request("POST", "/v1/load_lora_adapter", {"lora_name": name, "lora_path": folder})
        return name

    async def unload_adapter(self, name: str) -> None:
        """Unload an adapter."""
        await self._request("POST", "/v1/unload_lora_adapter", {"lora_name": name})

    async def prepare(self) -> None:
        """Get ready for :meth:`update_weights`, before the training begins; nothing is needed here."""

    async def update_weights(self, folder: str, version: str) -> None:
        """Load weights into the running server. It is paused during the update; if that fails, it stays
        paused."""
        await self._request("POST", "/pause?mode=wait")
        await self._load(folder)
        for cache in ("/reset_prefix_cache", "/reset_mm_cache", "/reset_encoder_cache"):
            if await self.offers(cache):
                await self._request("POST", cache)
        await self.label(version)
        await self.resume()

    async def _load(self, folder: str) -> None:
        """Load weights by the workers' ``reload_weights``."""
        call = {"method": "reload_weights", "kwargs": {"weights_path": folder}}
        await self._request("POST", "/collective_rpc", call)

    async def is_paused(self) -> bool:
        """Whether it is paused, as far as it tells."""
        return await self.offers("/is_paused") and bool(
            (await self._request("GET", "/is_paused")).get("is_paused")
        )

    async def resume(self) -> None:
        """End a pause; nothing happens if there is none."""
        await self._request("POST", "/resume")

    async def checksums(self) -> dict[str, dict[str, str]]:
        """A checksum of every parameter, by worker and name; empty if the server has none to give."""
        if not await self.offers("/weight_checker"):
            return {}
        answer = await self._request("POST", "/weight_checker", {"action": "checksum"})
        workers: dict[str, dict[str, str]] = {}
        for key, checksum in answer.get("checksums", {}).items():
            worker, _, name = key.rpartition(":")  # "dp0:pp0:pcp0:tp0:lm_head.weight"
            workers.setdefault(worker, {})[name] = checksum
        return workers

    async def label(self, version: str) -> None:
        """Set the version label of the server's weights, if it supports labels."""
        if await self.offers(self.labels) and await self.weight_version() != version:
            await self._request("POST", "/update_weight_version", {"new_version": version})

    async def _request(
        self, method: str, path: str, body: Mapping[str, Any] | None = None, *, once: bool = False
    ) -> dict[str, Any]:
        """Send a request; returns the JSON object in the answer, or an empty one if it is something else.

        Raises:
            LLMUnreachable: the server does not answer.
            LLMBadReply: it answers with an error status.
        """
        status, answer = await self._exchange(method, path, body, once=once)
        if status != 200:
            reason = error_message(answer) or quote(answer)
            raise LLMBadReply(f"{self._root}{path} answered {status}: {reason}")
        try:
            content = json.loads(answer or b"{}")
        except ValueError:
            return {}
        return content if isinstance(content, dict) else {}

    async def _exchange(
        self, method: str, path: str, body: Mapping[str, Any] | None = None, *, once: bool = False
    ) -> tuple[int, bytes]:
        """Status and body of the answer. If the connection breaks, the request is sent once more, unless it
        may not be repeated: servers close connections that they have kept."""
        limit = aiohttp.ClientTimeout(total=UPDATE_SECONDS if method == "POST" else _ANSWER_SECONDS)
        for is_last in (True,) if once else (False, True):
            try:
                async with self._http.request(method, self._root + path, json=body, timeout=limit) as answer:
                    return answer.status, await answer.read()
            except (aiohttp.ClientError, OSError, RuntimeError) as error:  # RuntimeError: it was closed
                if is_last or isinstance(error, RuntimeError | TimeoutError):
                    raise self._unreachable(error) from error
        raise AssertionError

    def _unreachable(self, error: Exception) -> LLMUnreachable:
        why = first_line(str(error)) or type(error).__name__
        return LLMUnreachable(f"the server {self._root} cannot be reached: {why}")


class ManagedServer:
    """A running server. Create one with :meth:`start`.

    Args:
        process: the process that watches it (:func:`webgym.core.child.watched`).
        name: name of the command, for errors.
        log: file with the server's output.
        stop_seconds: how long stopping may take before it is killed.
    """

    def __init__(self, process: Process, name: str, log: Path, stop_seconds: float) -> None:
        self._process = process
        self._name = name
        self._log = log
        self._stop_seconds = stop_seconds

    @classmethod
    async def start(
        cls, command: Sequence[str], env: Mapping[str, str], log: Path, *, stop_seconds: float = 30.0
    ) -> Self:
        """Start a server, without waiting until it is ready.

        Args:
            command: its program and arguments, which other users of the machine can see.
            env: environment variables to add to this process's environment.
            log: file to which its output is appended.
            stop_seconds: how long stopping may take before it is killed.

        Raises:
            ConfigError: there is no such program.
            StoreError: the log cannot be written.
        """
        program = shutil.which(command[0])
        if program is None:
            raise ConfigError(
                f"there is no command {command[0]}",
                hint="install it (pip install vllm, or sglang), or name a running server: vllm.base_url",
            )
        try:
            output = log.open("ab")
        except OSError as error:
            raise StoreError(f"cannot write {log}: {error.strerror}") from error
        with output:
            process = await asyncio.create_subprocess_exec(
                *watched([program, *command[1:]], stop_seconds),
                stdin=PIPE,
                stdout=output,
                stderr=STDOUT,
                env=_without_launcher(os.environ) | dict(env),
                start_new_session=True,  # Ctrl-C reaches only this process, which stops the server in order
            )
        return cls(process, command[0], log, stop_seconds)

    async def until(self, is_up: Callable[[], Awaitable[bool]], seconds: float) -> None:
        """Wait until it answers.

        Raises:
            TrainingError: it ended before that, or this took too long.
        """
        deadline = time.monotonic() + seconds
        while not await is_up():
            if not self.is_alive:
                raise self.failure("ended before it was up")
            if time.monotonic() > deadline:
                raise self.failure(f"was not up after {seconds:g} s")
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self.wait(), _POLL_SECONDS)

    @property
    def is_alive(self) -> bool:
        """Whether it has not ended."""
        return self._process.returncode is None

    async def wait(self) -> None:
        """Wait until it has ended."""
        await self._process.wait()

    async def stop(self) -> None:
        """Stop it, and every process that it started."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            async with asyncio.timeout(self._stop_seconds + 5):
                await self._process.wait()
        except TimeoutError:
            pass
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            await self._process.wait()

    def failure(self, what: str) -> TrainingError:
        """An error with this description and the end of the log."""
        return TrainingError(
            f"{self._name} {what}; its log ends: {self._last_log_line()}", hint=f"read {self._log}"
        )

    def _last_log_line(self) -> str:
        """The last line that mentions an error, or else the last line."""
        try:
            with self._log.open("rb") as file:
                file.seek(max(0, file.seek(0, os.SEEK_END) - _LOG_TAIL_BYTES))
                lines = [line.strip() for line in file.read().decode(errors="replace").splitlines()]
        except OSError:
            lines = []
        lines = [line for line in lines if line] or ["(nothing)"]
        return next((line for line in reversed(lines) if "rror" in line), lines[-1])[-_QUOTED_CHARS:]


@asynccontextmanager
async def serving_model(
    chat: ChatConfig | None, gpus: Sequence[str], log: Path, *, program: str = "vllm"
) -> AsyncIterator[None]:
    """Serve an endpoint's model with vLLM at its address on this machine during the block.

    If the endpoint's variable has no key, it gets a random one. A server that ends is started again a few
    times; after that, the endpoint does not answer.

    Args:
        chat: the endpoint; ``None`` for nothing to serve.
        gpus: ids of the GPUs, over which the weights are distributed.
        log: file to which the server's output is appended.
        program: the command.

    Raises:
        ConfigError: there is no such command, or the port is in use.
        TrainingError: the server did not come up.
    """
    if chat is None:
        yield
        return
    port = free_port(HOST, urlsplit(chat.base_url).port or 80, hint="is a server running there already?")
    key = os.environ.get(chat.api_key_env, "").strip() or secrets.token_hex(16)
    os.environ[chat.api_key_env] = key  # for the client
    command = [program, "serve", chat.model, "--served-model-name", chat.model, "--host", HOST]
    command += ["--port", str(port), "--tensor-parallel-size", str(len(gpus))]
    command += ["--max-model-len", str(REQUEST_TOKENS)]
    env = {"CUDA_VISIBLE_DEVICES": ",".join(gpus), "VLLM_API_KEY": key}
    await asyncio.to_thread(log.parent.mkdir, parents=True, exist_ok=True)
    server = await ManagedServer.start(command, env, log)
    api = VllmApi(chat.base_url, SecretStr(key))

    async def restart() -> None:
        nonlocal server
        for _ in range(_RESTARTS):
            await server.wait()
            logger.warning("%s", server.failure("ended; it is started again").message)
            server = await ManagedServer.start(command, env, log)

    try:
        await server.until(api.is_up, VllmConfig().start_seconds)
        async with running_in_background(restart()):
            yield
    finally:
        await api.close()
        await server.stop()


_OF_LAUNCHERS: Final = ("ACCELERATE_", "FSDP_", "TORCHELASTIC_", "PET_", "MASTER_", "GROUP_", "ROLE_")
_RANKS: Final = frozenset({"RANK", "LOCAL_RANK", "WORLD_SIZE", "LOCAL_WORLD_SIZE", "NODE_RANK"})


def _without_launcher(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment without what ``accelerate launch`` and ``torchrun`` tell the learner's processes about
    each other: with it, a server would try to join them."""
    return {
        name: value
        for name, value in environment.items()
        if name not in _RANKS and not name.startswith(_OF_LAUNCHERS)
    }


def free_port(host: str, port: int | None, hint: str = "set vllm.port to a free one, or leave it out") -> int:
    """A port that is not in use: the given one, or any.

    Raises:
        ConfigError: the given port is in use.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port or 0))
        except OSError as error:
            raise ConfigError(f"cannot listen at {host}:{port}: {error.strerror}", hint=hint) from error
        return int(probe.getsockname()[1])
