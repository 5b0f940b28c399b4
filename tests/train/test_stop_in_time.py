"""A training stops before its allocation ends, with nothing lost, and goes on as if it had not."""

from __future__ import annotations

import asyncio
import copy
import threading
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.conftest import wait_until
from tests.train import test_loop
from tests.train.test_kill import GIVEN
from tests.train.test_loop import TASKS, World, config, made
from tests.train.worlds import training_of

from webgym.core.errors import ConfigError, TrainingError
from webgym.rollout.progress import Progress
from webgym.store.runs import RunReader
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.loop import TrainConfig
from webgym.train.replay import ReplaySample
from webgym.train.start import follow, open_training
from webgym.train.stopping import Stop, ends_in_time

pytestmark = pytest.mark.timeout(400)  # real browsers, models and processes, beside others


def run(path: Path, world: World, stop: Stop | None = None, **loop: Any) -> list[dict[str, Any]]:
    return asyncio.run(training_of(path, world, config(**loop), TASKS, stop).run())


class Stopping(World):
    """Asks for the end once so much was done."""

    def __init__(self, after: int) -> None:
        super().__init__()
        self.stop, self._after = Stop(), after

    def do(self, what: str) -> None:
        super().do(what)
        if len(self.log) == self._after:
            self.stop.requested.set()


def test_wherever_it_stops_it_goes_on_as_if_it_had_not(tmp_path: Path) -> None:
    whole = World()
    run(tmp_path / "whole", whole)
    for after in range(1, len(whole.log), 3):
        folder, first, second = TrainingFolder(tmp_path / str(after)), Stopping(after), World()
        run(folder.path, first, first.stop)
        assert folder.stopped, whole.log[after - 1]
        rows = run(folder.path, second)
        assert not folder.stopped
        assert made(folder.path) == made(tmp_path / "whole")
        assert [row["iteration"] for row in rows] == [1, 2, 3]
        both = [line for line in first.log + second.log if not line.startswith("publish")]
        assert both == [line for line in whole.log if not line.startswith("publish")], "each once, in order"


def test_what_cannot_be_finished_is_abandoned_and_an_update_is_finished(tmp_path: Path) -> None:
    class Slow(World):
        async def attempts(self, *given: Any) -> Any:
            if given[0].parent.name == "0002":
                await asyncio.sleep(60)
            return await super().attempts(*given)

        def learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
            wait_until(lambda: time.time() > ends - 0.2)  # past the moment at which all is abandoned
            return super().learn(number, draw, folder)

    ends = time.time() + 2.5
    run(tmp_path, Slow(), Stop(ends, 1.0), staleness=1)
    folder = TrainingFolder(tmp_path)
    assert time.time() < ends + 1
    assert folder.stopped
    assert folder.stage(1) is Stage.FINISH
    assert folder.stage(2) is Stage.COLLECT


def test_an_update_that_would_be_cut_off_does_not_begin(tmp_path: Path) -> None:
    run(tmp_path, World(), iterations=1)
    folder = TrainingFolder(tmp_path)
    row = folder.figures(1, Stage.FINISH)
    folder.finish(1, Stage.FINISH, row | {"seconds": row["seconds"] | {"update": 1000.0}})
    now, world = time.time(), World()
    with pytest.raises(BaseExceptionGroup) as caught:
        run(tmp_path, World(), Stop(now + 900), iterations=2, evaluate_every=0)
    assert caught.group_contains(TrainingError, match="took 17 min, longer than", depth=1)
    run(tmp_path, world, Stop(now + 900, started=now - 900), iterations=2, evaluate_every=0, staleness=1)
    assert folder.stopped
    assert folder.stage(2) is Stage.REPLAY
    assert test_loop.done(world) == ["publish 1"]
    run(tmp_path, World(), Stop(now + 1900), iterations=2, evaluate_every=0)
    assert folder.stage(2) is None


def test_real_attempts_in_progress_end_and_no_other_begins(tmp_path: Path) -> None:
    given = copy.deepcopy(GIVEN)
    given["learn"]["model"] = "tiny"
    given["rollout"]["server"]["pictures"] = str(tmp_path / "pictures")
    given["rollout"]["collector"] = {"sessions": 1}
    given["loop"]["iterations"] = 1
    given["evaluation"]["count"] = 6
    settings, stop = TrainConfig.model_validate(given), Stop()
    folder = TrainingFolder(tmp_path / "out")

    @asynccontextmanager
    async def show(progress: Progress) -> AsyncIterator[None]:
        async def watch() -> None:
            while not progress.steps:
                await asyncio.sleep(0.001)
            stop.requested.set()

        watching = asyncio.create_task(watch())
        yield
        watching.cancel()

    async def train(*, resume: bool, **given: Any) -> None:
        async with open_training(settings, folder.path, resume=resume, **given) as training:
            await training.run()

    asyncio.run(train(resume=False, show=show, stop=stop))
    before = RunReader(folder.evaluation(0)).attempts
    assert 1 <= len(before) < 6
    assert not folder.is_evaluated(0)
    asyncio.run(train(resume=True))
    after = RunReader(folder.evaluation(0)).attempts
    assert after.items() >= before.items()
    assert len({(entry.task_id, entry.sample) for entry in after.values()}) == len(after) == 6
    assert folder.stage(1) is None


def test_the_other_processes_of_a_launch_end_when_the_first_one_stops(tmp_path: Path) -> None:
    folder = TrainingFolder(tmp_path)
    folder.mark_stopped(True)  # in the job before
    following = threading.Thread(target=follow, args=(config(), tmp_path), daemon=True)
    following.start()
    time.sleep(0.7)
    folder.mark_stopped(False)
    time.sleep(0.7)
    assert following.is_alive()
    folder.mark_stopped(True)
    following.join(10)
    assert not following.is_alive()


def test_the_end_of_the_allocation_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = time.time()

    def ends(before: str, given: str | None = None, **environment: str) -> tuple[float, float]:
        found = ends_in_time(before, given, environment)
        assert found.ends is not None
        return round(found.ends - now), found.before

    assert ends("10m", SLURM_JOB_END_TIME=str(now + 3600)) == (3600, 600)
    iso = time.strftime("%Y-%m-%dT%H:%M:%S", time.localtime(now + 7200))
    assert ends("90s", iso)[0] in (7199, 7200, 7201)
    assert ends("1h", iso, SLURM_JOB_END_TIME=str(now + 60))[1] == 3600
    scontrol = tmp_path / "scontrol"
    scontrol.write_text(f'#!/bin/sh\necho "JobId=$4 StartTime=x EndTime={iso} Deadline=N/A"; test "$4" = 7\n')
    scontrol.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert ends("5", SLURM_JOB_ID="7")[0] in (7199, 7200, 7201)
    for given, message in (
        (("soon",), "'soon' is no duration"),
        (("10m", "tonight"), "'tonight' is no time"),
        (("10m",), "found no Slurm allocation"),
    ):
        with pytest.raises(ConfigError, match=message):
            ends(*given)
    with pytest.raises(ConfigError, match="Slurm did not say when the job 8 ends"):
        ends("10m", SLURM_JOB_ID="8")
    with pytest.raises(ConfigError, match=r"only 1\.0 min are left, and --stop-before 10m leaves none"):
        ends("10m", SLURM_JOB_END_TIME=str(now + 60))
    scontrol.write_text("#!/bin/sh\necho JobId=7 EndTime=Unknown\n")
    with pytest.raises(ConfigError, match=r"the job 7 has no end; --ends gives it"):
        ends("10m", SLURM_JOB_ID="7")
