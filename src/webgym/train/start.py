"""Putting a training together: tasks, browsers, the model that collects and the one that learns."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from webgym.collection import Secrets, all_tasks, services
from webgym.core.errors import ConfigError, RunFolderError
from webgym.inference.local import LocalConfig
from webgym.rollout.files import CONFIG
from webgym.settings import merged, read_settings
from webgym.train.folder import TrainingFolder
from webgym.train.learner import Learner
from webgym.train.loop import Show, Tell, TrainConfig, Training
from webgym.train.objectives import make_objective
from webgym.train.replay import Replay
from webgym.train.serving import LocalServing


@asynccontextmanager
async def open_training(
    config: TrainConfig,
    out: Path,
    *,
    resume: bool = False,
    secrets: Secrets | None = None,
    show: Show | None = None,
    tell: Tell | None = None,
) -> AsyncIterator[Training]:
    """A training, with browsers and models started.

    Args:
        config: everything; of a training that is resumed, what :func:`read_config` gives.
        out: its folder; new or empty, unless it is resumed.
        resume: whether it is there already.
        secrets: tokens of servers that run elsewhere.
        show: shows the progress of each run.
        tell: is told, a line at a time, what a person should know.

    Raises:
        WebGymError: it cannot start.
    """
    folder = TrainingFolder(out)
    tasks = all_tasks(config.rollout)
    objective = make_objective(config.learn.objective)
    serving = LocalServing(config.local or LocalConfig(path=config.learn.model))
    async with (
        serving,
        services(config.rollout, secrets or Secrets()) as (where, tokens),
    ):
        training = Training(
            config,
            folder,
            tasks,
            serving=serving,
            learner=Learner(config.learn, objective),
            replay=Replay(config.learn.replay, objective, seed=config.seed),
            where=where,
            secrets=tokens,
            show=show,
            tell=tell,
        )
        if not resume:
            folder.create(config.model_dump(mode="json", exclude={"rollout": {"sites": {"token"}}}))
        yield training


def read_settings_of(files: Sequence[Path]) -> TrainConfig:
    """Settings from YAML files, each laid over those before it.

    Raises:
        ConfigError: a file cannot be read, or a setting is missing, unknown or out of range.
    """
    held: dict[str, Any] = {}
    for path in files:
        held = merged(held, read_settings(path, hint="see configs/train/ for examples"))
    try:
        return TrainConfig.model_validate(held)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        told = ", ".join(map(str, files)) or "no file"
        raise ConfigError(f"{told}: {where}: {first['msg'].removeprefix('Value error, ')}") from error


def read_config(out: Path) -> TrainConfig:
    """The configuration that a training was started with.

    Raises:
        RunFolderError: the folder is no training of this version.
    """
    try:
        held = yaml.safe_load((out / CONFIG).read_text())
        return TrainConfig.model_validate(held)
    except OSError as error:
        raise RunFolderError(
            f"{out} is not a training: it has no {CONFIG}", hint="give the folder that webgym train wrote"
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise RunFolderError(f"{out}/{CONFIG}: {where}: {first['msg']}") from error
