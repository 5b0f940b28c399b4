"""The tasks of a forum: which parts a website's assignments are composed of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

from webgym.offline.families.forum.acts import Acts
from webgym.offline.families.forum.ranks import Ranks
from webgym.offline.families.forum.reads import Reads
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.forum import Forum

Maker: TypeAlias = Callable[[], "Part | None"]

ATTEMPTS = 6
"""How often an assignment is drawn anew before it is left out, because a part cannot be made or was asked."""


class Author(Reads, Ranks, Acts):
    """Writes the assignments of one forum.

    Every assignment has its own stream, no two of its parts speak of the same thread, and one at most
    signs in.
    """

    def __init__(self, site: Forum) -> None:
        super().__init__(site)
        self.asked: set[str] = set()

    @property
    def _small(self) -> dict[str, Maker]:
        """Parts of one or two facts for everyone."""
        return {
            "head": lambda: self.about_thread(self.rng.randint(1, 2)),
            "says": self.says,
            "says-later": lambda: self.says(later=True),
            "solution": self.solution,
            "favourite": self.favourite,
            "latest": self.latest,
            "highest": self.highest,
            "price": self.price,
            "poll": self.poll,
            "profile": lambda: self.profile(self.rng.randint(1, 2)),
            "set-up": self.setup,
            "extreme": self.extreme,
            "count": self.count,
            "silent": self.silent,
            "either": self.either,
            "newest": self.newest,
            "member": self.member,
            "tag-count": self.tag_count,
            "help": self.help_topic,
        }

    @property
    def _large(self) -> dict[str, Maker]:
        """Parts of three facts for everyone."""
        return {
            "thread": lambda: self.about_thread(3),
            "expert": self.expert,
            "card": lambda: self.profile(3),
            "gap": self.gap,
            "top-three": self.top_three,
            "join": self.join,
        }

    @property
    def _members(self) -> dict[str, Maker]:
        """Parts of three facts for members."""
        return {
            "reply": self.reply,
            "start": self.start,
            "like": self.like,
            "flag": self.flag,
            "write": self.write,
        }

    @property
    def _short(self) -> dict[str, Maker]:
        """Parts of two facts for members."""
        return {"vote": self.vote, "letter": self.letter, "digest": self.digest}

    def assignments(self) -> Iterator[Assignment]:
        """Single parts first, then compositions."""
        rng = stream(self.site.seed, "plan")
        small, large = list(self._small), list(self._large)
        members, short = list(self._members), list(self._short)
        # There is one first member by each count, and one setting: asked once, they are used up.
        often = [kind for kind in small if kind != "member"]
        singles = [
            *rng.sample(small, 9),
            *rng.sample(large, 2),
            *rng.sample(members, 2),
            *rng.sample(short, 2),
        ]
        for name in singles:
            yield from self._assignment(name, [name])
        yield from self._assignment("tour-1", [rng.choice(large), rng.choice(often)])
        yield from self._assignment("tour-2", [rng.choice(members), rng.choice(often)])
        first, second, third, fourth = rng.sample(large, 4)
        yield from self._assignment(
            "study-1", [rng.choice((first, rng.choice(members))), second, rng.choice(often)]
        )
        yield from self._assignment("study-2", [third, rng.choice(members), fourth])

    def _assignment(self, name: str, kinds: list[str]) -> Iterator[Assignment]:
        makers = self._small | self._large | self._members | self._short
        for attempt in range(ATTEMPTS):
            self.begin(f"{name} {attempt}")
            parts = [part for kind in kinds if (part := makers[kind]()) is not None]
            asks = {part.ask for part in parts}
            if len(parts) == len(kinds) and not asks & self.asked:
                self.asked |= asks
                yield Assignment(name, tuple(parts))
                return
