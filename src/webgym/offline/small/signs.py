"""What a small page can show: colours, icons, numbers and short words, each filling one cell.

A sign has a name of one or two words of a small vocabulary. The same name looks alike on every website, up
to a shade, a font and the way it is drawn.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import msgspec

from webgym.offline.data import load

CELL = 32
"""Side of a cell, CSS pixels: what one image token of a Qwen3-VL covers."""

Ink = Literal["filled", "outlined", "reversed"]
"""How a coloured icon is drawn: in its colour, as an outline in its colour, or white on its colour."""


class SignData(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``signs.toml``: all there is to show."""

    words: tuple[str, ...]
    most: int
    colors: dict[str, str]
    icons: dict[str, str]
    controls: dict[str, str]


@lru_cache(maxsize=1)
def sign_data() -> SignData:
    """All colours, icons, controls and words."""
    return load("webgym.offline.small", "signs.toml", SignData)


@dataclass(frozen=True)
class Sign:
    """What fills a cell.

    Attributes:
        color: its colour, if it has one.
        icon: its icon, if it has one.
        text: a number or a word, if it is one.
        control: a control of the website (``home``, ``next``, ...), if it is one.
    """

    color: str = ""
    icon: str = ""
    text: str = ""
    control: str = ""

    @property
    def name(self) -> str:
        """Its accessible name, ``"red star"``, and what instructions and answers call it."""
        return self.control or self.text or f"{self.color} {self.icon}".strip()


def number_sign(value: int) -> Sign:
    """A number."""
    return Sign(text=str(value))


def control(name: str) -> Sign:
    """A control."""
    return Sign(control=name)


def numbers() -> tuple[str, ...]:
    """All numbers that a small page can show."""
    return tuple(str(value) for value in range(sign_data().most + 1))


def shaded(color: str, turn: float, lighten: float) -> str:
    """A shade of a colour: ``turn`` of the colour circle away, lighter by a share of what is left."""
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    hue, lightness, saturation = colorsys.rgb_to_hls(red, green, blue)
    lightness = min(1.0, max(0.0, lightness * (1 + lighten)))
    channels = colorsys.hls_to_rgb((hue + turn) % 1, lightness, saturation)
    return "#" + "".join(f"{round(channel * 255):02x}" for channel in channels)


@lru_cache(maxsize=4096)
def drawn(path: str, color: str, edge: str, ink: Ink, scale: float) -> str:
    """An SVG of one path in a cell.

    Args:
        path: in a box of 32 by 32.
        color: of the shape.
        edge: around the shape, so that no colour drowns in the ground.
        ink: ``outlined`` leaves the inside empty.
        scale: of the shape in its cell.
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
