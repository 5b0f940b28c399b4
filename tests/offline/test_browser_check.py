"""The check of solutions in Chromium, as ``webgym sites check`` makes it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest

from webgym.core.errors import RunFolderError
from webgym.core.task import Task
from webgym.core.truth import Click, Give
from webgym.offline.web import OfflineWeb
from webgym.results.rates import Successes
from webgym.rollout.progress import Progress
from webgym.store.runs import RunReader
from webgym.testing.solutions import check_in_browsers


def with_moves(task: Task, *moves: Click | Give, name: str) -> Task:
    assert task.truth is not None
    return msgspec.structs.replace(task, id=name, truth=msgspec.structs.replace(task.truth, moves=moves))


@pytest.mark.browser
@pytest.mark.timeout(300)
async def test_solutions_that_fail_are_named_and_a_check_goes_on_where_it_was(tmp_path: Path) -> None:
    web, run, shown = OfflineWeb(collection="small", per_family=1), tmp_path / "run", list[Progress]()
    right, *_ = sorted(web.tasks_of(next(iter(web.specs))), key=lambda task: len(task.truth.moves))  # type: ignore[union-attr]
    tasks = [right, with_moves(right, Click("No such sign"), Give("1"), name="lost")]

    @asynccontextmanager
    async def show(progress: Progress) -> AsyncIterator[None]:
        shown.append(progress)
        yield

    (fault,) = await check_in_browsers(web, tasks, run, sessions=2, show=show)
    assert fault.startswith("lost: expected success, got failure")
    assert shown[0].successes == Successes(1, 2, 2)
    shard = next((run / "trajectories").glob("*.jsonl"))
    first, _ = shard.read_bytes().splitlines(keepends=True)
    shard.write_bytes(first)  # as if the check had been killed
    kept = set(RunReader(run).attempts)
    assert await check_in_browsers(web, tasks, run, sessions=2, show=show) == [fault]
    assert shown[1].earlier == 1
    assert kept < set(RunReader(run).attempts)
    assert await check_in_browsers(web, tasks, run, sessions=2, show=show) == [fault]
    assert len(shown) == 2  # nothing was left to play
    with pytest.raises(RunFolderError, match="a check of other tasks"):
        await check_in_browsers(web, tasks[:1], run)


def test_websites_keep_nothing_but_cookies_in_a_browser() -> None:
    offline = Path(__file__).parents[2] / "src/webgym/offline"
    for path in offline.rglob("*"):
        if path.suffix in {".html", ".js", ".py"}:
            text = path.read_text()
            for storage in ("localStorage", "sessionStorage", "indexedDB", "caches.", "serviceWorker"):
                assert storage not in text, f"{path} uses {storage}; a tab cannot be used again"
