"""Pictures of pages: as arrays of pixels, and whether a page still looks as in its last one.

To read the PNGs that Chromium writes, and to write such ones, takes 1 to 4 ms of CPU each for a usual
viewport. Pillow, which filters and compresses more, takes 40.
"""

from __future__ import annotations

import asyncio
import base64
import io
import itertools
import struct
import zlib
from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray
from PIL import Image

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import CdpMessage, EmptyReply

Pixels: TypeAlias = NDArray[np.uint8]
"""``(height, width, 3)``: red, green, blue."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = struct.Struct(">IIBBBBB")
_RGB = (8, 2)
"""Bits of a channel, and the type of colour."""

_UP = 2
"""The filter of a line that holds the differences from the line above it."""

_LEVEL = 1


def decode(picture: bytes) -> Pixels:
    """The pixels of a picture, PNG or JPEG."""
    chunks = dict(_chunks(picture)) if picture.startswith(_SIGNATURE) else {b"IHDR": bytes(_HEADER.size)}
    width, height, *colour = _HEADER.unpack(chunks[b"IHDR"])[:4]
    if tuple(colour) == _RGB:
        lines = np.frombuffer(isal_zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, -1)
        if (lines[:, 0] == _UP).all():
            pixels = lines[:, 1:].copy()
            for above, line in itertools.pairwise(pixels):
                line += above
            return pixels.reshape(height, width, 3)
    return np.array(Image.open(io.BytesIO(picture)).convert("RGB"))


def encode(pixels: Pixels, quality: int | None = None) -> bytes:
    """A PNG of these pixels, equal for equal pixels; or a JPEG of this quality, 1 to 100."""
    if quality is not None:
        jpeg = io.BytesIO()
        Image.fromarray(pixels).save(jpeg, "JPEG", quality=quality)
        return jpeg.getvalue()
    height, width, _ = pixels.shape
    flat = pixels.reshape(height, -1)
    lines = np.empty((height, flat.shape[1] + 1), np.uint8)
    lines[:, 0] = _UP
    lines[0, 1:] = flat[0]
    np.subtract(flat[1:], flat[:-1], out=lines[1:, 1:])
    header = _HEADER.pack(width, height, *_RGB, 0, 0, 0)
    content = isal_zlib.compress(lines, _LEVEL)
    return b"".join([_SIGNATURE, _chunk(b"IHDR", header), _chunk(b"IDAT", content), _chunk(b"IEND", b"")])


def white(size: tuple[int, int], quality: int | None = None) -> bytes:
    """A white picture of this width and height."""
    return encode(np.full((size[1], size[0], 3), 255, np.uint8), quality)


def _chunks(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The content of a PNG by type, chunks of one type that follow each other joined."""
    at, parts = len(_SIGNATURE), []
    while at < len(png):
        length, kind = struct.unpack_from(">I4s", png, at)
        parts.append((kind, png[at + 8 : at + 8 + length]))
        at += 12 + length
    for kind, some in itertools.groupby(parts, key=lambda part: part[0]):
        yield kind, b"".join(data for _, data in some)


def _chunk(kind: bytes, data: bytes) -> bytes:
    checksum = zlib.crc32(data, zlib.crc32(kind))
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", checksum)


# --- whether a page still looks as in its last picture ------------------------------------------------

_OWN = 1
"""Frames that a request for a picture paints itself, before it is answered."""

_MOST_FRAMES = 10
"""Frames since a picture after which no more are reported until the next one."""

_RESTLESS = 2
"""Pictures in a row after which a page painted that often: it is never still."""

_UNASKED = 20
"""Pictures without reports after that."""

_MOST_BYTES = 2 * 1024**2
"""Bytes of pictures that are looked through for one step, which costs about a fifth of a new picture."""

_GIF_FRAME = b"\x21\xf9\x04"


class _Resource(CdpMessage, frozen=True):
    url: str
    type: str
    mime_type: str
    content_size: float = 0.0


class _Frame(CdpMessage, frozen=True):
    id: str


class _FrameResources(CdpMessage, frozen=True):
    frame: _Frame
    resources: tuple[_Resource, ...]
    child_frames: tuple[_FrameResources, ...] = ()


class _ResourceTree(CdpMessage, frozen=True):
    frame_tree: _FrameResources


class _Content(CdpMessage, frozen=True):
    content: str
    base64_encoded: bool


class Stillness:
    """Whether a page still looks as in its last picture. A new one is most of what a step costs.

    Chromium reports every frame in which a page's main thread paints (``LayerTree``): a style of the mouse, a
    canvas, a rule of a style sheet that a script changed, and nothing where the picture stays the same. It
    does not report what its compositor draws alone. Animations, films and the like are asked for in the page
    (``scripts/early.js``); whether pictures move is told by their bytes.

    Args:
        session: the page's session.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._frames = 0
        """Painted since the last picture was asked for."""
        self.has_painted = asyncio.Event()
        """Set when more is painted than the last picture takes."""
        self._restless = 0
        """Pictures in a row after which it painted that often."""
        self._unasked = 0
        """Pictures for which frames are not reported, which is work: the page is never still."""
        self._picture: tuple[str, bytes] | None = None
        """The last picture, and the loader of the document that it shows; ``None`` if it may be another."""
        self._still: set[str] = set()
        """Addresses of pictures that do not move."""
        session.on("LayerTree.layerTreeDidChange", EmptyReply, self._on_painted)

    def begin_picture(self) -> None:
        """A picture is about to be asked for."""
        self.forget()
        self._restless = self._restless + 1 if self._frames >= _MOST_FRAMES else 0
        if self._restless == _RESTLESS:
            self._unasked, self._restless = _UNASKED, 0
        self._frames = 0
        self.has_painted.clear()
        if self._unasked:
            self._unasked -= 1
        else:
            self._session.send("LayerTree.enable")

    def end_picture(self, loader: str, picture: bytes) -> None:
        """The picture has come; it was asked for when this loader's document was shown. One for which nothing
        was painted, or more than it takes, may show another state."""
        self._picture = (loader, picture) if self._frames == _OWN else None

    def forget(self) -> None:
        """The last picture is of no use any more."""
        self._picture = None

    def picture_of(self, loader: str) -> bytes | None:
        """The last picture, if this document has painted nothing since, as far as was reported."""
        if self._picture is None or self._picture[0] != loader or self._frames != _OWN:
            return None
        return self._picture[1]

    def _on_painted(self, _: EmptyReply) -> None:
        self._frames += 1
        if self._frames > _OWN:
            self.has_painted.set()
        if self._frames == _MOST_FRAMES:
            self._session.send("LayerTree.disable")

    async def has_still_pictures(self, seconds: float) -> bool:
        """Whether no picture in the page moves. Of many large ones that is not known at once.

        Args:
            seconds: deadline of each question.

        Raises:
            CommandFailed, BrowserError: the page is gone, or does not answer.
        """
        tree = await self._session.call("Page.getResourceTree", reply=_ResourceTree, seconds=seconds)
        left = _MOST_BYTES
        for frame, resource in _pictures(tree.frame_tree):
            if resource.url in self._still:
                continue
            left -= int(resource.content_size)
            if left < 0:
                return False
            params = {"frameId": frame, "url": resource.url}
            found = await self._session.call(
                "Page.getResourceContent", params, reply=_Content, seconds=seconds
            )
            if not found.base64_encoded or may_move(base64.b64decode(found.content)):
                return False
            self._still.add(resource.url)
        return True


def _pictures(tree: _FrameResources) -> Iterator[tuple[str, _Resource]]:
    """The pictures of a frame and those below it. What moves in an SVG is painted by the main thread."""
    for resource in tree.resources:
        if resource.type == "Image" and not resource.mime_type.startswith("image/svg"):
            yield tree.frame.id, resource
    for child in tree.child_frames:
        yield from _pictures(child)


def may_move(picture: bytes) -> bool:
    """Whether a picture of the web may have several frames: ``True`` if its format is not known."""
    if picture.startswith(b"GIF8"):
        return picture.count(_GIF_FRAME) > 1
    if picture.startswith(b"\x89PNG"):
        return b"acTL" in picture
    if picture.startswith(b"RIFF") and picture[8:12] == b"WEBP":
        return picture[12:16] == b"VP8X" and bool(picture[20] & 2)
    if picture[4:8] == b"ftyp":
        return b"avis" in picture[8:64]
    return not picture.startswith((b"\xff\xd8\xff", b"BM", b"\0\0\1\0"))
