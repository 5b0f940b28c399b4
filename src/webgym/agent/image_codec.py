"""Resizes pictures for a model and detects their media type."""

from __future__ import annotations

import io

from PIL import Image, UnidentifiedImageError

from webgym.agent.image_sizing import Size
from webgym.core.errors import ProtocolError

_SIGNATURES = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}


def media_type(data: bytes) -> str:
    """``image/png``, ``image/jpeg`` or ``image/webp``, by the first bytes.

    Raises:
        ProtocolError: the data is none of these formats.
    """
    for signature, kind in _SIGNATURES.items():
        if data.startswith(signature):
            return kind
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "image/webp"
    raise ProtocolError("a screenshot is not a PNG, JPEG or WebP image", hint="is the server up to date?")


def fit(data: bytes, size: Size) -> bytes:
    """The data unchanged if the picture has this size, else a PNG of it at this size. Takes milliseconds of
    CPU.

    Bicubic, as the processors of vision-language models resize. Equal pictures give equal bytes, so that a
    sent picture can be reproduced from the stored one.

    Raises:
        ProtocolError: the data cannot be read as a picture.
    """
    try:
        with Image.open(io.BytesIO(data)) as picture:
            if size == picture.size:
                return data
            out = io.BytesIO()
            picture.convert("RGB").resize(size, Image.Resampling.BICUBIC).save(out, "PNG", compress_level=1)
    except (UnidentifiedImageError, OSError) as error:
        hint = "is the server up to date?"
        raise ProtocolError("a screenshot cannot be read as an image", hint=hint) from error
    return out.getvalue()
