"""Interactive elements in the format of the authors' clients.

An element's id is its mark's number, as a string. The marks on a screenshot have the same ids, so that the
clients' mapping from drawn ids to element ids is the identity.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from webgym.browser.document import DocumentElement
from webgym.core.observation import Element

Json = dict[str, Any]

_TAG_OF_ROLE = {"link": "a", "textbox": "input, type=text", "combobox": "select", "option": "option"}
"""Tag by role, for elements in frames of another origin, which are missing when the document is read."""


def regions_of(elements: Iterable[DocumentElement]) -> dict[str, Json]:
    """Elements by id."""
    regions: dict[str, Json] = {}
    for element in elements:
        tag = f"{element.tag}, type={element.type}" if element.type else element.tag
        region = _region(tag, element.role, element.name, element.scrolls, element.boxes)
        regions[str(element.number)] = region
    return regions


def screenshot_info(
    marked: Iterable[Element], elements: Iterable[DocumentElement], viewport: tuple[int, int]
) -> Json:
    """The elements on a screenshot with marks, and those above and below the viewport.

    Options of dropdowns always count as visible: no screenshot shows them, but they can be chosen.
    """
    elements = tuple(elements)
    regions = regions_of(elements)
    visible = []
    for mark in marked:
        visible.append(str(mark.number))
        if str(mark.number) not in regions:
            tag = _TAG_OF_ROLE.get(mark.role, mark.role)
            regions[str(mark.number)] = _region(tag, mark.role, mark.name, False, (mark.box,))
    shown = set(visible)
    visible += [str(it.number) for it in elements if it.tag == "option" and str(it.number) not in shown]
    above, below = [], []
    width, height = viewport
    for element in elements:
        if str(element.number) in shown or not element.boxes:
            continue
        x, y, wide, tall = element.boxes[0]
        if 0 <= x + wide / 2 < width:
            if y + tall / 2 < 0:
                above.append(str(element.number))
            elif y + tall / 2 >= height:
                below.append(str(element.number))
    return {
        "visible_rects": visible,
        "rects_above": above,
        "rects_below": below,
        "interactive_regions": regions,
        "id_mapping": {number: number for number in (*visible, *above, *below)},
    }


def _region(tag: str, role: str, name: str, scrolls: bool, boxes: Iterable[tuple[float, ...]]) -> Json:
    return {
        "tag_name": tag,
        "role": role,
        "aria_name": name,
        "v_scrollable": scrolls,
        "rects": [
            {
                "x": x,
                "y": y,
                "width": width,
                "height": height,
                "top": y,
                "right": x + width,
                "bottom": y + height,
                "left": x,
            }
            for x, y, width, height in boxes
        ],
    }
