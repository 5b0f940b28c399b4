"""Illustrations as SVG, generated from a name: the same name gives the same picture."""

from __future__ import annotations

import colorsys
import random
from collections.abc import Callable

from webgym.offline.look import Look
from webgym.offline.seeds import stream


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
