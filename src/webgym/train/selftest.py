"""A self-test: does the served model read a known screenshot as the trainer does?

With every update the learner saves what these weights make of a fixed request: the likeliest tokens and
their log-probabilities (``selftest.json`` beside the weights). After every publication the served model is
asked the same, and must have read the same tokens and give the same reply within :data:`TOLERANCE`. It must
also not be clearly nearer to what the weights before the update made of it, nor say to the last bit what it
said before the publication: an update that never arrived, a stale cache or an adapter that was loaded and
never applied all look like that.
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
"""Longest reply. Each costs the learner a forward pass over a short request."""

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
"""Laid over whatever replies are sampled with otherwise."""

TOLERANCE: Final = 0.25
"""Mean difference of log-probabilities, in nats. Logits are computed in bfloat16 by most servers: those from
16 to 32 are multiples of 1/8, and kernels that sum in another order land a step or two away. Weights that are
half another's, and pictures that are read wrong, are off by whole nats."""

EXACT_TOLERANCE: Final = 0.01
"""The same where both sides compute in float32: only the order of sums differs."""

NEAR_TIE: Final = 0.5
"""Two tokens as near as this, in nats, may change places within twice :data:`TOLERANCE`."""

_MOVED: Final = 1e-3
"""Where the learner's log-probabilities moved by more than this, in nats, a server's must have moved as well:
each hangs on the logits of all tokens."""

_SIZE: Final = (320, 256)
"""Of the picture: above Qwen3-VL's least size and a multiple of its 32 pixels, so that nobody resizes it."""

_NAME: Final = "selftest"
_TEXT: Final = "Name the heading of this page, its buttons and their colours."


class Greedy(msgspec.Struct, frozen=True):
    """The likeliest tokens, one after the other.

    Attributes:
        ids: of the reply.
        logprobs: of each, at temperature 1.
        margins: how far each is ahead of the runner-up, in nats.
    """

    ids: list[int]
    logprobs: list[float]
    margins: list[float]


class SelfTest(msgspec.Struct, frozen=True):
    """What a model must make of the known screenshot.

    Attributes:
        prompt_ids: of the request, image tokens expanded.
        image_id: of an image token.
        after: by these weights.
        before: by the weights that the update began with.
        certain: the text of the reply up to its first near tie, for servers that give no token ids.
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
    """The screenshot, a PNG: a page with a heading, text and buttons, drawn."""
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
    """The test of saved weights; ``None`` for weights that an update did not save.

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
    """Hold the served model's reply to the test's request against what it should be.

    Args:
        test: of the weights that were published.
        reply: the likeliest one, by the served model.
        is_exact: whether the server computes in float32.
        earlier: what the same server replied while it had other weights.

    Raises:
        PublishError: it is another's.
    """
    if reply.tokens is None:
        if not reply.text.startswith(test.certain):
            raise _other(f"says {reply.text[:40]!r} where {test.certain[:40]!r} is expected")
        return
    if _before_expansion(reply.tokens.prompt_ids, test.image_id) != _before_expansion(
        test.prompt_ids, test.image_id
    ):
        raise _other("reads other tokens than the trainer: is its chat template another?")
    given = reply.tokens.prompt_ids.count(test.image_id)
    expected = test.prompt_ids.count(test.image_id)
    if given == 1:  # told before expansion; the count of the prompt is that after
        given = reply.prompt_tokens - len(reply.tokens.prompt_ids) + 1
    if given != expected:
        raise _other(f"reads the screenshot as {given} tokens where {expected} are expected")
    ids, logprobs = reply.tokens.reply_ids, reply.tokens.reply_logprobs
    if logprobs is None:
        raise _other("gives no log-probabilities")
    tolerance = EXACT_TOLERANCE if is_exact and test.is_exact else TOLERANCE
    off = distance(test.after, ids, logprobs)
    if not off <= tolerance:  # not a number is no pass
        raise _other(f"is off by {off:.3g} nats per token, {tolerance:g} are allowed")
    if off > tolerance / 10 and distance(test.before, ids, logprobs) < off / 2:
        raise _other("reads it as before the update: the new weights did not arrive")
    moved = distance(test.after, test.before.ids, test.before.logprobs)
    if earlier is not None and earlier.tokens == reply.tokens and moved > _MOVED:
        raise _other("says to the last bit what it said before: the new weights did not arrive")


def distance(expected: Greedy, ids: Sequence[int], logprobs: Sequence[float]) -> float:
    """Mean difference of log-probabilities up to the first other token, nats per token.

    Infinite where the other token is no near tie, or one reply goes on where the other ends.
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
    """The ids with every picture as one token."""
    return [token for token, run in groupby(ids) for _ in ([0] if token == image_id else list(run))]


def _other(what: str) -> PublishError:
    return PublishError(
        f"the served model does not pass its self-test: it {what}",
        hint="what was collected and learned is kept; fix the server, then webgym train --resume",
    )
