"""The benchmarks that tasks are taken from, over their native files as they are."""

from webgym.taskset.sources.base import Read, Skipped, Source, SourceTask
from webgym.taskset.sources.benchmarks import SOURCES
from webgym.taskset.sources.fields import PassedOver
from webgym.taskset.sources.importing import read_source
from webgym.taskset.sources.reading import HUB

__all__ = ["HUB", "SOURCES", "PassedOver", "Read", "Skipped", "Source", "SourceTask", "read_source"]
