"""Work that nothing interrupts."""

import asyncio
import threading

import pytest

from webgym.core.background import uninterrupted


async def test_whoever_is_cancelled_twice_ends_only_when_the_work_has_ended() -> None:
    """As a group does it to a task that its parent has cancelled too."""
    begun, may_end = threading.Event(), threading.Event()

    def work() -> None:
        begun.set()
        assert may_end.wait(100)

    waiting = asyncio.create_task(uninterrupted(asyncio.to_thread(work)))
    await asyncio.to_thread(begun.wait, 100)
    for _ in range(3):
        waiting.cancel()
        await asyncio.wait({waiting}, timeout=0.01)
        assert not waiting.done()
    may_end.set()
    await asyncio.wait({waiting})
    assert waiting.cancelled()


async def test_its_result_and_its_error_are_those_of_the_work() -> None:
    assert await uninterrupted(asyncio.to_thread(lambda: 5)) == 5
    with pytest.raises(ZeroDivisionError):
        await uninterrupted(asyncio.to_thread(lambda: 1 // 0))
