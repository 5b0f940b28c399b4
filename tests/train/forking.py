"""Processes that have imported torch and transformers when they begin: that takes seconds each time."""

from __future__ import annotations

import multiprocessing
import socket
from multiprocessing.context import ForkServerProcess
from typing import Any

_CONTEXT = multiprocessing.get_context("forkserver")


def process(target: Any, *arguments: Any) -> ForkServerProcess:
    """A process that calls this function, to be started; all are forked from one that imports everything."""
    _CONTEXT.set_forkserver_preload(["tests.train.preloaded"])
    return _CONTEXT.Process(target=target, args=arguments)


def together(target: Any, count: int, *given: Any) -> None:
    """Call a function with a rank, a port and their number in each of some processes."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    processes = [process(target, rank, port, count, *given) for rank in range(count)]
    for each in processes:
        each.start()
    for each in processes:
        each.join(280)
        each.kill()
    assert [each.exitcode for each in processes] == [0] * count
