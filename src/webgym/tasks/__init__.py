"""Task sets: reading and writing them, and choosing from them."""

from __future__ import annotations

from webgym.tasks.files import BrokenRecord, TaskFile
from webgym.tasks.formats import FORMATS, Format, read_tasks, write_tasks
from webgym.tasks.sampling import Sampler, SamplerConfig, draw, draw_spread

__all__ = [
    "FORMATS",
    "BrokenRecord",
    "Format",
    "Sampler",
    "SamplerConfig",
    "TaskFile",
    "draw",
    "draw_spread",
    "read_tasks",
    "write_tasks",
]
