"""Corrects ``asyncio.timeout`` of Python 3.11.0 to 3.11.2, which Debian 12 has.

In a task that is being cancelled, such as one that ends browsers at its end, an expired deadline raises
``CancelledError`` there in place of ``TimeoutError``: what should follow the deadline, such as killing a
process that does not end, is left out. Later versions compare the number of cancellations with that at the
start of the block, and so does this.
"""

from __future__ import annotations

import sys
from typing import Any


def correct_timeouts() -> None:
    """Correct it for the whole process; does nothing in other versions of Python."""
    if sys.version_info >= (3, 11, 3):
        return
    import asyncio

    timeout: Any = asyncio.Timeout
    enter, leave = timeout.__aenter__, timeout.__aexit__

    async def begin(self: Any) -> Any:
        self.cancelling = asyncio.current_task().cancelling()  # type: ignore[union-attr]
        return await enter(self)

    async def end(self: Any, kind: Any, error: Any, traceback: Any) -> bool | None:
        await leave(self, kind, error, traceback)
        task: Any = asyncio.current_task()
        if self.expired() and kind is asyncio.CancelledError and task.cancelling() <= self.cancelling:
            raise TimeoutError
        return None

    timeout.__aenter__, timeout.__aexit__ = begin, end
