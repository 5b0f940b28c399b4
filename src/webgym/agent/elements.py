"""Finds elements and visible text in observations, for scripted policies. Models see only the picture."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final
from urllib.parse import unquote, urlsplit

from webgym.core.action import GRID, Mode, Target
from webgym.core.observation import Element, Observation
from webgym.core.text import fold, says
from webgym.core.truth import Click

TEXT_ROLES: Final = frozenset({"textbox", "searchbox", "combobox", "spinbutton", "textarea", "slider"})
LIST_ROLES: Final = frozenset({"combobox", "listbox"})

_SLIVER_PX: Final = 8
"""The least visible height of an element at the viewport's edge that can be clicked safely, pixels."""


def shows_all(observation: Observation, texts: Iterable[str]) -> bool:
    """Whether all these texts are visible at once."""
    visible = fold(observation.text or "")
    return all(says(visible, text) for text in texts)


def path_of(url: str) -> str:
    """Path and query of a URL, ``"/"`` for an empty path."""
    parts = urlsplit(url)
    path = unquote(parts.path) or "/"
    return f"{path}?{unquote(parts.query)}" if parts.query else path


def same_host(url: str, other: str) -> bool:
    """Whether two URLs lead to the same host."""
    return urlsplit(url).hostname == urlsplit(other).hostname


def usable(observation: Observation) -> list[Element]:
    """The elements that can be clicked: without those of which only a sliver is inside the viewport."""
    height = observation.viewport[1]
    return [
        element
        for element in observation.elements or ()
        if min(element.box[2:]) >= 1 and not _is_sliver(element, height)
    ]


def _is_sliver(element: Element, viewport_height: int) -> bool:
    _, top, _, height = element.box
    at_edge = top <= 0 or top + height >= viewport_height
    return at_edge and height < _SLIVER_PX


def find_click(observation: Observation, move: Click) -> Element | None:
    """The first element that matches the move; text fields only if nothing else matches."""
    matching = [element for element in usable(observation) if _matches(element, move)]
    return min(matching, key=lambda element: element.role in TEXT_ROLES, default=None)


def _matches(element: Element, move: Click) -> bool:
    if move.role is not None and element.role != move.role:
        return False
    if move.name is not None and fold(element.name) != fold(move.name):
        return False
    return move.path is None or (element.href is not None and path_of(element.href) == unquote(move.path))


def find_named(observation: Observation, name: str, roles: Iterable[str]) -> Element | None:
    """The first element with this accessible name and one of these roles."""
    wanted, allowed = fold(name), frozenset(roles)
    named = (element for element in usable(observation) if element.role in allowed)
    return next((element for element in named if fold(element.name) == wanted), None)


def find_home(observation: Observation, website: str) -> Element | None:
    """A link to the website's front page."""
    links = (element for element in usable(observation) if element.href is not None)
    return next((link for link in links if is_home(link.href or "", website)), None)


def is_home(url: str, website: str) -> bool:
    """Whether a URL is the front page of the website, without a query."""
    return same_host(url, website) and path_of(url) == "/"


def target_of(
    element: Element, observation: Observation, mode: Mode, *, at: Sequence[float] = (0.5, 0.5)
) -> Target:
    """The target of an action on this element.

    Args:
        element: the element.
        observation: the observation that contains it.
        mode: how a target is named.
        at: the point of its visible part to click, as fractions of width and height. A second attempt should
            not click the middle again: the middle of a link that wraps over two lines may be another element.
    """
    if mode == "marks":
        return Target(element=element.number)
    left, top, width, height = element.box
    x = (left + width * at[0]) / observation.viewport[0] * GRID
    y = (top + height * at[1]) / observation.viewport[1] * GRID
    return Target(coordinate=(float(_on_grid(x)), float(_on_grid(y))))


def _on_grid(value: float) -> int:
    return min(GRID - 1, max(0, round(value)))
