"""What a command that was stopped says."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from webgym.cli import _run
from webgym.core.errors import StoreFull


async def interrupted() -> None:
    os.kill(os.getpid(), signal.SIGINT)
    await asyncio.sleep(10)


async def full() -> None:
    raise StoreFull("no space left")


async def whole() -> None:
    return None


@pytest.mark.parametrize(("job", "stop"), [(interrupted, KeyboardInterrupt), (full, StoreFull)])
def test_a_stopped_run_says_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], job: Callable[[], Any], stop: type[BaseException]
) -> None:
    run = tmp_path / "a run"
    run.mkdir()
    with pytest.raises(stop):
        _run.run(job, resumed_by=("webgym rollout", run))
    assert not capsys.readouterr().err, "nothing is there yet"
    (run / "config.yaml").touch()
    with pytest.raises(stop):
        _run.run(job, resumed_by=("webgym rollout", run))
    assert capsys.readouterr().err == (f"what is done is kept; go on with: webgym rollout --resume '{run}'\n")
    _run.run(whole, resumed_by=("webgym rollout", run))
    assert not capsys.readouterr().err
