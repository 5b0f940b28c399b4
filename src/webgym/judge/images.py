"""Screenshots in requests to a judge model: scaled and encoded."""

from __future__ import annotations

import base64
import io
import math

from PIL import Image

from webgym.core.errors import JudgeError
from webgym.judge.config import PIXELS_PER_TOKEN, ImageConfig

MAX_BYTES = 1_500_000
"""Size in bytes; a screenshot whose PNG is larger is sent as JPEG."""

JPEG_QUALITY = 85
"""Quality of those JPEG images, 1 to 95."""


def sent_size(size: tuple[int, int], config: ImageConfig) -> tuple[int, int]:
    """Width and height, pixels, at which a screenshot of this size is sent."""
    scale = min(1.0, config.max_side / max(1, *size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def tokens_of(size: tuple[int, int], config: ImageConfig) -> int:
    """Estimated tokens of a screenshot of this size (width and height, pixels) in a request."""
    width, height = sent_size(size, config)
    return math.ceil(width * height / PIXELS_PER_TOKEN)


def data_url(name: str, data: bytes, config: ImageConfig) -> str:
    """A screenshot as a ``data:`` URL, scaled down and compressed as the settings say. Takes milliseconds of
    CPU.

    The same screenshot gives the same URL, so that replies can be cached.

    Raises:
        JudgeError: the bytes cannot be read as an image.
    """
    kind = "png"
    try:
        with Image.open(io.BytesIO(data)) as picture:
            picture.load()  # also of one that is sent as it is: it may be cut off
            size = sent_size(picture.size, config)
            if size != picture.size or picture.format != "PNG" or len(data) > MAX_BYTES:
                small = picture.convert("RGB")
                if size != picture.size:
                    small = small.resize(size, Image.Resampling.LANCZOS)
                data = _encoded(small, "PNG")
                if len(data) > MAX_BYTES:
                    data, kind = _encoded(small, "JPEG", quality=JPEG_QUALITY), "jpeg"
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise JudgeError(f"the screenshot {name[:12]} cannot be read as an image: {error}") from error
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _encoded(picture: Image.Image, kind: str, **options: int) -> bytes:
    out = io.BytesIO()
    picture.save(out, kind, **options)
    return out.getvalue()
