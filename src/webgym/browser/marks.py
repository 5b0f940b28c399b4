"""Marks: a frame and a number over each element, drawn on the picture: no page can see or change them."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from webgym.browser.pictures import Pixels, decode, encode
from webgym.core.observation import Element

Box: TypeAlias = tuple[int, int, int, int]
"""Left, top, right, bottom, pixels."""

COLOURS = tuple(
    tuple(bytes.fromhex(colour))
    for colour in "c62828 1565c0 2e7d32 6a1b9a ad1457 00695c 4527a0 bf360c".split()
)
"""Red, green, blue of marks. Dark enough for white digits: a contrast of 4.5 at least."""

_WHITE = 255
_BORDER = 2
"""Width of a frame, pixels; around the element, so that nothing of it is hidden."""

_REACH = 40
"""Pixels around a box within which other elements count as near."""

_CROWD = 12
"""Elements near a box, itself included, among which there is room for small labels only."""

_HIDING = 10
"""How much worse it is to hide a pixel of another label than one of an element."""


class Size(NamedTuple):
    """Size of a label, pixels.

    Attributes:
        height: height of the label.
        padding: beside its digits, both sides together.
        advance: from one digit to the next.
        scale: pixels per unit of :data:`_DIGITS`.
    """

    height: int
    padding: int
    advance: float
    scale: float


_SIZES = (Size(14, 4, 7.3, 1.1), Size(10, 3, 5.5, 0.8))
"""The smaller one where the larger has no room."""

_DIGIT = (4, 7)
"""Width and height of a digit without the width of its line."""

_LINE = 1.6
"""Width of the line, in the same units."""

_DIGITS = tuple(
    np.array(points.split(), float).reshape(-1, 2)
    for points in (
        "0 2 .4 .8 1.4 .1 2.6 .1 3.6 .8 4 2 4 5 3.6 6.2 2.6 6.9 1.4 6.9 .4 6.2 0 5 0 2",
        ".8 1.6 2.5 0 2.5 7",
        "0 2 .4 .8 1.4 .1 2.6 .1 3.6 .8 4 2 3.9 2.8 3.6 3.6 3 4.3 0 7 4 7",
        ".2 1.2 .6 .5 1.2 .1 2 0 3 .3 3.6 1.2 3.6 2.2 3 3.1 2 3.4 1.4 3.4 2 3.4 3.1 3.7 3.8 4.6 3.8 5.8"
        " 3.1 6.7 2 7 1.1 6.9 .4 6.4 0 5.7",
        "3.1 7 3.1 0 0 4.9 4.2 4.9",
        "3.6 0 .6 0 .2 3.2 .8 2.9 1.4 2.7 2 2.6 3.2 3 4 4.1 4 5.5 3.2 6.6 2 7 1.2 6.9 .5 6.5 0 5.8",
        "3.6 .5 3.2 .2 2.8 .1 2.3 0 1 .5 .3 2.1 0 4.7 .4 6.1 1.4 6.9 2.6 6.9 3.6 6.1 4 4.7 3.6 3.3 2.6 2.5"
        " 1.4 2.5 .4 3.3 0 4.7",
        "0 0 4 0 1.4 7",
        "2 3.4 1.5 3.3 .6 2.7 .3 1.7 .6 .7 1.5 .1 2.5 .1 3.4 .7 3.7 1.7 3.4 2.7 2.5 3.3 2 3.4 2.6 3.5 3.6 4.1"
        " 4 5.2 3.6 6.3 2.6 6.9 1.4 6.9 .4 6.3 0 5.2 .4 4.1 1.4 3.5 2 3.4",
        ".4 6.5 .8 6.8 1.2 6.9 1.7 7 3 6.5 3.7 4.9 4 2.3 3.6 .9 2.6 .1 1.4 .1 .4 .9 0 2.3 .4 3.7 1.4 4.5"
        " 2.6 4.5 3.6 3.7 4 2.3",
    )
)
"""The points of each digit's line, from its upper left corner."""


class Label(NamedTuple):
    """The label of an element.

    Attributes:
        number: the number on it.
        size: its size.
        box: where it lies.
        hidden: pixels of earlier labels that it hides.
    """

    number: int
    size: Size
    box: Box
    hidden: int


def draw(
    picture: bytes, elements: Sequence[Element], quality: int | None = None, scale: float = 1.0
) -> bytes:
    """A PNG with marks over these elements, or a JPEG of this quality.

    Args:
        picture: the bare screenshot, as PNG.
        elements: the elements.
        quality: 1 to 100.
        scale: pixels of the picture for each CSS pixel.
    """
    if not elements and quality is None:
        return picture
    pixels = decode(picture)
    height, width, _ = pixels.shape
    boxes = [_whole(element.box, scale) for element in elements]
    for element, box in zip(elements, boxes, strict=True):
        _draw_frame(pixels, box, element.number)
    layer: list[Label] = []  # labels that do not lie over each other
    for label in place([element.number for element in elements], boxes, (width, height)):
        if label.hidden:
            _draw_labels(pixels, layer)
            layer.clear()
        layer.append(label)
    _draw_labels(pixels, layer)
    return encode(pixels, quality)


def _whole(box: tuple[float, float, float, float], scale: float) -> Box:
    """Edges between two pixels would be blurred."""
    x, y, width, height = box
    left, top, right, bottom = (math.floor(edge * scale + 0.5) for edge in (x, y, x + width, y + height))
    return left, top, right, bottom


# --- where labels go ----------------------------------------------------------------------------------

_SPOTS = ((0, 0), (1, 0), (2, 1), (3, 1), (0, 2), (1, 2), (1, 1), (0, 1), (1, 3), (0, 3))
"""Places for a label, the best first: which of the left and which of the upper edges in :func:`_spot`."""


def place(numbers: Sequence[int], boxes: Sequence[Box], viewport: tuple[int, int]) -> Iterator[Label]:
    """The labels of elements with these numbers and boxes.

    A label goes above its box if there is room, else where it hides least of other labels, then of elements.
    """
    edges = np.array(boxes, float).reshape(-1, 4)
    near = (edges[:, None, :2] - _REACH < edges[:, 2:]) & (edges[:, None, 2:] + _REACH > edges[:, :2])
    crowded = near.all(-1).sum(1) > _CROWD
    taken = np.zeros(viewport[::-1], bool)  # by labels
    used = taken.copy()  # by elements and labels
    for left, top, right, bottom in boxes:
        used[top:bottom, left:right] = True
    for index, (number, box) in enumerate(zip(numbers, boxes, strict=True)):
        for size in _SIZES[int(crowded[index]) :]:
            width = math.ceil(size.padding + size.advance * len(str(number)))
            left, top, right, bottom = spot = (box[0], box[1] - size.height, box[0] + width, box[1])
            hidden = 0
            if min(spot) < 0 or right > viewport[0] or used[top:bottom, left:right].any():  # no room above
                spot, hidden = _spot(index, box, (width, size.height), edges.T, taken)
            if not hidden:
                break
        left, top, right, bottom = spot
        taken[top:bottom, left:right] = used[top:bottom, left:right] = True
        yield Label(number, size, spot, hidden)


def _spot(
    index: int, box: Box, size: tuple[int, int], edges: NDArray[np.float64], taken: NDArray[np.bool_]
) -> tuple[Box, int]:
    """The best place for a label of this size for one of the boxes, and how much it hides of other labels."""
    (x, y, right, bottom), (width, height) = box, size
    lefts = _within((x, right - width, right, x - width), taken.shape[1] - width)
    tops = _within((y - height, y, bottom, bottom - height), taken.shape[0] - height)
    wide = _overlap(lefts, width, edges[0], edges[2])
    wide[:, index] /= 2  # rather its own than others
    covered = (wide @ _overlap(tops, height, edges[1], edges[3]).T).tolist()  # pixels of elements
    found: list[tuple[float, Box, int]] = []
    for column, row in _SPOTS:
        left, top = lefts[column], tops[row]
        hidden = int(np.count_nonzero(taken[top : top + height, left : left + width]))
        cost = _HIDING * hidden + covered[column][row]
        found.append((cost, (left, top, left + width, top + height), hidden))
        if not cost:
            break
    return min(found, key=operator.itemgetter(0))[1:]


def _within(starts: Sequence[int], most: int) -> list[int]:
    return [max(0, min(start, most)) for start in starts]


def _overlap(
    starts: Sequence[int], length: int, lows: NDArray[np.float64], highs: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How much of each interval from ``starts`` lies in each of those from ``lows`` to ``highs``."""
    column = np.array(starts, float)[:, None]
    common: NDArray[np.float64] = np.minimum(column + length, highs) - np.maximum(column, lows)
    return np.maximum(common, 0, out=common)


# --- drawing ------------------------------------------------------------------------------------------


def _draw_frame(pixels: Pixels, box: Box, number: int) -> None:
    """Draw a frame around a box; at the edge of the viewport, within it."""
    height, width, _ = pixels.shape
    left, top = max(0, box[0] - _BORDER), max(0, box[1] - _BORDER)
    right, bottom = min(width, box[2] + _BORDER), min(height, box[3] + _BORDER)
    line = _line(number % len(COLOURS), width)
    pixels[top : top + _BORDER, left:right] = line[left:right]
    pixels[max(top, bottom - _BORDER) : bottom, left:right] = line[left:right]
    pixels[top:bottom, left : left + _BORDER] = line[:_BORDER]
    pixels[top:bottom, max(left, right - _BORDER) : right] = line[: right - max(left, right - _BORDER)]


@functools.cache
def _line(colour: int, length: int) -> Pixels:
    line: Pixels = np.tile(np.array(COLOURS[colour], np.uint8), (length, 1))
    return line


def _draw_labels(pixels: Pixels, labels: Sequence[Label]) -> None:
    for _, _, (left, top, right, bottom), _ in labels:
        pixels[max(0, top - 1) : bottom + 1, max(0, left - 1) : right + 1] = _WHITE
    for number, size, (left, top, right, bottom), _ in labels:
        pixels[top:bottom, left:right] = _picture_of(number, size, right - left)


@functools.lru_cache(maxsize=2048)
def _picture_of(number: int, size: Size, width: int) -> Pixels:
    """The label of a number: white digits on its colour."""
    digits = str(number)
    first = (width - size.advance * (len(digits) - 1) - _DIGIT[0] * size.scale) / 2
    masks = [_mask(digit, first + size.advance * index, size, width) for index, digit in enumerate(digits)]
    colour = np.array(COLOURS[number % len(COLOURS)])
    share = np.max(masks, axis=0)[..., None]
    label: Pixels = np.rint(colour + (_WHITE - colour) * share).astype(np.uint8)
    return label


@functools.cache
def _mask(digit: str, x: float, size: Size, width: int) -> NDArray[np.float64]:
    """The share of each pixel of a label that a digit covers.

    Args:
        digit: the digit.
        x: its left edge.
        size: the label's size.
        width: the label's width.
    """
    points = _DIGITS[int(digit)] * size.scale + (x, (size.height - _DIGIT[1] * size.scale) / 2)
    starts, steps = points[:-1], np.diff(points, axis=0)
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(size.height) + 0.5), axis=-1)
    ways = pixels[..., None, :] - starts
    along = ((ways * steps).sum(-1) / (steps**2).sum(-1)).clip(0, 1)
    distance = np.linalg.norm(ways - along[..., None] * steps, axis=-1).min(-1)
    share: NDArray[np.float64] = np.clip(_LINE * size.scale / 2 + 0.5 - distance, 0, 1)
    return share
