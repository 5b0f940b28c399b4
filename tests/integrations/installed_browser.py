"""For Playwright as BrowserGym wants it, whose own browser is not installed."""

from __future__ import annotations

from functools import partialmethod

import pytest
from playwright.sync_api import BrowserType

from webgym.browser.find import find_browser


def use_installed_browser(patch: pytest.MonkeyPatch) -> None:
    """Start the Chromium that WebGym uses."""
    launch = partialmethod(BrowserType.launch, executable_path=str(find_browser().path))
    patch.setattr(BrowserType, "launch", launch)
