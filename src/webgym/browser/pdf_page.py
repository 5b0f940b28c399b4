"""Makes a page of a PDF: its pages as pictures, with their text and links where they stand on them.

A program of its own, because PDFium is C++ and PDFs come from anywhere: what breaks it, or has it use too
much, ends this process alone, which can open no file and no connection. It reads a PDF from standard input,
and writes HTML to standard output.
"""

from __future__ import annotations

import base64
import ctypes
import html
import io
import resource
import sys
import time
from collections.abc import Iterator

import pypdfium2
from PIL import Image, ImageChops
from pypdfium2 import raw

MOST_PAGES = 60
"""Pages that are shown; a line above them says how many the PDF has."""

MOST_BYTES = 32 * 2**20
"""Bytes of the pictures, all together: a page of text has 50 kB, a scanned one 0.5 MB."""

MOST_SECONDS = 6.0
"""After this time no further page is drawn. A page takes 0.05 s on a processor of its own."""

MEMORY_BYTES = 2 * 2**30
CPU_SECONDS = 10

PIXELS_PER_POINT = 96 / 72
MOST_PIXELS = 4_000_000
"""Pixels of a page's picture: a poster is drawn smaller."""

_STYLE = """
body { margin: 0; background: #525659; font: 14px system-ui, sans-serif; }
header { padding: 8px 16px; background: #323639; color: #fff; }
svg { display: block; margin: 8px auto; background: #fff; max-width: calc(100% - 16px); height: auto; }
text { fill: transparent; white-space: pre; font-family: sans-serif; }
a { fill: transparent; }
"""


class Broken(Exception):
    """There is nothing to show of this PDF; the message says why."""


def make_page(data: bytes, name: str) -> str:
    """The HTML of a PDF.

    Args:
        data: the PDF.
        name: what it is called.

    Raises:
        Broken: it is none, is broken, or wants a password.
    """
    try:
        document = pypdfium2.PdfDocument(data)
    except pypdfium2.PdfiumError as error:
        why = "it wants a password" if "assword" in str(error) else "the file is broken"
        raise Broken(why) from None
    document.init_forms()
    end = time.monotonic() + MOST_SECONDS
    count, room, drawn = len(document), MOST_BYTES, []
    for number in range(min(count, MOST_PAGES)):
        drawn.append(_page(document, number))
        room -= len(drawn[-1])
        if room < 0 or time.monotonic() > end:
            break
    if not drawn:
        raise Broken("it has no pages")
    pages = f"{count} page{'s' if count > 1 else ''}"
    rest = f"; the first {len(drawn)} are shown" if len(drawn) < count else ""
    title = html.escape(name)
    head = f"<meta charset=utf-8><title>{title}</title><style>{_STYLE}</style>"
    return f"<!doctype html>{head}<header>{title}: PDF, {pages}{rest}</header>{''.join(drawn)}"


def _page(document: pypdfium2.PdfDocument, number: int) -> str:
    try:
        page = document[number]
    except pypdfium2.PdfiumError:
        return f"<header>page {number + 1} is broken</header>"
    width, height = page.get_size()
    scale = min(PIXELS_PER_POINT, (MOST_PIXELS / max(1.0, width * height)) ** 0.5)
    source = _source(page.render(scale=scale).to_pil())
    return (
        f'<svg id="page{number + 1}" viewBox="0 0 {width:g} {height:g}" width="{width * PIXELS_PER_POINT:g}">'
        f'<image width="{width:g}" height="{height:g}" href="{source}"/>'
        f"{''.join(_texts(page))}{''.join(_links(document, page))}</svg>"
    )


def _source(picture: Image.Image) -> str:
    """A picture as a data address. One without colours, as of most texts, is lossless; of others a JPEG is
    smaller and takes a tenth of the time."""
    grey, out = picture.convert("L"), io.BytesIO()
    has_colours = ImageChops.difference(grey.convert("RGB"), picture).getbbox() is not None
    if has_colours:
        picture.save(out, "JPEG", quality=90)
    else:
        grey.save(out, "PNG")
    kind = "jpeg" if has_colours else "png"
    return f"data:image/{kind};base64,{base64.b64encode(out.getvalue()).decode()}"


def _at(page: pypdfium2.PdfPage, box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """A box ``(left, bottom, right, top)`` of the PDF's own coordinates on the page as it is shown:
    ``(x, y, width, height)`` in points from its upper left corner."""
    wide, tall = page.get_size()
    corners = []
    for x, y in ((box[0], box[1]), (box[2], box[3])):
        across, down = ctypes.c_int(), ctypes.c_int()
        # In hundredths of a point, as the interface takes whole numbers.
        raw.FPDF_PageToDevice(page, 0, 0, round(wide * 100), round(tall * 100), 0, x, y, across, down)
        corners.append((across.value / 100, down.value / 100))
    (x1, y1), (x2, y2) = corners
    return min(x1, x2), min(y1, y2), abs(x2 - x1), abs(y2 - y1)


def _texts(page: pypdfium2.PdfPage) -> Iterator[str]:
    """Each line of text, as long and as high as it is in the picture."""
    text = page.get_textpage()
    start, line = 0, ""
    for index in range(text.count_chars() + 1):
        character = chr(raw.FPDFText_GetUnicode(text, index)) if index < text.count_chars() else "\n"
        if character not in "\r\n":
            line += character
            continue
        if line.strip():
            count = raw.FPDFText_CountRects(text, start, index - start)
            rects = [text.get_rect(number) for number in range(count)]
            if rects:
                lefts, bottoms, rights, tops = zip(*rects, strict=True)
                box = _at(page, (min(lefts), min(bottoms), max(rights), max(tops)))
                yield _text(line.strip(), *box)
        start, line = index + 1, ""


def _text(line: str, x: float, y: float, width: float, height: float) -> str:
    return (
        f'<text x="{x:g}" y="{y + 0.8 * height:g}" font-size="{max(1.0, height):g}" textLength="{width:g}" '
        f'lengthAdjust="spacingAndGlyphs">{html.escape(line)}</text>'
    )


def _links(document: pypdfium2.PdfDocument, page: pypdfium2.PdfPage) -> Iterator[str]:
    position, link = ctypes.c_int(0), raw.FPDF_LINK()
    while raw.FPDFLink_Enumerate(page, position, link):
        box = raw.FS_RECTF()
        target = _target(document, link)
        if target and raw.FPDFLink_GetAnnotRect(link, box):
            x, y, width, height = _at(page, (box.left, box.bottom, box.right, box.top))
            yield (
                f'<a href="{html.escape(target)}"><rect x="{x:g}" y="{y:g}" '
                f'width="{width:g}" height="{height:g}"/></a>'
            )


def _target(document: pypdfium2.PdfDocument, link: raw.FPDF_LINK) -> str:
    """Where a link leads: a page of the PDF, or an address."""
    action = raw.FPDFLink_GetAction(link)
    place = raw.FPDFLink_GetDest(document, link) or (action and raw.FPDFAction_GetDest(document, action))
    if place:
        return f"#page{raw.FPDFDest_GetDestPageIndex(document, place) + 1}"
    size = raw.FPDFAction_GetURIPath(document, action, None, 0) if action else 0
    address = ctypes.create_string_buffer(size)
    raw.FPDFAction_GetURIPath(document, action, address, size)
    return address.value.decode("utf-8", "replace")


def main() -> None:
    """Standard input is the PDF, the only argument its name. Ends with 1 and a line that says why if there is
    nothing to show."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
    Image.preinit()  # loads the code of the formats
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))
    try:
        page = make_page(sys.stdin.buffer.read(), sys.argv[1])
    except Broken as error:
        sys.exit(str(error))
    sys.stdout.buffer.write(page.encode())


if __name__ == "__main__":
    main()
