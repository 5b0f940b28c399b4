"""Moves sliders by keys."""

from __future__ import annotations

import msgspec

from webgym.browser.chords import chord, keys_of
from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.page import Page
from webgym.browser.pointer import send_keys
from webgym.core.errors import ActionFailed

_ARROWS = ("ArrowRight", "ArrowLeft", "ArrowUp", "ArrowDown")
_FAR = 50
"""Number of presses of an arrow key above which Page Up or Page Down is tried. If the slider ignores it, the
page scrolls."""
_MOST_READS = 40
"""Most times that the value is read, for a slider that moves by itself or by steps of many sizes."""
_PRECISION = 1e-6
"""Relative difference up to which two values are equal, as pages round them."""

TYPED_KEYS = 200
"""A text of up to this many characters is typed key by key, because fields may handle key events. A key costs
about 1 ms of CPU, as much as inserting a whole text, so a longer text is inserted except for its last
character, which is typed. Also the longest text for an element that handles keys but is no field, such as a
game board."""


class _Told(msgspec.Struct, frozen=True):
    """What the page tells of the value of a slider."""

    value: float | None = None


class _Slider:
    """The focused slider: its value, and by how much each key that was pressed changes it."""

    def __init__(self, page: Page, value: float | None, frame: str | None) -> None:
        self.page = page
        self.value = value
        self.frame = frame
        self.steps: dict[str, float] = {}
        self.keys_left = TYPED_KEYS
        self.reads_left = _MOST_READS

    async def press(self, name: str, count: int = 1) -> None:
        """Press a key several times, and read the value.

        Raises:
            ActionFailed: the document is gone.
        """
        count = min(count, self.keys_left)
        self.keys_left -= count
        self.reads_left -= 1
        before = self.value
        await send_keys(self.page, chord(keys_of((name,))) * count)
        try:
            told = await self.page.run("readSlider", before, reply=_Told, frame=self.frame)
        except DocumentGone:
            raise ActionFailed("another page opened while the slider was moved") from None
        self.value = told.value
        if before is not None and self.value is not None:
            self.steps[name] = (self.value - before) / count

    def next_presses(self, wanted: float) -> tuple[str, int] | None:
        """The key that brings the value nearer, and how often to press it; ``None`` if nothing does."""
        if self.value is None or not (self.keys_left and self.reads_left):
            return None
        distance = wanted - self.value
        if abs(distance) <= _PRECISION * max(1.0, abs(wanted)):
            return None
        known = {name: step / distance for name, step in self.steps.items() if step * distance > 0}
        fitting = {
            name: max(1, int((1 + _PRECISION) / share))
            for name, share in known.items()
            if share <= 1 + _PRECISION
        }
        name = min(fitting, key=fitting.__getitem__, default=None)
        if name is None or fitting[name] > _FAR:
            for untried in self._candidates(distance, arrows=not known):
                if untried not in self.steps:
                    return untried, 1
        if name is not None:
            return name, fitting[name]
        nearest = min(known, key=known.__getitem__, default=None)
        return (nearest, 1) if nearest is not None and known[nearest] < 2 * (1 - _PRECISION) else None

    def _candidates(self, distance: float, *, arrows: bool) -> tuple[str, ...]:
        """Keys that may change the value in the direction of a distance."""
        right, left, up, down = _ARROWS
        if not arrows:
            return ("PageUp" if distance > 0 else "PageDown",)
        first, opposite, second = (right, left, up) if distance > 0 else (left, right, down)
        is_mirrored = self.steps.get(first, 0) * distance < 0
        return (first, opposite, second) if is_mirrored else (first, second)


async def slide(page: Page, wanted: float, value: float | None, *, share: bool, frame: str | None) -> None:
    """Move the focused slider to a value by keys, as near as its steps lead, by ``typed_keys`` keys at most.

    Args:
        page: the page.
        wanted: the requested value.
        value: the current value; ``None`` if the page tells it only when it changes.
        share: whether both are positions of the handle on its track, in percent.
        frame: the frame of another origin that the slider is in; ``None`` if it is in none.

    Raises:
        ActionFailed: the slider has another value than the requested one; the message contains it. Or
            the document is gone.
    """
    slider = _Slider(page, value, frame)
    for name in _ARROWS if value is None else ():
        await slider.press(name)
        if slider.value is not None:
            break
    while presses := slider.next_presses(wanted):
        await slider.press(*presses)
    if slider.value is None:
        raise ActionFailed(
            "nothing on the page tells the value of this slider; write where its handle shall be, such as 40%"
        )
    if abs(wanted - slider.value) > _PRECISION * max(1.0, abs(wanted)):
        why = "" if any(slider.steps.values()) else ", and does not react to keys"
        unit = " % of its track" if share else ""
        raise ActionFailed(f"the slider is at {slider.value:g}{unit}, not at {wanted:g}{unit}{why}")
