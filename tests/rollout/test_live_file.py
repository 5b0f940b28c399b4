"""``live.json``: whole at any moment, and gone at the end."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from pathlib import Path

import pytest

from webgym.core.errors import StoreCorrupt
from webgym.rollout import live_file
from webgym.rollout.live_file import STALE_SECONDS, feeding, read_feed
from webgym.rollout.progress import Progress
from webgym.store.files import LIVE


async def _until(condition: object) -> None:
    async with asyncio.timeout(100):
        while not condition():  # type: ignore[operator]
            await asyncio.sleep(0.01)


async def test_it_follows_the_collector_and_is_gone_at_the_end(tmp_path: Path) -> None:
    progress = Progress(total=5)
    async with feeding(progress, tmp_path, 0.01):
        progress.move(None, "opening", "a#0.0")
        progress.stepped("a#0.0")
        await _until(lambda: (read_feed(tmp_path) or {}).get("steps") == 1)
        told = read_feed(tmp_path)
        assert told is not None
        assert told["cells"][0][:4] == [0, "a#0.0", "opening", 1]
        assert not told["is_stale"]
    assert list(tmp_path.iterdir()) == []
    assert read_feed(tmp_path) is None


async def test_no_late_write_leaves_it_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The block ends while a write is under way, and is cancelled too."""
    begun, go_on = threading.Event(), threading.Event()
    write = live_file._write

    def slowly(path: Path, data: bytes) -> None:
        begun.set()
        assert go_on.wait(100)
        write(path, data)

    monkeypatch.setattr(live_file, "_write", slowly)

    async def run() -> None:
        async with feeding(Progress(total=1), tmp_path, 0.01):
            await asyncio.Event().wait()

    running = asyncio.create_task(run())
    await asyncio.to_thread(begun.wait, 100)
    running.cancel()
    await asyncio.sleep(0)
    running.cancel()  # once more, while it waits for the removal
    go_on.set()
    await asyncio.gather(running, return_exceptions=True)
    await _until(lambda: not any(thread.name.startswith("live-feed") for thread in threading.enumerate()))
    assert list(tmp_path.iterdir()) == []


async def test_a_feed_that_cannot_be_written_is_told_and_stops_nothing(tmp_path: Path) -> None:
    progress = Progress(total=1)
    run = tmp_path / "run"
    async with feeding(progress, run, 0.01):  # there is no such folder
        await _until(lambda: progress.feed_error)
        assert "live.json cannot be written" in progress.warnings[0]
        run.mkdir()
        await _until(lambda: not progress.feed_error)


def test_what_a_killed_collector_left_is_stale(tmp_path: Path) -> None:
    told = Progress(total=5).snapshot()
    (tmp_path / LIVE).write_text(json.dumps({**told, "at": time.time() - STALE_SECONDS - 1}))
    left = read_feed(tmp_path)
    assert left is not None
    assert left["is_stale"]
    for broken in ("", "[]", "{}", '{"at": "x"}'):
        (tmp_path / LIVE).write_text(broken)
        with pytest.raises(StoreCorrupt):
            read_feed(tmp_path)
