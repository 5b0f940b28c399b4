"""The desktop that pages are told of: mouse, screen, languages, permissions.

A headless browser says by itself that there is no mouse, and sends no languages: websites then serve layouts
for touch, and menus that open under the mouse never do. What a headed one answers is compared by
:mod:`webgym.browser.questions`.
"""

from __future__ import annotations

from typing import Any

from webgym.browser.config import Place

SCREEN = (1920, 1080)
"""Size of the screen, CSS pixels; a larger window has a screen of its own size."""

FLAGS = (
    # Blink's numbers for "hovers" and "fine"; the headless shell has no device to derive them from.
    "--blink-settings=primaryHoverType=2,availableHoverTypes=2,primaryPointerType=4,availablePointerTypes=4",
    "--accept-lang=en-US,en",
)
"""Flags of the browser."""

_ACCURACY_METRES = 20


def permissions(context: str, place: Place | None = None) -> list[dict[str, Any]]:
    """Parameters of ``Browser.setPermission`` for an episode's browser context: nobody could answer a
    question. The clipboard is empty when a context starts.

    Args:
        context: id of the context.
        place: where pages are told that they are; ``None`` if they are not told.
    """
    settings = {
        "clipboard-read": "granted",
        "clipboard-write": "granted",
        "notifications": "denied",
        "geolocation": "granted" if place else "denied",
    }
    return [
        {"permission": {"name": name}, "setting": setting, "browserContextId": context}
        for name, setting in settings.items()
    ]


def location(place: Place) -> dict[str, Any]:
    """Parameters of ``Emulation.setGeolocationOverride``."""
    latitude, longitude = place
    return {"latitude": latitude, "longitude": longitude, "accuracy": _ACCURACY_METRES}


def metrics(viewport: tuple[int, int]) -> dict[str, Any]:
    """Parameters of ``Emulation.setDeviceMetricsOverride`` for a window with this viewport."""
    width, height = viewport
    return {
        "width": width,
        "height": height,
        "screenWidth": max(width, SCREEN[0]),
        "screenHeight": max(height, SCREEN[1]),
        "deviceScaleFactor": 1,
        "mobile": False,
    }
