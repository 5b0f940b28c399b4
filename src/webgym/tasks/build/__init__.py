"""``webgym tasks build``: from the sources' files to a split, validated task set."""

from __future__ import annotations

from webgym.tasks.build.config import PURPOSES, BuildConfig, read_config
from webgym.tasks.build.estimate import Estimate
from webgym.tasks.build.pipeline import Build
from webgym.tasks.build.progress import Stages
from webgym.tasks.build.run import Finished, Noted, Place, run_batch, run_build, run_dry

__all__ = [
    "PURPOSES",
    "Build",
    "BuildConfig",
    "Estimate",
    "Finished",
    "Noted",
    "Place",
    "Stages",
    "read_config",
    "run_batch",
    "run_build",
    "run_dry",
]
