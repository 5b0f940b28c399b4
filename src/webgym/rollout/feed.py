"""``live.json`` in the run folder: the collector's present state, for other processes.

It is written whole about once a second and removed when the collector ends. One that was left by a killed
collector is told by the time in it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

import msgspec

from webgym.core.errors import StoreCorrupt
from webgym.rollout.files import LIVE, disk_errors, write_whole
from webgym.rollout.progress import Progress

FEED_SECONDS: Final = 1.0
"""How often it is written: 1,000 attempts make 60 kB."""

STALE_SECONDS: Final = 15.0
"""Older than this, nobody writes it any more: a busy machine delays a write, but not by so much."""


@asynccontextmanager
async def feeding(progress: Progress, run: Path, seconds: float = FEED_SECONDS) -> AsyncIterator[None]:
    """Keep ``live.json`` up to date until the block ends, then remove it.

    A feed that cannot be written stops nothing: ``progress.feed_error`` says why until it can be again.

    Args:
        progress: what is told.
        run: the run folder.
        seconds: between two writes.
    """
    path = run / LIVE
    # One thread for writes and removal, so that no write that is under way can follow the removal.
    thread = ThreadPoolExecutor(1, thread_name_prefix="live-feed")
    loop = asyncio.get_running_loop()

    async def write() -> None:
        while True:
            data = msgspec.json.encode(progress.snapshot())
            try:
                await loop.run_in_executor(thread, _write, path, data)
                progress.feed_error = ""
            except OSError as error:
                progress.feed_error = f"{path.name} cannot be written: {error.strerror}"
            await asyncio.sleep(seconds)

    writing = asyncio.create_task(write())
    try:
        yield
    finally:
        writing.cancel()
        removed = thread.submit(path.unlink, missing_ok=True)
        thread.shutdown(wait=False)
        with suppress(asyncio.CancelledError):
            await writing
        with disk_errors(f"removing {path}"):
            await asyncio.wrap_future(removed)


def _write(path: Path, data: bytes) -> None:
    write_whole(path, data, durable=False)


def read_feed(run: Path) -> dict[str, Any] | None:
    """What a collector says of itself, and ``age``, seconds since it did; ``None`` if none is at work.

    Raises:
        StoreCorrupt: the file is not what a collector writes.
    """
    path = run / LIVE
    try:
        feed = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
        age = max(0.0, time.time() - float(feed["at"]))
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError) as error:
        raise StoreCorrupt(f"{path} is not what a collector writes: {error}") from error
    return {**feed, "age": round(age, 1), "is_stale": age > STALE_SECONDS}
