"""Updates that several tests, and processes, make alike."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import yaml
from tests.inference.tiny import tiny_renderer
from tests.train.making import Made, sample, trajectory

from webgym.core.trajectory import Reply
from webgym.train import update
from webgym.train.config import LearnConfig, UpdateConfig
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.loop import LoopConfig, TrainConfig
from webgym.train.objectives import FilteredBC, GroupIS, Objective
from webgym.train.replay import Replay
from webgym.train.samples import Sample
from webgym.train.start import follow
from webgym.train.update import Learner, Updater, UpdateReport

REPLIES = ["click", "the other one", "a", "scroll down here", "click there", "no", "on and on it goes"]

CASES: dict[str, tuple[dict[str, Any], Objective]] = {
    "all_weights": ({"batch": 4}, FilteredBC()),
    "one_odd_batch": ({"batch": 7}, FilteredBC()),  # two processes: one has a sample too few
    "adapters": ({"batch": 7, "lora": {"rank": 4, "alpha": 8}}, FilteredBC()),
    "groups": ({"batch": 4}, GroupIS()),
    "chunks": ({"batch": 4, "micro_batch": 1, "logit_tokens": 3}, FilteredBC()),
}


SHARDED: dict[str, dict[str, dict[str, Any]]] = {
    "tied": {"one_odd_batch": {}, "adapters": {}, "all_weights": {"precision": "bf16"}},
    "untied": {"chunks": {"gradient_checkpointing": True}, "groups": {}},
}
"""What is updated under FSDP2, by model and case, with further settings."""


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


def join(rank: int, port: int, processes: int, **launched: str) -> None:
    """Become one of some processes that update together, as ``accelerate launch`` has them."""
    where = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "WORLD_SIZE": processes}
    own = {"LOCAL_WORLD_SIZE": processes, "RANK": rank, "LOCAL_RANK": rank, "ACCELERATE_USE_CPU": "true"}
    os.environ.update({name: str(value) for name, value in (where | own | launched).items()})


def launched(name: str) -> dict[str, str]:
    """The variables that ``accelerate launch`` sets for a file of configs/accelerate."""
    held = yaml.safe_load((Path(__file__).parents[2] / f"configs/accelerate/{name}.yaml").read_text())
    options = {key.upper(): str(value).lower() for key, value in held.get("fsdp_config", {}).items()}
    return options | ({"ACCELERATE_USE_FSDP": "true"} if options else {})


def run_cases_together(rank: int, port: int, source: Path, folder: Path, names: list[str]) -> None:
    """In one of two processes that update the same model together."""
    join(rank, port, 2)
    for name in names:
        run_case(name, source, folder / name)
    training = TrainConfig(learn=learning(source), loop=LoopConfig(iterations=1))
    if rank == 0:
        learn_first(training, folder / "training")
    else:
        follow(training, folder / "training")


def update_sharded(
    rank: int, port: int, processes: int, models: Path, out: Path, cases: int, halves: Path | None
) -> None:
    """Under FSDP2 as shipped, for each model: what goes on from halves of updates, some cases, and a half."""
    join(rank, port, processes, **launched("fsdp2"))
    update.REPLY_TOKENS = 2  # type: ignore[attr-defined]
    for model, names in SHARDED.items():
        if halves is not None:
            go_on(models / model, out / model / "again", halves / model / "half")
        if not cases:
            continue
        for name, settings in [*names.items()][:cases]:
            run_case(name, models / model, out / model / name, **settings)
        half = updater(models / model, batch=4)
        half.update(samples(FilteredBC()))
        half.save(out / model / "half")


def go_on(source: Path, folder: Path, half: Path | None) -> None:
    """The second of two updates."""
    made = updater(source, resume=half, batch=4)
    if half is None:
        made.update(samples(FilteredBC()))
    made.update(samples(FilteredBC()))
    made.save(folder)


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
