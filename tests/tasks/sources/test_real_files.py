"""The real files, where they lie beside the checkout."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest
from tests.tasks.sources import native

from webgym.core.websites import host_of
from webgym.tasks.files import NONE_FACT
from webgym.tasks.published import DIFFICULTY_DIFFERS
from webgym.tasks.sources import Read, read_source
from webgym.tasks.sources.base import DATED, ENCRYPTED_SOURCE, GARBLED

TODAY = date(2026, 1, 15)

pytestmark = pytest.mark.skipif(not native.REAL.is_dir(), reason=f"the real files are not at {native.REAL}")


def read(name: str, *parts: str) -> Read:
    path = native.REAL.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"{path} is not there")
    found = read_source(name, path, today=TODAY)
    assert found.records == len(found.tasks) + len(found.skipped)
    assert found.skipped == []
    return found


def test_insta_v1_and_v3() -> None:
    found = read("insta-v3", "insta-v3")
    assert len(found.tasks) == 62 + 11
    assert sum(bool(task.hints) for task in found.tasks) == 11
    assert all(task.website and task.website.startswith("https://") for task in found.tasks)


def test_webvoyager() -> None:
    found = read("pae-webvoyager", "webvoyager")
    assert len(found.tasks) == 643
    assert sum(task.reference_answer is not None for task in found.tasks) == 143
    assert sum(task.example_answer is not None for task in found.tasks) == 500
    assert len({task.website for task in found.tasks}) == 15
    named = [task for task in found.tasks if "2023" in task.instruction or "2024" in task.instruction]
    assert sum(DATED in task.flags for task in named) == 91
    assert [task.instruction for task in named if DATED not in task.flags] == [
        "Show the electrical resistivity of UNS A92024 and UNS G10800 at 20 degrees Celsius."
    ]


def test_agentsynth() -> None:
    found = read("agentsynth-web", "agentsynth-web")
    assert len(found.tasks) == 194 + 61
    assert sum(task.example_answer is not None for task in found.tasks) == 203
    assert sum(GARBLED in task.flags for task in found.tasks) == 2
    assert all(task.website for task in found.tasks)


def test_browsecomp() -> None:
    found = read("browsecomp", "browsecomp")
    assert len(found.tasks) == 100
    assert all(task.reference_answer and ENCRYPTED_SOURCE in task.flags for task in found.tasks)


def test_travelplanner() -> None:
    found = read("travelplanner", "travelplanner")
    assert len(found.tasks) == 180 + 3
    assert all(DATED in task.flags for task in found.tasks)
    assert not any(GARBLED in task.flags for task in found.tasks)
    rows = [task for task in found.tasks if "days: 3" in task.hints]
    assert rows
    assert all(any(hint.startswith("date: 2022-03-") for hint in task.hints) for task in rows)


def test_mind2web_live() -> None:
    found = read("mind2web-live", "mind2web-live")
    assert len(found.tasks) == 104 + 130
    assert found.websites_from() == {"derived": 234}


def test_online_mind2web() -> None:
    found = read("online-mind2web", "online-mind2web")
    assert len(found.tasks) == 300
    websites = {task.website for task in found.tasks if task.website}
    assert len(websites) == 139, "the paper's count"
    assert len(set(map(host_of, websites))) == 137
    assert found.websites() == 134, "by registrable domain"
    assert [Path(each.file).name for each in found.passed_over] == ["human_label.json"]


def test_deepshop() -> None:
    found = read("deepshop", "deepshop")
    assert len(found.tasks) == 150
    garbled = {task.id for task in found.tasks if GARBLED in task.flags}
    assert garbled == {"deepshop/Amazon--541", "deepshop/Amazon--595"}
    hints = [hint for task in found.tasks for hint in task.hints]
    assert not any("**" in hint or hint.endswith(": None") for hint in hints)


def test_mind2web_2() -> None:
    found = read("mind2web-2", "mind2web-2")
    assert len(found.tasks) == 10
    trees = {task.id.removeprefix("mind2web-2/"): len(task.hints) for task in found.tasks if task.hints}
    assert trees.keys() == {"nyc_sport_event", "find_parks", "lol_sylas", "llava_commit"}
    assert trees["lol_sylas"] == 8
    assert all(task.hints[0].startswith("must hold: ") for task in found.tasks if task.hints)


def test_the_published_sets_samples() -> None:
    first, second = read("webgym", "webgym-format").tasks
    assert (set(first.flags), set(second.flags)) == ({DIFFICULTY_DIFFERS}, {NONE_FACT})
    assert first.rubric is not None
    assert first.rubric.difficulty == 3
