"""Reading a whole document, not only what the viewport shows of it."""

from __future__ import annotations

from typing import Any

import msgspec

from webgym.browser.observe import patiently
from webgym.browser.page import Page

Box = tuple[float, float, float, float]


class ReadRequest(msgspec.Struct, frozen=True, omit_defaults=True):
    """What of a document is wanted.

    Attributes:
        lines: how many lines of its text, empty ones counted and left out; 0 for none.
        elements: its interactive elements, in view or not.
        meta: what it says about itself to machines.
    """

    lines: int = 0
    elements: bool = False
    meta: bool = False


class DocumentElement(msgspec.Struct, frozen=True, omit_defaults=True):
    """An interactive element of a document. Its number is also that of its mark, wherever it gets one.

    Attributes:
        tag, type: its name in HTML; of an ``<input>`` also the kind.
        role, name: as in :class:`~webgym.core.observation.Element`.
        scrolls: whether there is more in it than it shows, up and down.
        boxes: ``(x, y, width, height)`` of its parts, CSS pixels from the viewport's corner; none for an
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
    """What was read. What is too long is cut (``document_characters``, ``document_elements``).

    Attributes:
        url, title: of the main frame.
        text: its text as it is laid out.
        elements: in the order of the document, frames of the same origin included.
        meta: content of the ``<meta>`` elements by name or property.
        linked: the JSON-LD scripts, as written.
        items: the top-level microdata items; ``itemType`` and their properties.
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
        BrowserTimeout: no answer within the deadline of a look.
    """
    wanted = {
        **msgspec.structs.asdict(request),
        "characters": page.config.document_characters,
        "most": page.config.document_elements,
    }
    document = await patiently(page, lambda: page.run("readDocument", wanted, reply=Document))
    return msgspec.structs.replace(document, url=page.address)
