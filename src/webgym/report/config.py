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

    image_quality: int = Field(default=70, ge=1, le=100)
    """WebP quality. At 70 and 800 pixels, text of 14 CSS pixels stays readable, at 20-50 kB per
    screenshot."""

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

    refresh_seconds: float = Field(default=2.0, gt=0)
    """Interval at which an open page polls for new trajectories."""

    monitor_seconds: float = Field(default=0.5, gt=0)
    """Interval at which the monitor checks for new figures of the collector."""

    page_size: int = Field(default=100, ge=1, le=500)
    """Rows per page in the list of a task set."""

    labels: Path | None = None
    """File of the human labels, CSV or JSON by its suffix; ``None`` is ``labels.csv`` in the run folder."""

    label_count: int = Field(default=80, ge=1)
    """Number of attempts to label; the paper's study has 80."""

    label_seed: int = 0
    """Seed of the sample of those attempts. The same seed and count give the same attempts."""
