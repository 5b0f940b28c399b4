"""The look of a website: palette, fonts, layout, and illustrations (SVG) generated from a name."""

from __future__ import annotations

import colorsys
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from webgym.offline.seeds import pick, stream

PALETTES: tuple[tuple[str, str, str, str, str], ...] = (
    # primary, on primary, accent, page, surface
    ("#1f4e79", "#ffffff", "#b45309", "#f4f6f9", "#ffffff"),
    ("#14532d", "#ffffff", "#854d0e", "#f5f7f2", "#ffffff"),
    ("#7c2d12", "#ffffff", "#0f766e", "#faf6f2", "#ffffff"),
    ("#4c1d95", "#ffffff", "#be185d", "#f7f5fb", "#ffffff"),
    ("#0f172a", "#ffffff", "#2563eb", "#f1f5f9", "#ffffff"),
    ("#9f1239", "#ffffff", "#1d4ed8", "#fdf4f5", "#ffffff"),
    ("#155e75", "#ffffff", "#bf3f0a", "#f0f7f9", "#ffffff"),
    ("#3f3f46", "#ffffff", "#b45309", "#f4f4f5", "#ffffff"),
    ("#1e3a8a", "#ffffff", "#047857", "#eef2ff", "#ffffff"),
    ("#5b4636", "#ffffff", "#2f6f4f", "#f6f1ea", "#fffdf9"),
    ("#0b7285", "#ffffff", "#c2255c", "#f3fafb", "#ffffff"),
    ("#fde047", "#1c1917", "#1c1917", "#fafaf5", "#ffffff"),
    ("#111827", "#f9fafb", "#166534", "#ffffff", "#f6f7f8"),
    ("#86198f", "#ffffff", "#0369a1", "#fcf5fd", "#ffffff"),
    ("#c2410c", "#ffffff", "#334155", "#fff8f3", "#ffffff"),
    ("#065f46", "#ffffff", "#be123c", "#f1f8f5", "#ffffff"),
    ("#e2e8f0", "#0f172a", "#7c3aed", "#f8fafc", "#ffffff"),
    ("#334155", "#f8fafc", "#bf3f0a", "#eceff3", "#ffffff"),
)
"""Every foreground on its background has a contrast of at least 4.5 to 1."""

FONTS: tuple[tuple[str, str], ...] = (
    # headings, text
    ("'Liberation Sans', Arial, sans-serif", "'Liberation Sans', Arial, sans-serif"),
    ("'Liberation Serif', Georgia, serif", "'Liberation Sans', Arial, sans-serif"),
    ("'DejaVu Sans', Verdana, sans-serif", "'DejaVu Sans', Verdana, sans-serif"),
    ("'Liberation Serif', Georgia, serif", "'Liberation Serif', Georgia, serif"),
    ("'DejaVu Serif', Georgia, serif", "'DejaVu Sans', Verdana, sans-serif"),
    ("'Liberation Mono', 'Courier New', monospace", "'Liberation Sans', Arial, sans-serif"),
)


@dataclass(frozen=True)
class Look:
    """The look of a website, used by templates; ``site.css`` uses :attr:`variables` and :attr:`classes`.

    Attributes:
        navigation: main menu at the top, or at the left side.
        sticky: whether the header stays visible when the page scrolls.
        listing: results as a grid of cards, as rows, or as a table.
        filters: to the left of the results, or above them.
        pager: numbered pages, previous/next, or one "load more" button.
        detail: sections of a detail page as tabs, as accordions, or one below the other.
        consent: the cookie banner: a bar at the bottom, a box in the middle, or none.
        hero: whether the front page starts with a large banner.
    """

    primary: str
    on_primary: str
    accent: str
    page: str
    surface: str
    heading_font: str
    text_font: str
    radius: int
    navigation: Literal["top", "side"]
    sticky: bool
    listing: Literal["grid", "rows", "table"]
    filters: Literal["left", "top"]
    pager: Literal["numbers", "steps", "more"]
    detail: Literal["tabs", "accordion", "plain"]
    consent: Literal["bar", "box", "none"]
    hero: bool
    shadow: bool
    uppercase: bool

    @property
    def variables(self) -> str:
        """CSS custom properties."""
        pairs = {
            "primary": self.primary,
            "on-primary": self.on_primary,
            "accent": self.accent,
            "page": self.page,
            "surface": self.surface,
            "heading-font": self.heading_font,
            "text-font": self.text_font,
            "radius": f"{self.radius}px",
        }
        return ";".join(f"--{name}:{value}" for name, value in pairs.items())

    @property
    def classes(self) -> str:
        """Classes of the body element."""
        flags = [f"nav-{self.navigation}", f"filters-{self.filters}", f"list-{self.listing}"]
        flags += [name for name in ("sticky", "shadow", "uppercase") if getattr(self, name)]
        return " ".join(flags)


def look(seed: int) -> Look:
    """The look of the website with this seed."""
    rng = stream(seed, "look")
    primary, on_primary, accent, page, surface = pick(PALETTES, seed, "palette")
    heading_font, text_font = pick(FONTS, seed, "fonts")
    return Look(
        primary=primary,
        on_primary=on_primary,
        accent=accent,
        page=page,
        surface=surface,
        heading_font=heading_font,
        text_font=text_font,
        radius=rng.choice((0, 3, 6, 10, 16)),
        navigation="side" if rng.random() < 0.25 else "top",
        sticky=rng.random() < 0.6,
        listing=rng.choice(("grid", "grid", "rows", "table")),
        filters=rng.choice(("left", "left", "top")),
        pager=rng.choice(("numbers", "numbers", "steps", "more")),
        detail=rng.choice(("tabs", "accordion", "plain")),
        consent=rng.choice(("bar", "bar", "box", "none", "none")),
        hero=rng.random() < 0.6,
        shadow=rng.random() < 0.5,
        uppercase=rng.random() < 0.2,
    )


def _color(hue: float, saturation: float, lightness: float) -> str:
    red, green, blue = colorsys.hls_to_rgb(hue % 1, lightness, saturation)
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def _frame(body: str, background: str) -> str:
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 480 360" width="480" height="360">'
        f'<rect width="480" height="360" fill="{background}"/>{body}</svg>'
    )


def _dot(x: float, y: float, radius: int, color: str) -> str:
    return f'<circle cx="{x:.0f}" cy="{y:.0f}" r="{radius}" fill="{color}"/>'


def _thing(rng: random.Random) -> str:
    """An object on a table: stacked rounded shapes with a shadow."""
    hue = rng.random()
    body = '<ellipse cx="240" cy="306" rx="130" ry="16" fill="#00000022"/>'
    width, bottom = rng.randint(110, 230), 300
    for layer in range(rng.randint(2, 4)):
        height = rng.randint(40, 110)
        color = _color(hue + layer * rng.choice((0.0, 0.08, 0.5)), 0.45, 0.38 + 0.11 * layer)
        body += (
            f'<rect x="{240 - width / 2:.0f}" y="{bottom - height}" width="{width}" height="{height}" '
            f'rx="{rng.choice((4, 12, 26, height // 2))}" fill="{color}"/>'
        )
        body += (
            f'<rect x="{240 - width / 2 + 12:.0f}" y="{bottom - height + 10}" width="12" '
            f'height="{max(8, height - 24)}" rx="6" fill="#ffffff44"/>'
        )
        bottom -= height
        width = max(40, int(width * rng.uniform(0.5, 0.95)))
        if bottom < 70:
            break
    return _frame(body, _color(hue + 0.45, 0.3, 0.93))


def _scene(rng: random.Random) -> str:
    """A landscape: sky, sun and hills."""
    hue = rng.random()
    sun = _color(hue + 0.5, 0.7, 0.72)
    body = _dot(rng.randint(80, 400), rng.randint(60, 150), rng.randint(24, 52), sun)
    for layer in range(4):
        base = 170 + layer * 48
        points = [f"0,{base + rng.randint(-20, 20)}"]
        points += [f"{x},{base + rng.randint(-42, 32)}" for x in range(60, 480, 60)]
        points += [f"480,{base}", "480,360", "0,360"]
        color = _color(hue + 0.04 * layer, 0.38, 0.66 - 0.13 * layer)
        body += f'<polygon points="{" ".join(points)}" fill="{color}"/>'
    return _frame(body, _color(hue + 0.08, 0.5, 0.88))


def _dish(rng: random.Random) -> str:
    """A plate seen from above."""
    hue = rng.random()
    body = (
        '<circle cx="240" cy="180" r="150" fill="#ffffff"/><circle cx="240" cy="180" r="118" fill="#f2efe9"/>'
    )
    for _ in range(rng.randint(14, 26)):
        x, y, size = rng.gauss(240, 46), rng.gauss(180, 42), rng.randint(9, 30)
        body += _dot(x, y, size, _color(rng.uniform(0, 0.36), 0.6, rng.uniform(0.35, 0.7)))
    return _frame(body, _color(hue, 0.35, 0.78))


def _face(rng: random.Random) -> str:
    """A simple portrait."""
    skin = _color(rng.uniform(0.05, 0.1), rng.uniform(0.3, 0.6), rng.uniform(0.4, 0.82))
    hair = _color(rng.uniform(0.03, 0.12), 0.5, rng.uniform(0.12, 0.5))
    shirt = _color(rng.random(), 0.5, 0.5)
    body = (
        f'<path d="M90 360 C110 260 370 260 390 360 Z" fill="{shirt}"/>'
        + _dot(240, 170, 88, hair)
        + f'<ellipse cx="240" cy="188" rx="68" ry="80" fill="{skin}"/>'
        + _dot(214, 180, 7, "#222222")
        + _dot(266, 180, 7, "#222222")
        + f'<path d="M212 224 Q240 {rng.randint(226, 252)} 268 224" stroke="#222" stroke-width="5" '
        + 'fill="none"/>'
    )
    return _frame(body, _color(rng.random(), 0.4, 0.85))


def _pattern(rng: random.Random) -> str:
    """An abstract poster."""
    hue, body = rng.random(), ""
    for _ in range(rng.randint(6, 12)):
        color = _color(hue + rng.choice((0, 0.1, 0.5)), 0.6, rng.uniform(0.35, 0.75))
        x, y, size = rng.randint(0, 480), rng.randint(0, 360), rng.randint(40, 150)
        if rng.random() < 0.5:
            body += _dot(x, y, size, color)
        else:
            turn = rng.randint(0, 90)
            body += (
                f'<rect x="{x - size}" y="{y - size}" width="{2 * size}" height="{size}" '
                f'transform="rotate({turn} {x} {y})" fill="{color}" opacity=".75"/>'
            )
    return _frame(body, _color(hue, 0.4, 0.9))


_KINDS: dict[str, Callable[[random.Random], str]] = {
    "thing": _thing,
    "scene": _scene,
    "dish": _dish,
    "face": _face,
    "pattern": _pattern,
}


def draw(kind: str, name: str, look: Look) -> str:
    """An SVG picture.

    Args:
        kind: ``thing``, ``scene``, ``dish``, ``face`` or ``pattern``; anything else gives ``pattern``.
        name: seed of the picture.
        look: of the website; its primary colour is part of the seed.
    """
    return _KINDS.get(kind, _pattern)(stream("art", kind, name, look.primary))
