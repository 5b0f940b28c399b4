"""Settings of reports and of the viewer."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import Field

from webgym.settings import Settings


class ReportConfig(Settings):
    """How ``report.html`` is made."""

    embed: bool = False
    """Put the pictures of a run into the file, as far as the budget goes. Else it shows those beside it in
    the run folder, and stays small. The report of a training, which shows few, embeds them always."""

    image_width: int = Field(default=800, ge=64)
    """Width of an embedded screenshot, pixels; the height follows. Smaller ones are left as they are."""

    image_quality: int = Field(default=70, ge=1, le=100)
    """WebP quality. At 70 and 800 pixels, text of 14 CSS pixels stays readable at 20-50 kB a picture."""

    image_budget_bytes: int = Field(default=48 * 2**20, ge=0)
    """How much of the file pictures may take. Those beyond it are linked to in the run folder."""

    pairs: int = Field(default=8, ge=0)
    """Tasks that the report of a training shows before and after it, step by step."""

    threads: int = Field(default_factory=lambda: len(os.sched_getaffinity(0)), ge=1)
    """Pictures made smaller at the same time."""


class ViewConfig(Settings):
    """How a run, or a task set, is served."""

    port: int = Field(default=0, ge=0, le=65535)
    """Which port to listen on; 0 takes a free one."""

    refresh_seconds: float = Field(default=2.0, gt=0)
    """How often an open page asks for what is new."""

    monitor_seconds: float = Field(default=0.5, gt=0)
    """How often the monitor looks whether the collector has said something new."""

    page_size: int = Field(default=100, ge=1, le=500)
    """Rows on a page of a task set."""

    labels: Path | None = None
    """Where people's labels are kept, CSV or JSON by its name; ``None``: ``labels.csv`` in the run folder."""

    label_count: int = Field(default=80, ge=1)
    """How many attempts people are asked to label; the paper's study has 80."""

    label_seed: int = 0
    """Of the draw of those attempts. Whoever is to label the same ones needs the same seed and count."""
