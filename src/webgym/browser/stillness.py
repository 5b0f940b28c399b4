"""Whether a page still looks as in its last picture: then a step needs no new one, which costs most of it.

Chromium reports every frame in which a page's main thread paints (``LayerTree``): a style of the mouse, a
canvas, a rule of a style sheet that a script changed, and nothing where the picture stays the same. It does
not report what its compositor draws alone. Animations, films and the like are asked for in the page
(``scripts/early.js``); whether pictures move is told here by their bytes.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import CdpMessage, EmptyReply

_OWN = 1
"""Frames that a request for a picture paints itself, before it is answered."""

_MOST_FRAMES = 30
"""Frames since a picture after which no more are reported until the next one: a page that is never still."""

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
    """What a page has painted since its last picture.

    Args:
        session: the page's session.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._frames = 0
        """Painted since the last picture was asked for."""
        self._loader: str | None = None
        """Loader of the document that the last picture shows; ``None`` if it may have changed meanwhile."""
        self._still: set[str] = set()
        """Addresses of pictures that do not move."""
        session.on("LayerTree.layerTreeDidChange", EmptyReply, self._on_painted)

    def begin_picture(self) -> None:
        """A picture is about to be asked for."""
        self._loader, self._frames = None, 0
        self._session.send("LayerTree.enable")

    def end_picture(self, loader: str) -> None:
        """The picture has come; it shows the document of this loader."""
        self._loader = loader if self._frames == _OWN else None

    def is_as_pictured(self, loader: str) -> bool:
        """Whether this document was pictured last and has painted nothing since, as far as was reported."""
        return self._loader == loader and self._frames == _OWN

    def _on_painted(self, _: EmptyReply) -> None:
        self._frames += 1
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
