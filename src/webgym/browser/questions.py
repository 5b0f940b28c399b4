"""What pages can ask of a browser to find out what it runs on, and how a headed browser answers."""

from __future__ import annotations

import asyncio
import json
import tomllib
from collections.abc import Awaitable, Callable
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.proxy import Egress
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate

Answers: TypeAlias = dict[str, Any]

_FOLDER = resources.files("webgym.browser")
_ASKED = tomllib.loads((_FOLDER / "desktop.toml").read_text("utf-8"))
QUESTIONS: dict[str, str] = _ASKED["questions"]
HEADERS: list[str] = _ASKED["headers"]["names"]
WANTED: dict[str, str] = _ASKED["wanted"]
"""Why an answer may differ from a headed browser's, by question."""

ANSWER_SECONDS = 30.0
"""Until a page must have asked everything."""

_PAGE = """<!doctype html><meta charset=utf-8><title>Questions</title><body><script type=module>
const answers = {};
const AsyncFunction = (async () => {}).constructor;
for (const [name, question] of Object.entries(QUESTIONS))
  answers[name] = await AsyncFunction(`return ${question}`)().catch((error) => error.name) ?? null;
await fetch('/answers', { method: 'POST', body: JSON.stringify(answers) });
</script>"""


class Difference(msgspec.Struct, frozen=True):
    """An answer that differs from a headed browser's.

    Attributes:
        question: the question.
        ours, headed: the answers.
        reason: why it is wanted; empty if it is not.
    """

    question: str
    ours: Any
    headed: Any
    reason: str

    def __str__(self) -> str:
        answers = f"{self.question}: {json.dumps(self.ours)}, not {json.dumps(self.headed)}"
        return f"{answers} ({self.reason})" if self.reason else answers


async def ask(visit: Callable[[str], Awaitable[object]]) -> Answers:
    """The answers of a browser.

    Args:
        visit: opens a URL of this machine in the browser.

    Raises:
        TimeoutError: it did not answer.
    """
    answers: asyncio.Future[Answers] = asyncio.get_running_loop().create_future()
    headers: Answers = {}

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            request = await reader.readuntil(b"\r\n\r\n")
        except asyncio.IncompleteReadError:  # a connection that was opened in advance
            writer.close()
            return
        head, *lines = request.decode().split("\r\n")
        sent = {name.lower(): value for name, _, value in (line.partition(": ") for line in lines)}
        content = await reader.readexactly(int(sent.get("content-length", 0)))
        page = b""
        if head.startswith("POST /answers "):
            answers.set_result(json.loads(content))
        elif head.startswith("GET / "):
            headers.update({f"header {name}": sent.get(name) for name in HEADERS})
            page = _PAGE.replace("QUESTIONS", json.dumps(QUESTIONS)).encode()
        length = f"Content-Type: text/html\r\nContent-Length: {len(page)}\r\nConnection: close"
        writer.write(f"HTTP/1.1 200 OK\r\n{length}\r\n\r\n".encode() + page)
        await writer.drain()
        writer.close()

    async with asyncio.timeout(ANSWER_SECONDS), await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        await visit(f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/")
        return {**await answers, **headers}


async def ask_own(executable: Path) -> Answers:
    """The answers of a browser that is started as the server does.

    Raises:
        BrowserError: it does not start or show the page.
        TimeoutError: it did not answer.
    """
    config = BrowserConfig().allowing("127.0.0.1")
    async with Egress(config.egress) as egress:
        slot = Slot(config, executable, ProfileRoot(), egress)
        try:
            await slot.open(PageOptions())
            return await ask(lambda url: slot.step(Navigate(url)))
        finally:
            await slot.stop()


def headed_answers() -> Answers:
    """The stored answers of a headed Chromium."""
    answers: Answers = json.loads((_FOLDER / "headed.json").read_text("utf-8"))
    return answers


def differences(ours: Answers, headed: Answers) -> list[Difference]:
    """The answers that differ, those that are not wanted first."""
    found = [
        Difference(name, ours.get(name), answer, WANTED.get(name, ""))
        for name, answer in headed.items()
        if ours.get(name) != answer
    ]
    return sorted(found, key=lambda one: bool(one.reason))
