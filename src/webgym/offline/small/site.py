"""The base class of small websites: a design, pages of signs, and tasks in a small vocabulary."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import ClassVar

from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import number, stream
from webgym.offline.small.compose import Mix, compose
from webgym.offline.small.design import Design, design
from webgym.offline.small.screen import Block, Tile, bar_room, page
from webgym.offline.small.signs import Sign, control
from webgym.offline.website import Response, Visit, Website, slug


class SmallWebsite(Website):
    """Base class of the small families.

    A family overrides :meth:`fill`, :meth:`parts` and, if it has controls of its own, :meth:`controls`.
    """

    mix: ClassVar[Mix] = Mix()
    topic: ClassVar[tuple[str, str]] = ("Misc.", "General Info.")
    """Domain and subdomain, by which :class:`webgym.tasks.selection.Selection` can exclude tasks."""
    design: Design

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """Brand and hostname label of a new website: ``("Fernhill", "fernhill-small-market")``."""
        del seed
        return stem, f"{slug(stem)}-small-{cls.family}"

    def build(self) -> None:
        """Draw the design and the records."""
        (self.domain, self.subdomain), self.tagline = self.topic, ""
        self.design = design(self.seed, self.split)
        self.fill()

    def fill(self) -> None:
        """Draw the records from the seed and the design's signs."""
        raise NotImplementedError

    def parts(self) -> Iterable[Part]:
        """All parts of which tasks can be composed."""
        raise NotImplementedError

    def assignments(self) -> Iterable[Assignment]:
        """The tasks, composed of the parts."""
        return compose(stream(self.seed, "compose"), list(self.parts()), self.mix)

    # --- pages ------------------------------------------------------------------------------------

    def token(self, *names: object) -> str:
        """A part of an address that does not reveal what the page shows: six hexadecimal digits."""
        return f"{number(self.seed, 'token', *names) % 16**6:06x}"

    def controls(self, visit: Visit) -> list[Tile]:
        """The controls in the bar of every page."""
        return [] if visit.path == "/" else [Tile(control("home"), "/")]

    def show(
        self,
        visit: Visit,
        blocks: Sequence[Block],
        *controls: Tile,
        mark: Sign | None = None,
        status: int = 200,
    ) -> Response:
        """Render a page.

        Args:
            visit: the request.
            blocks: the content of the page.
            controls: controls of this page, after those of every page.
            mark: a sign at the end of the bar without a link; left out if there is no room.
            status: HTTP status.
        """
        bar = [*self.controls(visit), *controls]
        if mark is not None and len(bar) < bar_room(self.design.layout):
            bar.append(Tile(mark))
        return Response(page(self.design, self.brand, bar, blocks).encode(), status)

    def missing(self, visit: Visit, status: int = 404) -> Response:
        """A page with only the controls."""
        return self.show(visit, [], status=status)
