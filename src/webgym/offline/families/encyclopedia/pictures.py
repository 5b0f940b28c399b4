"""Illustrations of encyclopedias as SVG: the subject, coloured and posed by the article's name."""

from __future__ import annotations

import colorsys
import math
import random
from collections.abc import Callable
from textwrap import wrap
from xml.sax.saxutils import escape

from webgym.offline import art
from webgym.offline.look import Look
from webgym.offline.seeds import stream

WIDTH, HEIGHT = 480, 360


def draw(kind: str, name: str, look: Look) -> str:
    """An SVG picture; a kind that is not drawn here is drawn as on every website."""
    if kind not in _KINDS:
        return art.draw(kind, name, look)
    rng = stream("encyclopedia art", kind, name)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'height="{HEIGHT}">{_KINDS[kind](rng, name)}</svg>'
    )


def _color(hue: float, saturation: float, lightness: float) -> str:
    red, green, blue = colorsys.hls_to_rgb(hue % 1, lightness, saturation)
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def _ground(color: str) -> str:
    return f'<rect width="{WIDTH}" height="{HEIGHT}" fill="{color}"/>'


def _circle(x: float, y: float, radius: float, color: str) -> str:
    return f'<circle cx="{x:.0f}" cy="{y:.0f}" r="{radius:.1f}" fill="{color}"/>'


def _oval(x: float, y: float, wide: float, high: float, color: str, turn: float = 0) -> str:
    return (
        f'<ellipse cx="{x:.0f}" cy="{y:.0f}" rx="{wide:.0f}" ry="{high:.0f}" fill="{color}" '
        f'transform="rotate({turn:.0f} {x:.0f} {y:.0f})"/>'
    )


def _box(x: float, y: float, wide: float, high: float, color: str) -> str:
    return f'<rect x="{x:.0f}" y="{y:.0f}" width="{wide:.0f}" height="{high:.0f}" fill="{color}"/>'


def _text(y: float, size: int, text: str, color: str) -> str:
    return (
        f'<text x="240" y="{y:.0f}" font-size="{size}" text-anchor="middle" font-family="serif" '
        f'fill="{color}">{escape(text)}</text>'
    )


def _shape(points: str, color: str) -> str:
    return f'<polygon points="{points}" fill="{color}"/>'


def _line(path: str, color: str, width: int) -> str:
    return f'<path d="{path}" stroke="{color}" stroke-width="{width}" fill="none" stroke-linecap="round"/>'


def _bird(rng: random.Random, name: str) -> str:
    del name
    hue, size = rng.random(), rng.uniform(0.8, 1.15)
    body, wing, beak = (
        _color(hue, 0.5, 0.48),
        _color(hue + 0.04, 0.5, 0.32),
        rng.choice(("#d97706", "#3f3f46")),
    )
    wide, high, reach = 96 * size, rng.randint(58, 82) * size, rng.randint(22, 62)
    head = (240 + wide * 0.75, 178 - high * 0.75)
    return (
        _ground(_color(hue + 0.5, 0.35, 0.88))
        + _line("M40 292 Q240 268 450 288", "#6b4f3a", 12)
        + _line("M226 230 V280 M256 230 V278", beak, 6)
        + _shape(f"{240 - wide:.0f},170 {100 - reach},{rng.randint(190, 236)} {250 - wide:.0f},206", wing)
        + _oval(240, 188, wide, high, body, -14)
        + _shape(
            f"{head[0] + 24:.0f},{head[1] - 8:.0f} {head[0] + 40 + reach:.0f},{head[1]:.0f} "
            f"{head[0] + 24:.0f},{head[1] + 10:.0f}",
            beak,
        )
        + _circle(*head, 34 * size, body)
        + _circle(head[0] + 12, head[1] - 6, 5, "#111111")
        + _oval(220, 186, wide * 0.62, high * 0.5, wing, rng.randint(-26, 8))
    )


def _fish(rng: random.Random, name: str) -> str:
    del name
    hue, high = rng.random(), rng.randint(42, 92)
    body, fin = _color(hue, 0.6, 0.52), _color(hue + 0.08, 0.6, 0.4)
    stripes = "".join(
        f'<rect x="{190 + i * 34}" y="{180 - high * 0.8:.0f}" width="{rng.randint(5, 15)}" '
        f'height="{high * 1.6:.0f}" rx="6" fill="{fin}" opacity=".75"/>'
        for i in range(rng.randint(1, 4))
    )
    bubbles = "".join(
        _circle(rng.randint(20, 460), rng.randint(10, 350), rng.randint(3, 9), "#ffffff66") for _ in range(9)
    )
    return (
        _ground(_color(0.53 + rng.uniform(-0.04, 0.06), 0.5, 0.72))
        + bubbles
        + _shape(f"140,180 66,{180 - high} 84,180 66,{180 + high}", fin)
        + _shape(f"200,{190 - high} 250,{150 - high * 1.25:.0f} 310,{196 - high}", fin)
        + _oval(245, 180, 130, high, body)
        + stripes
        + _circle(336, 168, 11, "#ffffff")
        + _circle(339, 168, 6, "#111111")
    )


def _dino(rng: random.Random, name: str) -> str:
    del name
    hue = rng.uniform(0.05, 0.45)
    skin, neck, legs = _color(hue, 0.35, 0.4), rng.randint(60, 170), rng.randint(50, 90)
    plates = "".join(
        _shape(f"{180 + i * 24},150 {192 + i * 24},{rng.randint(104, 130)} {204 + i * 24},150", skin)
        for i in range(rng.choice((0, 0, 6)))
    )
    return (
        _ground(_color(hue + 0.1, 0.35, 0.85))
        + _oval(240, 318, 220, 26, "#00000022")
        + plates
        + _line(f"M180 200 Q110 {rng.randint(190, 240)} 50 {rng.randint(150, 290)}", skin, 30)
        + _line(f"M300 190 Q370 180 {350 + rng.randint(0, 50)} {210 - neck}", skin, 36)
        + _oval(386, 206 - neck, 40, 22, skin, rng.randint(-6, 24))
        + _circle(396, 200 - neck, 4, "#111111")
        + "".join(_line(f"M{x} 220 V{230 + legs}", skin, 30) for x in (190, 226, 268, 296))
        + _oval(240, 198, 100, 58, skin)
    )


def _plant(rng: random.Random, name: str) -> str:
    del name
    leaf, petal = _color(rng.uniform(0.22, 0.42), 0.45, 0.36), _color(rng.random(), 0.6, 0.6)
    body = _ground("#f7f3e8")
    for _ in range(rng.randint(3, 5)):
        x, top = rng.randint(130, 350), rng.randint(50, 140)
        body += _line(f"M240 350 Q{(x + 240) // 2} 240 {x} {top}", leaf, 5)
        for height in range(top + 50, 300, rng.randint(34, 52)):
            at = x + (240 - x) * (height - top) / (350 - top)
            for side in (-1, 1):
                body += _oval(at + side * 24, height, 26, rng.randint(7, 13), leaf, side * -28)
        for turn in range(0, 360, rng.choice((45, 60, 72))):
            angle = math.radians(turn)
            body += _circle(x + 15 * math.cos(angle), top + 15 * math.sin(angle), 10, petal)
        body += _circle(x, top, 8, "#fbbf24")
    return body


def _paw(rng: random.Random, name: str) -> str:
    del name
    fur, patch = _color(rng.uniform(0.05, 0.12), 0.4, rng.uniform(0.3, 0.7)), _color(0.08, 0.3, 0.2)
    drop, muzzle = rng.randint(60, 130), rng.randint(40, 62)
    return (
        _ground(_color(rng.random(), 0.35, 0.86))
        + _oval(240, 352, 130, 90, fur)
        + _oval(146, 140, 36, drop, patch, 14)
        + _oval(334, 140, 36, drop, patch, -14)
        + _oval(240, 176, 96, 104, fur)
        + (_oval(276, 150, 34, 42, patch) if rng.random() < 0.5 else "")
        + _oval(240, 222, muzzle, 46, _color(0.09, 0.3, 0.85))
        + _oval(240, 200, 20, 14, "#222222")
        + _circle(204, 152, 9, "#111111")
        + _circle(276, 152, 9, "#111111")
        + _line("M240 214 V234 M218 242 Q240 258 262 242", "#222222", 4)
    )


def _crystal(rng: random.Random, name: str) -> str:
    del name
    hue = rng.random()
    body = _ground("#22252e") + _oval(240, 316, 180, 26, "#00000066")
    for x in sorted(
        rng.sample(range(110, 370, 26), rng.randint(3, 6)), key=lambda x: abs(x - 240), reverse=True
    ):
        high, wide, lean = rng.randint(90, 250), rng.randint(22, 46), (x - 240) // 4
        top, tip = 310 - high, 280 - high
        left, right = x - wide + lean, x + wide + lean
        body += _shape(f"{x - wide},310 {x},318 {x + lean},{top + 14} {left},{top}", _color(hue, 0.55, 0.42))
        body += _shape(f"{x},318 {x + wide},310 {right},{top} {x + lean},{top + 14}", _color(hue, 0.55, 0.58))
        body += _shape(
            f"{left},{top} {x + lean},{top + 14} {x + lean + 4},{tip - 14}", _color(hue, 0.5, 0.66)
        )
        body += _shape(
            f"{right},{top} {x + lean},{top + 14} {x + lean + 4},{tip - 14}", _color(hue, 0.5, 0.78)
        )
    return body


def _moon(rng: random.Random, name: str) -> str:
    del name
    hue, radius = rng.random(), rng.randint(86, 136)
    body = _ground("#0b1020")
    body += "".join(
        _circle(rng.randint(0, 480), rng.randint(0, 360), rng.choice((1, 1.5, 2.5)), "#ffffffcc")
        for _ in range(46)
    )
    body += _circle(240, 180, radius, _color(hue, 0.18, 0.66))
    for _ in range(rng.randint(5, 14)):
        angle, far = rng.uniform(0, 6.28), rng.uniform(0, radius * 0.78)
        x, y, size = 240 + far * math.cos(angle), 180 + far * math.sin(angle), rng.uniform(5, radius * 0.17)
        body += _circle(x, y, size, _color(hue, 0.16, 0.52)) + _circle(
            x + 2, y + 2, size * 0.7, _color(hue, 0.16, 0.6)
        )
    shade = f"M240 {180 - radius} A{radius} {radius} 0 0 1 240 {180 + radius}"
    shade += f" A{radius * 0.5:.0f} {radius} 0 0 0 240 {180 - radius}"
    return f'{body}<path d="{shade}" fill="#00000066"/>'


def _coin(rng: random.Random, name: str) -> str:
    metal = rng.choice(("#c9a227", "#9aa3ad", "#a65e2e", "#8a7f5c"))
    teeth = "".join(
        _circle(
            240 + 128 * math.cos(i * math.pi / 30), 180 + 128 * math.sin(i * math.pi / 30), 4, "#00000044"
        )
        for i in range(60)
    )
    sign = rng.choice(("♛", "⚜", "✠", "★", "♜", "☀"))
    return (
        _ground("#e9e4da")
        + _oval(250, 196, 142, 142, "#00000033")
        + _circle(240, 180, 142, metal)
        + _circle(240, 180, 116, "#ffffff30")
        + teeth
        + _text(222, 128, sign, "#00000088")
        + _text(266, 22, name.split()[0].upper(), "#00000099")
    )


def _poster(rng: random.Random, name: str) -> str:
    hue = rng.random()
    dark, light = _color(hue, 0.5, 0.2), _color(hue + rng.choice((0.08, 0.5)), 0.65, 0.6)
    body = _ground("#d8d5cf") + _box(120, 14, 240, 332, dark)
    for i in range(rng.randint(3, 6)):
        body += rng.choice(
            (
                _circle(rng.randint(170, 310), rng.randint(70, 200), rng.randint(16, 50), light),
                _shape(
                    f"120,{240 - 20 * i} 240,{90 + 18 * i} 360,{230 - 10 * i} 360,250 120,250", light + "88"
                ),
            )
        )
    lines = wrap(name, 14)[:3]
    for place, line in enumerate(lines):
        body += _text(318 - 30 * (len(lines) - 1 - place), 25, line, "#ffffff")
    return body


def _sheet(rng: random.Random, name: str) -> str:
    body = _ground("#f6f0df") + _text(50, 26, name, "#2b2b2b")
    for staff in range(4):
        top = 84 + staff * 68
        body += "".join(_line(f"M40 {top + 9 * i} H440", "#5b5b5b", 1) for i in range(5))
        x = 70
        while x < 430:
            y = top + rng.randint(-1, 9) * 4.5
            body += _oval(x, y, 8, 6, "#1f1f1f", -18) + _line(f"M{x + 7} {y:.0f} v-30", "#1f1f1f", 2)
            x += rng.choice((24, 32, 46))
    return body


def _weave(rng: random.Random, name: str) -> str:
    del name
    hue, cell, step = rng.random(), rng.choice((14, 20, 28)), rng.choice((1, 2, 3))
    colors = [_color(hue, 0.4, 0.4), _color(hue + rng.choice((0.03, 0.12, 0.5)), 0.45, 0.66)]
    stripes = [rng.random() < 0.2 for _ in range(40)]
    accent = _color(hue + 0.33, 0.5, 0.5)
    body = _ground(colors[0])
    for row in range(HEIGHT // cell + 1):
        for column in range(WIDTH // cell + 1):
            if (column + row * step) % 4 < 2:
                color = accent if stripes[column % 40] or stripes[row % 40] else colors[1]
                body += _box(column * cell, row * cell, cell - 1, cell - 1, color)
    return body


def _castle(rng: random.Random, name: str) -> str:
    del name
    hue, stone = rng.uniform(0.5, 0.7), _color(0.09, 0.12, rng.uniform(0.35, 0.55))
    body = _ground(_color(hue, 0.5, 0.84)) + _oval(
        240, 372, 330, 96, _color(rng.uniform(0.2, 0.36), 0.4, 0.42)
    )
    body += _box(150, 200, 180, 100, stone)
    for x in rng.sample((120, 168, 220, 276, 322), rng.randint(3, 5)):
        high, wide = rng.randint(90, 190), rng.randint(34, 52)
        body += _box(x, 296 - high, wide, high, stone)
        if rng.random() < 0.5:
            roof = f"{x - 6},{298 - high} {x + wide // 2},{240 - high} {x + wide + 6},{298 - high}"
            body += _shape(roof, _color(rng.choice((0.02, 0.6)), 0.45, 0.36))
        else:
            body += "".join(_box(x + i * wide // 3, 286 - high, 9, 12, stone) for i in range(3))
        body += _box(x + wide // 2 - 4, 320 - high, 8, 20, "#2b2b2b")
    return body + '<path d="M222 300 V262 a18 18 0 0 1 36 0 V300 Z" fill="#2b2b2b"/>'


def _stadium(rng: random.Random, name: str) -> str:
    del name
    seat = _color(rng.random(), 0.55, 0.45)
    flat = rng.randint(80, 118)
    masts = "".join(_line(f"M{x} 190 V50", "#52525b", 6) + _circle(x, 48, 14, "#fde68a") for x in (60, 420))
    return (
        _ground(_color(0.57, 0.45, 0.82))
        + (masts if rng.random() < 0.6 else "")
        + _oval(240, 226, 214, flat, "#71717a")
        + _oval(240, 218, 200, flat - 8, seat)
        + _oval(240, 222, 150, flat - 36, "#d4d4d8")
        + _oval(240, 222, 128, flat - 50, _color(0.33, 0.45, 0.4))
        + _line(f"M240 {274 - flat} V{170 + flat}", "#ffffff", 2)
    )


def _machine(rng: random.Random, name: str) -> str:
    del name
    body = _ground("#ece5d8")
    for _ in range(rng.randint(3, 5)):
        x, y, radius, teeth = (
            rng.randint(110, 370),
            rng.randint(90, 260),
            rng.randint(34, 84),
            rng.randint(9, 18),
        )
        color = rng.choice(("#8a6d3b", "#57534e", "#a16207", "#475569"))
        for i in range(teeth):
            turn = 360 * i / teeth
            body += (
                f'<g transform="rotate({turn:.0f} {x} {y})">{_box(x - 8, y - radius - 12, 16, 22, color)}</g>'
            )
        body += (
            _circle(x, y, radius, color)
            + _circle(x, y, radius * 0.62, "#ece5d8")
            + _circle(x, y, radius * 0.2, color)
        )
        body += _line(f"M{x - radius * 0.7:.0f} {y} H{x + radius * 0.7:.0f}", color, 8)
    return body


_KINDS: dict[str, Callable[[random.Random, str], str]] = {
    "bird": _bird,
    "fish": _fish,
    "dino": _dino,
    "plant": _plant,
    "paw": _paw,
    "crystal": _crystal,
    "moon": _moon,
    "coin": _coin,
    "poster": _poster,
    "sheet": _sheet,
    "weave": _weave,
    "castle": _castle,
    "stadium": _stadium,
    "machine": _machine,
}
