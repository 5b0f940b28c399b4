"""The look of a website: palette, fonts and layout."""

from __future__ import annotations

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
