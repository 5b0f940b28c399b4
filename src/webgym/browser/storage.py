"""Puts what websites keep into an episode's browser before its first page, and reads it at any time.

Storage belongs to an origin, and only a page of that origin reaches it. So an empty page of ours is shown at
its address, in a tab of its own, for which no website is asked.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from webgym.browser.cdp import CommandFailed, Session
from webgym.browser.cdp_messages import CdpMessage, EmptyReply, Evaluated, RequestPaused
from webgym.core.errors import BrowserError
from webgym.core.storage import StorageState, StoredCookie, StoredItem, StoredOrigin

_PUT = """async ([items, databases]) => {
  for (const { name, value } of items) localStorage.setItem(name, value);
  const path = (one) => one.keyPathArray ?? one.keyPath ?? null;
  for (const { name, version, stores } of databases) {
    const request = indexedDB.open(name, version);
    request.onupgradeneeded = () => {
      for (const store of stores) {
        const made = request.result.createObjectStore(store.name, {
          keyPath: path(store), autoIncrement: store.autoIncrement ?? false });
        for (const index of store.indexes ?? [])
          made.createIndex(index.name, path(index), { multiEntry: index.multiEntry, unique: index.unique });
      }
    };
    const ended = (what) => new Promise((resolve, reject) => {
      what.onsuccess = what.oncomplete = () => resolve(what.result);
      what.onerror = what.onabort = () => reject(what.error);
    });
    const database = await ended(request);
    const filled = stores.filter(({ records }) => records?.length);
    if (filled.length) {
      const change = database.transaction(filled.map((store) => store.name), 'readwrite');
      for (const store of filled)
        for (const { key, value } of store.records)
          change.objectStore(store.name).put(value, ...(path(store) === null ? [key] : []));
      await ended(change);
    }
    database.close();
  }
}"""

_TAKE = """async () => {
  const ended = (request) => new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
  const named = (path) =>
    Array.isArray(path) ? { keyPathArray: path } : path === null ? {} : { keyPath: path };
  const databases = [];
  for (const { name, version } of await indexedDB.databases()) {
    const database = await ended(indexedDB.open(name));
    const stores = [];
    for (const storeName of database.objectStoreNames) {
      const store = database.transaction(storeName).objectStore(storeName);
      const [keys, values] = await Promise.all([ended(store.getAllKeys()), ended(store.getAll())]);
      const indexes = [...store.indexNames].map((index) => store.index(index)).map((index) => ({
        name: index.name, ...named(index.keyPath), multiEntry: index.multiEntry, unique: index.unique }));
      stores.push({ name: storeName, ...named(store.keyPath), autoIncrement: store.autoIncrement, indexes,
        records: values.map((value, at) => store.keyPath === null ? { key: keys[at], value } : { value }) });
    }
    database.close();
    databases.push({ name, version, stores });
  }
  const items = Object.entries(localStorage).map(([name, value]) => ({ name, value }));
  return JSON.stringify([items, databases]);
}"""


class _Cookies(CdpMessage, frozen=True):
    cookies: tuple[dict[str, Any], ...] = ()


async def put(session: Session, state: StorageState, seconds: float) -> None:
    """Put a state into the browser context of a tab that waits for the debugger.

    Args:
        session: the tab's.
        state: what websites keep.
        seconds: deadline of each command.

    Raises:
        BrowserError: the browser does not take it.
    """
    if state.cookies:
        cookies = [cookie.params for cookie in state.cookies]
        await _do(session, "Network.setCookies", {"cookies": cookies}, seconds)
    for origin in state.origins:
        if any("valueEncoded" in record or "keyEncoded" in record for record in _records(origin)):
            raise BrowserError(
                f"the databases of {origin.origin} hold more than JSON, which only Playwright can write"
            )
        given = msgspec.json.encode([origin.local_storage, origin.databases]).decode()
        await _at(session, origin.origin, f"({_PUT})({given})", seconds)


async def take(session: Session, context: str, origins: Iterable[str], seconds: float) -> StorageState:
    """The state of a tab's browser context.

    Args:
        session: of a tab that waits for the debugger.
        context: id of its browser context.
        origins: those whose storage is read.
        seconds: deadline of each command.

    Raises:
        BrowserError: it cannot be read.
    """
    params = {"browserContextId": context}
    found = await session.connection.call("Storage.getCookies", params, reply=_Cookies, seconds=seconds)
    kept = []
    for origin in sorted(origins):
        items, databases = msgspec.json.decode(await _at(session, origin, f"({_TAKE})()", seconds))
        if items or databases:
            stored = msgspec.convert(items, tuple[StoredItem, ...])
            kept.append(StoredOrigin(origin, stored, tuple(databases)))
    return StorageState(tuple(_cookie(each) for each in found.cookies), tuple(kept))


def _records(origin: StoredOrigin) -> list[dict[str, Any]]:
    stores: Sequence[dict[str, Any]] = [
        store for database in origin.databases for store in database.get("stores", ())
    ]
    return [record for store in stores for record in store.get("records", ())]


def _cookie(found: dict[str, Any]) -> StoredCookie:
    key = found.get("partitionKey") or {}
    known = {name: found[name] for name in ("name", "value", "domain", "path", "httpOnly", "secure")}
    known["expires"] = -1 if found.get("session") else found.get("expires", -1)
    known["sameSite"] = found.get("sameSite", "Lax")
    known["partitionKey"] = key.get("topLevelSite") if isinstance(key, dict) else None
    return msgspec.convert(known, StoredCookie)


async def _at(session: Session, origin: str, script: str, seconds: float) -> str:
    """Run a script in an empty page of an origin. Returns its result, or an empty string."""
    page = {
        "responseCode": 200,
        "responseHeaders": [{"name": "Content-Type", "value": "text/html"}],
        "body": "",
    }

    def answer(paused: RequestPaused) -> None:
        session.send("Fetch.fulfillRequest", {"requestId": paused.request_id, **page})

    forget = session.on("Fetch.requestPaused", RequestPaused, answer)
    try:
        await _do(session, "Fetch.enable", {}, seconds)
        await _do(session, "Page.navigate", {"url": origin}, seconds)
        asked = {"expression": script, "awaitPromise": True, "returnByValue": True}
        answered = await session.call("Runtime.evaluate", asked, reply=Evaluated, seconds=seconds)
    except CommandFailed as error:
        raise BrowserError(f"the storage of {origin} cannot be reached: {error.message}") from error
    finally:
        forget()
    if answered.exception_details is not None:
        raise BrowserError(f"the storage of {origin} cannot be reached: a script of ours failed")
    return msgspec.json.decode(answered.result.value) or ""


async def _do(session: Session, method: str, params: dict[str, Any], seconds: float) -> None:
    try:
        await session.call(method, params, reply=EmptyReply, seconds=seconds)
    except CommandFailed as error:
        raise BrowserError(f"the browser does not take the log-in: {error.message}") from error
