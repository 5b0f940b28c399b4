"""The benchmarks that tasks are taken from, over their native files as they are."""

from __future__ import annotations

from datetime import date
from pathlib import Path

from webgym.core.errors import UsageError
from webgym.taskset.sources import live_websites, published, web_search
from webgym.taskset.sources.base import Read, Skipped, Source, SourceTask
from webgym.taskset.sources.hub import HUB
from webgym.taskset.sources.importing import read_with
from webgym.taskset.sources.problems import PassedOver

SOURCES: dict[str, Source] = {
    source.name: source
    for source in (
        live_websites.INSTA,
        live_websites.WEBVOYAGER,
        web_search.AGENTSYNTH,
        web_search.BROWSECOMP,
        web_search.TRAVELPLANNER,
        live_websites.MIND2WEB_LIVE,
        live_websites.ONLINE_MIND2WEB,
        live_websites.DEEPSHOP,
        web_search.MIND2WEB_2,
        web_search.GAIA,
        published.SOURCE,
    )
}
"""By name, in the order of the paper's Table 1; the published set comes last."""

__all__ = ["HUB", "SOURCES", "PassedOver", "Read", "Skipped", "Source", "SourceTask", "read_source"]


def read_source(name: str, where: str | Path, *, today: date | None = None) -> Read:
    """Read a source's native files as they are.

    A broken record is skipped and counted, with its file, place and reason; the rest loads. Everything is
    read again on every call, and the same files give the same tasks under the same ids.

    Args:
        name: of the source, a key of :data:`SOURCES`.
        where: a file (JSON lines, JSON, CSV, TSV, Parquet, compressed or not), a folder of them, or
            ``"hub:<datasets id>[:[<configuration>/]<split>]"``, which needs the library ``datasets``.
        today: what lies before it has passed; the day of the call if not given.

    Raises:
        UsageError: there is no such source.
        TaskFileError: nothing is there, it cannot be read, or no record is in it.
        ConfigError: ``datasets`` is not installed, or gives no such dataset.
    """
    source = SOURCES.get(name)
    if source is None:
        raise UsageError(f"unknown source {name!r}", hint=f"the sources are {', '.join(SOURCES)}")
    return read_with(source, where, date.today() if today is None else today, tuple(SOURCES.values()))
