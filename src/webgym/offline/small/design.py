"""The design of a small website: its theme, its layout and its signs, drawn from its seed.

Every single choice occurs in both splits. Combinations do not: a test website has a pair of layout and theme,
and a pair of theme and signs, that no training website has, whatever the seeds. See :func:`side`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import msgspec

from webgym.offline.data import load
from webgym.offline.seeds import stream
from webgym.offline.small.signs import Ink, shaded, sign_data
from webgym.offline.website import Split

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


class ThemeChoices(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The possible values of a theme's properties."""

    ground: tuple[tuple[str, str, str, str], ...]
    shape: tuple[Literal["square", "rounded", "disc"], ...]
    frame: tuple[int, ...]
    ink: tuple[Ink, ...]
    font: tuple[str, ...]
    controls: tuple[Literal["symbol", "word"], ...]


class LayoutChoices(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The possible values of a layout's properties."""

    bar: tuple[Literal["top", "bottom", "left", "right"], ...]
    flow: tuple[Literal["rows", "columns"], ...]
    spread: tuple[Literal["packed", "apart"], ...]
    anchor: tuple[Literal["start", "end"], ...]
    order: tuple[Literal["forward", "backward"], ...]


class DesignData(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of ``design.toml``."""

    theme: ThemeChoices
    layout: LayoutChoices


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

    def draw(choices: object) -> Choice:
        sizes = [len(getattr(choices, name)) for name in choices.__struct_fields__]  # type: ignore[attr-defined]
        return tuple(rng.randrange(size) for size in sizes)

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
    return Design(
        theme=_theme(_chosen(data.theme, theme), shades),
        layout=Layout(*_chosen(data.layout, layout)),
        stock=stock,
        key=(theme, layout, left_out),
    )


def _theme(chosen: list[Any], colors: dict[str, str]) -> Theme:
    (page, bar, tile, ink), shape, frame, drawing, font, controls = chosen
    return Theme(page, bar, tile, ink, shape, frame, drawing, font, controls, colors)


def _chosen(choices: msgspec.Struct, indices: Choice) -> list[Any]:
    fields = type(choices).__struct_fields__
    return [getattr(choices, name)[index] for name, index in zip(fields, indices, strict=True)]


def _without(items: Sequence[str], first: int) -> list[str]:
    """``items`` without :data:`LEFT_OUT` of them, starting with index ``first``."""
    left_out = {(first + 3 * nth) % len(items) for nth in range(LEFT_OUT)}
    return [item for index, item in enumerate(items) if index not in left_out]


def _shuffled(items: Sequence[str], *names: object) -> tuple[str, ...]:
    return tuple(stream(*names).sample(list(items), len(items)))
