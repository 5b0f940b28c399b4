"""Turns stored steps into training samples: the token ids read and sampled, and the pictures' pixels.

The target is the sampled reply. Tokens that the endpoint reported are used unchanged and checked against the
record: the number of image tokens must match the pictures, and the decoded reply must equal the stored one.
Otherwise the request is rendered from its messages and the stored reply is tokenized:

- reasoning that the endpoint had split off is put back, in the chat template's form;
- a reply that the model ended gets the end token; one that was cut off at the token limit gets none;
- if the tokens cannot be known (a stop string was removed, a tool call was parsed, the request had parameters
  of the chat template), the step is dropped.

A step that is longer than the limit is dropped, not truncated. All drops are counted by reason.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal, TypeAlias

import torch

from webgym.agent.image_codec import fit
from webgym.core.errors import PolicyError
from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import Message, Reply, Step, was_cut_off
from webgym.inference.rendering import THINK_END, THINK_START, Pixels, Renderer, pictures_of
from webgym.llm.config import altering

DropReason: TypeAlias = Literal[
    "no_request",  # an image placeholder in a text, so that text and pictures do not match
    "too_long",  # longer than the limit
    "image_tokens",  # stored ids whose image tokens do not match the pictures
    "reply_text",  # stored ids that do not decode to the stored reply
    "reply_end",  # stored ids whose end contradicts the finish reason
    "not_rebuilt",  # no stored ids, and those read or sampled cannot be known
    "image_in_reply",  # an image token in the reply, without a picture
    "no_logprobs",  # the endpoint reported no log-probabilities, which the objective needs, or no numbers
    "altered_sampling",  # top-k, a penalty, ...: the log-probabilities are not the model's
]


class UntrainableStep(Exception):
    """A step cannot be trained on. Caught within this package, which counts such steps."""

    def __init__(self, reason: DropReason) -> None:
        super().__init__(reason)
        self.reason: DropReason = reason


@dataclass(frozen=True, slots=True)
class Sample:
    """A training sample of a step. Its pixels are computed on demand.

    Attributes:
        prompt_ids: (prompt), int32, image tokens expanded.
        reply_ids: (reply), int32, the end token included if it was sampled.
        logprobs: (reply), float32, when sampled; ``None`` if the endpoint gave none.
        temperature: that the reply was sampled with.
        version: of the weights that replied; empty if unknown.
        messages: of the request.
        picture: reads a stored screenshot by its name.
        advantage: from the objective.
        trajectory: a name that the steps of its trajectory share; empty if unknown.
    """

    prompt_ids: torch.Tensor
    reply_ids: torch.Tensor
    logprobs: torch.Tensor | None
    temperature: float
    version: str
    messages: tuple[Message, ...]
    picture: Callable[[str], bytes]
    advantage: float = 1.0
    trajectory: str = ""

    def __len__(self) -> int:
        return len(self.prompt_ids) + len(self.reply_ids)

    def pixels(self, renderer: Renderer) -> Pixels | None:
        """The pictures, resized as in the request."""
        refs = pictures_of(self.messages)
        sizes = {ref.screenshot: (ref.width, ref.height) for ref in refs}
        images = {name: fit(self.picture(name), size) for name, size in sizes.items()}
        return renderer.pixels(self.messages, images)


class SampleMaker:
    """Makes samples from steps, and counts dropped steps.

    Args:
        renderer: of the model that is trained.
        cutoff_tokens: most tokens of request and reply together.
        off_policy: whether the objective needs the log-probabilities of the behaviour policy.

    Attributes:
        dropped: number of dropped steps, by reason.
        rebuilt: number of samples made from messages, because no tokens were stored.
        stored: number of samples made from stored tokens.
    """

    def __init__(self, renderer: Renderer, *, cutoff_tokens: int = 16384, off_policy: bool = False) -> None:
        self._renderer = renderer
        self._cutoff = cutoff_tokens
        self._off_policy = off_policy
        self.dropped: Counter[DropReason] = Counter()
        self.rebuilt = 0
        self.stored = 0

    def make(self, steps: Iterable[tuple[Step, float]], picture: Callable[[str], bytes]) -> Iterator[Sample]:
        """The samples of those steps that can be trained on.

        Args:
            steps: with their advantages.
            picture: reads a stored screenshot by its name, e.g. ``RunReader(run).image``.
        """
        for step, advantage in steps:
            try:
                yield self.of(step, picture, advantage)
            except UntrainableStep as dropped:
                self.dropped[dropped.reason] += 1

    def of(self, step: Step, picture: Callable[[str], bytes], advantage: float = 1.0) -> Sample:
        """The sample of one step.

        Raises:
            UntrainableStep: it cannot be trained on.
        """
        tokens = step.reply.tokens
        if self._off_policy:
            _check_logprobs(step.reply)
        prompt_ids = self._stored_prompt(step, tokens) if tokens else self._rendered_prompt(step)
        if tokens:
            reply_ids = self._stored_reply(step.reply, tokens)
        else:
            reply_ids = rebuild_reply(self._renderer, step.reply, prompt_ids)
        if self._renderer.image_id in reply_ids:
            raise UntrainableStep("image_in_reply")
        if len(prompt_ids) + len(reply_ids) > self._cutoff:
            raise UntrainableStep("too_long")
        self.stored += tokens is not None
        self.rebuilt += tokens is None
        logprobs = tokens.reply_logprobs if tokens else None
        return Sample(
            torch.tensor(prompt_ids, dtype=torch.int32),
            torch.tensor(reply_ids, dtype=torch.int32),
            None if logprobs is None else torch.tensor(logprobs, dtype=torch.float32),
            temperature_of(step.reply),
            step.reply.weight_version,
            step.messages,
            picture,
            advantage,
        )

    def _stored_prompt(self, step: Step, tokens: ReplyTokens) -> list[int]:
        ids, expected = tokens.prompt_ids, self._renderer.image_tokens(step.messages)
        runs = [len(list(run)) for is_image, run in groupby(self._renderer.image_mask(ids)) if is_image]
        if runs == expected:
            return ids
        if runs == [1] * len(expected):  # reported before the expansion of images; check the expanded length
            expanded = self._renderer.expanded(ids, expected)
            if step.reply.prompt_tokens == len(expanded):
                return expanded
        raise UntrainableStep("image_tokens")

    def _rendered_prompt(self, step: Step) -> list[int]:
        if any(map(step.reply.sampling.get, ("chat_template_kwargs", "chat_template", "tools"))):
            raise UntrainableStep("not_rebuilt")
        try:
            return self._renderer.prompt_ids(step.messages)
        except PolicyError as error:
            raise UntrainableStep("no_request") from error

    def _stored_reply(self, reply: Reply, tokens: ReplyTokens) -> list[int]:
        ids = tokens.reply_ids
        if not ids or not _reads_as(reply, self._renderer.decode(ids)):
            raise UntrainableStep("reply_text")
        ended = ids[-1] in self._renderer.end_ids
        if ended == was_cut_off(reply.finish_reason) and not _stop_strings(reply):
            raise UntrainableStep("reply_end")
        return ids


def rebuild_reply(renderer: Renderer, reply: Reply, prompt_ids: Sequence[int]) -> list[int]:
    """Reconstruct the sampled ids of a reply that was stored as text only.

    Args:
        renderer: of the model that replied.
        reply: as stored.
        prompt_ids: of its request; they show whether the chat template had opened the thinking.

    Raises:
        UntrainableStep: the ids cannot be determined from the text.
    """
    finished = reply.finish_reason == "stop"
    opened = renderer.opens_thinking(prompt_ids) if reply.reasoning or reply.separated else False
    if not (finished or was_cut_off(reply.finish_reason)) or _stop_strings(reply):
        raise UntrainableStep("not_rebuilt")
    text = reply.text
    if reply.reasoning:
        text = _with_reasoning(reply, opened=opened, finished=finished)
    elif opened:  # endpoints do not report how empty thinking was closed
        raise UntrainableStep("not_rebuilt")
    ids: list[int] = renderer.tokenizer(text, add_special_tokens=False)["input_ids"]
    ids = [*ids, renderer.tokenizer.eos_token_id] if finished else ids
    if not ids:
        raise UntrainableStep("not_rebuilt")
    return ids


def _with_reasoning(reply: Reply, *, opened: bool, finished: bool) -> str:
    start = "" if opened else f"{THINK_START}\n"
    if not reply.text:
        if finished:  # endpoints do not report whether the thinking was closed
            raise UntrainableStep("not_rebuilt")
        return start + reply.reasoning
    return start + reply.whole.removeprefix(f"{THINK_START}\n")


def _reads_as(reply: Reply, decoded: str) -> bool:
    """Whether sampled text equals a stored reply. White space may differ if reasoning was split off, and a
    blank at the start: servers decode replies in parts, and some tokenizers' words bring a blank."""
    if not reply.reasoning and (decoded == reply.text or not reply.separated):
        return decoded.removeprefix(" ") == reply.text.removeprefix(" ")
    reasoning, _, text = decoded.partition(THINK_END)
    return (
        reasoning.strip().removeprefix(THINK_START).strip() == reply.reasoning.strip()
        and text.strip() == reply.text.strip()
    )


def _stop_strings(reply: Reply) -> bool:
    """Whether a reply may have been ended, and shortened, by a stop string or stop token."""
    return bool(reply.sampling.get("stop") or reply.sampling.get("stop_token_ids"))


def temperature_of(reply: Reply) -> float:
    """The temperature that a reply was sampled with; endpoints use 1 by default."""
    return float(reply.sampling.get("temperature") or 1.0)


def _check_logprobs(reply: Reply) -> None:
    logprobs = None if reply.tokens is None else reply.tokens.reply_logprobs
    if logprobs is None or not all(map(math.isfinite, logprobs)):
        raise UntrainableStep("no_logprobs")
    if altering(reply.sampling) or reply.sampling.get("temperature") == 0:
        raise UntrainableStep("altered_sampling")
