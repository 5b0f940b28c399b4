"""The pages of small websites: signs on a grid of 6 by 4 cells, without scripts, external images or
scrolling.

A page has a bar of controls and, in the space beside it, blocks of one or two tiles in order. The layout
determines their positions, the theme their appearance.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape

from webgym.offline.small.design import CELL, Design, Layout, Sign, Theme, drawn, sign_data

COLUMNS, ROWS = 6, 4

Cell = tuple[int, int]
"""Column and row, from 0."""


@dataclass(frozen=True)
class Tile:
    """A cell of a page with a sign.

    Attributes:
        sign: the sign.
        href: address of the link; ``None`` for a tile that is no link.
        post: address to which a click submits an empty form; the tile then is a button.
        chosen: whether it is marked as selected.
    """

    sign: Sign
    href: str | None = None
    post: str | None = None
    chosen: bool = False


Block = Sequence[Tile]
"""One tile, or two side by side."""


def space(layout: Layout) -> tuple[range, range]:
    """The columns and rows outside the bar."""
    columns, rows = range(COLUMNS), range(ROWS)
    match layout.bar:
        case "top":
            rows = range(1, ROWS)
        case "bottom":
            rows = range(ROWS - 1)
        case "left":
            columns = range(1, COLUMNS)
        case _:
            columns = range(COLUMNS - 1)
    return columns, rows


@lru_cache(maxsize=1024)
def slots(layout: Layout, width: int) -> tuple[tuple[Cell, ...], ...]:
    """The cells of every possible block of ``width`` tiles, in the order in which blocks are placed."""
    columns, rows = space(layout)
    if width == 1:
        places = [((column, row),) for row in rows for column in columns]
    else:
        starts = list(columns)[: len(columns) // width * width : width]
        places = [tuple((start + nth, row) for nth in range(width)) for row in rows for start in starts]  # type: ignore[misc]
    if layout.flow == "columns":
        places.sort()
    return tuple(places)


def capacity(layout: Layout, width: int) -> int:
    """Largest number of blocks of ``width`` tiles on a page."""
    return len(slots(layout, width))


def bar_room(layout: Layout) -> int:
    """Largest number of controls in the bar."""
    return COLUMNS if layout.bar in ("top", "bottom") else ROWS


def placed(layout: Layout, bar: Sequence[Tile], blocks: Sequence[Block]) -> list[tuple[Cell, Tile]]:
    """The cell of every tile.

    Raises:
        ValueError: there is not enough room for the tiles.
    """
    if len(bar) > bar_room(layout):
        raise ValueError(f"the bar has room for {bar_room(layout)} controls, not for {len(bar)}")
    cells = list(zip(_bar_cells(layout), bar, strict=False))
    if not blocks:
        return cells
    width = max(len(block) for block in blocks)
    places = slots(layout, width)
    if len(blocks) > len(places):
        raise ValueError(f"the page has room for {len(places)} blocks of {width}, not for {len(blocks)}")
    step = 2 if layout.spread == "apart" and 2 * len(blocks) - 1 <= len(places) else 1
    span = (len(blocks) - 1) * step + 1
    first = len(places) - span if layout.anchor == "end" else 0
    for nth, block in enumerate(blocks):
        cells += zip(places[first + nth * step], block, strict=False)
    return cells


def _bar_cells(layout: Layout) -> list[Cell]:
    if layout.bar in ("top", "bottom"):
        cells = [(column, 0 if layout.bar == "top" else ROWS - 1) for column in range(COLUMNS)]
    else:
        cells = [(0 if layout.bar == "left" else COLUMNS - 1, row) for row in range(ROWS)]
    return cells[::-1] if layout.order == "backward" else cells


def page(design: Design, title: str, bar: Sequence[Tile], blocks: Sequence[Block]) -> str:
    """The HTML of a page."""
    theme, layout = design.theme, design.layout
    tiles = "".join(
        _tile(theme, cell, tile) for cell, tile in placed(layout, list(bar), [tuple(b) for b in blocks])
    )
    style = (theme.page, theme.bar, theme.tile, theme.ink, theme.shape, str(theme.frame), theme.font)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_style(style, layout.bar)}</style></head><body><i id=bar></i>{tiles}</body></html>"
    )


@lru_cache(maxsize=1024)
def _style(theme_key: tuple[str, ...], bar: str) -> str:
    page_color, bar_color, tile, ink, shape, frame, font = theme_key
    radius = {"square": "0", "rounded": "9px", "disc": "50%"}[shape]
    across = bar in ("top", "bottom")
    size = f"width:{COLUMNS * CELL}px;height:{CELL}px" if across else f"width:{CELL}px;height:{ROWS * CELL}px"
    position = {
        "top": "left:0;top:0",
        "left": "left:0;top:0",
        "bottom": "left:0;bottom:0",
        "right": "right:0;top:0",
    }
    return (
        f"*{{box-sizing:border-box;margin:0;padding:0;outline:0}}"
        f"html,body{{width:100%;height:100%;overflow:hidden;background:{page_color}}}"
        f"#bar{{position:absolute;{position[bar]};{size};background:{bar_color}}}"
        f".t{{position:absolute;display:block;width:30px;height:30px;margin:1px;overflow:hidden;"
        f"border:{frame}px solid {ink};border-radius:{radius};background:{tile};color:{ink};"
        f"font:bold 19px/{30 - 2 * int(frame)}px {font};text-align:center;letter-spacing:-.5px;"
        f"text-decoration:none;white-space:nowrap}}"
        f".t svg{{position:absolute;left:{-int(frame)}px;top:{-int(frame)}px;width:30px;height:30px}}"
        f".w{{font-size:13px}}.k{{background:none;border:0;font-size:11px;line-height:30px;letter-spacing:-.8px}}"
        f".k svg{{left:0;top:0}}"
        f".on{{box-shadow:inset 0 0 0 4px {ink}}}"
    )


def _tile(theme: Theme, cell: Cell, tile: Tile) -> str:
    content, style, classes = _face(theme, tile.sign)
    if tile.chosen:
        classes += " on"
    attributes = f'class="t{classes}" style="left:{cell[0] * CELL}px;top:{cell[1] * CELL}px{style}"'
    label = f'aria-label="{escape(tile.sign.name)}"'
    if tile.post is not None:
        button = f"<button {attributes} {label}>{content}</button>"
        return f'<form method="post" action="{escape(tile.post)}">{button}</form>'
    if tile.href is not None:
        return f'<a {attributes} {label} href="{escape(tile.href)}">{content}</a>'
    return f'<div {attributes} role="img" {label}>{content}</div>'


def _face(theme: Theme, sign: Sign) -> tuple[str, str, str]:
    """The HTML inside a tile, its additional CSS, and its additional classes."""
    scale = 0.62 if theme.shape == "disc" else 0.76
    data = sign_data()
    if sign.control:
        if theme.controls == "word":
            return sign.control, "", " k"
        return drawn(data.controls[sign.control], theme.ink, "none", "filled", 0.7), "", " k"
    if sign.text:
        return sign.text, "", "" if sign.text.isdecimal() else " w"
    edge = theme.ink
    if not sign.icon:
        return "", f";background:{theme.colors[sign.color]}", ""
    path = data.icons[sign.icon]
    if not sign.color:
        return drawn(path, theme.ink, "none", "filled", scale), "", ""
    color = theme.colors[sign.color]
    if theme.drawing == "reversed":
        return drawn(path, "#ffffff", "#000000", "filled", scale), f";background:{color}", ""
    return drawn(path, color, edge, theme.drawing, scale), "", ""


def singles(tiles: Iterable[Tile]) -> list[Block]:
    """A block of its own for every tile."""
    return [(tile,) for tile in tiles]
