"""A self-test that a served model processes a known screenshot like the trainer.

With every update the learner saves the weights' reply to a fixed request: the likeliest tokens and their
log-probabilities (``selftest.json`` next to the weights). After every publication the served model gets the
same request. It must read the same tokens and give the same reply within :data:`TOLERANCE`. Its reply must
also not be clearly nearer to that of the weights before the update, nor bitwise equal to the server's reply
before the
publication: both would mean that the new weights are not in use, for example because of a stale cache or an
adapter that was not applied.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

import msgspec
from PIL import Image, ImageDraw

from webgym.core.errors import PublishError
from webgym.core.trajectory import ImageRef, Message, Reply, TextPart
from webgym.llm.config import Sampling

SELFTEST: Final = "selftest.json"

REPLY_TOKENS: Final = 8
"""Most tokens of the reply. Each costs the learner a forward pass over a short request."""

GREEDY: Final = Sampling(
    temperature=0.0,
    top_p=1.0,
    max_tokens=REPLY_TOKENS,
    extra_body={
        "top_k": -1,
        "repetition_penalty": 1.0,
        "presence_penalty": None,
        "frequency_penalty": None,
        "logit_bias": None,
        "stop": None,
    },
)
"""Greedy sampling, which overrides the usual settings."""

TOLERANCE: Final = 0.25
"""Largest accepted mean difference of log-probabilities, in nats. Most servers compute logits in bfloat16:
those from 16 to 32 are multiples of 1/8, and kernels that sum in another order may differ by a step or two.
Partly loaded weights and wrongly processed pictures differ by whole nats."""

EXACT_TOLERANCE: Final = 0.01
"""The same if both sides compute in float32, where only the order of sums differs."""

NEAR_TIE: Final = 0.5
"""Two tokens whose log-probabilities differ by less than this, in nats, may swap their order."""

_MOVED: Final = 1e-3
"""If an update changed the learner's log-probabilities by more than this, in nats, the server's must change,
too."""

_SIZE: Final = (320, 256)
"""Size of the picture: above Qwen3-VL's minimum and a multiple of 32 pixels, so that it is not resized."""

_NAME: Final = "selftest"
_TEXT: Final = "Name the heading of this page, its buttons and their colours."


class Greedy(msgspec.Struct, frozen=True):
    """A greedily decoded reply.

    Attributes:
        ids: of the reply.
        logprobs: of each, at temperature 1.
        margins: of each over the second likeliest token, in nats.
    """

    ids: list[int]
    logprobs: list[float]
    margins: list[float]


class SelfTest(msgspec.Struct, frozen=True):
    """The known request, and the expected reply.

    Attributes:
        prompt_ids: of the request, image tokens expanded.
        image_id: of an image token.
        after: reply of these weights.
        before: reply of the weights before the update.
        certain: text of the reply up to its first near tie, for servers that report no token ids.
        is_exact: whether the learner computed in float32.
        picture: PNG.
    """

    prompt_ids: list[int]
    image_id: int
    after: Greedy
    before: Greedy
    certain: str
    is_exact: bool
    picture: bytes

    def request(self) -> tuple[tuple[Message, ...], dict[str, bytes]]:
        """Messages and pictures, as :meth:`webgym.agent.openai_policy.OpenAIPolicy.ask` takes them."""
        return known_messages(), {_NAME: self.picture}


def known_messages() -> tuple[Message, ...]:
    """The request, the same for every model."""
    return (Message("user", (ImageRef(_NAME, *_SIZE), TextPart(_TEXT))),)


def known_picture() -> bytes:
    """The screenshot, PNG: a drawing of a page with a heading, text and buttons."""
    picture = Image.new("RGB", _SIZE, "white")
    draw = ImageDraw.Draw(picture)
    draw.rectangle((0, 0, 319, 47), fill="#1f4e79")
    draw.rectangle((16, 16, 175, 31), fill="white")
    for line in range(4):
        draw.rectangle((16, 64 + 16 * line, 303 - 40 * line, 71 + 16 * line), fill="#666666")
    for place, colour in enumerate(("#c00000", "#2e8b57", "#ffbf00")):
        draw.rectangle((16 + 96 * place, 160, 95 + 96 * place, 207), fill=colour)
        draw.ellipse((44 + 96 * place, 172, 67 + 96 * place, 195), fill="white")
    data = io.BytesIO()
    picture.save(data, "PNG")
    return data.getvalue()


def read_selftest(weights: Path) -> SelfTest | None:
    """The self-test of saved weights; ``None`` for weights that no update saved.

    Raises:
        PublishError: it cannot be read.
    """
    try:
        return msgspec.json.decode((weights / SELFTEST).read_bytes(), type=SelfTest)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError) as error:
        raise PublishError(f"cannot read {weights / SELFTEST}: {error}") from error


def check(test: SelfTest, reply: Reply, *, is_exact: bool, earlier: Reply | None = None) -> None:
    """Check the served model's reply to the self-test's request.

    Args:
        test: of the weights that were published.
        reply: the served model's greedy reply.
        is_exact: whether the server computes in float32.
        earlier: the same server's reply with its previous weights.

    Raises:
        PublishError: the reply does not come from these weights.
    """
    if reply.tokens is None:
        if not reply.text.startswith(test.certain):
            raise _failure(f"says {reply.text[:40]!r} where {test.certain[:40]!r} is expected")
        return
    if _before_expansion(reply.tokens.prompt_ids, test.image_id) != _before_expansion(
        test.prompt_ids, test.image_id
    ):
        raise _failure("reads other tokens than the trainer: does its chat template differ?")
    image_tokens = reply.tokens.prompt_ids.count(test.image_id)
    expected_tokens = test.prompt_ids.count(test.image_id)
    if image_tokens == 1:  # reported before expansion; the prompt's length is that after it
        image_tokens = reply.prompt_tokens - len(reply.tokens.prompt_ids) + 1
    if image_tokens != expected_tokens:
        raise _failure(f"reads the screenshot as {image_tokens} tokens where {expected_tokens} are expected")
    ids, logprobs = reply.tokens.reply_ids, reply.tokens.reply_logprobs
    if logprobs is None:
        raise _failure("gives no log-probabilities")
    tolerance = EXACT_TOLERANCE if is_exact and test.is_exact else TOLERANCE
    off = distance(test.after, ids, logprobs)
    if not off <= tolerance:  # also fails for NaN
        raise _failure(f"is off by {off:.3g} nats per token, {tolerance:g} are allowed")
    if off > tolerance / 10 and distance(test.before, ids, logprobs) < off / 2:
        raise _failure("replies as before the update: the new weights are not in use")
    moved = distance(test.after, test.before.ids, test.before.logprobs)
    if earlier is not None and earlier.tokens == reply.tokens and moved > _MOVED:
        raise _failure("gives exactly the same reply as before: the new weights are not in use")


def distance(expected: Greedy, ids: Sequence[int], logprobs: Sequence[float]) -> float:
    """Mean difference of log-probabilities up to the first different token, nats per token.

    Infinite if the different token is no near tie, or if one reply is longer than the other.
    """
    differences: list[float] = []
    places = zip(expected.ids, expected.logprobs, expected.margins, ids, logprobs, strict=False)
    for wanted, logprob, margin, got, got_logprob in places:
        if wanted != got:
            if margin > NEAR_TIE:
                return float("inf")
            differences.append(abs(got_logprob - (logprob - margin)))
            break
        differences.append(abs(got_logprob - logprob))
    else:
        if len(ids) != len(expected.ids):
            return float("inf")
    return sum(differences) / len(differences) if differences else float("inf")


def _before_expansion(ids: Sequence[int], image_id: int) -> list[int]:
    """The ids with each picture's tokens replaced by a single one."""
    return [token for token, run in groupby(ids) for _ in ([0] if token == image_id else list(run))]


def _failure(what: str) -> PublishError:
    return PublishError(
        f"the served model does not pass its self-test: it {what}",
        hint="what was collected and learned is kept; fix the server, then webgym train --resume",
    )
