"""Nothing of an episode reaches the next one in the same browser: a site writes all that a site can write.

Each mark is looked for three times: by a first visitor, by the same one again (who must find it, or the test
could not see a leak), and by the next episode's, to whom everything must be as it was to the first.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from webgym.browser.config import PageOptions
from webgym.browser.slot import Slot
from webgym.core.action import Navigate

from .conftest import Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

PAGE = """<!doctype html><title>marks</title><script>
const asked = (request) => new Promise((done, failed) => {
  request.onsuccess = () => done(request.result);
  request.onerror = () => failed(request.error);
});
const entries = async (mode) => (await base()).transaction('marks', mode).objectStore('marks');
const base = () => {
  const request = indexedDB.open('marks', 1);
  request.onupgradeneeded = () => request.result.createObjectStore('marks');
  return asked(request);
};
const marks = {
  cookie: [
    () => document.cookie.includes('script=seen'),
    () => { document.cookie = 'script=seen; max-age=9999'; },
  ],
  localStorage: [() => localStorage.mark ?? '', () => { localStorage.mark = 'seen'; }],
  sessionStorage: [() => sessionStorage.mark ?? '', () => { sessionStorage.mark = 'seen'; }],
  name: [() => window.name, () => { window.name = 'seen'; }],
  history: [() => history.length, () => history.pushState(null, '', '#on')],
  indexedDB: [
    async () => await asked((await entries('readonly')).get('mark')) ?? '',
    async () => asked((await entries('readwrite')).put('seen', 'mark')),
  ],
  caches: [async () => (await caches.keys()).length, async () => (await caches.open('marks')).add('/kept')],
  files: [
    async () => {
      const names = [];
      for await (const name of (await navigator.storage.getDirectory()).keys()) names.push(name);
      return names.length;
    },
    async () => (await navigator.storage.getDirectory()).getFileHandle('mark', { create: true }),
  ],
  serviceWorker: [
    async () => (await navigator.serviceWorker.getRegistrations()).length,
    async () => {
      await navigator.serviceWorker.register('/worker.js');
      await navigator.serviceWorker.ready;
    },
  ],
  httpCache: [async () => (await fetch('/kept')).text(), () => {}],
  httpCookie: [async () => (await fetch('/cookies')).text(), () => {}],
  httpAuth: [async () => (await fetch('/secret')).status, () => {}],
  geolocation: [
    async () => (await navigator.permissions.query({ name: 'geolocation' })).state,
    () => new Promise((done) => navigator.geolocation.getCurrentPosition(done, done)),
  ],
  persistence: [async () => await navigator.storage.persisted(), async () => navigator.storage.persist()],
};
(async () => {
  const found = {};
  for (const [name, [read]] of Object.entries(marks)) found[name] = await read();
  for (const [, write] of Object.values(marks)) await write();
  await fetch('/found', { method: 'POST', body: JSON.stringify(found) });
})().catch((error) => fetch('/found', { method: 'POST', body: JSON.stringify({ error: String(error) }) }));
</script>"""

MAY_BE_FORGOTTEN = {"geolocation", "persistence"}
"""A refusal that the browser keeps for itself leaves no mark, not even for the same visitor."""


class Marks:
    """The site, and what its visitors found."""

    def __init__(self, site: Site) -> None:
        self.seen: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.served = 0
        for path in ("marks", "worker.js", "kept", "cookies", "secret", "found"):
            site.on(f"/{path}", getattr(self, path.partition(".")[0]))

    async def marks(self, _: Request) -> Response:
        return HTMLResponse(PAGE, headers={"set-cookie": "server=seen; HttpOnly; Max-Age=9999"})

    async def worker(self, _: Request) -> Response:
        return Response("// waits", media_type="text/javascript")

    async def kept(self, _: Request) -> Response:
        self.served += 1
        return Response(str(self.served), headers={"cache-control": "max-age=3600", "etag": '"1"'})

    async def cookies(self, request: Request) -> Response:
        kept = "earlier=seen" in request.headers.get("cookie", "")
        return Response(str(kept), headers={"set-cookie": "earlier=seen; HttpOnly; Max-Age=9999"})

    async def secret(self, request: Request) -> Response:
        if "authorization" in request.headers:
            return HTMLResponse("<title>inside</title>")
        return Response("no", 401, headers={"www-authenticate": 'Basic realm="marks"'})

    async def found(self, request: Request) -> Response:
        self.seen.put_nowait(json.loads(await request.body()))
        return Response("")


async def test_the_next_episode_finds_nothing(site: Site, shared_slot: Slot) -> None:
    marks = Marks(site)

    async def visit() -> dict[str, Any]:
        await shared_slot.step(Navigate(site.url("/marks")))
        async with asyncio.timeout(100):
            found = await marks.seen.get()
        assert "error" not in found, found
        return found

    async def sign_in() -> None:
        with_name = site.url("/secret").replace("//", "//me:word@")
        assert (await shared_slot.step(Navigate(with_name))).observation.title == "inside"

    await shared_slot.open(PageOptions())
    launches = shared_slot.launches
    first = await visit()
    await sign_in()
    again = await visit()
    await shared_slot.close()

    unseen = {name for name in first if first[name] == again[name]} - {"httpCache"}
    assert unseen <= MAY_BE_FORGOTTEN, "marks that the same visitor does not find cannot show a leak"
    assert (first["httpCache"], again["httpCache"]) == ("1", "1"), "kept, and not asked for again"

    await shared_slot.open(PageOptions())
    then = await visit()
    await shared_slot.close()
    assert shared_slot.launches == launches, "in the same browser"
    assert then.pop("httpCache") != first.pop("httpCache"), "asked for anew"
    assert then == first
