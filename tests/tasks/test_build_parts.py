"""The parts of a build: its config, its books, its way of asking about many things."""

from __future__ import annotations

import asyncio
import io
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from rich.console import Console

from webgym.core.errors import (
    BudgetSpent,
    ConfigError,
    LLMBadReply,
    LLMError,
    LLMTimeout,
    LLMUnreachable,
    LLMUnusable,
    NotCached,
)
from webgym.llm.client import EndpointRefused
from webgym.tasks.sources import SourceTask
from webgym.taskset.construction.accounting import CountMismatch, TaskAccounting
from webgym.taskset.construction.config import PURPOSES, BuildConfig, read_config
from webgym.taskset.construction.pipeline import Done, Failed, Pending, ask_all, draw
from webgym.taskset.construction.progress import StageProgress

ROOT = Path(__file__).resolve().parents[2]
SOURCES = {"deepshop": "a.jsonl"}
MODEL = {"base_url": "http://127.0.0.1:1/v1", "model": "large"}


# --- config -------------------------------------------------------------------------------------------------


def test_options_go_before_the_file_and_nothing_overrides_nothing(tmp_path: Path) -> None:
    path = tmp_path / "build.yaml"
    path.write_text("sources: {deepshop: a.jsonl, gaia-web: {path: b, at_most: 7}}\nseed: 3\n")
    config = read_config(
        path, {"seed": None, "split": {"test_tasks": 5}, "sources": {"deepshop": {"path": "c"}}}
    )
    assert (config.seed, config.split.test_tasks) == (3, 5)
    assert config.sources["deepshop"].path == "c"
    assert read_config(path, {}, at_most=10).sources["gaia-web"].at_most == 7
    assert read_config(path, {}, at_most=5).sources["gaia-web"].at_most == 5


def test_the_preset_holds_every_source_of_the_paper() -> None:
    preset = read_config(ROOT / "configs" / "task-set.yaml", {})
    assert len(preset.sources) == 10
    assert preset.split.test_tasks == 1167
    website = preset.chat("website")
    assert website is not None
    assert website.sampling.max_tokens == 400


def test_sources_stand_in_the_order_of_the_paper() -> None:
    config = BuildConfig.model_validate({"sources": {"gaia-web": "a", "insta-v3": "b"}})
    assert list(config.sources) == ["insta-v3", "gaia-web"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sources: [", "is not YAML"),
        ("- a", "contains no settings"),
        ("seed: 1", "--source NAME=PATH"),
        ("sources: {deepshopp: a}", "unknown source deepshopp"),
        ("sources: {deepshop: a}\nsede: 1", "sede"),
        ("sorces: {deepshop: a}", "sorces: there is no such setting"),
        ("sources: {deepshop: a}\nmodel: {base_url: 'http://x', modl: x}", "model.modl: there is no such"),
        ("sources: {deepshop: a}\nsplit: {test_tasks: -1}", "split.test_tasks"),
        ("sources: {deepshop: a}\nplaintext: [browsecom]", "unknown source browsecom"),
        ("sources: {deepshop: {path: a, at_most: 0}}", "at_most"),
        ("sources: {deepshop: a}\nmodel: {model: x}", "base_url"),
    ],
)
def test_what_a_config_must_not_say_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "build.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_config(path, {})
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_option_that_is_not_given_hides_nothing_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "build.yaml"
    path.write_text("sources: [deepshop]")
    with pytest.raises(ConfigError, match="sources: Input should be a valid dictionary"):
        read_config(path, {"sources": {}, "model": {"base_url": None}})


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot read"):
        read_config(tmp_path / "none.yaml", {})


def test_every_purpose_has_its_model() -> None:
    small = {"model": "small", "sampling": {"temperature": 0}}
    config = BuildConfig.model_validate({"sources": SOURCES, "model": MODEL, "models": {"website": small}})
    website, rubric, rewriting, critic = map(config.chat, PURPOSES)
    assert website is not None
    assert rubric is not None
    assert rewriting is not None
    assert critic == rewriting
    assert (website.model, rubric.model, rewriting.model) == ("small", "large", "large")
    assert (website.sampling.temperature, rubric.sampling.temperature) == (0, None)
    assert website.base_url == rubric.base_url
    alone = BuildConfig.model_validate({"sources": SOURCES, "models": {"rubric": MODEL}})
    assert alone.chat("rubric") is not None
    assert alone.chat("website") is None
    with pytest.raises(ValidationError):
        BuildConfig.model_validate({"sources": SOURCES, "models": {"judge": MODEL}})


def test_one_seed_reaches_all_that_draw() -> None:
    seeded = BuildConfig.model_validate({"sources": SOURCES, "seed": 9}).seeded()
    assert (seeded.duplicates.seed, seeded.split.seed) == (9, 9)


def test_a_larger_draw_takes_the_same_tasks_and_more() -> None:
    tasks = [SourceTask(id=f"s/{n}", source="s", instruction="x") for n in range(50)]
    few, many = draw(tasks, 10, seed=1), draw(tasks, 30, seed=1)
    assert {task.id for task in few} < {task.id for task in many}
    assert many == [task for task in tasks if task in many], "in their order"
    assert draw(tasks, None, seed=1) == draw(tasks, 50, seed=1) == tasks
    assert draw(tasks, 10, seed=2) != few


# --- accounting ---------------------------------------------------------------------------------------------


def test_books_that_balance_are_kept() -> None:
    accounting = TaskAccounting(["a", "b"])
    accounting.record(
        "import", came=Counter(a=5, b=1), lost=Counter({("a", "no task"): 2}), left=Counter(a=3, b=1)
    )
    accounting.record("derive", came=Counter(a=3, b=1), made=Counter(a=4), left=Counter(a=7, b=1))
    assert [(row.stage, row.source, row.came, row.made, row.lost, row.left) for row in accounting.rows] == [
        ("import", "a", 5, 0, {"no task": 2}, 3),
        ("import", "b", 1, 0, {}, 1),
        ("derive", "a", 3, 4, {}, 7),
        ("derive", "b", 1, 0, {}, 1),
    ]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([{"came": Counter(a=5), "left": Counter(a=4)}], "5 entered"),
        ([{"came": Counter(a=5), "left": Counter(a=5, b=1)}], "of b, 0 entered"),
        (
            [{"came": Counter(a=5), "left": Counter(a=5)}, {"came": Counter(a=4), "left": Counter(a=4)}],
            "left the stage before",
        ),
        ([{"came": Counter(c=5), "left": Counter(c=5)}], "unknown sources: c"),
        ([{"came": Counter(a=5), "left": Counter(a=4), "lost": Counter({("b", "x"): 1})}], "5 entered"),
    ],
)
def test_books_that_do_not_balance_are_refused(rows: list[dict[str, Any]], words: str) -> None:
    accounting = TaskAccounting(["a", "b"])
    *good, bad = rows
    for row in good:
        accounting.record("before", **row)
    with pytest.raises(CountMismatch, match=words):
        accounting.record("after", **bad)


# --- asking -------------------------------------------------------------------------------------------------


class Asked:
    """Asks about numbers; some of them go wrong."""

    def __init__(self, wrong: dict[int, Exception] | None = None) -> None:
        self.wrong = wrong or {}
        self.now = self.most = self.count = 0

    async def __call__(self, number: int) -> int:
        self.now += 1
        self.count += 1
        self.most = max(self.most, self.now)
        await asyncio.sleep(0)
        self.now -= 1
        if number in self.wrong:
            raise self.wrong[number]
        return number * number

    async def about(self, count: int, *, workers: int = 4, in_a_row: int = 3) -> list[Any]:
        def advance() -> None:
            self.advanced = getattr(self, "advanced", 0) + 1

        return await ask_all(range(count), self, workers=workers, failures_in_a_row=in_a_row, advance=advance)


async def test_results_stand_in_the_order_of_the_things_and_workers_are_bounded() -> None:
    asked = Asked()
    assert await asked.about(100) == [Done(number * number) for number in range(100)]
    assert asked.most == 4
    assert asked.advanced == 100
    assert await asked.about(0) == []


async def test_every_thing_has_a_result_or_a_reason() -> None:
    wrong: dict[int, Exception] = {
        1: LLMUnusable("no", reason="it is empty.", replies=("", "")),
        3: NotCached("later"),
        5: LLMTimeout("slow"),
        6: EndpointRefused("too long", status=400),
    }
    results = await Asked(wrong).about(8)
    assert results[1] == Failed("it is empty.", ("", ""))
    assert results[3] == Pending()
    assert results[5] == Failed("slow", may_pass=True)
    assert results[6] == Failed("too long", may_pass=True)
    assert [type(results[index]) for index in (0, 2, 4, 7)] == [Done] * 4


@pytest.mark.parametrize(
    "error",
    [
        BudgetSpent("spent"),
        LLMUnreachable("gone"),
        EndpointRefused("no key", status=401),
        EndpointRefused("no model", status=404),
    ],
)
async def test_what_makes_no_sense_to_go_on_with_ends_it_at_once(error: LLMError) -> None:
    asked = Asked({2: error})
    with pytest.raises(type(error)):
        await asked.about(1000)
    assert asked.count < 12
    assert asked.now == 0, "what was under way has ended by itself"


async def test_failures_in_a_row_end_it_and_replies_between_them_do_not() -> None:
    broken = LLMBadReply("500")
    assert len(await Asked(dict.fromkeys(range(0, 60, 2), broken)).about(60, workers=1)) == 60
    asked = Asked(dict.fromkeys(range(20, 60), broken))
    with pytest.raises(LLMBadReply):
        await asked.about(60, workers=1)
    assert asked.count == 23


# --- progress -----------------------------------------------------------------------------------------------


def test_off_a_terminal_there_are_a_few_plain_lines() -> None:
    out = io.StringIO()
    stages = StageProgress(Console(file=out, width=200))
    with stages.shown():
        with stages.stage("rubrics", 1000) as advance:
            for _ in range(1000):
                advance(1)
        with stages.stage("nothing", 0):
            pass
    lines = out.getvalue().splitlines()
    assert lines[-2:] == ["rubrics: 1,000 of 1,000", "nothing: 0 of 0"]
    assert len(lines) == 5


def test_on_a_terminal_there_is_a_bar_for_each_stage() -> None:
    out = io.StringIO()
    stages = StageProgress(Console(file=out, width=100, force_terminal=True))
    with stages.shown():
        for name in ("import", "rubrics"):
            with stages.stage(name, 3) as advance:
                advance(3)
    assert "import" in out.getvalue()
    assert out.getvalue().count("3/3") >= 2
