"""Updates that several tests, and processes, make alike."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from tests.inference.tiny import tiny_renderer
from tests.train.making import Made, sample, trajectory

from webgym.core.trajectory import Reply
from webgym.train.config import LearnConfig, UpdateConfig
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.learner import Learner
from webgym.train.loop import LoopConfig, TrainConfig
from webgym.train.objectives import FilteredBC, GroupIS, Objective
from webgym.train.replay import Replay
from webgym.train.samples import Sample
from webgym.train.start import follow
from webgym.train.update import Updater, UpdateReport

REPLIES = ["click", "the other one", "a", "scroll down here", "click there", "no", "on and on it goes"]

CASES: dict[str, tuple[dict[str, Any], Objective]] = {
    "all_weights": ({"batch": 4}, FilteredBC()),
    "one_odd_batch": ({"batch": 7}, FilteredBC()),  # two processes: one has a sample too few
    "adapters": ({"batch": 7, "lora": {"rank": 4, "alpha": 8}}, FilteredBC()),
    "groups": ({"batch": 4}, GroupIS()),
    "chunks": ({"batch": 4, "micro_batch": 1, "logit_tokens": 3}, FilteredBC()),
}


def samples(objective: Objective) -> list[Sample]:
    renderer = tiny_renderer()
    made = []
    for number, reply in enumerate(REPLIES):
        plain = sample(renderer, reply, look=number % 4)
        if not objective.off_policy:
            made.append(plain)
            continue
        logprobs = plain.reply_ids.float() * 0 - 5.0 - 0.1 * number
        advantage = 0.05 if number % 2 else -0.05
        made.append(sample(renderer, reply, look=number % 4, logprobs=logprobs, advantage=advantage))
    return made


def updater(
    source: Path, objective: Objective | None = None, *, resume: Path | None = None, **settings: Any
) -> Updater:
    given = {"precision": "fp32", "learning_rate": 1e-2, "warmup_steps": 1, "micro_batch": 2} | settings
    return Updater(UpdateConfig.model_validate(given), objective or FilteredBC(), source, resume=resume)


def run_case(name: str, source: Path, folder: Path, **settings: Any) -> UpdateReport:
    """Two passes, saved."""
    given, objective = CASES[name]
    made = updater(source, objective, **(given | settings))
    report = made.update(samples(objective), passes=2)
    made.save(folder)
    return report


def run_cases_together(rank: int, port: int, source: Path, folder: Path, names: list[str]) -> None:
    """In one of two processes that update the same model together."""
    where = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "WORLD_SIZE": 2, "LOCAL_WORLD_SIZE": 2}
    own = {"RANK": rank, "LOCAL_RANK": rank, "ACCELERATE_USE_CPU": "true"}
    os.environ.update({name: str(value) for name, value in (where | own).items()})
    for name in names:
        run_case(name, source, folder / name)
    training = TrainConfig(learn=learning(source), loop=LoopConfig(iterations=1))
    if rank == 0:
        learn_first(training, folder / "training")
    else:
        follow(training, folder / "training")


def learning(source: Path) -> LearnConfig:
    update = {"precision": "fp32", "learning_rate": 1e-2, "warmup_steps": 1, "micro_batch": 2, "batch": 4}
    return LearnConfig.model_validate({"model": str(source), "update": update, "replay": {"passes": 1}})


def learn_first(config: TrainConfig, path: Path) -> None:
    """The first iteration of a training whose trajectories are there already."""
    folder, objective = TrainingFolder(path), FilteredBC()
    replay = Replay(config.learn.replay, objective)
    run = Made([trajectory(number, reply=Reply(text, "p")) for number, text in enumerate(REPLIES[:2])])
    folder.iteration(1).mkdir(parents=True)
    replay.add(1, run.write(folder.run(1)))
    folder.write_batch(1, replay.draw())
    told = Learner(config.learn, objective).learn(1, folder.draw(1), folder)
    folder.finish(1, Stage.UPDATE, told)
