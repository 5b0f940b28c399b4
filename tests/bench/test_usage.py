"""What process trees use."""

from __future__ import annotations

import subprocess
import sys

import psutil

from webgym.bench.usage import proportional_bytes


def test_memory_is_that_of_the_processes_given() -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", "x = bytearray(50_000_000); print('up', flush=True); input()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with child:
        assert child.stdout is not None
        child.stdout.readline()
        assert proportional_bytes([psutil.Process(child.pid)]) > 50_000_000
        child.kill()
