"""Tokens without a tokenizer: a guess for plans, and a bound for budgets."""

from __future__ import annotations

import base64
import io
import math
import string
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from PIL import Image

_LETTERS: Final = (string.ascii_letters + " ").encode()
_OTHER_ASCII: Final = bytes(set(range(128)) - set(_LETTERS))
_PER_LETTER: Final = 0.21
_PER_MARK: Final = 0.55
_PER_FOREIGN_BYTE: Final = 0.30
_PER_MESSAGE: Final = 5
_TEMPLATE: Final = 100
"""For what a chat template says by itself."""

_USUAL_SIZE: Final = (1280, 768)
_PIXELS_PER_TOKEN: Final = 850
_FEWEST_PIXELS_PER_TOKEN: Final = 700
_LEAST_IMAGE: Final = 255
_HEADER_CHARS: Final = 65_536


def count_text(text: str) -> int:
    """About how many tokens a text is."""
    data = text.encode(errors="replace")
    letters = len(data) - len(data.translate(None, _LETTERS))
    marks = len(data) - len(data.translate(None, _OTHER_ASCII))
    foreign = len(data) - letters - marks
    return math.ceil(letters * _PER_LETTER + marks * _PER_MARK + foreign * _PER_FOREIGN_BYTE)


def count_messages(messages: Sequence[Mapping[str, Any]]) -> int:
    """About how many tokens messages are, pictures included."""
    total = 3
    for message in messages:
        total += _PER_MESSAGE
        content = message.get("content")
        if isinstance(content, str):
            total += count_text(content)
        for part in _parts(message):
            if isinstance(text := part.get("text"), str):
                total += count_text(text)
    return total + sum(
        math.ceil(width * height / _PIXELS_PER_TOKEN) for width, height, _ in _images(messages)
    )


def most_tokens(content: bytes, messages: Sequence[Mapping[str, Any]]) -> int:
    """More tokens than a request can have.

    A tokenizer that falls back to bytes never makes more tokens than there are bytes, and the request's
    JSON has more bytes than what a chat template makes of it.
    """
    images = list(_images(messages))
    text_bytes = len(content) - sum(chars for _, _, chars in images)
    return (
        _TEMPLATE
        + text_bytes
        + sum(
            _LEAST_IMAGE + math.ceil(width * height / _FEWEST_PIXELS_PER_TOKEN) for width, height, _ in images
        )
    )


def _parts(message: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    content = message.get("content")
    return content if isinstance(content, list) else []


def _images(messages: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, int, int]]:
    """Width, height and the length of the URL of each picture."""
    for message in messages:
        for part in _parts(message):
            image = part.get("image_url")
            url = image.get("url") if isinstance(image, dict) else None
            if isinstance(url, str):
                yield *_size(url), len(url)


def _size(url: str) -> tuple[int, int]:
    """Width and height of a picture; those of a usual screenshot if they cannot be seen."""
    if not url.startswith("data:"):
        return _USUAL_SIZE
    _, _, encoded = url.partition(",")
    try:
        with Image.open(io.BytesIO(base64.b64decode(encoded[:_HEADER_CHARS]))) as image:
            return image.size
    except (OSError, ValueError):
        return _USUAL_SIZE
