"""``webgym tasks build``: from the sources' files to a split, validated task set."""

from __future__ import annotations

from webgym.tasks.construction.config import PURPOSES, BuildConfig, read_config
from webgym.tasks.construction.estimate import Estimate
from webgym.tasks.construction.pipeline import Build
from webgym.tasks.construction.progress import StageProgress
from webgym.tasks.construction.run import (
    BuildPaths,
    FinishedBuild,
    PendingBatches,
    run_batch,
    run_build,
    run_dry,
)

__all__ = [
    "PURPOSES",
    "Build",
    "BuildConfig",
    "BuildPaths",
    "Estimate",
    "FinishedBuild",
    "PendingBatches",
    "StageProgress",
    "read_config",
    "run_batch",
    "run_build",
    "run_dry",
]
