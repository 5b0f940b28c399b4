"""What the scripts leave open in the text, by placeholders.

* Numbers that style sheets count (``counter()``), which no script can read: Chromium's snapshot has them.
* Words under a mask, a blend or a filter, of which only the picture tells whether they can be seen.

Pages that show neither cost nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
from typing import TypeAlias

import msgspec
import numpy as np

from webgym.browser.cdp import CommandFailed, Session
from webgym.browser.cdp_messages import CdpMessage
from webgym.browser.pictures import decode
from webgym.core.errors import BrowserTimeout

Box: TypeAlias = tuple[float, float, float, float]
"""Left, top, width and height in the viewport, CSS pixels."""

Counted: TypeAlias = tuple[str, str, Box]
"""A pseudo-element that counts: the tag of its element, its own name, and the element's box."""

_NUMBER = re.compile("\ufdd0([0-9]+)\ufdd1")
_DOUBTFUL = re.compile("\ufdd2([0-9]+)\ufdd3([^\ufdd4]*)(?:\ufdd4|$)")
"""Written by ``scripts/sight.js``; no text has these characters, which Unicode leaves out."""

_SLACK = 1.5
"""Most that two boxes of an element differ, CSS pixels."""

_LEVELS = 20
"""Least difference of a colour channel, of 255, between letters that can be read and what they lie on."""


class _Rare(CdpMessage, frozen=True):
    index: tuple[int, ...] = ()


class _Nodes(CdpMessage, frozen=True):
    parent_index: tuple[int, ...]
    node_name: tuple[int, ...]
    pseudo_type: _Rare = _Rare()


class _Layout(CdpMessage, frozen=True):
    node_index: tuple[int, ...]
    bounds: tuple[Box, ...]
    text: tuple[int, ...]


class _Document(CdpMessage, frozen=True):
    nodes: _Nodes
    layout: _Layout
    scroll_offset_x: float = 0.0
    scroll_offset_y: float = 0.0

    def written(self, strings: tuple[str, ...]) -> list[tuple[Counted, str]]:
        """What the pseudo-elements of the document write."""
        nodes, layout = self.nodes, self.layout
        texts = dict.fromkeys(nodes.pseudo_type.index, "")
        boxes: dict[int, Box] = {}
        for node, box, string in zip(layout.node_index, layout.bounds, layout.text, strict=True):
            boxes.setdefault(node, (box[0] - self.scroll_offset_x, box[1] - self.scroll_offset_y, *box[2:]))
            if node in texts and string >= 0:
                texts[node] += strings[string]
        found = []
        for node, text in texts.items():
            parent = nodes.parent_index[node]
            if text and parent in boxes:
                tag, name = (strings[nodes.node_name[one]].lower() for one in (parent, node))
                found.append(((tag, name, boxes[parent]), text))
        return found


class _Snapshot(msgspec.Struct, frozen=True):
    documents: tuple[_Document, ...]
    strings: tuple[str, ...]


async def count(session: Session, text: str, counted: tuple[Counted, ...], seconds: float) -> str:
    """The text with its numbers in place of the placeholders; without those that cannot be told.

    Args:
        session: the page's session.
        text: the text of the page.
        counted: what counts, in the order of the placeholders' numbers.
        seconds: longest time for the snapshot.
    """
    written: list[tuple[Counted, str]] = []
    with contextlib.suppress(CommandFailed, BrowserTimeout):  # reported by what is asked next
        shot = await session.call(
            "DOMSnapshot.captureSnapshot", {"computedStyles": []}, reply=_Snapshot, seconds=seconds
        )
        written = shot.documents[0].written(shot.strings)

    def number(found: re.Match[str]) -> str:
        wanted = counted[int(found[1])] if int(found[1]) < len(counted) else None
        return next((text for one, text in written if wanted and _is_same(one, wanted)), "").strip()

    return _NUMBER.sub(number, text)


def _is_same(one: Counted, other: Counted) -> bool:
    return one[:2] == other[:2] and all(abs(a - b) <= _SLACK for a, b in zip(one[2], other[2], strict=True))


async def drop_unseen(text: str, doubts: tuple[tuple[Box, ...], ...], image: bytes, scale: float) -> str:
    """The text without the doubtful words where the picture has one colour.

    Args:
        text: the text of the page.
        doubts: where the doubtful words stand, in the order of the placeholders' numbers.
        image: the picture.
        scale: of the picture.
    """
    return await asyncio.to_thread(_drop_unseen, text, doubts, image, scale)


def _drop_unseen(text: str, doubts: tuple[tuple[Box, ...], ...], image: bytes, scale: float) -> str:
    pixels = decode(image)

    def is_seen(box: Box) -> bool:
        x, y, width, height = box
        left, top, right, bottom = (max(0, round(at * scale)) for at in (x, y, x + width, y + height))
        inner = pixels[top:bottom, left:right]
        return inner.size > 0 and bool((np.ptp(inner, axis=(0, 1)) >= _LEVELS).any())

    def words(found: re.Match[str]) -> str:
        boxes = doubts[int(found[1])] if int(found[1]) < len(doubts) else ()
        return found[2] if any(is_seen(box) for box in boxes) else ""

    lines = (" ".join(_DOUBTFUL.sub(words, line).split()) for line in text.split("\n"))
    return "\n".join(line for line in lines if line)
