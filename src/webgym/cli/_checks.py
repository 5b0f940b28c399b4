"""What is wrong in arguments, found before servers, browsers or torch start."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from webgym.core.errors import ConfigError, RunFolderError, TaskFileError


def check_writable(file: Path | None) -> None:
    """Refuse an output file that cannot be written, before anything is measured.

    Raises:
        ConfigError: the path is a folder, or its folder does not exist.
    """
    if file is not None and (file.is_dir() or not file.parent.is_dir()):
        raise ConfigError(f"{file} cannot be written", hint="give a file in a folder that exists")


def check_figure(file: Path | None) -> None:
    """Refuse a figure's file that cannot be written, or has no suffix of a format.

    Raises:
        UsageError: that is so.
    """
    from webgym.core.plotting import check_suffix

    check_writable(file)
    if file is not None:
        check_suffix(file)


def check_folder(folder: Path) -> None:
    """Refuse an output folder that cannot be made.

    Raises:
        RunFolderError: a part of the path is no folder, or may not be written to.
    """
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        why = "may not be written to" if there.is_dir() else "is no folder"
        raise RunFolderError(f"cannot create {folder}: {there} {why}", hint="choose another folder")


def check_policy_name(name: str) -> None:
    """Refuse a policy that there is not.

    Raises:
        ConfigError: that is so.
    """
    from webgym.agent.scripted import POLICY_NAMES

    if name not in POLICY_NAMES:
        raise ConfigError(f"unknown policy {name!r}", hint=f"choose one of {', '.join(POLICY_NAMES)}")


def check_training(data: Mapping[str, Any], folder: Path | None) -> None:
    """Refuse settings of a training whose model or task file is missing, and a folder that cannot be made.

    Args:
        data: plain settings, as the class that validates them takes seconds to import.
        folder: of the training to make.

    Raises:
        WebGymError: one of them is missing or cannot be made.
    """
    if folder is not None:
        check_folder(folder)
    learn, rollout = data.get("learn"), data.get("rollout")
    model = learn.get("model") if isinstance(learn, Mapping) else None
    if model is None:
        raise ConfigError("learn.model is missing", hint="a model's folder, or its id on the hub")
    check_model(Path(str(model)))
    tasks = rollout.get("tasks") if isinstance(rollout, Mapping) else None
    if isinstance(tasks, Mapping) and tasks.get("file") is not None:
        check_tasks(str(tasks["file"]))


def check_model(path: Path) -> None:
    """Refuse a model's folder that does not exist; an id on the hub may be downloaded.

    Raises:
        ConfigError: that is so.
    """
    is_hub_id = not path.is_absolute() and len(path.parts) <= 2 and path.parts[:1] != ("..",)
    if not path.exists() and not is_hub_id:
        raise ConfigError(f"cannot load the model {path}: there is no such folder", hint="check its path")


def check_tasks(name: str) -> None:
    """Refuse tasks that are neither a file, a folder, a known name nor an address on the hub.

    Raises:
        TaskFileError: that is so.
    """
    from webgym.offline.config import collection_of
    from webgym.tasks.hub import address_of

    if collection_of(name) is None and address_of(name) is None and not Path(name).exists():
        raise TaskFileError(f"cannot read {name}: there is no such file", hint="check its path")
