"""The signs of small pages: colours, icons, numbers and short words, each in one cell.

A sign has a name of one or two words of a small vocabulary. A sign looks similar on all websites; only the
shade, the font and the drawing style differ.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import msgspec

from webgym.offline.data import load

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
