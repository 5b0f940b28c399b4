"""``webgym login`` with a real window on a virtual screen."""

from __future__ import annotations

import asyncio
import shutil
from asyncio.subprocess import PIPE, STDOUT
from pathlib import Path

import pytest
from aiohttp import web
from benchmarks.stand_ins import serving_app
from tests.conftest import Commands, webgym

from webgym.core.storage import StoredItem, read_storage

PAGE = "<title>Shop</title><script>localStorage.token = 'T-1'; document.cookie = 'sid=abc'</script>"


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(
    not shutil.which("xvfb-run") or not shutil.which("chromium"), reason="no screen, no chromium"
)
async def test_what_is_signed_in_by_hand_is_saved(tmp_path: Path) -> None:
    async def shop(_: web.Request) -> web.Response:
        return web.Response(text=PAGE, content_type="text/html")

    app, file = web.Application(), tmp_path / "shop.json"
    app.router.add_get("/", shop)
    async with serving_app(app) as port:
        site = f"http://127.0.0.1:{port}"
        login = ["xvfb-run", "-a", *webgym("login", site, "--save", file, "egress.allow=[127.0.0.1]")]
        process = await asyncio.create_subprocess_exec(*login, stdin=PIPE, stdout=PIPE, stderr=STDOUT)
        assert process.stdin is not None
        assert process.stdout is not None
        said = b""
        while b"press Enter" not in said:
            said += (line := await process.stdout.readline())
            assert line, said
        process.stdin.write(b"\n")
        said = await process.stdout.read()
        assert await process.wait() == 0, said
    assert b"1 cookies, storage of 1 origins" in said
    [origin] = read_storage(file).origins
    assert (origin.origin, origin.local_storage) == (site, (StoredItem("token", "T-1"),))
    assert file.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(
    ("website", "file", "told"),
    [
        ("shop.example", "a.json", "shop.example is no address"),
        ("https://shop.example", "none/a.json", "there is no folder"),
        ("https://shop.example", "a.json", "there is no screen"),
    ],
)
def test_what_cannot_be_saved_is_told_at_once(
    commands: Commands, tmp_path: Path, website: str, file: str, told: str
) -> None:
    code, said = commands.run("login", website, "--save", tmp_path / file, DISPLAY="", WAYLAND_DISPLAY="")
    assert code != 0
    assert told in said
    assert len(said.splitlines()) == 1
