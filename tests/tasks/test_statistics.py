"""What a task set holds, as numbers, tables and figures."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from tests.tasks.making import task

from webgym.core.plotting import COLUMN
from webgym.taskset.figures import draw_figures
from webgym.taskset.statistics import Statistics, describe, kernel_density, measure

TASKS = [
    task("a/1", "https://www.one.example/", 1, split="train"),
    task("a/2", "one.example", 4, split="train", subdomain="Music", flags=("dated",)),
    task("a/3", "https://shop.one.example/x", 3, 4, split="train", subdomain="Shopping"),
    task("a/3+1", "https://shop.one.example/x", 3, split="train", subdomain="Shopping", parent_id="a/3"),
    task("b/1", "two.example", 2, split="test", source="deepshop"),
    task("b/2", "no website", 2, split=None, source="deepshop", subdomain="Soup", domain="Food"),
]
LENGTHS = {"easy": [3, 4, 4, 5, 15], "medium": [7], "hard": [9, 9, 9]}


@pytest.fixture(scope="module")
def found() -> Statistics:
    return describe(TASKS, LENGTHS)  # type: ignore[arg-type]


def test_the_counts(found: Statistics) -> None:
    assert (found.tasks, found.websites) == (6, 3)
    assert found.sizes == [(4, 1), (1, 2)]
    assert found.top == [("one.example", 4), ("no website", 1), ("two.example", 1)]
    assert found.top_share == 1.0
    assert found.difficulties == {
        "train": {1: 1, 3: 1, 4: 1, 7: 1},
        "test": {2: 1},
        "decomposed": {3: 1},
        "unsplit": {2: 1},
    }
    assert found.levels("train") == {"easy": 2, "medium": 1, "hard": 1}
    rows = {(row.domain, row.subdomain): row.tasks for row in found.domains}
    assert sum(rows.values()) == 6
    assert len(rows) == 25
    assert rows["Food", "Soup"] == rows["Entertainment", "Music"] == 1
    assert [(row.source, row.tasks, row.derived, row.train, row.test) for row in found.sources] == [
        ("insta-v3", 4, 1, 4, 0),
        ("deepshop", 2, 0, 0, 1),
    ]


def test_it_survives_json(found: Statistics) -> None:
    assert msgspec.json.decode(msgspec.json.encode(found), type=Statistics) == found


def test_no_tasks_and_no_lengths(tmp_path: Path) -> None:
    nothing = describe([])
    assert (nothing.tasks, nothing.websites, nothing.top_share, nothing.lengths) == (0, 0, 0.0, {})
    assert [len(table.rows) for table in nothing.tables()] == [0, 0, 0, 0]
    assert draw_figures(nothing, tmp_path) == []
    assert {path.stem for path in draw_figures(describe(TASKS), tmp_path)} == {
        "websites",
        "difficulty",
        "domains",
    }


def test_lengths_have_mean_and_mode() -> None:
    lengths = measure([2] * 50 + [3] * 60 + [4] * 40 + [30] * 10)
    assert lengths.trajectories == 160
    assert lengths.mean == pytest.approx((100 + 180 + 160 + 300) / 160)
    assert 2.5 < lengths.mode < 3.8
    assert measure([7]).mode == pytest.approx(7, abs=0.05)


@given(st.lists(st.integers(5, 60), min_size=1, max_size=40))
def test_a_density_adds_up_to_one(steps: list[int]) -> None:
    lengths = measure(steps)
    grid, density = kernel_density(lengths.counts)
    below = 0.35  # what a wide kernel may put below 0
    assert 1 - below < float(np.trapezoid(density, grid)) < 1.001
    assert 0 <= lengths.mode <= max(steps) + 1


def test_the_tables_hold_what_was_counted(found: Statistics) -> None:
    sources, difficulty, domains, top, lengths = found.tables()
    assert sources.rows[0] == ("insta-v3", "1", "4", "1", "4", "0")
    assert difficulty.rows[0] == ("train", "4", "2", "50.0", "1", "25.0", "1", "25.0")
    assert ("Food", "Soup", "1", "1", "0", "0") in domains.rows
    assert top.title == "The 3 largest of 3 websites: 100.0% of tasks"
    assert [row[0] for row in lengths.rows] == ["easy", "medium", "hard"]
    assert all(len(row) == len(table.columns) for table in found.tables() for row in table.rows)


def test_the_figures_are_drawn_the_same_every_time(found: Statistics, tmp_path: Path) -> None:
    once, again = draw_figures(found, tmp_path / "a"), draw_figures(found, tmp_path / "b")
    assert [path.name for path in once] == [
        f"{name}.{suffix}"
        for name in ("websites", "difficulty", "domains", "lengths")
        for suffix in ("png", "svg")
    ]
    for one, other in zip(once, again, strict=True):
        assert one.read_bytes() == other.read_bytes()
        if one.suffix == ".png":
            with Image.open(one) as image:
                assert image.width == round(COLUMN * 300)
                assert image.getpixel((0, 0)) == (255, 255, 255, 255)
        else:
            assert ElementTree.parse(one).getroot().tag.endswith("svg")
