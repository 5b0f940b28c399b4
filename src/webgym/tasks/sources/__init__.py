"""The benchmarks that tasks are taken from, over their native files as they are."""

from webgym.tasks.sources.base import ENCRYPTED_SOURCE, Read, Skipped, Source, SourceTask
from webgym.tasks.sources.benchmarks import SOURCES
from webgym.tasks.sources.fields import PassedOver
from webgym.tasks.sources.importing import read_source

__all__ = [
    "ENCRYPTED_SOURCE",
    "SOURCES",
    "PassedOver",
    "Read",
    "Skipped",
    "Source",
    "SourceTask",
    "read_source",
]
