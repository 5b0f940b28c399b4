from __future__ import annotations

import asyncio

import pytest

import webgym


async def test_a_deadline_holds_in_a_task_that_is_being_cancelled() -> None:
    """Python 3.11.0 to 3.11.2 raise ``CancelledError`` there."""
    assert webgym.__version__  # it is corrected by the import
    ended = []

    async def work() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.01):
                    await asyncio.Event().wait()
            ended.append("in order")

    task = asyncio.create_task(work())
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert ended == ["in order"]


async def test_a_cancellation_from_outside_is_none_of_a_deadline() -> None:
    async def work() -> None:
        async with asyncio.timeout(0.01):
            task.cancel()
            await asyncio.Event().wait()

    task = asyncio.create_task(work())
    with pytest.raises(asyncio.CancelledError):
        await task
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.01):
            await asyncio.Event().wait()
