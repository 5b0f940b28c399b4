"""The parts of a report: content, charts, inert data, small pictures."""

from __future__ import annotations

import base64
import hashlib
import html
import io
import json
import re
import shutil
from pathlib import Path
from typing import ClassVar

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from webgym.core.action import (
    AnswerDialog,
    DoubleClick,
    Drag,
    Hold,
    Hover,
    LeftClick,
    Press,
    RightClick,
    Scroll,
    Target,
    Type,
    Upload,
    _Action,
)
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Revision
from webgym.judge.prompts import action_history
from webgym.report.charts import Histogram
from webgym.report.config import ReportConfig
from webgym.report.content import page
from webgym.report.live_run import Overview, overview_html
from webgym.report.template import Page, inert
from webgym.report.thumbnails import thumbnails
from webgym.results.run_index import row
from webgym.results.summary import digest_of, quantiles
from webgym.store.runs import RunReader

# --- content -----------------------------------------------------------------------------------------


def test_places_are_percent_of_the_picture(run_folder: Path) -> None:
    reader = RunReader(run_folder)
    made = next(t for t in reader.trajectories() if t.episode.sample == 8)  # in marks mode
    seen = made.episode.steps[0].observation
    shown = page(made, reader.tasks[made.episode.task_id])["steps"][0]["action"]
    assert shown["name"] == "type"
    (place,) = shown["places"]
    assert (place["mark"], place["on"], place["role"]) == (1, "Search the catalogue", "searchbox")
    x, y, w, h = (element.box for element in seen.elements or () if element.number == 1).__next__()
    assert place["box"] == pytest.approx([x / 12.8, y / 7.68, w / 12.8, h / 7.68], abs=1e-3)


def test_figures_of_odd_tasks_and_messages_can_be_read(run_folder: Path) -> None:
    reader = RunReader(run_folder)
    overview = Overview(reader)
    for trajectory in reader.trajectories():
        overview.add(digest_of(trajectory))
    figures = overview.figures()
    summary = figures.summary
    summary["by_domain"] = {"": summary["by_level"]["easy"]}
    summary["by_level"]["hard"]["steps_per_attempt"] = quantiles([])
    summary["losses"]["blocked"]["message"] = "E" * 3_000
    text = overview_html(reader, figures, [])
    assert ">no domain</th>" in text
    assert "median –" in text
    assert "median 0" not in text
    assert "E" * 299 + "…</a>" in text


def test_a_point_says_what_lies_under_it(run_folder: Path) -> None:
    made = next(RunReader(run_folder).trajectories())
    step = made.episode.steps[0]
    for target, on in (
        (Target(coordinate=(500, 40)), "Search the catalogue"),
        (Target(coordinate=(1, 999)), None),
    ):
        changed = msgspec.structs.replace(step, action=LeftClick(target))
        episode = msgspec.structs.replace(made.episode, steps=(changed,))
        action = page(msgspec.structs.replace(made, episode=episode), None)["steps"][0]["action"]
        (place,) = action["places"]
        assert place.get("on") == on
        assert target.coordinate is not None
        assert place["point"] == [value / 10 for value in target.coordinate]


def test_a_mark_that_was_not_recorded_is_still_shown(run_folder: Path) -> None:
    made = next(RunReader(run_folder).trajectories())
    step = msgspec.structs.replace(made.episode.steps[0], action=Type(Target(element=77), "x"))
    episode = msgspec.structs.replace(made.episode, steps=(step,))
    action = page(msgspec.structs.replace(made, episode=episode), None)["steps"][0]["action"]
    assert (action["words"], action["entered"]) == ('Typed "x" into element 77', "x")
    assert action["places"] == [{"mark": 77}]


PLACE = Target(coordinate=(500, 40))
SEARCH = "“Search the catalogue”"
EXTENDED = {
    "left click": (LeftClick(PLACE, ("Control", "Shift")), f"Clicked {SEARCH} with Control+Shift held"),
    "double click": (DoubleClick(PLACE), f"Double-clicked {SEARCH}"),
    "right click": (RightClick(PLACE), f"Right-clicked {SEARCH}"),
    "hover": (Hover(PLACE), f"Moved the mouse to {SEARCH}"),
    "drag": (
        Drag(Target(element=77), PLACE, ((500, 40), (0, 1000))),
        f"Dragged element 77 to {SEARCH} through 2 points",
    ),
    "hold": (Hold(PLACE, 0.5), f"Held the mouse button down on {SEARCH} for 0.5 s"),
    "press": (Press(("Control", "a")), "Pressed Control+a"),
    "answer dialog": (AnswerDialog(accept=False), "Answered the dialog with Cancel"),
    "upload": (Upload(PLACE, ("cv.txt", "photo.png")), f"Chose the files cv.txt, photo.png at {SEARCH}"),
    "scroll": (Scroll("left", PLACE), f"Scrolled left at {SEARCH}"),
}


@pytest.mark.parametrize("name", EXTENDED)
def test_extended_actions_are_told_and_drawn(run_folder: Path, name: str) -> None:
    made = next(RunReader(run_folder).trajectories())
    act, words = EXTENDED[name]
    step = msgspec.structs.replace(made.episode.steps[0], action=act)
    episode = msgspec.structs.replace(made.episode, steps=(step,))
    action = page(msgspec.structs.replace(made, episode=episode), None)["steps"][0]["action"]
    assert (action["name"], action["words"]) == (name, words)
    assert len(action["places"]) == (0 if name in ("press", "answer dialog") else 2 if name == "drag" else 1)
    assert action["way"] == ([[50, 4], [0, 100]] if name == "drag" else [])
    history = action_history(episode, line_chars=300, limit=3000)
    assert history.startswith(f"step 1, on {step.observation.url}: {words.split()[0].lower()} ")


def test_an_action_of_a_kind_yet_unknown_is_told_from_its_fields() -> None:
    """What an action says of itself is all that prompts, histories and pages need."""

    class Pinch(_Action, frozen=True, tag="pinch"):
        does = "pinch at {target}."
        did = "pinched {target}"
        did_also: ClassVar = {"by": " by {by}"}

        target: Target
        by: float = 2.0

    assert Pinch(PLACE).told(lambda _: "it") == "pinched it"
    assert Pinch(PLACE, 3.5).told(lambda _: "it") == "pinched it by 3.5"
    assert Pinch(PLACE).targets == (PLACE,)


def test_how_a_memory_was_mended_is_told(run_folder: Path) -> None:
    made = next(RunReader(run_folder).trajectories())
    revision = Revision(dropped=("price",), rewritten=("size", "colour"))
    step = msgspec.structs.replace(made.episode.steps[0], revision=revision)
    episode = msgspec.structs.replace(made.episode, steps=(step, *made.episode.steps[1:]))
    first, *others = page(msgspec.structs.replace(made, episode=episode), None)["steps"]
    assert first["memory"] == "omitted, kept: price; changed, both values kept: size, colour"
    assert {other["memory"] for other in others} <= {""}


def test_every_fact_has_its_judgement(run_folder: Path) -> None:
    reader = RunReader(run_folder)
    for made in reader.trajectories():
        task = reader.tasks[made.episode.task_id]
        facts = [fact for group in page(made, task)["groups"] for fact in group["facts"]]
        assert [fact["text"] for fact in facts] == [text for _, _, text in task.rubric.facts()]
        judged = [fact["passed"] for fact in facts]
        if made.verdict is None:
            assert set(judged) == {None}
        else:
            assert judged == [fact.judgement.passed for fact in made.verdict.facts]


def test_a_task_that_the_run_does_not_hold(run_folder: Path) -> None:
    made = next(RunReader(run_folder).trajectories())
    assert row(made, None)["task"] == made.episode.task_id
    shown = page(made, None)
    assert shown["task"] == {"id": made.episode.task_id, "instruction": made.episode.task_id}
    assert len(shown["groups"][0]["facts"]) == 2  # as the verdict tells them


# --- charts ------------------------------------------------------------------------------------------


@given(
    st.dictionaries(st.tuples(st.integers(0, 300), st.sampled_from(Outcome)), st.integers(1, 50), min_size=1)
)
def test_a_histogram_draws_every_attempt(counts: dict[tuple[int, Outcome], int]) -> None:
    chart = Histogram({"easy": {(steps, outcome.value): count for (steps, outcome), count in counts.items()}})
    svg = str(chart.row("easy"))
    drawn = sum(int(told) for told in re.findall(r": (\d+)</title>", svg))
    assert drawn == sum(counts.values())
    for x, width in re.findall(r'x="([\d.]+)%" y="[\d.-]+" width="([\d.]+)%"', svg):
        assert float(x) + float(width) <= 100.01
    assert all(0 <= place <= 100 for place, _ in chart.ticks())


# --- inert data --------------------------------------------------------------------------------------


@given(st.recursive(st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)))
def test_inert_data_reads_back_and_cannot_end_its_element(value: object) -> None:
    try:
        msgspec.json.encode(value)
    except UnicodeEncodeError:
        return  # the store holds no half characters
    text = str(inert(value))
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text) == value


def test_the_policy_lets_exactly_our_script_and_style_run(run_folder: Path) -> None:
    document = Page("a run", live=False)
    head = document.head(inert(""), [])
    told = re.search(r'Content-Security-Policy" content="([^"]+)"', head)
    assert told is not None
    policy = html.unescape(told[1])
    for kind, text in (
        ("script", re.findall(r"<script>(.*?)</script>", head, re.S)[0]),
        ("style", re.findall(r"<style>(.*?)</style>", head, re.S)[0]),
    ):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy
    assert "connect-src 'none'" in policy


# --- small pictures ----------------------------------------------------------------------------------


def _names(run: Path) -> list[str]:
    return sorted(file.stem for file in (run / "screenshots").glob("*/*.png"))


def _decoded(data: str) -> Image.Image:
    kind, encoded = data.split(",", 1)
    assert kind == "image/webp;base64"
    return Image.open(io.BytesIO(base64.b64decode(encoded)))


def test_pictures_become_small_and_stay_in_order(run_folder: Path, tmp_path: Path) -> None:
    run = shutil.copytree(run_folder, tmp_path / "run")
    names = _names(run)[:9]
    made = list(thumbnails(run, names, ReportConfig(image_width=400)))
    assert [small.name for small in made] == names
    assert {_decoded(small.data).size for small in made} == {(400, 240)}
    for name in names:
        (run / "screenshots" / name[:2] / f"{name}.png").unlink()
    assert list(thumbnails(run, names, ReportConfig(image_width=400))) == made  # kept from before
    assert list(thumbnails(run, names, ReportConfig(image_width=500))) == []


def test_small_pictures_stop_at_the_budget(run_folder: Path, tmp_path: Path) -> None:
    run = shutil.copytree(run_folder, tmp_path / "run")
    names = _names(run)[:12]
    sizes = [len(small.data) for small in thumbnails(run, names, ReportConfig(image_width=200))]
    budget = sum(sizes[:5]) + sizes[5] // 2
    made = list(thumbnails(run, names, ReportConfig(image_width=200, image_budget_bytes=budget)))
    assert [small.name for small in made] == names[:5]


def test_missing_and_broken_pictures_are_left_out(tmp_path: Path) -> None:
    whole = io.BytesIO()
    Image.new("RGBA", (90, 50), (200, 10, 10, 128)).save(whole, "PNG")
    found = {"aa" * 32: whole.getvalue(), "bb" * 32: b"no picture", "cc" * 32: whole.getvalue()[:60]}
    for name, data in found.items():
        path = tmp_path / "screenshots" / name[:2] / f"{name}.png"
        path.parent.mkdir(parents=True)
        path.write_bytes(data)
    made = list(thumbnails(tmp_path, [*found, "dd" * 32], ReportConfig()))
    assert [small.name for small in made] == ["aa" * 32]
    assert _decoded(made[0].data).size == (90, 50)  # never made larger
