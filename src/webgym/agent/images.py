"""Pictures on their way to a model: their size and their kind."""

from __future__ import annotations

import io

from PIL import Image, UnidentifiedImageError

from webgym.core.errors import ProtocolError

_SIGNATURES = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}


def media_type(data: bytes) -> str:
    """``image/png``, ``image/jpeg`` or ``image/webp``, by the first bytes.

    Raises:
        ProtocolError: it is none of them.
    """
    for signature, found in _SIGNATURES.items():
        if data.startswith(signature):
            return found
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "image/webp"
    raise ProtocolError("a screenshot is no PNG, JPEG or WebP picture", hint="is the server up to date?")


def fitted_size(size: tuple[int, int], max_side: int | None) -> tuple[int, int]:
    """The size, in pixels, at which a picture is sent: its own, or scaled down to ``max_side``."""
    width, height = size
    longest = max(width, height)
    if max_side is None or longest <= max_side:
        return size
    return max(1, round(width * max_side / longest)), max(1, round(height * max_side / longest))


def fit(data: bytes, max_side: int) -> bytes:
    """The picture itself if it fits, else a PNG of it at its fitted size. Takes milliseconds of CPU.

    Raises:
        ProtocolError: the bytes are no picture.
    """
    try:
        with Image.open(io.BytesIO(data)) as picture:
            size = fitted_size(picture.size, max_side)
            if size == picture.size:
                return data
            out = io.BytesIO()
            picture.convert("RGB").resize(size, Image.Resampling.LANCZOS).save(out, "PNG", compress_level=1)
    except (UnidentifiedImageError, OSError) as error:
        hint = "is the server up to date?"
        raise ProtocolError("a screenshot is no picture that can be read", hint=hint) from error
    return out.getvalue()
