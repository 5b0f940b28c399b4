"""What process trees use."""

from __future__ import annotations

import subprocess
import sys
import time

import psutil

from webgym.bench.usage import CpuTimes, proportional_bytes


def burn(seconds: float) -> None:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def test_what_was_used_before_is_not_counted() -> None:
    burn(0.2)
    cpu = CpuTimes(psutil.Process().pid)
    assert cpu.since_last()["server"] < 0.1
    burn(0.2)
    assert cpu.since_last()["server"] > 0.1


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
