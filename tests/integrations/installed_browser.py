"""For Playwright as BrowserGym wants it, whose own browser is not installed."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import BrowserType

from webgym.browser.find import find_browser


def use_installed_browser(patch: pytest.MonkeyPatch) -> None:
    """Start the Chromium that WebGym uses."""
    launch = BrowserType.launch
    path = str(find_browser().path)

    def with_path(self: Any, **given: Any) -> Any:
        return launch(self, **{"executable_path": path, **given})

    patch.setattr(BrowserType, "launch", with_path)
