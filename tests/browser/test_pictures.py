"""Pictures as pixels, and the marks that are drawn on them."""

from __future__ import annotations

import io
import itertools

import numpy as np
import pytest
from PIL import Image

from webgym.browser.marks import COLOURS, Label, draw, place
from webgym.browser.pictures import Pixels, decode, encode, white
from webgym.core.observation import Element

VIEWPORT = (800, 600)
Box = tuple[float, float, float, float]


def random_pixels(width: int, height: int) -> Pixels:
    return np.random.default_rng(1).integers(0, 256, (height, width, 3), np.uint8)


def with_pillow(picture: bytes) -> Pixels:
    return np.array(Image.open(io.BytesIO(picture)).convert("RGB"))


@pytest.mark.parametrize("size", [(1, 1), (7, 5), (1280, 768)])
def test_a_picture_keeps_its_pixels(size: tuple[int, int]) -> None:
    pixels = random_pixels(*size)
    png = encode(pixels)
    assert (decode(png) == pixels).all()
    assert (with_pillow(png) == pixels).all()
    assert encode(pixels.copy()) == png


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P"])
def test_other_pngs_are_read_too(mode: str) -> None:
    written = io.BytesIO()
    Image.fromarray(random_pixels(40, 30)).convert(mode).save(written, "PNG")
    assert (decode(written.getvalue()) == with_pillow(written.getvalue())).all()


def test_a_jpeg_is_about_the_same() -> None:
    marked = elements([(100, 100, 80, 20)])
    jpeg, png = draw(white(VIEWPORT), marked, quality=90), draw(white(VIEWPORT), marked)
    assert jpeg.startswith(b"\xff\xd8")
    assert np.abs(with_pillow(jpeg).astype(int) - decode(png)).mean() < 1


# --- marks --------------------------------------------------------------------------------------------


def elements(boxes: list[Box]) -> list[Element]:
    return [Element(number=number + 1, role="button", name="", box=box) for number, box in enumerate(boxes)]


def whole(boxes: list[Box]) -> list[tuple[int, int, int, int]]:
    return [(int(x), int(y), int(x + w), int(y + h)) for x, y, w, h in boxes]


def labels_for(boxes: list[Box]) -> list[Label]:
    return list(place(range(1, len(boxes) + 1), whole(boxes), VIEWPORT))


def dense() -> list[Box]:
    """As on a page with a long menu, a calendar, and a button in each corner."""
    menu = [(8.0 + 52 * (n % 15), 8.0 + 18 * (n // 15), 44.0, 16.0) for n in range(60)]
    days = [(8.0 + 28 * column, 90.0 + 27 * row, 24.0, 22.0) for row in range(12) for column in range(9)]
    corners = [
        (0.0, 579.0, 25.0, 21.0),
        (775.0, 579.0, 25.0, 21.0),
        (775.0, 240.0, 25.0, 21.0),
        (775.0, 0.0, 25.0, 21.0),
    ]
    return [*menu, *days, *corners]


def test_a_frame_lies_around_its_element() -> None:
    drawn = decode(draw(white(VIEWPORT), elements([(100.4, 100.4, 80, 20), (0, 500, 60, 99.8)])))
    colour, other = (np.array(COLOURS[number]) for number in (1, 2))
    for x, y in ((98, 110), (99, 110), (180, 110), (181, 110), (140, 121)):
        assert (drawn[y, x] == colour).all(), (x, y)
    assert (drawn[102:118, 102:178] == 255).all(), "nothing of the element is hidden"
    assert (drawn[598:600, 2:60] == other).all(), "at the edge it lies within the picture"


@pytest.mark.parametrize("box", [(10, 10, 0, 0), (10, 10, 1, 1), (0, 0, 800, 600), (799, 599, 1, 1)])
def test_any_box_can_be_marked(box: Box) -> None:
    assert (decode(draw(white(VIEWPORT), elements([box]))) != 255).any()


def test_a_label_lies_above_its_element_if_there_is_room() -> None:
    (above, below) = labels_for([(100, 100, 80, 20), (100, 0, 80, 20)])
    assert above.box[1:4:2] == (86, 100)
    assert below.box[0] == 180, "beside it"
    assert not above.hidden


def test_labels_keep_off_each_other() -> None:
    labels = labels_for(dense())
    assert len(labels) > 150
    assert len({label.size for label in labels}) == 2
    assert all(
        0 <= label.box[0] < label.box[2] <= 800 and 0 <= label.box[1] < label.box[3] <= 600
        for label in labels
    )
    overlaps = [
        (one.number, other.number)
        for one, other in itertools.combinations(labels, 2)
        if min(one.box[2], other.box[2]) > max(one.box[0], other.box[0])
        and min(one.box[3], other.box[3]) > max(one.box[1], other.box[1])
    ]
    assert len(overlaps) <= len(labels) * 0.02, overlaps


def test_labels_can_be_read() -> None:
    boxes = dense()
    drawn = decode(draw(white(VIEWPORT), elements(boxes)))
    shapes: dict[bytes, set[int]] = {}
    for label in labels_for(boxes):
        left, top, right, bottom = label.box
        cut, colour = drawn[top:bottom, left:right], COLOURS[label.number % len(COLOURS)]
        rim = np.concatenate([cut[0], cut[-1], cut[:, 0], cut[:, -1]])
        if (rim != rim[0]).any():
            continue  # another one lies over it
        assert tuple(rim[0]) == colour, "no digit is cut off"
        written = cut.astype(int).sum(-1) > 600
        shapes.setdefault(bytes(written.shape) + written.tobytes(), set()).add(label.number)
    assert sum(map(len, shapes.values())) >= len(boxes) * 0.9
    assert all(len(numbers) == 1 for numbers in shapes.values()), "each number has a shape of its own"


def test_white_digits_stand_out() -> None:
    for colour in COLOURS:
        channels = (part / 255 for part in colour)
        red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
        assert 1.05 / (0.2126 * red + 0.7152 * green + 0.0722 * blue + 0.05) >= 4.5
