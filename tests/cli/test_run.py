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


async def finishing_or_not(finishing: asyncio.Event, presses: int) -> str:
    for _ in range(presses):
        os.kill(os.getpid(), signal.SIGINT)
        await asyncio.sleep(0.05)
    async with asyncio.timeout(30):
        await finishing.wait()
    return "finished"


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


@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_once_lets_a_run_finish_and_twice_abandons_it(
    capsys: pytest.CaptureFixture[str], presses: int
) -> None:
    ends: list[str] = []

    finishing = asyncio.Event()

    async def work() -> None:
        try:
            ends.append(await finishing_or_not(finishing, presses))
        except asyncio.CancelledError:
            ends.append("abandoned")
            raise

    with pytest.raises(KeyboardInterrupt):
        _run.run(work, finishing=finishing)
    assert ends == [{1: "finished", 2: "abandoned"}[presses]]
    assert "Ctrl-C again abandons" in capsys.readouterr().err
