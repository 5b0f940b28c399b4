"""Pictures of goods as SVG: a silhouette by what the name says, colours and pose by the name itself.

The silhouettes are symbols in ``templates/shop/goods.svg``.
"""

from __future__ import annotations

import colorsys
import random
import re
from functools import cache
from pathlib import Path
from textwrap import wrap
from xml.sax.saxutils import escape

from webgym.offline.seeds import stream

DRAWINGS = Path(__file__).parents[2] / "templates" / "shop" / "goods.svg"

WORDS: dict[str, str] = {
    "kettle": "kettle moka press watering pour",
    "pan": "pan wok saute tin",
    "blade": "caliper knife cleaver saw handsaw jigsaw scissors secateurs lopper shears clipper",
    "jar": "jar jam honey marmalade bin ink cream blush drops gel bottled grinder candle food capsules",
    "bottle": "soap oil vinegar serum cleanser tonic shampoo conditioner milk mouthwash tint burner fountain",
    "tube": "sunscreen sun tinted mascara brow stick balm toothbrush",
    "pouch": "tea sencha beans roast blend seeds mix hay tablets multivitamin chocolate nougat",
    "lamp": "lamp light pendant",
    "torch": "torch headlamp lantern front rear clip",
    "tent": "tent bivouac kite",
    "bag": "bag pack daypack pannier",
    "garment": "neck jacket shirt coat jumper cardigan parka shell vest raincoat polo",
    "trousers": "trousers chinos jeans",
    "shoe": "shoes boots trainers loafers insoles",
    "scarf": "scarf beanie gloves belt shawl mitten support brace bandage",
    "chair": "chair stool armchair bench seat",
    "table": "table stand desk platform",
    "shelf": "shelf bookcase rack organiser tray",
    "cloth": "rug throw cushion curtain blanket mat canvas cloth corduroy cotton hammock quilt",
    "guitar": "guitar ukulele dreadnought violin viola fiddle",
    "keys": "piano synthesizer organ practice",
    "keyboard": "keyboard pad",
    "drum": "drum cajon bongo barrel",
    "headphones": "headphones earbuds earphones",
    "speaker": "speaker soundbar",
    "screen": "monitor",
    "camera": "camera",
    "device": "tool tape bank charger adapter metronome tuner meter thermometer oximeter scale pump stove",
    "notebook": "notebook sketchbook journal pattern",
    "pen": "pen pencil charcoal colouring needle hook brush comb level rolling handle",
    "cards": "cards postcard envelope seal patterns",
    "yarn": "yarn ball loom weaving embroidery hat rope",
    "bicycle": "bike bicycle scooter",
    "helmet": "helmet",
    "lock": "lock",
    "truck": "truck train tractor engine wagon",
    "blocks": "block marble plank bridge rocking",
    "puzzle": "puzzle",
    "doll": "doll knight family puppets",
    "planter": "planter pot window vase",
    "spade": "spade fork trowel sprinkler hose",
    "bowl": "bowl dish feeder",
    "basket": "basket cave bed tunnel wand",
    "lead": "lead harness collar cable chain folding",
    "drill": "clamp drill sander driver",
    "ladder": "ladder",
}
"""Which words of a name call for which silhouette."""

PHRASES = {
    "moka pot": "kettle",
    "sleeping bag": "cloth",
    "mummy bag": "cloth",
    "practice keyboard": "keys",
}
"""Pairs of words that mean something else than their last word."""

BY_WORD = {word: shape for shape, words in WORDS.items() for word in words.split()}


@cache
def shapes() -> dict[str, str]:
    """The silhouettes by name."""
    found = re.findall(r'<symbol id="(\w+)">(.*?)</symbol>', DRAWINGS.read_text(), re.DOTALL)
    return {name: re.sub(r">\s+<", "><", body.strip()) for name, body in found}


def _color(hue: float, saturation: float, lightness: float) -> str:
    red, green, blue = colorsys.hls_to_rgb(hue % 1, lightness, saturation)
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def shape_of(name: str) -> str:
    """The silhouette that fits a product's name: that of the last word that has one; else a box."""
    for phrase, shape in PHRASES.items():
        if name.lower().endswith(phrase):
            return shape
    known = [BY_WORD[word] for word in name.lower().replace("-", " ").split() if word in BY_WORD]
    return known[-1] if known else "box"


def _cover(title: str, rng: random.Random) -> str:
    """The front of a book, a film or a game, with its title."""
    hue = rng.random()
    dark, light = _color(hue, 0.5, 0.28), _color(hue + rng.choice((0.1, 0.4, 0.5)), 0.6, 0.7)
    body = f'<rect x="128" y="18" width="224" height="324" fill="{dark}"/>'
    for _ in range(rng.randint(2, 5)):
        x, y, size = rng.randint(140, 340), rng.randint(170, 320), rng.randint(14, 60)
        shade = _color(hue + rng.uniform(0, 0.5), 0.5, rng.uniform(0.35, 0.75))
        body += f'<circle cx="{x}" cy="{y}" r="{min(size, x - 128, 352 - x, 342 - y)}" fill="{shade}"/>'
    for line, text in enumerate(wrap(title, 14)[:4]):
        body += (
            f'<text x="240" y="{66 + 30 * line}" font-family="Liberation Serif,Georgia,serif" font-size="25" '
            f'text-anchor="middle" fill="{light}">{escape(text)}</text>'
        )
    return body


def draw(name: str, *, cover: bool) -> str:
    """A picture of a product.

    Args:
        name: of the product; decides everything.
        cover: whether it is a book, a film or a game.
    """
    rng = stream("goods", name)
    hue = rng.random()
    if cover:
        body = _cover(name, rng)
    else:
        other = hue + rng.choice((0.0, 0.05, 0.5))
        tones = f"--a:{_color(hue, 0.4, 0.26)};--b:{_color(hue, 0.42, 0.5)};--c:{_color(other, 0.5, 0.74)}"
        turn, flip = rng.uniform(-4, 4), rng.choice((-1, 1))
        size = rng.uniform(0.86, 1.04)
        pose = (
            f"translate(240 190) rotate({turn:.1f}) scale({flip * size:.2f} {size:.2f}) translate(-240 -190)"
        )
        body = '<ellipse cx="240" cy="312" rx="150" ry="14" fill="#0000001c"/>'
        body += f'<g transform="{pose}" style="{tones}">{shapes()[shape_of(name)]}</g>'
    ground = _color(hue + rng.choice((0.0, 0.5)), 0.25, rng.choice((0.93, 0.95, 0.97)))
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 480 360" width="480" height="360">'
        f'<rect width="480" height="360" fill="{ground}"/>{body}</svg>'
    )
