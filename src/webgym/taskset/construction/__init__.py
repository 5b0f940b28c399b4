"""``webgym tasks build``: from the sources' files to a split, validated task set."""

from __future__ import annotations

from webgym.taskset.construction.config import PURPOSES, BuildConfig, read_config
from webgym.taskset.construction.estimate import Estimate
from webgym.taskset.construction.pipeline import Build
from webgym.taskset.construction.progress import StageProgress
from webgym.taskset.construction.run import (
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
