"""`webgym view` of a task set: over HTTP and in a real browser."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from urllib.parse import quote

import httpx
import pytest
from msgspec.structs import replace
from PIL import Image
from playwright.async_api import Browser, expect
from tests.report.conftest import HOSTILE, asking
from tests.report.test_pages import CONTRAST, opened

from webgym.cli.tasks._files import has_tasks
from webgym.core.errors import TaskFileError
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.truth import AnswerTruth, Click, Truth
from webgym.report.config import ViewConfig
from webgym.report.taskset import serve_tasks, tasks_app
from webgym.tasks.formats import write_tasks

GROUPS = (
    FactGroup(1, "the crossing", ("it leaves at nine", "it is on time", "it takes bicycles")),
    FactGroup(2, "the cabin", ("it has a window", "it costs less than £40", "it has two beds", "it is aft")),
    FactGroup(3, "", ("the deck is named",)),
)
PARENT = Task(
    "deepshop/ferry",
    "Find a crossing and a cabin.",
    "https://www.harbour.example/book",
    "Travel & Transportation",
    "Travel & Accommodation",
    Rubric(GROUPS),
    "deepshop",
    reference_answer="The nine o'clock, cabin 12",
    website_from="inferred",
    flags=("dated",),
    extra={"attempt_level": 2, "published": "{}"},
    split="train",
    truth=Truth("harbour.example", (), AnswerTruth(), (Click("Book"),)),
)


def derived(*ids: int) -> Task:
    groups = tuple(group for group in GROUPS if group.id in ids)
    name = f"{PARENT.id}+{'-'.join(map(str, ids))}"
    return replace(
        PARENT, id=name, parent_id=PARENT.id, rubric=Rubric(groups), flags=(), truth=None, extra={}
    )


def tasks() -> list[Task]:
    simple = Task("gaia-web/0", "Look", "other.example", "Misc.", "News", Rubric(GROUPS[2:]), "gaia-web")
    many = [
        replace(simple, id=f"gaia-web/{number}", instruction=f"Read page {number} aloud.", split="test")
        for number in range(250)
    ]
    hostile = replace(
        simple, id=f"gaia-web/{HOSTILE}", instruction=HOSTILE, website="evil.example/<script>pwned=1</script>"
    )
    orphan = replace(simple, id="gaia-web/orphan", parent_id="gaia-web/lost")
    return [PARENT, derived(1), derived(2), derived(1, 3), hostile, orphan, *many]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a build leaves it."""
    path = tmp_path_factory.mktemp("sets") / "2026-03-set"
    write_tasks(path / "tasks.jsonl", tasks())
    (path / "tasks.jsonl").write_bytes((path / "tasks.jsonl").read_bytes() + b"{\n")
    (path / "figures").mkdir()
    Image.new("RGB", (40, 30), "teal").save(path / "figures" / "domains.png")
    Image.new("RGB", (40, 30), "red").save(path / "figures" / "levels.png")
    drawn = (
        '<svg xmlns="http://www.w3.org/2000/svg" width="40" height="30"><rect width="9" height="9"/></svg>'
    )
    (path / "figures" / "levels.svg").write_text(drawn)
    return path


@pytest.fixture
async def client(folder: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with asking(tasks_app(folder)) as client:
        yield client


# --- over HTTP ----------------------------------------------------------------------------------------


async def test_the_page_forbids_foreign_scripts_and_names(client: httpx.AsyncClient) -> None:
    reply = await client.get("/")
    assert reply.status_code == 200
    assert "default-src 'none'" in reply.headers["content-security-policy"]
    assert (await client.get("/", headers={"host": "evil.example"})).status_code == 400
    assert "script>window.pwned" not in reply.text


async def test_rows_are_found_counted_and_paged(client: httpx.AsyncClient) -> None:
    async def ask(**asked: object) -> dict[str, object]:
        reply = await client.get("/api/tasks", params={key: str(value) for key, value in asked.items()})
        assert reply.status_code == 200
        found: dict[str, object] = reply.json()
        return found

    assert (await ask(count=1))["total"] == 256
    assert (await ask(source="deepshop", level="medium"))["total"] == 2
    page = await ask(split="test", text="page", after=100, count=50)
    assert page["total"] == 250
    assert [row["id"] for row in page["rows"]] == [f"gaia-web/{number}" for number in range(100, 150)]  # type: ignore[attr-defined]
    assert len((await ask(count=10_000))["rows"]) == 256  # type: ignore[arg-type]
    assert (await ask(text="no such thing", count=5)) == {"total": 0, "rows": []}
    for bad in ({"after": "-1"}, {"count": "x"}, {"after": "9" * 30}):
        assert (await client.get("/api/tasks", params=bad)).status_code == 400


async def test_a_task_with_its_family(client: httpx.AsyncClient) -> None:
    shown = (await client.get("/api/task", params={"id": PARENT.id})).json()
    assert [[group["id"] for group in child["groups"]] for child in shown["children"]] == [[1], [2], [1, 3]]
    assert shown["extra"] == {"attempt_level": "2"}
    assert shown["websiteFrom"] == "inferred"
    child = (await client.get("/api/task", params={"id": f"{PARENT.id}+1-3"})).json()
    assert child["parent"]["id"] == PARENT.id
    orphan = (await client.get("/api/task", params={"id": "gaia-web/orphan"})).json()
    assert (orphan["parentId"], orphan["parent"]) == ("gaia-web/lost", None)
    assert (await client.get("/api/task", params={"id": "none"})).status_code == 404


async def test_figures_of_the_folder_and_nothing_else(client: httpx.AsyncClient) -> None:
    drawing = await client.get("/figures/levels.svg")
    assert drawing.headers["content-type"].startswith("image/svg+xml")
    assert "default-src 'none'" in drawing.headers["content-security-policy"]
    assert (await client.get("/figures/domains.png")).status_code == 200
    for name in ("levels.png", "tasks.jsonl", "..%2Ftasks.jsonl", "../tasks.jsonl"):
        assert (await client.get(f"/figures/{name}")).status_code == 404


def test_a_set_of_a_single_task_has_a_page(tmp_path: Path) -> None:
    write_tasks(tmp_path / "one.parquet", [replace(PARENT, split=None, domain="", subdomain="", flags=())])
    tasks_app(tmp_path / "one.parquet")
    with pytest.raises(TaskFileError):
        tasks_app(tmp_path / "none.parquet")


def test_what_is_viewed_is_told_by_what_is_there(run_folder: Path, folder: Path, tmp_path: Path) -> None:
    assert not has_tasks(run_folder)  # though a run holds its tasks, too
    assert has_tasks(folder)
    assert has_tasks(folder / "tasks.jsonl")
    assert has_tasks(tmp_path / "none.parquet")
    assert not has_tasks(tmp_path)
    assert not has_tasks(tmp_path / "nowhere")


# --- in a browser -------------------------------------------------------------------------------------


@asynccontextmanager
async def viewed(path: Path) -> AsyncIterator[str]:
    """The address of a task set that is served."""
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    async with asyncio.TaskGroup() as group:
        serving = group.create_task(serve_tasks(path, ViewConfig(), ready.set_result))
        yield await ready
        serving.cancel()


def address(url: str, task_id: str) -> str:
    return f"{url}#/task/{quote(task_id, safe='')}"


in_browser = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


class TestPages:
    pytestmark = in_browser

    async def test_the_overview(self, browser: Browser, folder: Path) -> None:
        async with viewed(folder) as url, opened(browser, url) as page:
            await expect(page.locator("h1")).to_have_text("2026-03-set")
            await expect(page.locator(".warning")).to_contain_text("1 broken record is left out")
            tiles = re.sub(r"\s+", " ", await page.locator(".tiles").inner_text())
            for part in ("Tasks 256", "Websites 3", "Derived 4", "Training 4", "Test 250"):
                assert part in tiles
            await expect(page.locator(".gallery img")).to_have_count(2)
            for picture in await page.locator(".gallery img").all():
                await picture.scroll_into_view_if_needed()
                await expect(picture).to_have_js_property("complete", True)
                assert await picture.evaluate("image => image.naturalWidth") == 40
            await page.get_by_role("button", name="Travel & Transportation").click()
            await expect(page.locator("#rows-body tr")).to_have_count(4)
            for wide in (1200, 390):
                await page.set_viewport_size({"width": wide, "height": 800})
                await page.wait_for_function(
                    "wide => innerWidth == wide && document.documentElement.scrollWidth <= wide", arg=wide
                )
                cut = "names => names.filter(e => e.scrollWidth > e.clientWidth).map(e => e.innerText)"
                assert await page.locator(".plots tbody th").evaluate_all(cut) == []

    async def test_search_filters_and_pages(self, browser: Browser, folder: Path) -> None:
        async with viewed(folder) as url, opened(browser, url) as page:
            lines, count = page.locator("#rows-body tr"), page.locator("#list-count")
            await expect(lines).to_have_count(100)
            twice = "button => { button.click(); button.click() }"  # before the second page is there
            await page.get_by_role("button", name="Next page").evaluate(twice)
            await expect(lines).to_have_count(56)
            await expect(page.locator("#pager")).to_contain_text("201 to 256 of 256")
            await expect(page.get_by_role("button", name="Next page")).to_be_disabled()
            await page.reload()  # the address tells the state
            await expect(lines).to_have_count(56)
            await page.get_by_role("searchbox").fill("READ 249")
            await expect(count).to_have_text("1")
            await page.get_by_role("combobox", name="Split").select_option("train")
            await expect(page.locator("#nothing")).to_be_visible()
            await page.get_by_role("button", name="Clear").click()
            await expect(count).to_have_text("256")
            await page.get_by_role("combobox", name="Flag").select_option("dated")
            await expect(count).to_have_text("1")
            await page.get_by_role("combobox", name="Flag").select_option("")
            await page.get_by_role("combobox", name="Domain", exact=True).select_option("Misc.")
            assert await page.locator("#filter-subdomain option").all_inner_texts() == [
                "All subdomains",
                "News (252)",
            ]
            await page.get_by_role("button", name="Clear").click()
            await page.get_by_role("button", name="harbour.example").first.click()
            await expect(count).to_have_text("4")
            assert "website=harbour.example" in page.url
            await page.locator("#website").click()
            await expect(count).to_have_text("256")

    async def test_a_task_and_its_family(self, browser: Browser, folder: Path) -> None:
        async with viewed(folder) as url, opened(browser, url) as page:
            await page.locator("#rows-body tr").first.locator("td").nth(3).click()
            await expect(page.locator(".where")).to_have_text("1 of 256")
            await expect(page.locator("#rubric h2")).to_have_text("8 facts in 3 groups")
            await expect(page.locator("#rubric .fact")).to_have_count(8)
            await expect(page.locator("#about")).to_contain_text("inferred by a model")
            await expect(page.locator("#about")).to_contain_text("attempt_level")
            answer = page.get_by_text("The nine o'clock, cabin 12")
            await expect(answer).to_be_hidden()
            await page.get_by_text("Show the reference answer").click()
            await expect(answer).to_be_visible()
            children = page.locator("#family .relative")
            await expect(children).to_have_count(3)
            await expect(children.nth(2).get_by_role("img", name="groups 1, 3")).to_be_visible()
            await children.nth(2).click()
            await expect(page.locator("#rubric h2")).to_have_text("4 facts in 2 groups")
            await expect(page.locator("#family")).to_contain_text("Derived from")
            await page.locator("#family .relative").click()
            await expect(page.locator("#rubric h2")).to_have_text("8 facts in 3 groups")
            await page.keyboard.press("Escape")
            await expect(page.locator("#rows-body tr")).to_have_count(100)

    async def test_neighbours_go_past_the_end_of_a_page(self, browser: Browser, folder: Path) -> None:
        async with viewed(folder) as url, opened(browser, f"{url}#/?split=test") as page:
            await expect(page.locator("#list-count")).to_have_text("250")
            await page.locator("#rows-body tr").nth(99).locator("td").nth(3).click()
            await expect(page.locator(".where")).to_have_text("100 of 250")
            await page.keyboard.press("]")
            await expect(page.locator(".where")).to_have_text("101 of 250")
            await expect(page.locator("h1").last).to_have_text("Read page 100 aloud.")
            twice = """() => { for (let times = 0; times < 2; times++)
                document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "]", bubbles: true })) }"""
            await page.evaluate(twice)  # before the reply to the first
            await expect(page.locator(".where")).to_have_text("103 of 250")
            await expect(page.locator("h1").last).to_have_text("Read page 102 aloud.")
            await page.keyboard.press("Escape")
            await expect(page.locator("#pager")).to_contain_text("101 to 200 of 250")

    async def test_hostile_text_is_shown_and_inert(self, browser: Browser, folder: Path) -> None:
        async with viewed(folder) as url:
            async with opened(browser, address(url, f"gaia-web/{HOSTILE}")) as page:
                await expect(page.locator("#task h1")).to_contain_text("</script><script>window.pwned=1")
                assert await page.locator("#task a[href^=javascript]").count() == 0
                assert await page.locator("#task script, #task img").count() == 0
            async with opened(browser, f"{url}#/?q=x&text=pwned") as page:
                await expect(page.locator("#rows-body")).to_contain_text("<img src=x")

    async def test_an_unknown_task_is_said(self, browser: Browser, folder: Path) -> None:
        async with viewed(folder) as url:
            context = await browser.new_context()  # not opened(): a 404 is written to the console
            page = await context.new_page()
            await page.goto(address(url, "nothing"))
            await expect(page.locator("#task")).to_contain_text("has no such task")
            await context.close()

    @pytest.mark.parametrize("scheme", ["light", "dark"])
    async def test_text_has_contrast_and_controls_have_names(
        self, browser: Browser, folder: Path, scheme: str
    ) -> None:
        nameless = "e => e.filter(e => !(e.ariaLabel || e.textContent.trim() || e.labels?.length)).length"
        async with viewed(folder) as url:
            for seen in (url, address(url, PARENT.id)):
                async with opened(browser, seen, color_scheme=scheme) as page:
                    await page.wait_for_selector("#rows-body tr:visible, #rubric:visible")
                    assert await page.evaluate(CONTRAST) == []
                    assert await page.locator("button, a[href], input, select").evaluate_all(nameless) == 0
