"""Trains to the end, then again while it is killed time after time.

Every life is a child of this process, which has imported everything already; its end is SIGKILL, at a random
moment. With ``browsers`` demonstrators attempt real tasks in real browsers, else attempts are made up; loop,
store, replay, model and update are the real ones either way.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import sys
from pathlib import Path

import torch
from tests.train import test_loop
from tests.train.test_training import Breakable, Serving, settings

from webgym.run.choice import all_tasks
from webgym.run.config import Secrets, ServerChoice, resolved
from webgym.run.services import services
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig, Training, make_run
from webgym.train.objectives import make_objective
from webgym.train.replay import Replay
from webgym.train.update import Learner


def config(model: Path, staleness: int) -> TrainConfig:
    update = {"precision": "fp32", "learning_rate": 1e-3, "warmup_steps": 2, "batch": 4, "micro_batch": 4}
    loop = {"iterations": 3, "tasks": 6, "evaluate_every": 2, "staleness": staleness}
    held = settings(model).model_dump(mode="json", exclude_unset=True)
    held["learn"] |= {"update": update, "replay": {"steps": 12, "passes": 1}}
    held["rollout"]["collector"] |= {"straggler_share": 1.0, "sessions": 2}
    held |= {"loop": loop, "evaluation": {"count": 2, "budget": [8, 16, 24]}}
    return TrainConfig.model_validate(held)


async def train(path: Path, model: Path, *, browsers: bool, staleness: int) -> None:
    given = config(model, staleness)
    world = test_loop.World(sampling=given.sampling.body())
    if browsers:
        rollout = resolved(given.rollout, Breakable(), None)
        given = given.model_copy(update={"rollout": rollout})
    objective = make_objective(given.learn.objective)
    folder = TrainingFolder(path)
    if not (path / "config.yaml").exists():
        folder.create(given.model_dump(mode="json", exclude={"rollout": {"sites": {"token"}}}))

    async def run(where: ServerChoice, secrets: Secrets) -> None:
        await Training(
            given,
            folder,
            all_tasks(given.rollout) if browsers else test_loop.TASKS,
            serving=Serving(Breakable()) if browsers else world,
            learner=Learner(given.learn, objective),
            replay=Replay(given.learn.replay, objective),
            where=where,
            secrets=secrets,
            attempts=make_run if browsers else world.attempts,
        ).run()

    with folder.locked():
        if not browsers:
            await run(ServerChoice(), Secrets())
            return
        async with services(given.rollout, Secrets()) as reached:
            await run(*reached)


def live(path: Path, model: Path, browsers: bool, staleness: int, seconds: float | None) -> float | None:
    """One life of so many seconds of CPU time, which do not depend on who else is at work; those that it took
    to come to its end by itself."""
    child = os.fork()
    if child == 0:
        signal.setitimer(signal.ITIMER_PROF, seconds or 0.0)  # its signal ends the process, as SIGKILL does
        try:
            asyncio.run(train(path, model, browsers=browsers, staleness=staleness))
        except BaseException:
            sys.excepthook(*sys.exc_info())
            os._exit(1)
        os._exit(0)
    _, status, used = os.wait4(child, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status):
        sys.exit(f"a life ended with {os.WEXITSTATUS(status)}")
    return used.ru_utime + used.ru_stime if os.WIFEXITED(status) else None


def main(folder: Path, model: Path, kills: int, seed: int, browsers: bool, staleness: int) -> None:
    """Make ``folder/whole`` and ``folder/killed``, and write to ``folder/kills`` how often it was killed."""
    torch.set_num_threads(1)
    rng = random.Random(seed)
    whole = live(folder / "whole", model, browsers, staleness, None)
    assert whole is not None
    killed = 0
    # Lives that are long enough, on the whole, to come to the end only after the last kill.
    while killed < kills:
        seconds = rng.uniform(0.1, 1.3) * whole / kills
        if live(folder / "killed", model, browsers, staleness, seconds) is not None:
            break
        killed += 1
    live(folder / "killed", model, browsers, staleness, None)
    (folder / "kills").write_text(str(killed))
