"""``webgym login``: sign in to a website by hand, and save what it keeps in the browser."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import Annotated

import typer

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.cli._fields import Given, Options, takes
from webgym.cli._options import has_desktop
from webgym.core.action import Navigate
from webgym.core.errors import BrowserNotFound, ConfigError, UsageError
from webgym.core.settings import validated
from webgym.core.storage import write_storage

LOGIN = Options(BrowserConfig, {"--executable": "executable"})


@takes(settings=LOGIN)
def command(
    website: Annotated[str, typer.Argument(help="Where to sign in, such as https://shop.example/login.")],
    settings: Given,
    save: Annotated[Path, typer.Option(help="The file for it. Whoever has it is signed in: keep it secret.")],
) -> None:
    """Open a website in a window of a full Chromium, and save its log-in when you press Enter here.

    The file has Playwright's format for storage state. A run uses it by attempt.logins.
    """
    if not website.startswith(("http://", "https://")):
        raise UsageError(f"{website} is no address", hint="such as https://shop.example/login")
    if not (folder := save.absolute().parent).is_dir():
        raise UsageError(f"there is no folder {folder}", hint="make it, or choose another file")
    if not has_desktop():
        raise ConfigError("there is no screen to open a window on", hint="go to a desktop, or set DISPLAY")
    config = validated(BrowserConfig, settings).model_copy(update={"headed": True, "freeze": False})
    asyncio.run(_login(website, config, save))


async def _login(website: str, config: BrowserConfig, save: Path) -> None:
    try:
        found = find_browser(config.executable, headed=True)
    except BrowserNotFound as error:
        raise ConfigError(
            error.message, hint="a log-in needs a full browser: apt-get install chromium"
        ) from error
    if found.kind == "headless-shell":
        raise ConfigError(f"{found.path} shows no windows", hint="name a full browser by --executable")
    async with Egress(config.egress) as egress:
        slot = Slot(config, found.path, ProfileRoot(), egress)
        try:
            await slot.open(PageOptions())
            await slot.act(Navigate(website))
            print(f"Sign in to {website} in the window, then press Enter here.", flush=True)
            await asyncio.to_thread(sys.stdin.readline)
            state = await slot.storage()
        finally:
            await slot.stop()
    write_storage(save, state)
    print(f"{save}: {state}. Whoever has this file is signed in.")
