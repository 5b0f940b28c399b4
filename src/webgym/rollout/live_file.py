"""``live.json`` in the run folder: the collector's current state, for other processes.

It is rewritten about once a second and removed when the collector ends. A file left by a killed collector is
recognised by the time in it.
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
from webgym.rollout.progress import Progress
from webgym.store.files import LIVE, disk_errors, write_whole

FEED_SECONDS: Final = 1.0
"""Interval at which it is written; with 1,000 attempts it has 60 kB."""

STALE_SECONDS: Final = 15.0
"""Age from which the collector counts as dead: longer than a busy machine delays a write."""


@asynccontextmanager
async def feeding(progress: Progress, run: Path, seconds: float = FEED_SECONDS) -> AsyncIterator[None]:
    """Keep ``live.json`` up to date until the block ends, then remove it.

    If it cannot be written, the run continues, and ``progress.feed_error`` says why.

    Args:
        progress: progress of the run.
        run: the run folder.
        seconds: interval of writes.
    """
    path = run / LIVE
    # A single thread for writes and the removal, so that no write happens after the removal.
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
    """The state that a collector has written, and its ``age`` in seconds; ``None`` if no collector is
    running.

    Raises:
        StoreCorrupt: the file does not have a collector's format.
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
