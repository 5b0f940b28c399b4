"""Shows PDFs, which Chromium's headless shell would offer as a download: as a page of ours at their address.

Each document's response is paused before the tab takes it. That of a PDF is read, and answered by a page of
pictures and text (``pdf_page.py``) instead. So history, links, frames, scrolling and observations work as for
any other page, and the PDF comes through the same connections and limits.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import sys
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from webgym.browser.cdp import CommandFailed, Session
from webgym.browser.cdp_messages import CdpMessage, RequestPaused
from webgym.core.background import BackgroundTasks
from webgym.core.errors import BrowserError

PDF_BYTES = 32 * 2**20
"""Largest PDF that is shown."""

RENDER_SECONDS = 12.0
"""Longest time of the program that draws its pages, which itself stops earlier (``MOST_SECONDS``). Less than
``browser.navigate_seconds``."""

COMMAND_SECONDS = 3600.0
"""Deadline of a command: the browser may be stopped for as long as a model thinks."""

_PROGRAM = Path(__file__).with_name("pdf_page.py")
_CHUNK_BYTES = 2**20
_NAME_LENGTH = 100

_HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    # An origin of its own, so that no page reads it, and nothing in it but what is drawn.
    # Without `allow-scripts` ours would have no timers in it.
    "Content-Security-Policy": "default-src 'none'; img-src data:; style-src 'unsafe-inline'; sandbox "
    "allow-scripts allow-popups allow-popups-to-escape-sandbox allow-top-navigation-by-user-activation",
}


DOCUMENTS = {"resourceType": "Document", "requestStage": "Response"}
"""The pattern of what has to be paused: the responses of documents."""


class _Stream(CdpMessage, frozen=True):
    stream: str


class _Chunk(CdpMessage, frozen=True):
    data: str = ""
    base64_encoded: bool = False
    eof: bool = False


class Unshown(Exception):
    """A PDF cannot be shown; the message says why."""


class Pdfs:
    """The PDFs that one tab opens.

    Args:
        session: the tab's session.
        on_unshown: called with a message for the agent about a PDF that cannot be shown.
    """

    def __init__(self, session: Session, on_unshown: Callable[[str], None]) -> None:
        self._session = session
        self._on_unshown = on_unshown
        self._tasks = BackgroundTasks()
        session.on("Fetch.requestPaused", RequestPaused, self._on_paused)

    async def close(self) -> None:
        """Give up what is being drawn."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _on_paused(self, paused: RequestPaused) -> None:
        if not paused.is_response or paused.resource_type != "Document":
            return
        kind = _header(paused, "content-type").partition(";")[0].strip().lower()
        if kind == "application/pdf" and paused.response_status_code == HTTPStatus.OK:
            self._tasks.start(self._show(paused))
        else:
            self._session.send("Fetch.continueRequest", {"requestId": paused.request_id})

    async def _show(self, paused: RequestPaused) -> None:
        number = {"requestId": paused.request_id}
        name = unquote(PurePosixPath(urlsplit(paused.request.url).path).name)[:_NAME_LENGTH] or "document"
        with contextlib.suppress(BrowserError, CommandFailed):  # the tab is gone, or went elsewhere
            try:
                page = await render(await self._read(paused), name)
            except Unshown as why:
                self._on_unshown(f'the PDF "{name}" cannot be shown: {why}')
                self._session.send("Fetch.failRequest", {**number, "errorReason": "Aborted"})
                return
            answer = {
                **number,
                "responseCode": HTTPStatus.OK,
                "responseHeaders": [{"name": name, "value": value} for name, value in _HEADERS.items()],
                "body": base64.b64encode(page).decode(),
            }
            await self._session.do("Fetch.fulfillRequest", answer, seconds=COMMAND_SECONDS)

    async def _read(self, paused: RequestPaused) -> bytes:
        """The body of a response."""
        length = _header(paused, "content-length")
        if length.isdecimal() and int(length) > PDF_BYTES:
            raise _too_large()
        session, seconds = self._session, COMMAND_SECONDS
        number = {"requestId": paused.request_id}
        taken = await session.call("Fetch.takeResponseBodyAsStream", number, reply=_Stream, seconds=seconds)
        source = {"handle": taken.stream, "size": _CHUNK_BYTES}
        body = bytearray()
        try:
            while True:
                chunk = await session.call("IO.read", source, reply=_Chunk, seconds=seconds)
                body += base64.b64decode(chunk.data) if chunk.base64_encoded else chunk.data.encode()
                if len(body) > PDF_BYTES:
                    raise _too_large()
                if chunk.eof:
                    return bytes(body)
        finally:
            session.send("IO.close", {"handle": taken.stream})


def _header(paused: RequestPaused, wanted: str) -> str:
    return next((one.value for one in paused.response_headers if one.name.lower() == wanted), "")


def _too_large() -> Unshown:
    return Unshown(f"it is larger than {PDF_BYTES / 2**20:g} MB")


async def render(pdf: bytes, name: str) -> bytes:
    """The page that shows a PDF, drawn by a process of its own.

    Raises:
        Unshown: it is broken, wants a password, or takes too much memory or time.
    """
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-I", str(_PROGRAM), name,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, env={},
    )  # fmt: skip
    try:
        async with asyncio.timeout(RENDER_SECONDS):
            page, errors = await process.communicate(pdf)
    except TimeoutError:
        raise Unshown(f"its pages were not drawn within {RENDER_SECONDS:g} s") from None
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    if process.returncode:
        lines = errors.decode(errors="replace").strip().splitlines()
        is_said = process.returncode == 1 and len(lines) == 1
        raise Unshown(lines[0] if is_said else "its pages cannot be drawn")
    return page
