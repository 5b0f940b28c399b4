"""Actions and replies that can be."""

from __future__ import annotations

from hypothesis import strategies as st

from webgym.core.action import (
    GRID,
    Action,
    Answer,
    AnswerDialog,
    DoubleClick,
    Drag,
    GoBack,
    Hold,
    Hover,
    LeftClick,
    Mode,
    Navigate,
    Press,
    RightClick,
    Scroll,
    Space,
    Target,
    Type,
    Upload,
    Wait,
)

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=60)
SECONDS = st.floats(0, 1e6)
SAID = TEXTS.filter(lambda text: bool(text.strip()))
LINES = TEXTS.map(lambda text: " ".join(text.replace("<", "").split()))
JSON_OBJECTS = st.dictionaries(
    TEXTS,
    st.recursive(
        st.none() | st.booleans() | st.integers(-(10**9), 10**9) | TEXTS,
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
        max_leaves=6,
    ),
    max_size=4,
)


def targets(mode: Mode) -> st.SearchStrategy[Target]:
    if mode == "marks":
        return st.integers(0, 10_000).map(lambda number: Target(element=number))
    return points().map(lambda point: Target(coordinate=point))


def points() -> st.SearchStrategy[tuple[float, float]]:
    side = st.floats(0, GRID) | st.integers(0, GRID).map(float)
    return st.tuples(side, side)


def actions(mode: Mode, space: Space = "paper") -> st.SearchStrategy[Action]:
    paper = st.one_of(
        st.builds(LeftClick, targets(mode)),
        st.builds(Type, targets(mode), TEXTS),
        st.builds(Scroll, st.sampled_from(["up", "down"])),
        st.builds(Wait, SECONDS),
        st.just(GoBack()),
        st.builds(Navigate, SAID.map(str.strip)),
        st.builds(Answer, SAID),
    )
    if space == "paper":
        return paper
    places = targets(mode) | targets("coordinates")
    names = st.lists(SAID, min_size=1, max_size=3).map(tuple)
    modifiers = st.lists(st.sampled_from(["Alt", "Control", "Meta", "Shift"]), max_size=2).map(tuple)
    return st.one_of(
        paper,
        st.builds(LeftClick, places, modifiers),
        *(st.builds(act, places) for act in (DoubleClick, RightClick, Hover)),
        st.builds(Drag, places, places, st.lists(points(), max_size=3).map(tuple), SECONDS),
        st.builds(Hold, places, SECONDS),
        st.builds(AnswerDialog, st.booleans(), st.none() | TEXTS),
        st.builds(Type, places, TEXTS, st.booleans()),
        st.builds(Press, names),
        st.builds(Scroll, st.sampled_from(["up", "down", "left", "right"]), st.none() | places),
        st.builds(Upload, places, names),
    )
