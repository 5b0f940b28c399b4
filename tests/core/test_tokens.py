"""Token ids survive the record, and stay small."""

from __future__ import annotations

import base64
import json
import zlib

import msgspec
import numpy as np
import pytest

from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import Reply

PROMPT = [151644, *[151655] * 3840, 198, 0]
REPLY = [9906, 11, 151645]
LOGPROBS = [-0.25, -1.5, -0.001]


def test_a_record_gives_back_the_tokens_that_went_in() -> None:
    tokens = ReplyTokens.of(PROMPT, REPLY, LOGPROBS)
    record = msgspec.json.encode(Reply("Hello", policy="tiny", tokens=tokens, weight_version="3"))
    back = msgspec.json.decode(record, type=Reply)
    assert back.tokens is not None
    assert back.tokens.prompt_ids == PROMPT
    assert back.tokens.reply_ids == REPLY
    assert back.tokens.reply_logprobs == [float(np.float32(value)) for value in LOGPROBS]
    assert back.weight_version == "3"
    assert len(record) < 400


def test_tokens_are_readable_without_our_code() -> None:
    record = json.loads(msgspec.json.encode(ReplyTokens.of(PROMPT, REPLY, LOGPROBS)))
    ids = np.frombuffer(zlib.decompress(base64.b64decode(record["prompt"])), "<i4")
    assert ids.tolist() == PROMPT
    assert np.frombuffer(zlib.decompress(base64.b64decode(record["logprobs"])), "<f4") == pytest.approx(
        LOGPROBS
    )


def test_a_reply_needs_a_log_probability_for_each_token_or_none_at_all() -> None:
    assert ReplyTokens.of(PROMPT, REPLY).reply_logprobs is None
    with pytest.raises(ValueError, match="2 log-probabilities for 3"):
        ReplyTokens.of(PROMPT, REPLY, LOGPROBS[:2])
