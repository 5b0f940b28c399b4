"""Interactive elements in the shape that their clients read.

An element's id is its mark's number, as a string. What is drawn on a picture is named by the same ids, so
that their mapping from drawn ids to element ids changes nothing here.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from webgym.browser.document import DocumentElement
from webgym.core.observation import Element

Json = dict[str, Any]

_TAG_OF_ROLE = {"link": "a", "textbox": "input, type=text", "combobox": "select", "option": "option"}
"""Of an element that the reading of the document did not reach: it lies in a frame of another origin."""


def regions_of(elements: Iterable[DocumentElement]) -> dict[str, Json]:
    """Elements by id."""
    return {
        str(one.number): _region(
            f"{one.tag}, type={one.type}" if one.type else one.tag, one.role, one.name, one.scrolls, one.boxes
        )
        for one in elements
    }


def screenshot_info(
    marked: Iterable[Element], elements: Iterable[DocumentElement], viewport: tuple[int, int]
) -> Json:
    """What a picture with marks shows, and what lies above and below of it.

    Options of dropdowns always count as visible: no picture shows them, but they can be chosen.
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
    visible += [str(one.number) for one in elements if one.tag == "option" and str(one.number) not in shown]
    above, below = [], []
    width, height = viewport
    for one in elements:
        if str(one.number) in shown or not one.boxes:
            continue
        x, y, wide, tall = one.boxes[0]
        if 0 <= x + wide / 2 < width:
            if y + tall / 2 < 0:
                above.append(str(one.number))
            elif y + tall / 2 >= height:
                below.append(str(one.number))
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
