"""The design of a small website: its theme, its layout and its signs, drawn from its seed.

A sign is a colour, an icon, a number or a short word, and fills a cell. It has a name of one or two words of
a small vocabulary, and looks similar on all websites; only shade, font and drawing style differ.

Every single choice occurs in both splits. Combinations do not: a test website has a pair of layout and theme,
and a pair of theme and signs, that no training website has, whatever the seeds. See :func:`side`.
"""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import msgspec

from webgym.offline.data import load
from webgym.offline.seeds import stream
from webgym.offline.website import Split

# --- signs ------------------------------------------------------------------------------------------------

CELL = 32
"""Side of a cell in CSS pixels; one image token of Qwen3-VL covers as much."""

Ink = Literal["filled", "outlined", "reversed"]
"""How a coloured icon is drawn: in its colour, as an outline in its colour, or white on its colour."""


class SignData(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of ``signs.toml``; ``most`` is the largest number."""

    words: tuple[str, ...]
    most: int
    colors: dict[str, str]
    icons: dict[str, str]
    controls: dict[str, str]


@lru_cache(maxsize=1)
def sign_data() -> SignData:
    """The content of ``signs.toml``."""
    return load("webgym.offline.small", "signs.toml", SignData)


@dataclass(frozen=True)
class Sign:
    """A sign. Attributes that it does not have are empty.

    Attributes:
        color: name of its colour.
        icon: name of its icon.
        text: its number or word.
        control: name of a control of the website: ``home``, ``next``, ...
    """

    color: str = ""
    icon: str = ""
    text: str = ""
    control: str = ""

    @property
    def name(self) -> str:
        """Its accessible name, ``"red star"``; instructions and answers use it as well."""
        return self.control or self.text or f"{self.color} {self.icon}".strip()


def number_sign(value: int) -> Sign:
    """The sign of a number."""
    return Sign(text=str(value))


def control(name: str) -> Sign:
    """The sign of a control."""
    return Sign(control=name)


def numbers() -> tuple[str, ...]:
    """All numbers that small pages use."""
    return tuple(str(value) for value in range(sign_data().most + 1))


def shaded(color: str, turn: float, lighten: float) -> str:
    """A shade of a CSS colour.

    Args:
        color: ``#rrggbb``.
        turn: change of the hue, as a share of the colour circle.
        lighten: change of the lightness, as a share of itself.
    """
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    hue, lightness, saturation = colorsys.rgb_to_hls(red, green, blue)
    lightness = min(1.0, max(0.0, lightness * (1 + lighten)))
    channels = colorsys.hls_to_rgb((hue + turn) % 1, lightness, saturation)
    return "#" + "".join(f"{round(channel * 255):02x}" for channel in channels)


@lru_cache(maxsize=4096)
def drawn(path: str, color: str, edge: str, ink: Ink, scale: float) -> str:
    """The SVG of a path in a cell.

    Args:
        path: SVG path in a box of 32 by 32.
        color: colour of the shape.
        edge: colour of the line around the shape, which separates it from the background.
        ink: drawing style; ``outlined`` leaves the inside empty.
        scale: size of the shape, as a share of the cell.
    """
    shift = CELL / 2 * (1 - scale)
    place = f"translate({shift:g} {shift:g}) scale({scale:g})"
    opening = f'<svg viewBox="0 0 32 32" aria-hidden="true"><g transform="{place}" stroke-linejoin="round"'
    shape = f'<path d="{path}"'
    if ink == "outlined":
        lines = f'{shape} stroke="{edge}" stroke-width="4.5"/>{shape} stroke="{color}" stroke-width="2.8"/>'
        return f'{opening} fill="none">{lines}</g></svg>'
    fill = f'fill="{color}" fill-rule="evenodd" stroke="{edge}" stroke-width="1.5"'
    return f"{opening} {fill}>{shape}/></g></svg>"


# --- designs ----------------------------------------------------------------------------------------------

Choice = tuple[int, ...]

HELD_OUT = 4
"""One of this many pairs of layout and theme, and of theme and signs, is held out for testing."""

LEFT_OUT = 2
"""Number of colours, and of icons, that a website does not use."""

TURN = 0.012
LIGHTEN = 0.07
"""Largest change of a colour on a website: of the hue, as a share of the colour circle, and of the
lightness, as a share of itself.
"""


class DesignData(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of ``design.toml``: the possible values of each property of a theme and of a layout."""

    theme: dict[str, tuple[Any, ...]]
    layout: dict[str, tuple[str, ...]]


@lru_cache(maxsize=1)
def design_data() -> DesignData:
    """The content of ``design.toml``."""
    return load("webgym.offline.small", "design.toml", DesignData)


@dataclass(frozen=True)
class Theme:
    """Colours and shapes.

    Attributes:
        page, bar, tile, ink: CSS colours of the page, its bar, its tiles, and the text on them.
        shape: shape of tiles.
        frame: width of a tile's frame, CSS pixels.
        drawing: how coloured icons are drawn.
        font: CSS font family.
        controls: whether controls are symbols or words.
        colors: this website's shade of each colour, by name.
    """

    page: str
    bar: str
    tile: str
    ink: str
    shape: str
    frame: int
    drawing: Ink
    font: str
    controls: str
    colors: dict[str, str]


@dataclass(frozen=True)
class Layout:
    """The arrangement of a page of 6 by 4 cells.

    Attributes:
        bar: side of the page with the controls.
        flow: whether tiles fill rows or columns.
        spread: ``packed`` without gaps, ``apart`` with a gap between tiles.
        anchor: whether tiles begin at the start of the space or finish at its end.
        order: direction of the controls.
    """

    bar: str
    flow: str
    spread: str
    anchor: str
    order: str


@dataclass(frozen=True)
class Stock:
    """The signs that a website uses.

    Attributes:
        colors, icons, words: their names, in random order.
    """

    colors: tuple[str, ...]
    icons: tuple[str, ...]
    words: tuple[str, ...]


@dataclass(frozen=True)
class Design:
    """The design of a small website.

    Attributes:
        theme, layout, stock: its parts.
        key: indices of the choices of theme, layout and signs.
    """

    theme: Theme
    layout: Layout
    stock: Stock
    key: tuple[Choice, Choice, Choice]


def side(theme: Choice, layout: Choice, signs: Choice) -> Split | None:
    """The split that may use a combination; ``None`` for neither.

    A pair is held out if the sum of its choices is divisible by :data:`HELD_OUT`. Both pairs of a test
    website are held out, no pair of a training website is.
    """
    pairs = ((*layout, *theme), (*theme, *signs))
    held_out = [sum(pair) % HELD_OUT == 0 for pair in pairs]
    if all(held_out):
        return "test"
    return None if any(held_out) else "train"


def design(seed: int, split: Split) -> Design:
    """The design for a seed in a split."""
    data, signs = design_data(), sign_data()
    rng = stream(seed, "design")

    def draw(choices: Mapping[str, Sequence[object]]) -> Choice:
        return tuple(rng.randrange(len(values)) for values in choices.values())

    while True:
        theme, layout = draw(data.theme), draw(data.layout)
        left_out = (rng.randrange(len(signs.colors)), rng.randrange(len(signs.icons)))
        if side(theme, layout, left_out) == split:
            break
    turn, lighten = rng.uniform(-TURN, TURN), rng.uniform(-LIGHTEN, LIGHTEN)
    shades = {name: shaded(color, turn, lighten) for name, color in signs.colors.items()}
    stock = Stock(
        colors=_shuffled(_without(list(signs.colors), left_out[0]), seed, "colors"),
        icons=_shuffled(_without(list(signs.icons), left_out[1]), seed, "icons"),
        words=_shuffled(signs.words, seed, "words"),
    )
    palette, *others = _chosen(data.theme, theme)
    return Design(
        theme=Theme(*(*palette, *others, shades)),
        layout=Layout(*_chosen(data.layout, layout)),
        stock=stock,
        key=(theme, layout, left_out),
    )


def _chosen(choices: Mapping[str, Sequence[Any]], indices: Choice) -> list[Any]:
    return [values[index] for values, index in zip(choices.values(), indices, strict=True)]


def _without(items: Sequence[str], first: int) -> list[str]:
    """``items`` without :data:`LEFT_OUT` of them, starting with index ``first``."""
    left_out = {(first + 3 * nth) % len(items) for nth in range(LEFT_OUT)}
    return [item for index, item in enumerate(items) if index not in left_out]


def _shuffled(items: Sequence[str], *names: object) -> tuple[str, ...]:
    return tuple(stream(*names).sample(list(items), len(items)))
