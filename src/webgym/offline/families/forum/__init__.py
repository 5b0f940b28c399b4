"""Forums about one hobby: threads, posts, members."""

from __future__ import annotations

from typing import ClassVar

from webgym.offline.engine.specified import SpecifiedWebsite


class Forum(SpecifiedWebsite):
    """A forum."""

    family: ClassVar[str] = "forum"
