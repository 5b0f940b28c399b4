"""What Chromium says, also when it is no JSON by the book."""

from __future__ import annotations

import asyncio
import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.browser.cdp import TargetGone, _decode
from webgym.core.action import GoBack, Wait
from webgym.core.observation import Observation

from .conftest import Open, Site


def said(text: str) -> bytes:
    return b'{"id": 7, "result": {"text": "' + text.encode() + b'"}}'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (r"a\ud83d", "a�"),
        (r"\ud83db", "�b"),
        (r"\ude00b", "�b"),
        (r"\ude00\ud83d", "��"),
        (r"\ud83d\ud83d\ude00", "�😀"),
        (r"\uD83D\uDE00\uD83D", "😀�"),
        (r"\ud83d \\ud83d \\\ud83d", "� \\ud83d \\�"),
        (r"\ud83d\n\"\\", '�\n"\\'),
        (r"\ud83d\u00e9", "�é"),
    ],
)
def test_half_a_character_is_replaced(text: str, expected: str) -> None:
    incoming = _decode(said(text))
    assert incoming.id == 7
    assert msgspec.json.decode(incoming.result) == {"text": expected}


@given(st.text(st.characters(codec=None)))
def test_whatever_a_page_writes_is_understood(text: str) -> None:
    message = json.dumps({"id": 7, "result": {"text": text}}).encode()
    expected = text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    assert msgspec.json.decode(_decode(message).result) == {"text": expected}


def test_what_is_no_message_at_all_is_not_repaired() -> None:
    with pytest.raises(msgspec.DecodeError):
        _decode(b'{"id": 7, "result": {"text": "\\ud83d')


HALF = "cut off \\ud83d"


@pytest.mark.browser
@pytest.mark.asyncio(loop_scope="package")
async def test_a_page_with_half_characters_everywhere(open_tab: Open, site: Site) -> None:
    script = f"""
        document.title = "{HALF}";
        const button = document.body.appendChild(document.createElement("button"));
        button.textContent = "{HALF}";
        history.replaceState(null, "", "#{HALF}");
        window.open("about:blank", "{HALF}");
        setTimeout(() => alert("{HALF}"), 0);
        console.log("{HALF}");
    """
    tab = await open_tab()
    seen: list[Observation] = [(await tab.goto(site.page(f"<body><script>{script}</script>"))).observation]
    seen.append((await tab.step(GoBack())).observation)
    assert seen[-1].title == "cut off �"
    assert "cut off �" in (seen[-1].text or "")
    assert [one.name for one in seen[-1].elements or ()] == ["cut off �"]
    assert any("cut off �" in notice.text for one in seen for notice in one.notices)


@pytest.mark.browser
@pytest.mark.asyncio(loop_scope="package")
async def test_what_needed_a_crashed_renderer_is_told_so(open_tab: Open, site: Site) -> None:
    """Chromium holds such commands, and refuses them when the page is loaded again."""
    tab = await open_tab()
    await tab.goto(site.page("<p>text"))
    page = tab.slot.page
    page.session.send("Page.crash")
    async with asyncio.timeout(60):
        while not page.is_crashed:
            await asyncio.sleep(0.01)
    page.session.crashed = None
    asked = asyncio.create_task(page.worlds.run("content", reply=msgspec.Raw, seconds=60))
    await asyncio.sleep(0)
    await page.session.call("Page.navigate", {"url": page.url}, reply=msgspec.Raw, seconds=60)
    with pytest.raises(TargetGone):
        await asked
    assert (await tab.step(Wait(0.1))).observation.text == "text"
