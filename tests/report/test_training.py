"""The report of a training: curves, counts, and the same tasks before and after; in a real browser too."""

from __future__ import annotations

import html
import json
import re
import shlex
import shutil
from pathlib import Path

import pytest
from playwright.async_api import Browser, expect
from tests.conftest import Calls
from tests.report.test_pages import opened
from tests.report.training import build_training

from webgym.core.errors import RunFolderError
from webgym.core.outcome import Outcome
from webgym.report.config import ReportConfig
from webgym.report.formatting import percent, points
from webgym.report.training import Curves, Line, Point, Training, nice_ticks, write_training_report
from webgym.store.files import is_training
from webgym.study.demo import before_and_after
from webgym.train.figures import success_line


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = build_training(tmp_path_factory.mktemp("training") / "first", iterations=3, count=18, distinct=2)
    write_training_report(path, config=ReportConfig(image_width=320, pairs=3))
    return path


def test_the_moving_average_is_the_papers() -> None:
    line = Line("Overall", [Point(10, 0.2), Point(20, 0.4), Point(30, 0.8)], smoothing=0.5)
    assert [point.y for point in line.smooth] == pytest.approx([0.2, 0.3, 0.55])


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0, 1, [0, 0.2, 0.4, 0.6, 0.8, 1]),
        (0, 0.07, [0, 0.02, 0.04, 0.06, 0.08]),
        (0, 12.4, [0, 2.5, 5, 7.5, 10, 12.5]),
        (40, 320, [0, 100, 200, 300, 400]),
        (0, 0, [0, 0.2, 0.4, 0.6, 0.8, 1]),
    ],
)
def test_axes_have_round_numbers(low: float, high: float, ticks: list[float]) -> None:
    assert nice_ticks(low, high) == pytest.approx(ticks)


def test_one_measurement_is_a_chart_and_none_is_not() -> None:
    assert Curves("x", [Line("a", [])], percent).is_empty
    one = Curves("x", [Line("a", [Point(5, 0.5, (0.2, 0.8))])], percent, whole=True)
    assert "a, 5: 50.0% (20.0% to 80.0%)" in one.svg()


def test_differences_are_told_in_points() -> None:
    assert [points(each) for each in (0.123, -0.05, None)] == ["+12.3 points", "−5.0 points", "–"]


def test_curves_are_what_the_folder_says(folder: Path) -> None:
    training = Training(folder)
    rows = [json.loads(line) for line in (folder / "metrics.jsonl").read_bytes().splitlines()]
    curves = training.curves()

    tested = {line.name: line for line in curves["Success on unseen test tasks"].lines}
    overall = tested["Overall"]
    assert [point.x for point in overall.points] == [0, 18, 36, 54]
    first = json.loads((folder / "evaluations/0000.json").read_bytes())
    assert overall.points[0].y == first["success_rate"]["overall"]
    assert overall.points[0].interval == first["success_interval"]["overall"]
    assert set(tested) == {"Overall", "Easy", "Medium", "Hard"}

    collected = curves["Success while collecting"].lines[0]
    assert [point.y for point in collected.points] == [
        row["collect"]["success_rate"]["overall"] for row in rows
    ]
    assert collected.smoothing == 0.5
    steps = curves["Steps per trajectory"].lines[0]
    assert [point.y for point in steps.points] == [row["collect"]["steps_per_trajectory"] for row in rows]
    assert "Blocked attempts" in curves
    assert "Reply length, tokens" in curves
    assert "Reply length, characters" not in curves
    assert "Steps without effect" in curves
    groups = curves["Advantages"].lines[0]
    assert [point.y for point in groups.points] == [row["replay"]["advantages"]["mean_size"] for row in rows]


def test_what_each_rule_left_out_is_told(folder: Path) -> None:
    rows = {row["iteration"]: row for row in Training(folder).rows}
    for iteration, samples, told in Training(folder).dropped():
        counts = rows[iteration]["replay"]["counts"]
        assert told["steps that changed nothing"] == counts["unchanged"]
        assert told["attempts without a reward"] == counts["unrewarded"]
        assert told.get("request too long", 0) == (2 if iteration == 2 else 0)
        assert samples == rows[iteration]["update"]["samples"]


def test_what_was_learned_is_shown_first(folder: Path) -> None:
    training = Training(folder)
    pairs = training.pairs()
    won = [(pair.before.outcome is Outcome.SUCCESS, pair.after.outcome is Outcome.SUCCESS) for pair in pairs]
    order = [(False, True), (True, False), (True, True), (False, False)]
    assert [order.index(each) for each in won] == sorted(order.index(each) for each in won)
    assert won[0] == (False, True)
    assert all(pair.before.task_id == pair.after.task_id for pair in pairs)
    assert all(pair.before.outcome.is_rewarded and pair.after.outcome.is_rewarded for pair in pairs)


def test_success_is_of_the_attempts_that_were_judged(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "evaluations", tmp_path / "evaluations")
    shutil.copy(folder / "config.yaml", tmp_path)
    for file in (tmp_path / "evaluations").glob("*.json"):
        figures = json.loads(file.read_bytes())
        figures["attempts"] = 12
        figures["outcomes"] |= {"success": 4, "failure": 2, "truncated": 1, "blocked": 5}
        file.write_text(json.dumps(figures))
    assert "of 7 judged attempts" in success_line(figures)
    assert all("of 7 judged attempts" in line for line in before_and_after(tmp_path))
    text = write_training_report(tmp_path).read_text()
    assert text.count("of 7 judged attempts") == 2
    pairs = Training(tmp_path).pairs()
    assert f"Of {len(pairs)} samples that were judged both times" in text


def test_the_command_to_browse_names_the_folder_as_it_was_given(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(folder / "evaluations", tmp_path / "my runs/first/evaluations")
    shutil.copy(folder / "config.yaml", tmp_path / "my runs/first")
    monkeypatch.chdir(tmp_path)
    text = write_training_report(Path("my runs/first")).read_text()
    (shown,) = re.findall("<code>(webgym view .*)</code>", text)
    _, _, named = shlex.split(html.unescape(shown))
    assert named.startswith("my runs/first/")
    assert (tmp_path / named / "config.yaml").is_file()


@pytest.mark.parametrize("left", ["nothing", "an evaluation"])
def test_a_training_that_has_only_begun_has_a_report(folder: Path, tmp_path: Path, left: str) -> None:
    path = tmp_path / "young"
    shutil.copytree(folder / "evaluations/0000", path / "evaluations/0000")
    shutil.copy(folder / "config.yaml", path)
    if left == "an evaluation":
        shutil.copy(folder / "evaluations/0000.json", path / "evaluations")
    text = write_training_report(path).read_text()
    assert "No iteration is finished yet." in text
    assert "0 of 3 iterations" in text


def test_the_command_knows_a_training_from_a_run(folder: Path, run_folder: Path, calls: Calls) -> None:
    assert is_training(folder)
    assert not is_training(run_folder)
    code, said = calls.run("report", folder, "--width", 160)
    assert (code, said.strip()) == (0, str(folder / "report.html"))


@pytest.mark.parametrize(
    "command",
    "view,verify,export --out out,judge,judge agreement,eval --of,rollout --resume,compare".split(","),
)
def test_a_command_of_runs_names_those_of_a_training(
    folder: Path, run_folder: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(folder.parent)
    more = [run_folder] if command == "compare" else []
    code, said = calls.run(*command.split(), "first", *more)
    runs = "its runs are first/iterations/0001/run, first/evaluations/0000, ..."
    assert (code, said) == (2, f"webgym: first is a training, not a run ({runs})\n")


def test_a_run_is_not_resumed_as_a_training(run_folder: Path, calls: Calls) -> None:
    code, said = calls.run("train", "--resume", run_folder)
    hint = f"resume it with webgym rollout --resume {run_folder}"
    assert (code, said) == (2, f"webgym: {run_folder} is a run, not a training ({hint})\n")


def test_figures_that_are_torn_are_said_in_a_line(folder: Path, tmp_path: Path) -> None:
    path = shutil.copytree(folder, tmp_path / "torn")
    (path / "metrics.jsonl").write_text('{"iteration": 1')
    with pytest.raises(RunFolderError, match="cannot be read"):
        write_training_report(path)


def test_nothing_is_loaded_from_outside(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    shell = re.sub(r'<script type="(application/json|text/plain)".*?</script>', "", text, flags=re.S)
    assert not re.findall(r"(?:src|href)=[\"']?(?:https?:)?//", shell)


@pytest.mark.browser
@pytest.mark.asyncio(loop_scope="package")
@pytest.mark.parametrize(("width", "budget"), [(1280, 48 * 2**20), (800, 0)])
async def test_the_page_in_a_browser(browser: Browser, folder: Path, width: int, budget: int) -> None:
    """Wide with embedded pictures; narrow with those of the run folders."""
    config = ReportConfig(image_width=320, pairs=3, image_budget_bytes=budget)
    report = write_training_report(folder, config=config)
    assert ('id="p-' in report.read_text()) is bool(budget)
    async with opened(browser, report.as_uri(), viewport={"width": width, "height": 900}) as page:
        assert await page.evaluate("document.documentElement.scrollWidth") == width
        await expect(page.locator("h1")).to_have_text("first")
        await expect(page.locator(".tiles")).to_contain_text("Test success after")
        lines = page.locator(".curve-line")
        assert await lines.count() >= 8 + 6
        box = await page.locator(".curve-plot").first.bounding_box()
        assert box is not None
        assert box["width"] > 250
        # Every chart's line lies inside its chart.
        assert await page.evaluate(
            """() => [...document.querySelectorAll(".curve-plot")].every((plot) => {
                const outer = plot.getBoundingClientRect();
                return [...plot.querySelectorAll(".curve-line")].every((line) => {
                  const inner = line.getBoundingClientRect();
                  return inner.left >= outer.left - 2 && inner.right <= outer.right + 2
                      && inner.top >= outer.top - 2 && inner.bottom <= outer.bottom + 2; }); })"""
        )
        pairs = page.locator(".pair-card")
        await expect(pairs).to_have_count(3)
        sides = pairs.first.locator(".side-by")
        await expect(sides).to_have_count(2)
        await expect(sides.nth(1)).to_contain_text("Success")
        await expect(sides.nth(0)).not_to_contain_text("Success")
        first, second = await sides.nth(0).bounding_box(), await sides.nth(1).bounding_box()
        assert first is not None
        assert second is not None
        assert (first["y"] == second["y"]) is (width > 900), "side by side where there is room"
        shots = sides.nth(0).locator("img")
        await expect(shots.first).not_to_have_js_property("naturalWidth", 0)
        assert await page.locator(".shot .absent").count() == 0
        await expect(sides.nth(0).locator(".ring").first).to_be_visible()
