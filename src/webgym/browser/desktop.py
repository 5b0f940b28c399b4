"""The desktop that pages are told of: a mouse, a screen, permissions, and an identity.

A headless browser says by itself that there is no mouse, and sends no languages: websites then serve layouts
for touch, and menus that open under the mouse never do. What a headed one answers is compared by
:mod:`webgym.browser.questions`.
"""

from __future__ import annotations

import platform
import re
import sys
from dataclasses import dataclass
from typing import Any

from webgym.core.identity import Identity

SCREEN = (1920, 1080)
"""Size of the screen, CSS pixels; a larger window has a screen of its own size."""

# Blink's numbers for "hovers" and "fine"; the headless shell has no device to derive them from.
MOUSE_FLAG = (
    "--blink-settings=primaryHoverType=2,availableHoverTypes=2,primaryPointerType=4,availablePointerTypes=4"
)

_ACCURACY_METRES = 20

_SYSTEMS = {
    "darwin": ("Macintosh; Intel Mac OS X 10_15_7", "macOS", "MacIntel"),
    "linux": ("X11; Linux x86_64", "Linux", "Linux x86_64"),
}
"""Platform in the user agent, in client hints and in scripts, by ``sys.platform``. Browsers reduce the
first to one per system, whatever its version and processor are."""

_CHROME_VERSION = re.compile(r"Chrome/(\d+(?:\.\d+){0,3})")
_GREASE = " (:-./);=?_"
"""Characters in the name of a brand that does not exist, and that browsers list for servers to ignore."""
_GREASE_VERSIONS = ("8", "99", "24")


def permissions(context: str, identity: Identity) -> list[dict[str, Any]]:
    """Parameters of ``Browser.setPermission`` for an episode's browser context: nobody could answer a
    question. The clipboard is empty when a context starts.

    Args:
        context: id of the context.
        identity: the browser's.
    """
    settings = {
        "clipboard-read": "granted",
        "clipboard-write": "granted",
        "notifications": "denied",
        "geolocation": "granted" if identity.place else "denied",
    }
    return [
        {"permission": {"name": name}, "setting": setting, "browserContextId": context}
        for name, setting in settings.items()
    ]


def metrics(viewport: tuple[int, int], device_scale: float) -> dict[str, Any]:
    """Parameters of ``Emulation.setDeviceMetricsOverride`` for a window with this viewport."""
    width, height = viewport
    return {
        "width": width,
        "height": height,
        "screenWidth": max(width, SCREEN[0]),
        "screenHeight": max(height, SCREEN[1]),
        "deviceScaleFactor": device_scale,
        "mobile": False,
    }


@dataclass(frozen=True)
class Told:
    """How one browser says who it is: by its flags everywhere, and by commands what flags cannot say.

    Attributes:
        identity: what it is to say.
        version: of the executable, such as ``156.0.8078.108``.
    """

    identity: Identity
    version: str

    @property
    def flags(self) -> list[str]:
        """The browser's flags. Workers that pages share are told by them alone when they start."""
        identity = self.identity
        flags = [MOUSE_FLAG, f"--lang={identity.languages[0]}", f"--accept-lang={self._languages}"]
        flags += [f"--user-agent={self.user_agent}"] if self.user_agent else []
        return flags + ([] if identity.webdriver else ["--disable-blink-features=AutomationControlled"])

    @property
    def user_agent(self) -> str:
        """The user agent; empty for the executable's own."""
        identity = self.identity
        agent = identity.user_agent or ""
        if not agent and (identity.profile == "desktop" or identity.contact):
            name = "Chrome" if identity.profile == "desktop" else "HeadlessChrome"
            number = f"{self._major}.0.0.0" if identity.profile == "desktop" else self.version
            agent = f"Mozilla/5.0 ({_system()[0]}) AppleWebKit/537.36 (KHTML, like Gecko) "
            agent += f"{name}/{number} Safari/537.36"
        return f"{agent} ({identity.contact})" if identity.contact else agent

    @property
    def commands(self) -> list[tuple[str, dict[str, Any]]]:
        """Commands for every page, before it runs."""
        identity = self.identity
        commands = self.of_workers
        if identity.time_zone:
            commands.append(("Emulation.setTimezoneOverride", {"timezoneId": identity.time_zone}))
        locale = identity.locale or identity.languages[0]
        if locale != "en-US":  # which the headless shell has, whatever its flags say
            commands.append(("Emulation.setLocaleOverride", {"locale": locale}))
        if identity.color_scheme != "light":
            scheme = {"name": "prefers-color-scheme", "value": identity.color_scheme}
            commands.append(("Emulation.setEmulatedMedia", {"features": [scheme]}))
        if identity.place:
            latitude, longitude = identity.place
            place = {"latitude": latitude, "longitude": longitude, "accuracy": _ACCURACY_METRES}
            commands.append(("Emulation.setGeolocationOverride", place))
        return commands

    @property
    def of_workers(self) -> list[tuple[str, dict[str, Any]]]:
        """Commands for every worker, before it runs."""
        commands: list[tuple[str, dict[str, Any]]] = []
        if self.user_agent:
            agent: dict[str, Any] = {"userAgent": self.user_agent, "acceptLanguage": self._languages}
            agent["platform"] = _system()[2]
            if self._shown_version:
                agent["userAgentMetadata"] = self._hints()
            commands.append(("Emulation.setUserAgentOverride", agent))
        if self.identity.headers:
            commands.append(("Network.setExtraHTTPHeaders", {"headers": self.identity.headers}))
        return commands

    @property
    def _languages(self) -> str:
        return ",".join(self.identity.languages)

    @property
    def _shown_version(self) -> str:
        """The version that the user agent names; the executable's, where it names that one's first number."""
        found = _CHROME_VERSION.search(self.user_agent)
        if found is None:
            return ""
        return self.version if found[1].partition(".")[0] == self._major else found[1]

    @property
    def _major(self) -> str:
        return self.version.partition(".")[0]

    def _hints(self) -> dict[str, Any]:
        """The client hints, as Chromium makes them for itself."""
        version = self._shown_version
        seed = int(version.partition(".")[0])
        grease = "Not{}A{}Brand".format(*(_GREASE[(seed + more) % len(_GREASE)] for more in (0, 1)))
        brands = [(grease, f"{_GREASE_VERSIONS[seed % 3]}.0.0.0"), ("Chromium", version)]
        brands = brands[::-1] if seed % 2 else brands
        machine = platform.machine().lower()
        return {
            "brands": [{"brand": name, "version": full.partition(".")[0]} for name, full in brands],
            "fullVersionList": [{"brand": name, "version": full} for name, full in brands],
            "platform": _system()[1],
            "platformVersion": "",
            "architecture": "arm" if machine in ("arm64", "aarch64") else "x86",
            "bitness": "64",
            "model": "",
            "mobile": False,
        }


def _system() -> tuple[str, str, str]:
    return _SYSTEMS.get(sys.platform, _SYSTEMS["linux"])
