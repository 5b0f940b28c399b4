"""A self-test that a served model processes a known screenshot like the trainer.

With every update the learner saves the weights' reply to a fixed request: the likeliest tokens and their
log-probabilities (``selftest.json`` next to the weights). After every publication the served model gets the
same request. It must read the same tokens and give the same reply, as nearly as it did with the weights that
learning started from (:func:`tolerance_of`): it rounds no worse since. And its reply must have changed as the
learner's did. Either fails if the new weights are not in use or a part of them is stale, for example because
of a stale cache, a packed copy of a layer or an adapter that was not applied.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
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
"""Largest accepted mean difference of log-probabilities, in nats, for any server. Most compute logits in
bfloat16: those from 16 to 32 are multiples of 1/8, and kernels that sum in another order may differ by a step
or two. Wrongly processed pictures differ by whole nats."""

EXACT_TOLERANCE: Final = 0.01
"""The same if both sides compute in float32 in this process."""

_ROUNDING: Final = (3, 0.05)
"""How many times its distance at the start a server may have later, and the distance that it always may have,
in nats, if it or the learner rounds to bfloat16."""
_EXACT_ROUNDING: Final = (10, 1e-4)
"""The same if both compute in float32, where only the order of sums differs: by 4e-7 for vLLM and the tiny
policy, of which a single stale matrix makes 1e-4 to 2e-3."""
_EXACT_AT_START: Final = 1e-3
"""Largest distance at the start of a server that computes in float32."""

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
        first: reply of the weights that learning started from; ``None`` in tests of older versions.
        since: version of the weights before the update; empty if unknown.
    """

    prompt_ids: list[int]
    image_id: int
    after: Greedy
    before: Greedy
    certain: str
    is_exact: bool
    picture: bytes
    first: Greedy | None = None
    since: str = ""

    def request(self) -> tuple[tuple[Message, ...], dict[str, bytes]]:
        """The request, as :func:`known_request` gives it, with the picture of the test."""
        return known_messages(), {_NAME: self.picture}

    @property
    def moved(self) -> float:
        """How far the update changed the learner's reply, nats per token."""
        return distance(self.after, self.before.ids, self.before.logprobs)


def known_messages() -> tuple[Message, ...]:
    """The request, the same for every model."""
    return (Message("user", (ImageRef(_NAME, *_SIZE), TextPart(_TEXT))),)


def known_request() -> tuple[tuple[Message, ...], dict[str, bytes]]:
    """Messages and pictures, as :meth:`webgym.agent.openai_policy.OpenAIPolicy.ask` takes them."""
    return known_messages(), {_NAME: known_picture()}


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


def tolerance_of(test: SelfTest, expected: Greedy | None, reply: Reply) -> float:
    """The largest accepted distance of a server's replies, nats per token.

    Args:
        test: of weights of the training.
        expected: reply of weights that the server has certainly loaded, as those of its start; ``None`` if
            unknown.
        reply: the server's reply with them.
    """
    if expected is None or reply.tokens is None or reply.tokens.reply_logprobs is None:
        return TOLERANCE
    off = distance(expected, reply.tokens.reply_ids, reply.tokens.reply_logprobs)
    times, least = _EXACT_ROUNDING if test.is_exact and off <= _EXACT_AT_START else _ROUNDING
    return min(TOLERANCE, max(least, times * off))


def check(
    test: SelfTest, reply: Reply, *, tolerance: float = TOLERANCE, earlier: Reply | None = None
) -> None:
    """Check the served model's reply to the self-test's request.

    Args:
        test: of the weights that were published.
        reply: the served model's greedy reply.
        tolerance: largest accepted distance, nats per token.
        earlier: the same server's reply with the weights before the update (``since``); ``None`` if it had
            others, as where a stopped training goes on with a server that has just started.

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
    off = distance(test.after, ids, logprobs)
    if off > tolerance / 10 and distance(test.before, ids, logprobs) < off / 2:
        raise _failure("replies as before the update: the new weights are not in use")
    if not off <= tolerance:  # also fails for NaN
        raise _failure(f"is off by {off:.3g} nats per token, {tolerance:g} are allowed")
    if earlier is not None:
        _check_change(test, earlier, reply, tolerance)


def _check_change(test: SelfTest, earlier: Reply, reply: Reply, tolerance: float) -> None:
    """Check that the server's reply changed as the learner's did, which a constant difference does not hide.

    Raises:
        PublishError: it did not.
    """
    if earlier.tokens == reply.tokens and test.moved > _MOVED:
        raise _failure("gives exactly the same reply as before: the new weights are not in use")
    before, after = _errors(test.before, earlier), _errors(test.after, reply)
    if before is None or after is None or _mean(before) > TOLERANCE:  # it had other weights, of its own
        return
    off = _mean([now - then for now, then in zip(after, before, strict=False)])
    if off > tolerance:
        raise _failure(
            f"changed otherwise than the learner, by {off:.3g} nats per token where that changed by "
            f"{test.moved:.3g}: a part of its weights is stale"
        )


def check_checksums(
    test: SelfTest, before: Mapping[str, Mapping[str, str]], after: Mapping[str, Mapping[str, str]]
) -> None:
    """Check a server's checksums of its weights before and after a publication, by worker and name.

    Raises:
        PublishError: a worker still has the old weights, or copies of the weights differ.
    """
    copies: dict[str, Mapping[str, str]] = {}
    for worker, checksums in after.items():
        if checksums == before.get(worker) and test.moved > _MOVED:
            raise _failure(f"has the same weights as before, by the checksums of its worker {worker}")
        copy = copies.setdefault(
            worker.partition(":")[2], checksums
        )  # what follows the copy's number, "dp1:"
        if stale := sorted(name for name in checksums if checksums[name] != copy.get(name)):
            raise _failure(f"has copies of {stale[0]} that differ, by the checksums of its worker {worker}")


def distance(expected: Greedy, ids: Sequence[int], logprobs: Sequence[float]) -> float:
    """Mean difference of log-probabilities up to the first different token, nats per token.

    Infinite if the different token is no near tie, or if one reply is longer than the other.
    """
    errors = _differences(expected, ids, logprobs)
    return _mean(errors) if errors else float("inf")


def _errors(expected: Greedy, reply: Reply) -> list[float] | None:
    """The differences of a server's log-probabilities; ``None`` if they cannot be compared."""
    if reply.tokens is None or reply.tokens.reply_logprobs is None:
        return None
    return _differences(expected, reply.tokens.reply_ids, reply.tokens.reply_logprobs)


def _differences(expected: Greedy, ids: Sequence[int], logprobs: Sequence[float]) -> list[float] | None:
    """Differences of log-probabilities up to the first different token, with their signs; ``None`` if it is
    no near tie, or if one reply is longer than the other."""
    differences: list[float] = []
    places = zip(expected.ids, expected.logprobs, expected.margins, ids, logprobs, strict=False)
    for wanted, logprob, margin, got, got_logprob in places:
        if wanted != got:
            return [*differences, got_logprob - (logprob - margin)] if margin <= NEAR_TIE else None
        differences.append(got_logprob - logprob)
    return differences if differences and len(ids) == len(expected.ids) else None


def _mean(differences: Sequence[float]) -> float:
    return sum(map(abs, differences)) / len(differences)


def _before_expansion(ids: Sequence[int], image_id: int) -> list[int]:
    """The ids with each picture's tokens replaced by a single one."""
    return [token for token, run in groupby(ids) for _ in ([0] if token == image_id else list(run))]


def _failure(what: str) -> PublishError:
    return PublishError(
        f"the served model does not pass its self-test: it {what}",
        hint="what was collected and learned is kept; fix the server, then webgym train --resume",
    )
