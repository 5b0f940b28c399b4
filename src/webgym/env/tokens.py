"""Episodes for trainers that hand token ids to an inference engine, and train on what was sampled::

    async with webgym.EnvironmentPool("offline-v2", size=8) as pool, pool.environment() as env:
        rollout = await webgym.roll_out(env, generate, renderer, task_id=task_id)
        for row in rollout.rows:
            ...  # row.prompt_ids, row.reply_ids, row.logprobs, row.images

There is one row per step, because WebGym's history is a window: no two steps share a prompt. All rows of an
episode have its reward. The ids that the engine sampled go unchanged into the record and from there into the
row; inconsistent rows are dropped and counted (:mod:`webgym.train.samples`).
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, Literal

from PIL import Image

from webgym.core.errors import PolicyError, UsageError, WebGymError
from webgym.core.outcome import Outcome, ending_of, outcome_of
from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import Failure, Message, Reply, Trajectory
from webgym.env.environment import Environment
from webgym.inference.rendering import Pixels, Renderer, pictures_of
from webgym.train.samples import SampleMaker


@dataclass(frozen=True)
class TokenRequest:
    """A request to an inference engine.

    Attributes:
        id: of the episode: requests of an episode share most of their pictures, so an engine may route them
            to the same replica.
        prompt_ids: token ids, image tokens expanded; these are trained on.
        short_prompt_ids: the same with one image token per picture, for engines that expand them.
        images: the pictures in the order of the prompt, encoded (PNG), at the size at which they are read.
        messages: the request before it was rendered.
    """

    id: str
    prompt_ids: list[int]
    short_prompt_ids: list[int]
    images: tuple[bytes, ...]
    messages: tuple[Message, ...]

    def pil_images(self) -> list[Image.Image]:
        """The pictures, decoded (RGB)."""
        return [Image.open(BytesIO(data)).convert("RGB") for data in self.images]


@dataclass(frozen=True)
class Sampled:
    """A reply that the engine sampled.

    Attributes:
        reply_ids: token ids, the end token included if it was sampled. If there is none, nothing was sampled:
            the engine failed, as with ``abort``.
        logprobs: of ``reply_ids``, under the distribution that they were drawn from.
        finish_reason: ``stop``: the model ended the reply; ``length``: it was cut off; ``abort``: the engine
            broke it off, and the episode ends without a reward.
        weight_version: of the weights that sampled it; empty if the engine does not report it.
        prompt_ids: those that the engine read, if it reports them; they are trained on instead of the
            request's.
        sampling: parameters, for the record; those that alter log-probabilities (``top_k``, ...) are
            required.
    """

    reply_ids: Sequence[int]
    logprobs: Sequence[float] | None = None
    finish_reason: Literal["stop", "length", "abort"] = "stop"
    weight_version: str = ""
    prompt_ids: Sequence[int] | None = None
    sampling: dict[str, Any] = field(default_factory=dict)


Generate = Callable[[TokenRequest], Awaitable[Sampled]]


@dataclass(frozen=True)
class TokenRow:
    """A step as a training sample.

    Attributes:
        step: its number, from 0.
        prompt_ids: token ids, image tokens expanded.
        reply_ids: token ids that were sampled.
        logprobs: of ``reply_ids``; ``None`` if the engine gave none.
        weight_version: of the weights that sampled them.
        images: the pictures in the order of the prompt, encoded (PNG), at the size at which they were read.
        messages: of the request.
    """

    step: int
    prompt_ids: list[int]
    reply_ids: list[int]
    logprobs: list[float] | None
    weight_version: str
    images: tuple[bytes, ...]
    messages: tuple[Message, ...]

    def pixels(self, renderer: Renderer) -> Pixels | None:
        """The pictures as input of the vision tower; ``None`` if there are none.

        Args:
            renderer: of the model that the row is for.
        """
        refs = pictures_of(self.messages)
        images = {ref.screenshot: data for ref, data in zip(refs, self.images, strict=True)}
        return renderer.pixels(self.messages, images)


@dataclass(frozen=True)
class TokenRollout:
    """An episode as training samples.

    Attributes:
        task_id: of its task.
        reward: 1.0 or 0.0; ``None`` if there is none (blocked, or an error of environment, policy or judge):
            such an episode has no rows and must not count as 0.
        outcome: one of eight.
        rows: one per step that can be trained on.
        dropped: steps without a row, by reason: ``no_reward``, and :data:`~webgym.train.samples.DropReason`.
        failure: the error that ended the episode or prevented its verdict; ``None`` if there was none.
        trajectory: the whole record; ``None`` if the episode could not start, or a request could not be
            rendered.
        seconds: duration, wall time.
    """

    task_id: str
    reward: float | None
    outcome: Outcome
    rows: list[TokenRow]
    dropped: Counter[str]
    failure: Failure | None
    trajectory: Trajectory | None
    seconds: float


async def roll_out(
    env: Environment,
    generate: Generate,
    renderer: Renderer,
    *,
    task_id: str | None = None,
    policy: str = "external",
    cutoff_tokens: int = 16384,
    needs_logprobs: bool = False,
) -> TokenRollout:
    """Play one episode with an inference engine.

    Args:
        env: open, with ``on_fault="nan"``: an episode without a reward is a result here, not an error.
        generate: calls the engine. Its exceptions are passed on, and the episode is abandoned.
        renderer: with the model's tokenizer and image processor.
        task_id: the task; by default the environment's next.
        policy: its name, for the record.
        cutoff_tokens: most tokens of prompt and reply together; longer rows are dropped, never truncated.
        needs_logprobs: drop rows without log-probabilities of the distribution that was sampled from.

    Raises:
        ConfigError: there is no such task.
        UsageError: the environment is not open, or raises for faults.
    """
    if env.on_fault == "raise":
        raise UsageError("an episode without a reward is a result here", hint='make env with on_fault="nan"')
    started = time.monotonic()
    try:
        _, info = await env.reset(options={} if task_id is None else {"task_id": task_id})
    except UsageError:
        raise
    except WebGymError as error:
        return _failed(task_id or "", error, 0, started)
    requests: list[TokenRequest] = []
    try:
        while not info["is_over"]:
            try:
                request = await asyncio.to_thread(_request, env.episode_id, info, renderer)
            except PolicyError as error:  # a renderer of another kind than ours
                await env.abandon()
                return _failed(info["task_id"], error, len(requests), started)
            requests.append(request)
            sampled = await generate(requests[-1])
            _, _, _, _, info = await env.step(_reply(requests[-1], sampled, renderer, policy))
    except BaseException:
        await env.abandon()
        raise
    trajectory: Trajectory = info["trajectory"]
    reward = trajectory.outcome.reward
    rows: list[TokenRow] = []
    dropped: Counter[str] = Counter(no_reward=len(trajectory.episode.steps))
    if reward is not None:
        maker = SampleMaker(renderer, cutoff_tokens=cutoff_tokens, off_policy=needs_logprobs)
        rows = await asyncio.to_thread(_rows, trajectory, requests, maker)
        dropped = Counter(maker.dropped)
    return TokenRollout(
        trajectory.episode.task_id,
        reward,
        trajectory.outcome,
        rows,
        dropped,
        trajectory.episode.failure or trajectory.judge_failure,
        trajectory,
        time.monotonic() - started,
    )


def _failed(task_id: str, error: WebGymError, steps: int, started: float) -> TokenRollout:
    """An episode that ended by an error before it could be judged."""
    failure, seconds = Failure(error.code, error.message), time.monotonic() - started
    dropped = Counter(no_reward=steps) if steps else Counter[str]()
    return TokenRollout(
        task_id, None, outcome_of(ending_of(error), None), [], dropped, failure, None, seconds
    )


def _request(episode_id: str, info: dict[str, Any], renderer: Renderer) -> TokenRequest:
    messages, images = info["messages"], info["images"]
    short = renderer.short_prompt_ids(messages)
    prompt_ids = renderer.expanded(short, renderer.image_tokens(messages))
    shown_images = tuple(images[ref.screenshot] for ref in pictures_of(messages))
    return TokenRequest(episode_id, prompt_ids, short, shown_images, messages)


def _reply(request: TokenRequest, sampled: Sampled, renderer: Renderer, policy: str) -> Reply:
    prompt_ids = request.prompt_ids if sampled.prompt_ids is None else sampled.prompt_ids
    return Reply(
        renderer.decode(sampled.reply_ids),
        policy=policy,
        finish_reason=sampled.finish_reason if len(sampled.reply_ids) else "abort",
        sampling=sampled.sampling,
        prompt_tokens=len(request.prompt_ids),
        completion_tokens=len(sampled.reply_ids),
        tokens=ReplyTokens.of(prompt_ids, sampled.reply_ids, sampled.logprobs),
        weight_version=sampled.weight_version,
    )


def _rows(trajectory: Trajectory, requests: Sequence[TokenRequest], maker: SampleMaker) -> list[TokenRow]:
    rows = []
    for step, request in zip(trajectory.episode.steps, requests, strict=True):
        for sample in maker.make([(step, 1.0)], picture=_no_picture):
            logprobs = None if sample.logprobs is None else sample.logprobs.tolist()
            rows.append(
                TokenRow(
                    step.index,
                    sample.prompt_ids.tolist(),
                    sample.reply_ids.tolist(),
                    logprobs,
                    sample.version,
                    request.images,
                    request.messages,
                )
            )
    return rows


def _no_picture(name: str) -> bytes:
    raise AssertionError(f"rows hold their pictures; {name} must not be looked up")
