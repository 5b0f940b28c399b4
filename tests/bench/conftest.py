from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import pytest
from benchmarks.command import run

Benchmark: TypeAlias = Callable[..., tuple[int, str]]


@pytest.fixture
def benchmark(capsys: pytest.CaptureFixture[str]) -> Benchmark:
    """A benchmark's command line in this process: (exit code, what it printed)."""

    def call(command: Callable[..., None], *arguments: object) -> tuple[int, str]:
        with pytest.raises(SystemExit) as ended:
            run(command, [str(argument) for argument in arguments])
        printed = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, printed.out + printed.err

    return call
