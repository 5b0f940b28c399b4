"""The benchmarks that tasks are taken from, one file each, over their native files as they are."""

from __future__ import annotations

from webgym.tasks.sources.base import Skipped, Source, SourceTask

__all__ = ["Skipped", "Source", "SourceTask"]
