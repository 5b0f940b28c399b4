"""Job boards of one sector: jobs, employers, pay grades, applications."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Jobs(SpecifiedWebsite):
    """A job board."""

    family: ClassVar[str] = "jobs"
