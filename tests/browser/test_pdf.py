"""PDFs are shown like pages: drawn, read, scrolled, followed; and what cannot be shown is told."""

from __future__ import annotations

import io

import numpy
import pytest
from PIL import Image
from starlette.requests import Request
from starlette.responses import Response
from tests.browser.conftest import Site, Tab

from webgym.browser import pdf
from webgym.browser.pdf_page import Broken, make_page
from webgym.core.action import GoBack, LeftClick, Scroll, Target

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


def make_pdf(*pages: str, link: str = "") -> bytes:
    """A PDF of pages with a line of text each; the first one leads to ``link``, if that is given."""
    objects = ["<</Type/Catalog/Pages 2 0 R>>", "", "<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>"]
    annotation = f"/Annots[<</Type/Annot/Subtype/Link/Rect[40 700 300 740]/A<</S/URI/URI({link})>>>>]"
    kids = []
    for number, text in enumerate(pages):
        content = f"BT /F1 24 Tf 50 710 Td ({text}) Tj ET"
        objects.append(f"<</Length {len(content)}>>stream\n{content}\nendstream")
        more = annotation if link and not number else ""
        objects.append(
            f"<</Type/Page/Parent 2 0 R/MediaBox[0 0 600 800]/Resources<</Font<</F1 3 0 R>>>>"
            f"/Contents {len(objects)} 0 R{more}>>"
        )
        kids.append(f"{len(objects)} 0 R")
    objects[1] = f"<</Type/Pages/Kids[{' '.join(kids)}]/Count {len(kids)}>>"
    out, offsets = "%PDF-1.4\n", []
    for number, one in enumerate(objects, 1):
        offsets.append(len(out))
        out += f"{number} 0 obj{one}endobj\n"
    table = "".join(f"{offset:010} 00000 n \n" for offset in offsets)
    size = len(objects) + 1
    out += f"xref\n0 {size}\n0000000000 65535 f \n{table}trailer<</Size {size}/Root 1 0 R>>\nstartxref\n"
    return (out + f"{out.index('xref')}\n%%EOF").encode()


def serve(site: Site, path: str, body: bytes, **headers: str) -> str:
    async def answer(_: Request) -> Response:
        return Response(body, media_type="application/pdf", headers=headers)

    return site.on(path, answer)


def dark_pixels(tab: Tab) -> int:
    assert tab.last is not None
    return int((numpy.asarray(Image.open(io.BytesIO(tab.last.image)).convert("L"))[:, 100:700] < 40).sum())


async def test_a_pdf_is_drawn_read_scrolled_and_left(site: Site, tab: Tab) -> None:
    url = serve(site, "/report.pdf", make_pdf("Sum 512", "Page two", "Page three"))
    await tab.goto(site.page("<a href=/report.pdf>Report</a>"))
    look = await tab.step(LeftClick(tab.at("Report")))
    assert (look.observation.url, look.observation.status, tab.notices) == (url, 200, [])
    assert tab.text == ["report.pdf: PDF, 3 pages", "Sum 512"]
    assert dark_pixels(tab) > 300
    for _ in range(2):
        await tab.step(Scroll("down"))
    assert tab.text == ["Page two"]
    await tab.step(GoBack())
    assert tab.text == ["Report"]
    assert site.hits.count("/report.pdf") == 1


WAYS = {
    "an address": ("", ""),
    "another tab": ("<a href=/way.pdf target=_blank>Open</a>", "Open"),
    "a form": ("<form action=/way.pdf method=post><button>Open</button></form>", "Open"),
    "a script": ("<button onclick='location = \"/way.pdf\"'>Open</button>", "Open"),
    "a frame": ("<iframe src=/way.pdf width=700 height=400></iframe>", ""),
}


@pytest.mark.parametrize("way", WAYS)
async def test_every_way_leads_to_a_pdf(site: Site, tab: Tab, way: str) -> None:
    url = serve(site, "/way.pdf", make_pdf("Sum 512"))
    home, button = WAYS[way]
    await tab.goto(site.page(home) if home else url)
    if button:
        await tab.step(LeftClick(tab.at(button)))
    assert "Sum 512" in tab.text
    assert dark_pixels(tab) > 100


async def test_a_file_that_is_offered_is_shown_too_if_it_is_a_pdf(site: Site, tab: Tab) -> None:
    offered = {"content-disposition": "attachment; filename=bill.pdf"}
    await tab.goto(serve(site, "/bill", make_pdf("Sum 512"), **offered))
    assert tab.text == ["bill: PDF, 1 page", "Sum 512"]


async def test_links_of_a_pdf_are_elements_that_lead_on(site: Site, tab: Tab) -> None:
    target = site.page("<p>Behind the link")
    url = serve(site, "/links.pdf", make_pdf("More here", link=target))
    await tab.goto(url)
    [link] = [one for one in tab.last.observation.elements or () if one.role == "link"]  # type: ignore[union-attr]
    assert link.href == target
    x, y, width, height = link.box
    wide, tall = tab.options.viewport
    point = ((x + width / 2) / wide * 1000, (y + height / 2) / tall * 1000)
    await tab.step(LeftClick(Target(coordinate=point)))
    assert tab.text == ["Behind the link"]
    look = await tab.step(GoBack())
    assert look.observation.url == url
    assert "More here" in tab.text


UNSHOWN = {
    "broken": (b"%PDF-1.4\nnothing of it", "the file is broken"),
    "no PDF": (b"<p>words", "the file is broken"),
    "large": (make_pdf("x" * 4000), "it is larger than 0.00195312 MB"),
}


@pytest.mark.parametrize("kind", UNSHOWN)
async def test_what_cannot_be_shown_is_told_and_the_page_stays(
    site: Site, tab: Tab, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr(pdf, "PDF_BYTES", 2048)
    body, why = UNSHOWN[kind]
    serve(site, "/odd.pdf", body)
    home = site.page("<a href=/odd.pdf>Open</a>")
    await tab.goto(home)
    look = await tab.step(LeftClick(tab.at("Open")))
    assert tab.notices == [("download_refused", f'the PDF "odd.pdf" cannot be shown: {why}')]
    assert look.observation.url == home


async def test_a_page_cannot_read_the_pdf_in_its_frame(site: Site, tab: Tab) -> None:
    serve(site, "/mine.pdf", make_pdf("Sum 512"))
    script = "<p>?</p><script>onmessage = 0; document.querySelector('iframe').onload = (event) => "
    script += "document.querySelector('p').textContent = event.target.contentDocument === null</script>"
    await tab.goto(site.page(f"<iframe src=/mine.pdf width=700 height=300></iframe>{script}"))
    assert "true" in tab.text


async def test_a_long_pdf_says_how_much_of_it_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.browser.pdf_page.MOST_PAGES", 2)
    page = make_page(make_pdf("one", "two", "three"), "a <b>.pdf")
    assert "a &lt;b&gt;.pdf: PDF, 3 pages; the first 2 are shown" in page
    assert "three" not in page


async def test_what_is_no_pdf_is_broken() -> None:
    with pytest.raises(Broken):
        make_page(b"words", "words")
