"""A policy whose model runs in this process: for small models, for tests, and where no server is available.

Calls are answered in batches as they arrive: while one batch is being generated, the next calls are
collected, so that many attempts share every forward pass without waiting for each other.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field, field_validator

from webgym.agent.policy import PolicyInput
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile
from webgym.core.errors import ConfigError, PolicyError
from webgym.core.settings import ModelName, Settings
from webgym.core.task import Task
from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import Message, Reply
from webgym.llm.config import Sampling

if TYPE_CHECKING:
    from webgym.inference.generate import Generated
    from webgym.inference.rendering import Encoded

_SEED_SPACE = 2**63


class LocalConfig(Settings):
    """Settings of a model that runs in this process."""

    path: ModelName
    """A folder, or the id of a model on the Hugging Face hub; ``tiny`` for the tiny policy."""

    dtype: Literal["float32", "bfloat16"] = "float32"
    """Data type of the weights."""

    device: str = "cpu"
    """Device, as torch names it."""

    threads: int | None = Field(default=None, ge=1)
    """Processor threads of torch; by default torch's choice. Browsers on the same machine need some too."""

    most_at_once: int = Field(default=64, ge=1)
    """Most requests in one batch."""

    sampling: Sampling = Sampling()
    """Sampling parameters; those not set come from the model's profile. ``top_k`` is in ``extra_body``, as
    for vLLM; there are no others."""

    @field_validator("sampling")
    @classmethod
    def _is_applied(cls, sampling: Sampling) -> Sampling:
        given = {name for name, value in sampling.extra_body.items() if value is not None}
        if unknown := sorted(given - {"top_k"}):
            raise ValueError(f"a model in this process is sampled without {', '.join(unknown)}")
        return sampling


@dataclass(eq=False)
class _Call:
    """A request that waits for its reply."""

    encoded: Encoded
    seed: int
    sampling: Sampling
    reply: asyncio.Future[tuple[Generated, str]]


class LocalPolicy:
    """Replies with a model in this process, which is loaded when the policy is entered.

    Args:
        config: the model, and how it is sampled.
        profile: profile of the model family; by default chosen by the model's name.

    Attributes:
        weight_version: version of the current weights; every reply records the version that generated it.
    """

    wants_elements = False

    def __init__(self, config: LocalConfig, profile: Profile | None = None) -> None:
        self.config = config
        self._name = Path(config.path).name
        self._profile = profile or choose_profile(None, self._name)
        self._sampling = self._profile.sampling_of(config.sampling)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="local-model")
        self._waiting: list[_Call] = []
        self._arrived = asyncio.Event()
        self._worker: asyncio.Task[None] | None = None
        self._loaded: Any = None
        self.weight_version = "0"

    @property
    def name(self) -> str:
        """The model's name."""
        return self._name

    def begin(self, task: Task, seed: int) -> _LocalSession:  # noqa: ARG002
        """A session whose random numbers are determined by ``seed``."""
        return _LocalSession(self, seed)

    async def publish(self, folder: Path, version: str) -> None:
        """Replace the weights by others of the same architecture.

        Atomic: a batch is generated with the old weights or with the new ones, never with a mixture.

        Args:
            folder: folder with all weights (``model.safetensors``), or with adapters
                (``adapter_config.json``), which are merged into their base weights.
            version: version of the weights, for the records of replies.

        Raises:
            ConfigError: the weights are missing or have other shapes.
        """
        await asyncio.get_running_loop().run_in_executor(self._thread, self._load_weights, folder, version)

    async def reply(self, turn: PolicyInput, seed: int) -> Reply:
        """The model's reply to a turn.

        Raises:
            PolicyError: the request cannot be rendered, the model failed, or the policy is closed.
        """
        started = time.monotonic()
        encoded = await self._encode(turn.messages, turn.images)
        future: asyncio.Future[tuple[Generated, str]] = asyncio.get_running_loop().create_future()
        sampling = turn.sampling.over(self._sampling) if turn.sampling else self._sampling
        self._waiting.append(_Call(encoded, seed, sampling, future))
        self._arrived.set()
        generated, version = await future
        return self._reply(encoded, generated, version, sampling, started)

    async def ask(
        self, messages: Sequence[Message], images: Mapping[str, bytes], sampling: Sampling
    ) -> Reply:
        """The model's reply to any request, in a batch of its own.

        Raises:
            PolicyError: the request cannot be rendered, or the policy is not open.
        """
        started = time.monotonic()
        encoded = await self._encode(messages, images)
        chosen = sampling.over(self._sampling)
        (generated,), version = await asyncio.get_running_loop().run_in_executor(
            self._thread, self._generate, [encoded], [0], chosen
        )
        return self._reply(encoded, generated, version, chosen, started)

    async def _encode(self, messages: Sequence[Message], images: Mapping[str, bytes]) -> Encoded:
        self._check_open()
        encoded: Encoded = await asyncio.to_thread(self._loaded.renderer.prompt, messages, images)
        self._check_open()
        return encoded

    def _check_open(self) -> None:
        if self._worker is None:
            raise PolicyError("the local policy is not open", hint="use it as `async with policy:`")

    def _reply(
        self, encoded: Encoded, generated: Generated, version: str, sampling: Sampling, started: float
    ) -> Reply:
        return Reply(
            self._loaded.renderer.decode(generated.ids),
            policy=self._name,
            finish_reason="length" if generated.is_cut else "stop",
            sampling=sampling.body(),
            prompt_tokens=len(encoded.prompt_ids),
            completion_tokens=len(generated.ids),
            seconds=time.monotonic() - started,
            tokens=ReplyTokens.of(encoded.prompt_ids, generated.ids, generated.logprobs),
            weight_version=version,
        )

    async def __aenter__(self) -> Self:
        self._loaded = await asyncio.get_running_loop().run_in_executor(
            self._thread, self._load, self.config.path
        )
        self._worker = asyncio.create_task(self._serve())
        return self

    async def __aexit__(self, *exc: object) -> None:
        if self._worker is not None:
            self._worker.cancel()
            await asyncio.gather(self._worker, return_exceptions=True)
            self._worker = None
        for call in self._waiting:
            if not call.reply.done():
                call.reply.set_exception(PolicyError("the local policy was closed before it replied"))
        self._waiting.clear()
        await asyncio.to_thread(self._thread.shutdown)

    # --- the worker ---------------------------------------------------------------------------------

    async def _serve(self) -> None:
        """Answer waiting calls, one batch at a time."""
        loop = asyncio.get_running_loop()
        while True:
            await self._arrived.wait()
            # Cancelled calls need no reply.
            self._waiting = [call for call in self._waiting if not call.reply.done()]
            alike = [call for call in self._waiting if call.sampling == self._waiting[0].sampling]
            batch = alike[: self.config.most_at_once]
            self._waiting = [call for call in self._waiting if call not in batch]
            if not self._waiting:
                self._arrived.clear()
            if not batch:
                continue
            try:
                generated, version = await loop.run_in_executor(
                    self._thread,
                    self._generate,
                    [call.encoded for call in batch],
                    [call.seed for call in batch],
                    batch[0].sampling,
                )
            except asyncio.CancelledError:
                self._waiting += batch  # closed, and whoever waits is told
                raise
            except Exception as error:
                reason = (
                    f"the local model failed: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
                )
                for call in batch:
                    if not call.reply.done():
                        call.reply.set_exception(PolicyError(reason))
                continue
            for call, reply in zip(batch, generated, strict=True):
                if not call.reply.done():
                    call.reply.set_result((reply, version))

    def _generate(
        self, requests: Sequence[Encoded], seeds: Sequence[int], sampling: Sampling
    ) -> tuple[list[Generated], str]:
        from webgym.inference.generate import LONGEST_REPLY, SamplingParameters, generate

        parameters = SamplingParameters(
            temperature=1.0 if sampling.temperature is None else sampling.temperature,
            top_p=1.0 if sampling.top_p is None else sampling.top_p,
            top_k=int(sampling.extra_body.get("top_k", 0)),
            max_tokens=sampling.max_tokens or LONGEST_REPLY,
        )
        return generate(self._loaded, requests, seeds, parameters), self.weight_version

    def _load(self, path: str | Path) -> Any:
        try:
            import torch

            from webgym.inference.model import load_model
        except ImportError as error:
            raise ConfigError(
                f"a model in this process needs {error.name}", hint="pip install 'webgym-rl[train]'"
            ) from error
        if self.config.threads is not None:
            torch.set_num_threads(self.config.threads)
        return load_model(path, dtype=self.config.dtype, device=self.config.device)

    def _load_weights(self, folder: Path, version: str) -> None:
        """Load weights, all or none: mismatches are found before anything is overwritten."""
        if (folder / "adapter_config.json").exists():
            self._loaded = self._load(folder)
        else:
            self._overwrite(folder / "model.safetensors")
        self.weight_version = version

    def _overwrite(self, path: Path) -> None:
        from safetensors import SafetensorError
        from safetensors.torch import load_file

        model = self._loaded.model
        try:
            weights = load_file(path)  # into the model tensor by tensor: a device may not hold them twice
            current = model.state_dict()
            missing = sorted(set(current) - set(weights) - set(model.all_tied_weights_keys or ()))
            if missing:
                raise ValueError(f"{len(missing)} weights are missing, {missing[0]} among them")
            shared = current.keys() & weights.keys()
            mismatched = [name for name in shared if current[name].shape != weights[name].shape]
            if mismatched:
                raise ValueError(
                    f"{len(mismatched)} weights have another shape, {min(mismatched)} among them"
                )
            model.load_state_dict(weights, strict=False)
        except (OSError, ValueError, RuntimeError, SafetensorError) as error:
            reason = " ".join(str(error).split())[:200]
            raise ConfigError(f"cannot publish {path}: {reason}") from error


class _LocalSession:
    """The session of one attempt, which gives each turn a seed of its own."""

    def __init__(self, policy: LocalPolicy, seed: int) -> None:
        self._policy = policy
        self._seed = seed

    async def reply(self, turn: PolicyInput) -> Reply:
        """See :meth:`LocalPolicy.reply`."""
        return await self._policy.reply(turn, (self._seed * 1_000_003 + turn.index) % _SEED_SPACE)
