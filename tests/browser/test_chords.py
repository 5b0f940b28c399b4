from __future__ import annotations

import pytest

from webgym.browser.chords import chord, keys_of


@pytest.mark.parametrize(
    ("names", "codes"),
    [
        (["Enter"], ["Enter"]),
        (["Control+a"], ["ControlLeft", "KeyA"]),
        (["ctrl", "A"], ["ControlLeft", "KeyA"]),
        (["ControlOrMeta+Shift+ArrowDown"], ["ControlLeft", "ShiftLeft", "ArrowDown"]),
        (["ctrl++"], ["ControlLeft", "Equal"]),
        (["+"], ["Equal"]),
        (["space"], ["Space"]),
        ([" "], ["Space"]),
        (["KeyQ"], ["KeyQ"]),
        (["esc", "pgdn", "win", "option", "F12"], ["Escape", "PageDown", "MetaLeft", "AltLeft", "F12"]),
        (["/"], ["Slash"]),
        (["é"], [""]),
    ],
)
def test_names(names: list[str], codes: list[str]) -> None:
    assert [key.code for key in keys_of(names)] == codes


@pytest.mark.parametrize("name", ["Hyper", "Control+Nothing", "ab"])
def test_a_name_that_no_key_has(name: str) -> None:
    with pytest.raises(ValueError, match="there is no key"):
        keys_of([name])


def test_a_chord_goes_down_in_order_and_up_in_reverse() -> None:
    events = [(event["type"], event["key"], event["modifiers"]) for event in chord(keys_of(["Shift", "a"]))]
    assert events == [
        ("rawKeyDown", "Shift", 8),
        ("keyDown", "A", 8),
        ("keyUp", "A", 8),
        ("keyUp", "Shift", 0),
    ]


def test_a_command_types_nothing() -> None:
    down = [event for event in chord(keys_of(["Control", "a"])) if event["type"] != "keyUp"]
    assert all("text" not in event for event in down)
