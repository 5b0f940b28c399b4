"""The check of ``webgym doctor`` that starts the browser as the server does and renders a page."""

from __future__ import annotations

import asyncio
import io
import json
import time
from pathlib import Path

import msgspec
from PIL import Image

from webgym.browser.cdp_messages import CreatedTarget
from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.process import BrowserProcess, launch_sandboxed
from webgym.browser.profiles import ProfileRoot
from webgym.core.errors import BrowserError, BrowserTimeout

SIZE = (640, 200)
"""Width and height of the test page, pixels."""

SAMPLES = {"Latin": "agW", "CJK": "漢字書", "emoji": "😀🚀🍎"}
"""Three different characters of each writing system that the offline websites use."""

# Characters without a font are all drawn as the same box. Emoji must also have colour.
_DRAWS = """
(samples) => {
  const draw = (character) => {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 48;
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.font = "32px sans-serif";
    context.fillText(character, 4, 36);
    const pixels = Array.from(context.getImageData(0, 0, 48, 48).data);
    const coloured = pixels.some((value, at) => at % 4 < 2 && value !== pixels[at + 1]);
    return { drawing: pixels.join(), blank: pixels.every((value) => value === 0), coloured };
  };
  const renders = ([name, text]) => {
    const drawn = Array.from(text, draw);
    const differ = new Set(drawn.map((glyph) => glyph.drawing)).size === drawn.length;
    return [name, differ && !drawn.some((glyph) => glyph.blank || (name === "emoji" && !glyph.coloured))];
  };
  document.body.style.font = "40px sans-serif";
  document.body.textContent = Object.values(samples).join(" ");
  return Object.fromEntries(Object.entries(samples).map(renders));
}
"""


class LaunchCheck(msgspec.Struct, frozen=True):
    """The result of the check.

    Attributes:
        seconds: time from the start of the process to the screenshot.
        size: ``(width, height)`` of the screenshot, pixels.
        sandbox: whether Chromium's sandbox is on, as it would be in a server.
        sandbox_reason: why the sandbox is off; empty if it is on.
        fonts: by writing system, whether its characters are rendered.
    """

    seconds: float
    size: tuple[int, int]
    sandbox: bool
    sandbox_reason: str
    fonts: dict[str, bool]


class _Attached(msgspec.Struct, frozen=True, rename="camel"):
    session_id: str


class _Value(msgspec.Struct, frozen=True):
    value: dict[str, bool]


class _Evaluated(msgspec.Struct, frozen=True):
    result: _Value


class _Picture(msgspec.Struct, frozen=True):
    data: bytes


async def try_browser(executable: Path, seconds: float) -> LaunchCheck:
    """Start a browser, render a page, take a screenshot, and end the browser.

    Args:
        executable: the browser.
        seconds: the time limit for all of it.

    Raises:
        BrowserError: it did not start, respond or render within the limit; none of its processes is left.
    """
    config = BrowserConfig()
    started = time.monotonic()
    try:
        async with asyncio.timeout(seconds):
            async with Egress(config.egress) as egress:
                process, sandbox = await launch_sandboxed(
                    config, executable, ProfileRoot(), None, egress.main
                )
                try:
                    fonts, picture = await _draw(process, seconds)
                finally:
                    await process.kill()
    except TimeoutError:
        raise BrowserTimeout(f"the browser rendered no page within {seconds:g} s") from None
    return LaunchCheck(
        seconds=time.monotonic() - started,
        size=_size_of(picture),
        sandbox=sandbox.on,
        sandbox_reason=sandbox.reason,
        fonts=fonts,
    )


async def _draw(process: BrowserProcess, seconds: float) -> tuple[dict[str, bool], bytes]:
    width, height = SIZE
    call = process.connection.call
    target = await call(
        "Target.createTarget",
        {"url": "about:blank", "width": width, "height": height},
        reply=CreatedTarget,
        seconds=seconds,
    )
    attached = await call(
        "Target.attachToTarget",
        {"targetId": target.target_id, "flatten": True},
        reply=_Attached,
        seconds=seconds,
    )
    evaluated = await call(
        "Runtime.evaluate",
        {"expression": f"({_DRAWS})({json.dumps(SAMPLES)})", "returnByValue": True},
        reply=_Evaluated,
        seconds=seconds,
        session_id=attached.session_id,
    )
    picture = await call(
        "Page.captureScreenshot",
        {"format": "png"},
        reply=_Picture,
        seconds=seconds,
        session_id=attached.session_id,
    )
    return evaluated.result.value, picture.data


def _size_of(picture: bytes) -> tuple[int, int]:
    """The size of a screenshot.

    Raises:
        BrowserError: the screenshot is empty.
    """
    with Image.open(io.BytesIO(picture)) as image:
        colours = image.convert("L").getextrema()
        if colours[0] == colours[1]:
            raise BrowserError("the browser renders empty pages")
        return image.size
