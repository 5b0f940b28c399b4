"""A vLLM server: how it is started, what it is asked, and the policy that replies with it.

Names of flags, endpoints and fields are those of vLLM's documentation (0.33): LoRA adapters
(``features/lora``), weight transfer and asynchronous RL (``training/``), the chat API's own extensions
(``return_token_ids``). Nothing beyond the chat API is taken for granted: see :meth:`VllmApi.offers`.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Self, TypeAlias

import httpx
import msgspec
from pydantic import Field, SecretStr, field_validator

from webgym.agent.openai_policy import OpenAIPolicy, as_policy_error
from webgym.agent.policy import BasePolicy, PolicyInput
from webgym.core.errors import LLMBadReply, LLMError, LLMUnreachable, PolicyBadReply, PolicyError
from webgym.core.task import Task
from webgym.core.trajectory import Reply
from webgym.llm.client import is_loopback
from webgym.llm.completion import first_line, quote, told
from webgym.llm.config import ChatConfig, Sampling
from webgym.llm.health import register_client
from webgym.settings import Settings

Way: TypeAlias = Literal["lora", "in_place", "restart"]

_HOST: Final = "127.0.0.1"
_LORA_RANKS: Final = (8, 16, 32, 64, 128, 256, 320, 512)
"""What ``--max-lora-rank`` takes."""

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
"""Every parameter is named: a server takes what is not from the model's ``generation_config.json``."""

_MOST_FOREIGN: Final = 5
"""Replies of other weights than the published ones, after which the training stops."""


class VllmConfig(Settings):
    """A vLLM server that replies while a policy learns. Fields that it has too are named as there."""

    base_url: str | None = None
    """Of a server that runs already, e.g. ``http://127.0.0.1:8000/v1``; ``None`` starts one here."""

    model: str | None = None
    """What a server that is started here serves first: a folder or hub id, by default ``learn.model``. Of a
    running server: the name that it has for that model, by default the only one that it lists."""

    publish: Literal["auto", "lora", "in_place", "restart"] = "auto"
    """How it gets new weights. ``auto`` takes ``lora`` for adapters; for all weights ``restart`` where the
    server is ours, else ``in_place``."""

    tensor_parallel_size: int = Field(default=1, ge=1)
    """GPUs that share the weights."""

    data_parallel_size: int = Field(default=1, ge=1)
    """Copies of the weights."""

    max_model_len: int | None = Field(default=None, ge=1)
    """Longest request and reply, in tokens; by default the model's own."""

    gpu_memory_utilization: float = Field(default=0.9, gt=0, le=1)
    """Share of each GPU's memory. Less where the learner is on the same GPU."""

    executable: str = "vllm"
    """The command, on the PATH or as a path."""

    extra_args: tuple[str, ...] = ()
    """Further arguments of ``vllm serve``, e.g. ``--enforce-eager``."""

    env: dict[str, str] = Field(default_factory=dict)
    """Further environment, e.g. ``CUDA_VISIBLE_DEVICES``."""

    port: int | None = Field(default=None, ge=1, le=65535)
    """Where it listens on this machine; by default any free one."""

    start_seconds: float = Field(default=1800.0, gt=0)
    """How long it may take until it replies: weights are read, and kernels compiled."""

    restarts: int = Field(default=3, ge=0)
    """How often a server that ended is started again between two publications."""

    update_seconds: float = Field(default=600.0, gt=0)
    """How long taking new weights may last, from the last reply of the old ones on."""

    api_key_env: str = "WEBGYM_API_KEY"
    """Environment variable that holds the key of a running server. One that is started here gets its own."""

    concurrency: int = Field(default=80, ge=1)
    """Most requests in flight (paper, appendix F: 80)."""

    total_seconds: float = Field(default=600.0, gt=0)
    """Deadline of a reply."""

    sampling: Sampling = Sampling()
    """What is not set comes from the model's profile."""

    @field_validator("base_url")
    @classmethod
    def _is_url(cls, value: str | None) -> str | None:
        return None if value is None else ChatConfig(base_url=value, model="any").base_url

    @field_validator("extra_args")
    @classmethod
    def _leaves_ours_alone(cls, given: tuple[str, ...]) -> tuple[str, ...]:
        ours = {
            "--host",
            "--port",
            "--served-model-name",
            "--api-key",
            "--logprobs-mode",
            "--generation-config",
        }
        if taken := sorted(ours & {each.split("=", 1)[0] for each in given}):
            raise ValueError(f"extra_args must not set {', '.join(taken)}")
        return given

    def command(self, model: str, name: str, port: int, way: Way, lora_rank: int) -> list[str]:
        """``vllm serve`` and its arguments.

        Args:
            model: folder or hub id.
            name: what requests ask for.
            port: where to listen.
            way: how weights will be published.
            lora_rank: of adapters.
        """
        made = [self.executable, "serve", model, "--served-model-name", name]
        made += ["--host", _HOST, "--port", str(port)]
        made += ["--tensor-parallel-size", str(self.tensor_parallel_size)]
        made += ["--data-parallel-size", str(self.data_parallel_size)] if self.data_parallel_size > 1 else []
        made += ["--gpu-memory-utilization", str(self.gpu_memory_utilization)]
        made += ["--max-model-len", str(self.max_model_len)] if self.max_model_len else []
        made += ["--logprobs-mode", "processed_logprobs", "--generation-config", "vllm"]
        if way == "lora":
            largest = next((rank for rank in _LORA_RANKS if rank >= lora_rank), lora_rank)
            # Two at once: the new adapter is loaded and tested while the old one still replies.
            made += ["--enable-lora", "--max-lora-rank", str(largest), "--max-loras", "2"]
            # Each of several front ends would know its own adapters alone, so vLLM refuses more than one.
            made += ["--api-server-count", "1"] if self.data_parallel_size > 1 else []
        return [*made, *self.extra_args]

    def environment(self, key: SecretStr, way: Way) -> dict[str, str]:
        """Of the server that is started."""
        own = {"VLLM_API_KEY": key.get_secret_value()}
        if way == "lora":
            own["VLLM_ALLOW_RUNTIME_LORA_UPDATING"] = "True"
        if way == "in_place":
            own["VLLM_SERVER_DEV_MODE"] = "1"
        return own | self.env

    def chat(self, base_url: str, model: str) -> ChatConfig:
        """The endpoint as the policy's client knows it."""
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
    """What a server is asked beside replies.

    Args:
        base_url: with ``/v1``.
        key: that it wants; empty for none.
        update_seconds: how long it may take over new weights.
    """

    def __init__(self, base_url: str, key: SecretStr, update_seconds: float = 600.0) -> None:
        self.base_url = base_url
        self.key = key
        self._root = base_url.removesuffix("/v1")
        self._update_seconds = update_seconds
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
        """Whether it replies by now."""
        try:
            await self.models()
        except LLMError:
            return False
        return True

    async def models(self) -> list[str]:
        """The names that requests may ask for, adapters among them."""
        found = await self._ask("GET", "/v1/models")
        return [str(each["id"]) for each in found.get("data", []) if isinstance(each, dict) and "id" in each]

    async def offers(self, path: str) -> bool:
        """Whether there is an endpoint. It is not used: one that wants POST refuses GET in another way."""
        try:
            return (await self._http.get(self._root + path)).status_code not in (404, 501)
        except httpx.HTTPError as error:
            raise self._unreachable(error) from error

    async def weight_version(self) -> str:
        """The label of the weights that reply now."""
        return str((await self._ask("GET", "/weight_info")).get("weight_version", ""))

    async def load_adapter(self, name: str, folder: str) -> None:
        """Load an adapter under a name that was never used: caches go by the name (vLLM #42125)."""
        await self._ask("POST", "/v1/load_lora_adapter", {"lora_name": name, "lora_path": folder})

    async def unload_adapter(self, name: str) -> None:
        """Forget an adapter."""
        await self._ask("POST", "/v1/unload_lora_adapter", {"lora_name": name})

    async def update_weights(self, folder: str, version: str) -> None:
        """Put weights into the server as it runs. It is paused meanwhile; if this fails, it stays so.

        By the ``disk`` backend of its weight transfer, which only some builds have; else by the workers'
        ``reload_weights``.
        """
        await self._ask("POST", "/pause?mode=wait")
        if await self._takes_from_disk():
            await self._ask("POST", "/start_weight_update", {})
            await self._ask("POST", "/update_weights", {"update_info": {"path": folder}})
            await self._ask("POST", "/finish_weight_update", {"weight_version": version})
        else:
            wanted = {"method": "reload_weights", "kwargs": {"weights_path": folder}}
            await self._ask("POST", "/collective_rpc", wanted)
        for cache in ("/reset_prefix_cache", "/reset_mm_cache", "/reset_encoder_cache"):
            if await self.offers(cache):
                await self._ask("POST", cache)
        await self.label(version)
        await self._ask("POST", "/resume")

    async def label(self, version: str) -> None:
        """Have the server call its weights so, where it can."""
        if await self.offers("/weight_info") and await self.weight_version() != version:
            await self._ask("POST", "/update_weight_version", {"new_version": version})

    async def _takes_from_disk(self) -> bool:
        if not await self.offers("/init_weight_transfer_engine"):
            return False
        try:
            await self._ask("POST", "/init_weight_transfer_engine", {"init_info": {}})
        except LLMBadReply:  # another backend, which wants to know more; or none
            return False
        return True

    async def _ask(self, method: str, path: str, body: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The JSON object that it answers; empty if it answers something else.

        Raises:
            LLMUnreachable: it does not answer.
            LLMBadReply: it refuses.
        """
        timeout = self._update_seconds if method == "POST" else 10.0
        try:
            answer = await self._http.request(method, self._root + path, json=body, timeout=timeout)
        except (httpx.HTTPError, RuntimeError) as error:  # closed meanwhile, because the server ended
            raise self._unreachable(error) from error
        if answer.status_code != 200:
            said = told(answer.content) or quote(answer.content)
            raise LLMBadReply(f"{self._root}{path} answered {answer.status_code}: {said}")
        try:
            found = json.loads(answer.content or b"{}")
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}

    def _unreachable(self, error: Exception) -> LLMUnreachable:
        why = first_line(str(error)) or type(error).__name__
        return LLMUnreachable(f"the server {self._root} cannot be reached: {why}")


@dataclass(eq=False)
class Served:
    """Weights that are served, under the name that requests ask for.

    Attributes:
        api: of the server.
        model: that name. Replies must have it.
        version: of the weights; what replies are recorded with.
        policy: the client.
        is_labelled: whether the server was told this version, so that what it says can be compared.
        is_adapter: whether the name is an adapter's, which is to be unloaded in the end.
        idle: set while no request is in flight.
    """

    api: VllmApi
    model: str
    version: str
    policy: OpenAIPolicy
    is_labelled: bool = False
    is_adapter: bool = False
    idle: asyncio.Event = field(default_factory=asyncio.Event)
    _in_flight: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.idle.set()

    @contextmanager
    def used(self) -> Iterator[None]:
        """While a request is in flight."""
        self._in_flight += 1
        self.idle.clear()
        try:
            yield
        finally:
            self._in_flight -= 1
            if not self._in_flight:
                self.idle.set()

    async def reply(self, turn: PolicyInput) -> Reply:
        """The model's reply to a turn, :meth:`checked`."""
        return await self.checked(await self.policy.reply(turn))

    async def checked(self, reply: Reply) -> Reply:
        """The reply, if it is of these weights as far as the server says it.

        Raises:
            ForeignReply: it is not.
            PolicyError: the server does not say any more.
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
        return reply


class ForeignReply(PolicyBadReply):
    """The endpoint replied with other weights than were published."""


class VllmPolicy(BasePolicy):
    """Replies with the weights that are served; while none are, callers wait.

    Args:
        name: of the model, for records; the same for all its weights.

    Attributes:
        name: as given.
        served: what replies now.
        distrusted: set when the server replied with other weights a few times.
        why: then, the last time.
    """

    wants_elements = False

    def __init__(self, name: str) -> None:
        self.name = name
        self.served: Served | None = None
        self.distrusted = asyncio.Event()
        self.why = ""
        self._foreign = 0
        self._open = asyncio.Event()

    def switch(self, served: Served) -> Served | None:
        """Reply with these from now on; what replied before, and may have requests in flight."""
        before, self.served = self.served, served
        self._foreign = 0
        self._open.set()
        return before

    async def close(self) -> None:
        """Let no further request through, and wait for those in flight."""
        self._open.clear()
        if self.served is not None:
            await self.served.idle.wait()

    def hold(self) -> None:
        """Let no further request through; those in flight are lost, and will be sent again."""
        self._open.clear()

    @property
    def problem(self) -> str:
        """What holds its requests up at this moment; empty for nothing."""
        if not self._open.is_set():
            return "replies wait for new weights"
        return self.served.policy.problem if self.served is not None else ""

    async def __aenter__(self) -> Self:
        register_client(self)  # to each run anew; its client is open for longer
        return self

    def begin(self, task: Task, seed: int) -> VllmPolicy:  # noqa: ARG002
        """Itself: nothing is kept from turn to turn."""
        return self

    async def reply(self, turn: PolicyInput) -> Reply:
        """The model's reply. One that was lost because the server ended is asked for again.

        Raises:
            PolicyError: there is none, or it is of other weights than the published ones.
        """
        while True:
            await self._open.wait()
            served = self.served
            assert served is not None
            try:
                with served.used():
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
