from __future__ import annotations

import base64
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from webgym.llm.config import Sampling
from webgym.llm.request import Request
from webgym.llm.tokens import count_messages, count_text, most_tokens

# Counted with four tokenizers (o200k, cl100k, Qwen, DeepSeek): the fewest and the most tokens.
COUNTED = [
    ("", 0, 0),
    ("Find the cheapest flight from Boston to Lisbon on 12 March 2027 and name the airline.", 20, 23),
    ('{"fact_groups": [{"id": "1", "description": "Flight", "facts": ["price", "airline"]}]}', 27, 30),
]


@pytest.mark.parametrize(("text", "fewest", "most"), COUNTED)
def test_a_guess_is_near(text: str, fewest: int, most: int) -> None:
    assert 0.7 * fewest <= count_text(text) <= 1.3 * most


def picture(width: int, height: int, form: str) -> str:
    data = io.BytesIO()
    Image.effect_noise((width, height), 60).save(data, form)
    return f"data:image/{form.lower()};base64,{base64.b64encode(data.getvalue()).decode()}"


def message(*urls: str) -> dict[str, object]:
    images = [{"type": "image_url", "image_url": {"url": url}} for url in urls]
    return {"role": "user", "content": [{"type": "text", "text": "What is it?"}, *images]}


@pytest.mark.parametrize("form", ["PNG", "JPEG", "WEBP"])
def test_a_picture_counts_by_its_size(form: str) -> None:
    without = count_messages([message()])
    one = count_messages([message(picture(1280, 768, form))]) - without
    # 1,105 tokens by tiles, 1,242 and 960 by patches
    assert 0.85 * 1242 <= one <= 1.15 * 960
    assert count_messages([message(picture(640, 384, form))]) - without < one / 3


@pytest.mark.parametrize(
    "url", ["https://example.com/a.png", "data:image/png;base64,AAAA", "data:image/png", "data:,%"]
)
def test_a_picture_that_cannot_be_seen_counts_as_a_screenshot(url: str) -> None:
    assert count_messages([message(url)]) - count_messages([message()]) > 1000


def test_a_pictures_bytes_are_no_text() -> None:
    messages = [message(picture(1280, 768, "PNG"))]
    request = Request("http://x/v1", "m", messages, Sampling())
    assert len(request.content) > 500_000
    assert count_messages(messages) < most_tokens(request.content, messages) < 2200


@given(st.text())
def test_the_bound_is_above_every_byte(text: str) -> None:
    messages = [{"role": "user", "content": text.encode(errors="replace").decode()}]
    request = Request("http://x/v1", "m", messages, Sampling())
    assert most_tokens(request.content, messages) > len(text.encode(errors="replace"))
    assert (count_text(text) > 0) == bool(text)
