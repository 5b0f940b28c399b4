"""Settings of reports and of the viewer."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import Field

from webgym.core.settings import Settings


class ReportConfig(Settings):
    """Settings of ``report.html``."""

    embed: bool = False
    """Embed the screenshots of a run in the file, up to the budget. Otherwise the file is small and refers to
    the screenshots in the run folder. The report of a training, which shows few, always embeds them."""

    image_width: int = Field(default=800, ge=64)
    """Width of embedded screenshots in pixels, with the aspect ratio kept. Smaller ones are not enlarged."""

    image_budget_bytes: int = Field(default=48 * 2**20, ge=0)
    """Most bytes of embedded screenshots. Further ones are references to the run folder."""

    pairs: int = Field(default=8, ge=0)
    """Number of tasks that the report of a training shows step by step, before and after it."""

    threads: int = Field(default_factory=lambda: len(os.sched_getaffinity(0)), ge=1)
    """Number of screenshots that are scaled down concurrently."""


class ViewConfig(Settings):
    """Settings of the viewer of a run or a task set."""

    port: int = Field(default=0, ge=0, le=65535)
    """Port to listen on; 0 takes a free one."""

    labels: Path | None = None
    """File of the human labels, CSV or JSON by its suffix; ``None`` is ``labels.csv`` in the run folder."""

    label_count: int = Field(default=80, ge=1)
    """Number of attempts to label; the paper's study has 80."""

    label_seed: int = 0
    """Seed of the sample of those attempts. The same seed and count give the same attempts."""
