"""The file of results of ``webgym sites check``, and playing tasks in Chromium with it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest

from webgym.browser.slot import Slot
from webgym.core.action import BrowserAction, LeftClick, Scroll, Target
from webgym.core.errors import StoreCorrupt, StoreLocked
from webgym.core.observation import Notice, Observation
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.truth import Click, Give
from webgym.offline.web import OfflineWeb
from webgym.results.rates import Successes
from webgym.rollout.progress import Progress
from webgym.testing.browser_check import Result, ResultFile, _moves_of, _Tab, check_in_browsers, content_of


@pytest.fixture(scope="module")
def web() -> OfflineWeb:
    return OfflineWeb(collection="small", per_family=1)


@pytest.fixture(scope="module")
def tasks(web: OfflineWeb) -> list[Task]:
    """The shortest of a website."""
    return sorted(web.tasks_of(next(iter(web.specs))), key=_moves_of)[:4]


def passed(task: Task) -> Result:
    return Result(task.id, content_of(task), "Chrome/1", "coordinates", Outcome.SUCCESS, 3)


def test_a_result_counts_until_its_task_changes(tasks: list[Task], tmp_path: Path) -> None:
    with ResultFile(tmp_path / "results.jsonl") as file:
        file.add(passed(tasks[0]))
    with ResultFile(tmp_path / "results.jsonl") as file:
        assert file.of(tasks[0], "coordinates") == passed(tasks[0])
        assert file.of(tasks[1], "coordinates") is None
        assert (
            file.of(msgspec.structs.replace(tasks[0], instruction="Something else."), "coordinates") is None
        )
        assert file.of(tasks[0], "marks") is None


def test_a_line_that_was_not_completed_is_cut_off(tasks: list[Task], tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    with ResultFile(path) as file:
        file.add(passed(tasks[0]))
        file.add(passed(tasks[1]))
    path.write_bytes(path.read_bytes()[:-9])
    with ResultFile(path) as file:
        assert file.of(tasks[1], "coordinates") is None
        file.add(passed(tasks[1]))
    with ResultFile(path) as file:
        assert [file.of(task, "coordinates") for task in tasks[:2]] == [passed(task) for task in tasks[:2]]


def test_a_damaged_line_and_a_second_writer_are_refused(tasks: list[Task], tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    with ResultFile(path) as file:
        file.add(passed(tasks[0]))
        with pytest.raises(StoreLocked, match="another process"):
            ResultFile(path)
    path.write_bytes(b'{"task":1}\n' + path.read_bytes())
    with pytest.raises(StoreCorrupt, match="line 1 "):
        ResultFile(path)


def mistaken(task: Task) -> Task:
    """The task with a solution that cannot be carried out."""
    assert task.truth is not None
    truth = msgspec.structs.replace(task.truth, moves=(Click("No such sign"), Give("1")))
    return msgspec.structs.replace(task, truth=truth)


@pytest.mark.browser
@pytest.mark.timeout(300)
async def test_a_check_goes_on_where_it_was(web: OfflineWeb, tasks: list[Task], tmp_path: Path) -> None:
    path, played, shown = tmp_path / "results.jsonl", list[str](), list[Progress]()

    @asynccontextmanager
    async def show(progress: Progress) -> AsyncIterator[None]:
        shown.append(progress)
        yield

    async def check(tasks: list[Task], *, again: bool = False) -> list[str]:
        played.clear()
        return await check_in_browsers(
            web,
            tasks,
            path,
            sessions=1,
            again=again,
            show=show,
            on_episode=lambda task, _: played.append(task.id),
        )

    assert await check(tasks[:2]) == []
    assert await check(tasks[:3]) == []
    assert played == [tasks[2].id]
    assert shown[-1].successes == Successes(3, 3, 3)  # earlier results included
    broken = [*tasks[:2], mistaken(tasks[2])]
    (fault,) = await check(broken)
    assert fault.startswith(f"{tasks[2].id}: expected success, got failure")
    assert set(played) == {tasks[2].id}
    with ResultFile(path) as file:
        result = file.results[tasks[2].id]
    assert result.browser
    assert result.seen[0].startswith(tasks[2].website)
    assert (await check(broken), played) == ([fault], [])
    assert (await check(broken, again=True), set(played)) == ([fault], {tasks[2].id})


@pytest.mark.browser
@pytest.mark.timeout(300)
async def test_a_task_of_which_the_browser_failed_is_played_again(
    web: OfflineWeb, tasks: list[Task], tmp_path: Path
) -> None:
    path = tmp_path / "results.jsonl"
    lost = msgspec.structs.replace(
        passed(tasks[0]), outcome=Outcome.ENVIRONMENT_ERROR, faults=("the browser crashed",)
    )
    with ResultFile(path) as file:
        file.add(lost)
    assert await check_in_browsers(web, tasks[:1], path, sessions=1) == []


@pytest.mark.browser
@pytest.mark.timeout(300)
async def test_a_solution_that_another_begins_with_is_not_played_again(
    web: OfflineWeb, tasks: list[Task], tmp_path: Path
) -> None:
    first = tasks[0]
    assert first.truth is not None
    twin = msgspec.structs.replace(first, id="twin")
    wrong = msgspec.structs.replace(
        first,
        id="wrong",
        truth=msgspec.structs.replace(first.truth, moves=(*first.truth.moves[:-1], Give("No answer."))),
    )
    faults = await check_in_browsers(web, [first, twin, wrong], tmp_path / "results.jsonl", sessions=1)
    assert {fault.partition(":")[0] for fault in faults} == {"wrong"}
    with ResultFile(tmp_path / "results.jsonl") as file:
        assert [file.results[name].begins for name in (first.id, "twin", "wrong")] == ["", first.id, ""]


class UnchangedText:
    """A slot whose page shows the same words and elements after every action."""

    def __init__(self, *notices: Notice) -> None:
        self._notices = notices

    async def act(self, action: Any) -> None:
        pass

    async def observe_without_picture(self, *, cuts: bool = False) -> Observation:
        return Observation("name", "http://check.test/", "", (64, 48), notices=self._notices)


@pytest.mark.parametrize("action", [Scroll("down"), LeftClick(Target((1.0, 1.0)))])
async def test_an_effect_that_only_a_picture_would_show_is_seen(action: BrowserAction) -> None:
    async def names(*notices: Notice) -> set[str]:
        tab = _Tab(cast("Slot", UnchangedText(*notices)))
        return {(await tab.step(action)).observation.screenshot for _ in range(2)}

    assert len(await names()) == 2
    assert len(await names(Notice("no_effect", "nothing scrolled down"))) == 1


def test_websites_keep_nothing_but_cookies_in_a_browser() -> None:
    offline = Path(__file__).parents[2] / "src/webgym/offline"
    for path in offline.rglob("*"):
        if path.suffix in {".html", ".js", ".py"}:
            text = path.read_text()
            for storage in ("localStorage", "sessionStorage", "indexedDB", "caches.", "serviceWorker"):
                assert storage not in text, f"{path} uses {storage}; a tab cannot be used again"
