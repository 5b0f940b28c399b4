"""Processes that have imported torch and transformers when they begin: that takes seconds each time."""

from __future__ import annotations

import multiprocessing
from multiprocessing.context import ForkServerProcess
from typing import Any

_CONTEXT = multiprocessing.get_context("forkserver")


def process(target: Any, *arguments: Any) -> ForkServerProcess:
    """A process that calls this function, to be started; all are forked from one that imports everything."""
    _CONTEXT.set_forkserver_preload(["tests.train.preloaded"])
    return _CONTEXT.Process(target=target, args=arguments)
