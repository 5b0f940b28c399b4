"""Dialogs: answered at once, or left open for an agent that can answer them."""

from __future__ import annotations

import asyncio

import pytest
import pytest_asyncio

from webgym.browser.config import BrowserConfig
from webgym.core.action import AnswerDialog, GoBack, LeftClick, Navigate, Type

from .conftest import Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

ASKS = """<title>Files</title><button>Clean up</button><button>New folder</button><button>Say</button>
<button>Twice</button><button>Note</button><p id=s>12 files</p><script>
const [clean, folder, say, twice, note] = document.querySelectorAll('button');
clean.onclick = () => { s.textContent = confirm('Delete all 12 files?') ? '0 files' : 'kept' };
folder.onclick = () => { s.textContent = 'folder ' + prompt('Name?', 'Untitled') };
say.onclick = () => { alert('done'); s.textContent = 'said' };
twice.onclick = () => { s.textContent = [confirm('one?'), confirm('two?')] };
note.onclick = () => { s.textContent = 'noted' };
</script>"""


@pytest_asyncio.fixture(loop_scope="package")
async def asked(site: Site, open_tab: Open) -> Tab:
    """A tab whose dialogs stay open, at a page that asks."""
    tab = await open_tab(keep_dialogs=True)
    await tab.goto(site.page(ASKS))
    return tab


def said(tab: Tab) -> str:
    return tab.text[-1]


@pytest.mark.parametrize(
    ("button", "answer", "result"),
    [
        ("Clean up", AnswerDialog(accept=False), "kept"),
        ("Clean up", AnswerDialog(), "0 files"),
        ("New folder", AnswerDialog(text="Invoices"), "folder Invoices"),
        ("New folder", AnswerDialog(), "folder Untitled"),
        ("New folder", AnswerDialog(accept=False, text="x"), "folder null"),
    ],
)
async def test_a_question_is_answered(asked: Tab, button: str, answer: AnswerDialog, result: str) -> None:
    before = asked.last
    async with asyncio.timeout(8):
        look = await asked.step(LeftClick(asked.at(button)))
        assert before is not None
        assert look.image == before.image
        assert said(asked) == "12 files", "nothing has happened yet"
        [(kind, text)] = asked.notices
        assert kind == "dialog"
        assert "answer_dialog answers it" in text
        assert ("accepted" in text) == (button == "Clean up")
        await asked.step()
        assert asked.notices == [], "it is reported once"
        await asked.step(answer)
    assert said(asked) == result
    assert asked.notices == []


async def test_any_other_action_accepts_it_first(asked: Tab) -> None:
    await asked.step(LeftClick(asked.at("Clean up")))
    await asked.step(LeftClick(asked.at("Note")))
    assert asked.notices[0] == ("dialog", 'confirm "Delete all 12 files?": accepted')
    assert said(asked) == "noted"
    await asked.step(AnswerDialog())
    assert asked.notices == [("action_failed", "no dialog is open")]


async def test_an_alert_is_closed_and_two_questions_come_one_by_one(asked: Tab) -> None:
    await asked.step(LeftClick(asked.at("Say")))
    assert (asked.notices, said(asked)) == ([("dialog", 'alert "done": accepted')], "said")
    await asked.step(LeftClick(asked.at("Twice")))
    await asked.step(AnswerDialog(accept=False))
    assert 'confirm "two?" is open' in asked.notices[0][1]
    await asked.step(AnswerDialog())
    assert said(asked) == "false,true"


async def test_what_was_typed_is_not_lost_unasked(site: Site, open_tab: Open) -> None:
    away = site.page("<title>Away</title><p>here</p>")
    form = site.page(
        "<title>Form</title><input aria-label=Note><script>"
        "onbeforeunload = (e) => document.querySelector('input').value && e.preventDefault()</script>"
    )
    tab = await open_tab(keep_dialogs=True)
    await tab.goto(away)
    await tab.goto(form)
    await tab.step(Type(tab.at("Note"), "draft", enter=False))
    for leave in (Navigate(away), GoBack()):
        async with asyncio.timeout(8):
            look = await tab.step(leave)
        assert look.observation.title == "Form"
        assert "lose what was entered" in tab.notices[0][1]
        look = await tab.step(AnswerDialog(accept=False))
        assert (look.observation.url, tab.find("Note").value) == (form, "draft")
    await tab.goto(away)
    look = await tab.step(AnswerDialog())
    assert look.observation.url == away


async def test_a_page_that_never_stops_asking_can_be_left(site: Site, open_tab: Open) -> None:
    tab = await open_tab(keep_dialogs=True, config=BrowserConfig(execute_seconds=2))
    away = site.page("<title>Away</title><p>here</p>")
    await tab.goto(site.page("<button onclick=\"while (true) confirm('again')\">Trap</button>"))
    await tab.step(LeftClick(tab.at("Trap")))
    await tab.step(AnswerDialog(accept=False))
    assert "is open" in tab.notices[0][1]
    async with asyncio.timeout(12):
        look = await tab.goto(away)
    assert look.observation.url == away


async def test_a_question_of_a_window_and_of_the_page_behind(site: Site, open_tab: Open) -> None:
    site.page(
        "<title>Window</title><button onclick='document.title = confirm(\"here?\")'>Here</button>"
        "<button onclick='opener.ask()'>There</button>",
        "/window",
    )
    tab = await open_tab(keep_dialogs=True)
    await tab.goto(
        site.page(
            "<a href=/window target=_blank rel=opener>Go</a><script>function ask() {"
            "setTimeout(() => { document.title = confirm('there?') }) }</script>"
        )
    )
    await tab.step(LeftClick(tab.at("Go")))
    for name in ("Here", "There"):
        await tab.step(LeftClick(tab.at(name)))
        assert f'confirm "{name.lower()}?" is open' in tab.notices[0][1]
        await tab.step(AnswerDialog(accept=False))
    assert tab.last is not None
    assert tab.last.observation.title == "false"
    look = await tab.step(GoBack())
    assert look.observation.title == "false"


async def test_an_episode_ends_with_an_open_question(asked: Tab) -> None:
    await asked.step(LeftClick(asked.at("Clean up")))
    async with asyncio.timeout(3):
        await asked.slot.close()
    assert asked.slot.is_up
