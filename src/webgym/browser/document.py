"""Reads a whole document, not only the part in the viewport."""

from __future__ import annotations

from typing import Any

import msgspec

from webgym.browser.observe import with_retries
from webgym.browser.page import Page

Box = tuple[float, float, float, float]

DOCUMENT_CHARACTERS = 1_000_000
"""Most characters, all texts together, when a whole document is read."""

DOCUMENT_ELEMENTS = 5_000
"""Most elements when a whole document is read."""


class ReadRequest(msgspec.Struct, frozen=True, omit_defaults=True):
    """Which parts of a document to read.

    Attributes:
        lines: number of lines of its text, empty lines counted but left out; 0 for no text.
        elements: whether to read its interactive elements, in view or not.
        meta: whether to read its metadata: ``<meta>`` elements, JSON-LD and microdata.
    """

    lines: int = 0
    elements: bool = False
    meta: bool = False


class DocumentElement(msgspec.Struct, frozen=True, omit_defaults=True):
    """An interactive element of a document.

    Attributes:
        number: also the number of its mark.
        tag, type: its name in HTML, and the ``type`` of an ``<input>``.
        role, name: as in :class:`~webgym.core.observation.Element`.
        scrolls: whether it can be scrolled vertically.
        boxes: ``(x, y, width, height)`` of its parts, CSS pixels from the viewport's corner; empty for an
            option of a closed dropdown.
    """

    number: int
    tag: str
    role: str
    name: str
    scrolls: bool = False
    boxes: tuple[Box, ...] = ()
    type: str = ""


class Document(msgspec.Struct, frozen=True, omit_defaults=True):
    """The content of a document, truncated to ``DOCUMENT_CHARACTERS`` and ``DOCUMENT_ELEMENTS``.

    Attributes:
        url, title: URL and title of the main frame.
        text: its text as laid out.
        elements: its interactive elements in document order, frames of the same origin included.
        meta: content of the ``<meta>`` elements by name or property.
        linked: the JSON-LD scripts, unparsed.
        items: the top-level microdata items: ``itemType`` and properties.
    """

    url: str = ""
    title: str = ""
    text: str = ""
    elements: tuple[DocumentElement, ...] = ()
    meta: dict[str, str] = {}
    linked: tuple[str, ...] = ()
    items: tuple[dict[str, Any], ...] = ()


async def read(page: Page, request: ReadRequest) -> Document:
    """Read the document that the page shows now.

    Raises:
        BrowserTimeout: no answer within ``screenshot_seconds``.
    """
    options = {
        **msgspec.structs.asdict(request),
        "characters": DOCUMENT_CHARACTERS,
        "most": DOCUMENT_ELEMENTS,
    }
    document = await with_retries(page, lambda: page.run("readDocument", options, reply=Document))
    return msgspec.structs.replace(document, url=page.address)
