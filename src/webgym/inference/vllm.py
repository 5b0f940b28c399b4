"""A vLLM server: its command line, its HTTP API, and the policy that replies with it.

Names of flags, endpoints and fields are those of vLLM's documentation (0.33): LoRA adapters
(``features/lora``), weight transfer and asynchronous RL (``training/``), the chat API's own extensions
(``return_token_ids``). Endpoints beyond the chat API are optional: see :meth:`VllmApi.offers`.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Self, TypeAlias

import httpx
import msgspec
from pydantic import Field, SecretStr, field_validator

from webgym.agent.openai_policy import OpenAIPolicy, as_policy_error
from webgym.agent.policy import BasePolicy, PolicyInput
from webgym.core.errors import LLMBadReply, LLMError, LLMUnreachable, PolicyBadReply, PolicyError
from webgym.core.settings import Settings
from webgym.core.trajectory import Reply
from webgym.llm.client import is_loopback
from webgym.llm.completion import error_message, first_line, quote
from webgym.llm.config import ChatConfig, Sampling
from webgym.llm.health import register_client

PublishMethod: TypeAlias = Literal["lora", "in_place", "restart"]
"""How new weights are published: as a LoRA adapter, into the running server, or by restarting it."""

_HOST: Final = "127.0.0.1"
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
        "logprobs": True,
    },
)
"""Every parameter is set, because a server takes missing ones from the model's ``generation_config.json``."""

UPDATE_SECONDS: Final = 600.0
"""Deadline for loading new weights, after the last reply with the old ones."""

_MOST_FOREIGN: Final = 5
"""Number of replies with other weights than the published ones, after which the training stops."""


class VllmConfig(Settings):
    """Settings of a vLLM server for training. Fields with vLLM's names have the same meaning as there."""

    base_url: str | None = None
    """Base URL of a running server, e.g. ``http://127.0.0.1:8000/v1``; ``None`` starts one on this
    machine."""

    model: str | None = None
    """For a server started here, the first model that it serves: a folder or hub id, by default
    ``learn.model``. For a running server, its name for that model, by default the only one that it lists."""

    publish: Literal["auto", "lora", "in_place", "restart"] = "auto"
    """How new weights are published. ``auto``: ``lora`` for adapters; for all weights ``restart`` if the
    server was started here, else ``in_place``."""

    tensor_parallel_size: int = Field(default=1, ge=1)
    """Number of GPUs over which the weights are distributed."""

    data_parallel_size: int = Field(default=1, ge=1)
    """Number of copies of the weights."""

    max_model_len: int | None = Field(default=None, ge=1)
    """Longest request and reply together, in tokens; by default the model's own limit."""

    gpu_memory_utilization: float = Field(default=0.9, gt=0, le=1)
    """Share of each GPU's memory to use. Set it lower if the learner is on the same GPU."""

    executable: str = "vllm"
    """The command: a name on the PATH, or a path."""

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
    def _is_url(cls, value: str | None) -> str | None:
        return None if value is None else ChatConfig(base_url=value, model="any").base_url

    @field_validator("extra_args")
    @classmethod
    def _sets_no_reserved_option(cls, arguments: tuple[str, ...]) -> tuple[str, ...]:
        reserved = {
            "--host",
            "--port",
            "--served-model-name",
            "--api-key",
            "--logprobs-mode",
            "--generation-config",
        }
        if conflicts := sorted(reserved & {argument.split("=", 1)[0] for argument in arguments}):
            raise ValueError(f"extra_args must not set {', '.join(conflicts)}")
        return arguments

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
        arguments = [self.executable, "serve", model, "--served-model-name", name]
        arguments += ["--host", _HOST, "--port", str(port)]
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
    """

    def __init__(self, base_url: str, key: SecretStr) -> None:
        self.base_url = base_url
        self.key = key
        self._root = base_url.removesuffix("/v1")
        secret = key.get_secret_value()
        self._http = httpx.AsyncClient(
            headers={"Authorization": f"Bearer {secret}"} if secret else {},
            timeout=httpx.Timeout(10.0, pool=None),
            trust_env=not is_loopback(base_url),
        )

    async def close(self) -> None:
        """Close its connections."""
        await self._http.aclose()

    async def is_up(self) -> bool:
        """Whether it answers requests."""
        try:
            await self.models()
        except LLMError:
            return False
        return True

    async def models(self) -> list[str]:
        """The names of its models and adapters."""
        answer = await self._request("GET", "/v1/models")
        models = answer.get("data", [])
        return [str(model["id"]) for model in models if isinstance(model, dict) and "id" in model]

    async def offers(self, path: str) -> bool:
        """Whether the server has an endpoint. It is not called: endpoints for POST refuse GET with another
        status."""
        try:
            return (await self._http.get(self._root + path)).status_code not in (404, 501)
        except httpx.HTTPError as error:
            raise self._unreachable(error) from error

    async def weight_version(self) -> str:
        """The version label of the current weights."""
        return str((await self._request("GET", "/weight_info")).get("weight_version", ""))

    async def load_adapter(self, name: str, folder: str) -> None:
        """Load an adapter under a name that was never used, because caches are keyed by the name (vLLM
        #42125)."""
        await self._request("POST", "/v1/load_lora_adapter", {"lora_name": name, "lora_path": folder})

    async def unload_adapter(self, name: str) -> None:
        """Unload an adapter."""
        await self._request("POST", "/v1/unload_lora_adapter", {"lora_name": name})

    async def update_weights(self, folder: str, version: str) -> None:
        """Load weights into the running server, which is paused during the update. If that fails, it stays
        paused.

        Uses the ``disk`` backend of its weight transfer, which only some builds have; else the workers'
        ``reload_weights``.
        """
        await self._request("POST", "/pause?mode=wait")
        if await self._supports_disk_transfer():
            await self._request("POST", "/start_weight_update", {})
            await self._request("POST", "/update_weights", {"update_info": {"path": folder}})
            await self._request("POST", "/finish_weight_update", {"weight_version": version})
        else:
            call = {"method": "reload_weights", "kwargs": {"weights_path": folder}}
            await self._request("POST", "/collective_rpc", call)
        for cache in ("/reset_prefix_cache", "/reset_mm_cache", "/reset_encoder_cache"):
            if await self.offers(cache):
                await self._request("POST", cache)
        await self.label(version)
        await self._request("POST", "/resume")

    async def label(self, version: str) -> None:
        """Set the version label of the server's weights, if it supports labels."""
        if await self.offers("/weight_info") and await self.weight_version() != version:
            await self._request("POST", "/update_weight_version", {"new_version": version})

    async def _supports_disk_transfer(self) -> bool:
        if not await self.offers("/init_weight_transfer_engine"):
            return False
        try:
            await self._request("POST", "/init_weight_transfer_engine", {"init_info": {}})
        except LLMBadReply:  # another backend, which needs more arguments; or none
            return False
        return True

    async def _request(self, method: str, path: str, body: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Send a request; returns the JSON object in the answer, or an empty one if it is something else.

        Raises:
            LLMUnreachable: the server does not answer.
            LLMBadReply: it answers with an error status.
        """
        timeout = UPDATE_SECONDS if method == "POST" else 10.0
        try:
            answer = await self._http.request(method, self._root + path, json=body, timeout=timeout)
        except (httpx.HTTPError, RuntimeError) as error:  # RuntimeError: closed, because the server ended
            raise self._unreachable(error) from error
        if answer.status_code != 200:
            reason = error_message(answer.content) or quote(answer.content)
            raise LLMBadReply(f"{self._root}{path} answered {answer.status_code}: {reason}")
        try:
            content = json.loads(answer.content or b"{}")
        except ValueError:
            return {}
        return content if isinstance(content, dict) else {}

    def _unreachable(self, error: Exception) -> LLMUnreachable:
        why = first_line(str(error)) or type(error).__name__
        return LLMUnreachable(f"the server {self._root} cannot be reached: {why}")


@dataclass(eq=False)
class Served:
    """Weights on a server.

    Attributes:
        api: the server's API.
        model: name of the weights in requests, which replies must have too.
        version: version of the weights, for the records of replies.
        policy: the client.
        is_labelled: whether the server has this version as its label, so that it can be compared.
        is_adapter: whether the name is that of an adapter, which is to be unloaded later.
        retest: tests the weights again, where neither a label nor the name would tell that the server was
            started anew without them. Raises :class:`ForeignReply`.
        idle: set while no request is in flight.
    """

    api: VllmApi
    model: str
    version: str
    policy: OpenAIPolicy
    is_labelled: bool = False
    is_adapter: bool = False
    retest: Callable[[], Awaitable[None]] | None = None
    idle: asyncio.Event = field(default_factory=asyncio.Event)
    _in_flight: int = field(default=0, init=False)
    _retesting: asyncio.Lock = field(default_factory=asyncio.Lock, init=False)
    _interruptions: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.idle.set()

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Count a request in flight during the block."""
        self._in_flight += 1
        self.idle.clear()
        try:
            yield
        finally:
            self._in_flight -= 1
            if not self._in_flight:
                self.idle.set()

    async def reply(self, turn: PolicyInput) -> Reply:
        """The model's reply to a turn, checked by :meth:`checked`."""
        return await self.checked(await self.policy.reply(turn))

    async def checked(self, reply: Reply) -> Reply:
        """The reply, if it is of these weights, as far as the server reports that.

        Raises:
            ForeignReply: it is of other weights.
            PolicyError: the server's label could not be queried.
        """
        if reply.policy != self.model:
            raise ForeignReply(f"the endpoint replied with the model {reply.policy!r}, not {self.model!r}")
        if self.is_labelled:
            try:
                version = reply.weight_version or await self.api.weight_version()
            except LLMError as error:
                raise as_policy_error(error) from error
            if version != self.version:
                raise ForeignReply(f"the endpoint replied with the weights {version!r}, not {self.version!r}")
        if self.retest is not None:
            async with self._retesting:
                if (interruptions := self.policy.interruptions) != self._interruptions:
                    await self.retest()
                    self._interruptions = interruptions
        return reply


class ForeignReply(PolicyBadReply):
    """The endpoint replied with other weights than were published."""


class VllmPolicy(BasePolicy):
    """Replies with the current weights of a server; during a change of weights, callers wait.

    Args:
        name: name of the model in records, the same for all of its weights.

    Attributes:
        name: as given.
        served: the current weights.
        distrusted: set when the server replied with other weights a few times.
        why: the message of the last such reply.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.served: Served | None = None
        self.distrusted = asyncio.Event()
        self.why = ""
        self._foreign = 0
        self._open = asyncio.Event()

    def switch(self, served: Served) -> Served | None:
        """Reply with these weights from now on. Returns the previous ones, which may have requests in
        flight."""
        previous, self.served = self.served, served
        self._foreign = 0
        self._open.set()
        return previous

    async def close(self) -> None:
        """Hold back further requests, and wait for those in flight."""
        self._open.clear()
        if self.served is not None:
            await self.served.idle.wait()

    def hold(self) -> None:
        """Hold back further requests. Those in flight are lost, and will be sent again."""
        self._open.clear()

    @property
    def problem(self) -> str:
        """Why requests are delayed at this moment; empty if they are not."""
        if not self._open.is_set():
            return "replies wait for new weights"
        return self.served.policy.problem if self.served is not None else ""

    async def __aenter__(self) -> Self:
        register_client(self)  # for each run; its client stays open for longer
        return self

    async def reply(self, turn: PolicyInput) -> Reply:
        """The model's reply. A request that was lost because the server ended is sent again.

        Raises:
            PolicyError: the request failed, or the reply is of other weights than the published ones.
        """
        while True:
            await self._open.wait()
            served = self.served
            assert served is not None
            try:
                with served.in_use():
                    reply = await served.reply(turn)
            except ForeignReply as error:
                self._foreign += 1
                self.why = error.message
                if self._foreign >= _MOST_FOREIGN:
                    self.distrusted.set()
                raise
            except PolicyError:
                if self.served is served and self._open.is_set():
                    raise
                continue
            return msgspec.structs.replace(reply, policy=self.name, weight_version=served.version)
