"""For Playwright as BrowserGym wants it, whose own browser is not installed."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserType

from webgym.browser.find import find_browser


def use_installed_browser(patch: pytest.MonkeyPatch) -> list[Browser]:
    """Start the Chromium that WebGym uses. The list gets every browser that is started."""
    launch = BrowserType.launch
    path = str(find_browser().path)
    started: list[Browser] = []

    def with_path(self: Any, **given: Any) -> Browser:
        started.append(launch(self, **{"executable_path": path, **given}))
        return started[-1]

    patch.setattr(BrowserType, "launch", with_path)
    return started
