"""Parts of pages that attempts at one task load once, if a run asks for it: scripts, style sheets, pictures
and fonts that a website calls public.

A session's browser context goes with it, and its cache too. So the tab pauses requests for such parts; the
first session's responses are kept for the others, in their group alone and as long as ``Cache-Control`` says,
if it says ``public``.
"""

from __future__ import annotations

import contextlib
import re
import time
from collections import OrderedDict
from http import HTTPStatus
from typing import Any, Final, NamedTuple

from webgym.browser.access import Access
from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import CdpMessage, RequestPaused
from webgym.browser.pdf import COMMAND_SECONDS
from webgym.core.background import BackgroundTasks
from webgym.core.errors import BrowserError

SHARED_CHARACTERS: Final = 96 * 2**20
"""Most characters of parts in base64 that a process keeps: 72 MiB. The ones used longest ago go first."""

_KINDS: Final = ("Script", "Stylesheet", "Image", "Font")
_MAX_AGE = re.compile(r"(?:^|[,\s])max-age=\"?(\d+)")
_PUBLIC = re.compile(r"(?:^|[,\s])public\b")
_NOT_KEPT = re.compile(r"(?:^|[,\s])(?:no-store|no-cache)\b")
_OF_THE_CONNECTION = frozenset({"content-encoding", "content-length", "transfer-encoding", "connection"})


class _Body(CdpMessage, frozen=True):
    body: str = ""
    base64_encoded: bool = False


class _Part(NamedTuple):
    """A response: until when it is fresh (``time.monotonic()``), its headers, its body in base64."""

    until: float
    headers: list[dict[str, str]]
    body: str


class SharedParts:
    """The parts that one process's browsers keep, by group and URL."""

    def __init__(self) -> None:
        self._parts: OrderedDict[tuple[str, str], _Part] = OrderedDict()
        self._characters = 0

    def get(self, group: str, url: str) -> _Part | None:
        """The part, if it is fresh."""
        part = self._parts.get((group, url))
        if part is None or part.until <= time.monotonic():
            return None
        self._parts.move_to_end((group, url))
        return part

    def put(self, group: str, url: str, part: _Part) -> None:
        """Keep a part; the ones used longest ago make room."""
        if old := self._parts.pop((group, url), None):
            self._characters -= len(old.body)
        self._parts[group, url] = part
        self._characters += len(part.body)
        while self._characters > SHARED_CHARACTERS:
            self._characters -= len(self._parts.popitem(last=False)[1].body)


class PartSharing:
    """Answers one tab's requests with what its group has, and keeps what it loads.

    Args:
        session: the tab's session.
        parts: of the process.
        access: knows the origins with credentials, of which nothing is shared.
        group: the name of the group; empty if nothing is shared.
    """

    def __init__(self, session: Session, parts: SharedParts, access: Access, group: str) -> None:
        self._session = session
        self._parts = parts
        self._tasks = BackgroundTasks()
        self._access = access
        self.group = group
        session.on("Fetch.requestPaused", RequestPaused, self._on_paused)

    @property
    def patterns(self) -> list[dict[str, Any]]:
        """What has to be paused."""
        stages = ("Request", "Response") if self.group else ()
        return [{"resourceType": kind, "requestStage": stage} for kind in _KINDS for stage in stages]

    def _on_paused(self, paused: RequestPaused) -> None:
        url, number = paused.request.url, {"requestId": paused.request_id}
        if paused.resource_type not in _KINDS:
            return
        if self._access.signs_in(url):
            if paused.is_response:  # else it is answered there
                self._session.send("Fetch.continueRequest", number)
        elif paused.is_response and (seconds := _seconds_fresh(paused)):
            self._tasks.start(self._keep(paused, time.monotonic() + seconds))
        elif not paused.is_response and (part := self._parts.get(self.group, url)):
            answer = {"responseCode": HTTPStatus.OK, "responseHeaders": part.headers, "body": part.body}
            self._session.send("Fetch.fulfillRequest", number | answer)
        else:
            self._session.send("Fetch.continueRequest", number)

    async def _keep(self, paused: RequestPaused, until: float) -> None:
        number = {"requestId": paused.request_id}
        headers = [
            {"name": one.name, "value": one.value}
            for one in paused.response_headers
            if one.name.lower() not in _OF_THE_CONNECTION
        ]
        with contextlib.suppress(BrowserError):  # the tab is gone, or went elsewhere
            found = await self._session.call(
                "Fetch.getResponseBody", number, reply=_Body, seconds=COMMAND_SECONDS
            )
            if found.base64_encoded:
                self._parts.put(self.group, paused.request.url, _Part(until, headers, found.body))
            self._session.send("Fetch.continueRequest", number)


def _seconds_fresh(paused: RequestPaused) -> int:
    """For how many seconds a response may be given to others; 0 if it may not."""
    headers = {one.name.lower(): one.value.lower() for one in paused.response_headers}
    control = headers.get("cache-control", "")
    allowed = _MAX_AGE.search(control)
    is_public = _PUBLIC.search(control) and not _NOT_KEPT.search(control)
    is_same = headers.get("vary", "accept-encoding").strip() == "accept-encoding"
    is_whole = paused.request.method == "GET" and paused.response_status_code == HTTPStatus.OK
    if allowed is None or not (is_public and is_same and is_whole):
        return 0
    age = headers.get("age", "0")
    return max(0, int(allowed[1]) - (int(age) if age.isdecimal() else 0))
