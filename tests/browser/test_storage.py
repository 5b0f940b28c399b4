"""Log-ins: what websites keep in a browser goes in before the first page, and comes out again."""

from __future__ import annotations

import json
import time
from pathlib import Path

import msgspec
import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from webgym.core.errors import BrowserError, ConfigError
from webgym.core.storage import (
    StorageState,
    StoredCookie,
    StoredItem,
    StoredOrigin,
    read_storage,
    write_storage,
)

from .conftest import Open, Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

TOMORROW = float(int(time.time()) + 86_400)
READS = """
<script>
const open = indexedDB.open('app');
open.onsuccess = () => {
  const names = [...open.result.objectStoreNames];
  if (!names.length) { document.title = `${localStorage.token} none`; return; }
  open.result.transaction('users').objectStore('users').index('by name').get('Ann').onsuccess = (event) => {
    document.title = `${localStorage.token} ${event.target.result?.role}`;
  };
};
</script>"""


def state(site: Site) -> StorageState:
    users = {
        "name": "users",
        "keyPath": "id",
        "autoIncrement": False,
        "indexes": [{"name": "by name", "keyPath": "name", "multiEntry": False, "unique": True}],
        "records": [{"value": {"id": 7, "name": "Ann", "role": "editor"}}],
    }
    plain = {
        "name": "flags",
        "autoIncrement": False,
        "indexes": [],
        "records": [{"key": "seen", "value": True}],
    }
    database = {"name": "app", "version": 3, "stores": [plain, users]}
    cookies = (
        StoredCookie("sid", "abc", "127.0.0.1", http_only=True, same_site="Strict", expires=TOMORROW),
        StoredCookie("__Host-id", "h", "secure.example", secure=True),
        StoredCookie(
            "part", "p", "127.0.0.1", secure=True, same_site="None", partition_key="https://top.example"
        ),
    )
    origin = StoredOrigin(
        site.url("")[:-1] if site.url("").endswith("/") else site.url(""),
        (StoredItem("token", "T-1"),),
        (database,),
    )
    return StorageState(cookies, (origin,))


def serve(site: Site) -> str:
    async def answer(request: Request) -> Response:
        return HTMLResponse(f"<p>cookie {request.headers.get('cookie', '-')}</p>{READS}")

    return site.on("/storage", answer)


async def test_an_episode_begins_signed_in_and_its_state_comes_out_again(site: Site, open_tab: Open) -> None:
    url = serve(site)
    tab = await open_tab(storage=state(site))
    assert site.hits == [], "no website is asked for it"
    look = await tab.goto(url)
    assert (look.observation.title, tab.text) == ("T-1 editor", ["cookie sid=abc"])
    assert tab.notices == []
    found = await tab.slot.storage()
    assert {cookie.name: cookie for cookie in found.cookies} == {c.name: c for c in state(site).cookies}
    assert found.origins == state(site).origins
    again = await open_tab(storage=found)
    assert (await again.goto(url)).observation.title == "T-1 editor"
    await again.slot.close()
    fresh = await open_tab(viewport=(800, 600))
    assert (await fresh.goto(url)).observation.title == "undefined none", "the next episode has none of it"


async def test_what_only_playwright_writes_is_refused(site: Site, open_tab: Open) -> None:
    store = {"name": "s", "records": [{"key": 1, "valueEncoded": {"o": []}}]}
    database = {"name": "app", "version": 1, "stores": [store]}
    with pytest.raises(BrowserError, match="hold more than JSON"):
        await open_tab(storage=StorageState(origins=(StoredOrigin("http://a.example", (), (database,)),)))


async def test_files_are_whole_private_and_say_what_is_wrong(tmp_path: Path, site: Site) -> None:
    path = tmp_path / "login.json"
    write_storage(path, state(site))
    assert read_storage(path) == state(site)
    assert path.stat().st_mode & 0o777 == 0o600
    playwright = {
        "cookies": [
            {"name": "a", "value": "b", "domain": ".x.example", "path": "/", "expires": -1, "httpOnly": False,
             "secure": False, "sameSite": "Lax"}
        ],
        "origins": [{"origin": "https://x.example", "localStorage": [{"name": "k", "value": "v"}]}],
    }  # fmt: skip
    path.write_text(json.dumps(playwright))
    assert read_storage(path).origins[0].local_storage == (StoredItem("k", "v"),)
    for text in ('{"cookies": [{"name": "SECRET"}]}', "SECRET", '{"origins": [{"origin": "x"}]}'):
        path.write_text(text)
        with pytest.raises(ConfigError, match="is no storage state") as caught:
            read_storage(path)
        assert "SECRET" not in str(caught.value)
    with pytest.raises(ConfigError, match="cannot read"):
        read_storage(tmp_path / "none")
    assert msgspec.json.decode(msgspec.json.encode(state(site)), type=StorageState) == state(site)
