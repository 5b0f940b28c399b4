"""What all parts of an encyclopedia's tasks are written with: proofs, moves and words."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Evidence, Fill, Move
from webgym.offline.families.encyclopedia.schema import Article, Measure, Person
from webgym.offline.seeds import stream
from webgym.offline.website import slug

if TYPE_CHECKING:
    from webgym.offline.families.encyclopedia import Encyclopedia


class Desk:
    """Shared by the modules that write parts.

    Attributes:
        site: the encyclopedia.
        rng: of the assignment that is being written.
        taken: titles that it speaks of already.
    """

    def __init__(self, site: Encyclopedia) -> None:
        self.site = site
        self.stock = site.stock
        self.subject = site.subject
        self.begin("")

    def begin(self, name: str) -> None:
        """Begin an assignment."""
        self.rng = stream(self.site.seed, "task", name)
        self.taken: set[str] = set()

    # --- choosing ---------------------------------------------------------------------------------------

    def take(self, articles: Iterable[Article]) -> bool:
        """Reserve articles, if none of them is taken."""
        titles = {article.title for article in articles}
        if titles & self.taken:
            return False
        self.taken |= titles
        return True

    def fresh(self, candidates: Iterable[Article] | None = None) -> Article | None:
        """An article that this assignment does not speak of yet."""
        pool = self.stock.articles if candidates is None else candidates
        free = [article for article in pool if article.title not in self.taken]
        if not free:
            return None
        chosen = self.rng.choice(free)
        self.taken.add(chosen.title)
        return chosen

    def shuffled_groups(self) -> list[str]:
        """All groups in random order."""
        return self.rng.sample(self.stock.groups, len(self.stock.groups))

    def others(self, members: Iterable[Article], *not_these: Article) -> tuple[str, ...]:
        """Titles of up to three others, as wrong answers; they are taken."""
        pool = [m for m in members if m not in not_these and m.title not in self.taken]
        wrong = self.rng.sample(pool, min(3, len(pool)))
        self.taken |= {article.title for article in wrong}
        return tuple(article.title for article in wrong)

    # --- words ------------------------------------------------------------------------------------------

    def group_words(self, group: str) -> str:
        """``"the range “Iron Teeth”"``."""
        return f"the {self.subject.group_label.lower()} “{group}”"

    def name_of(self, measure: Measure) -> str:
        """``"height"``, or where the label alone would not do: ``"figure for “Seats”"``."""
        return (
            measure.label[0].lower() + measure.label[1:] if measure.unit else f"figure for “{measure.label}”"
        )

    def opening(self) -> str:
        """A way to begin."""
        entry = self.site.word("entry")
        ways = (f"open the {entry} on", f"look at the {entry} on", f"read the {entry} about")
        return self.rng.choice(ways)

    # --- moves ------------------------------------------------------------------------------------------

    def open(self, article: Article) -> tuple[Move, ...]:
        """Get to an article by searching for it."""
        path = self.site.article_path(article)
        return (Fill(self.site.word("search"), article.title), Click(path=path))

    def go(self, name: str) -> Click:
        """Click a menu entry."""
        return Click(path=self.site.path(f"/~{name}"))

    def filtered(self, *choices: tuple[str, str], sort: tuple[str, str] | None = None) -> list[Move]:
        """From the front page to the list with these dropdowns chosen, sorted by (label, direction)."""
        site = self.site
        moves: list[Move] = [self.go("list"), *(Choose(label, option) for label, option in choices)]
        if sort is not None and not site.headers:
            moves.append(Choose(site.word("sort"), site.word(*_way(sort[1]), label=sort[0])))
        if not site.submits:
            moves.append(Click(name=site.word("apply"), role="button"))
        if sort is not None and site.headers:
            label, direction = sort
            first = "asc" if label == self.subject.event[0] else "desc"
            moves += [Click(name=f"Sort by {label}")] * (1 if direction == first else 2)
        return moves

    def next_page(self, path: str, number: int) -> Click:
        """From one page of a list to the next."""
        if self.site.look.pager == "numbers":
            return Click(path=f"{path}?page={number}")
        return Click(name="Next" if self.site.look.pager == "steps" else "Load more")

    # --- proofs -----------------------------------------------------------------------------------------

    def on(self, path: str, **query: str) -> str:
        """A pattern for a page with at least these query parameters."""
        wanted = "".join(rf"(?=.*[?&]{key}={re.escape(value)}(?:&|$))" for key, value in query.items())
        return re.escape(path) + r"(?=\?|$)" + wanted

    def on_article(self, article: Article) -> str:
        """A pattern for an article's page."""
        return self.on(self.site.article_path(article))

    def on_person(self, person: Person) -> str:
        """A pattern for a biography."""
        return self.on(self.site.person_path(person))

    def on_lists(self) -> str:
        """A pattern for every page that shows rows of articles."""
        return f"{self.on(self.site.path('/~list'))}|{re.escape(self.site.path('/~group/'))}"

    def on_group(self, group: str) -> str:
        """A pattern for lists that are narrowed to a group."""
        table = self.on(self.site.path("/~list"), group=slug(group))
        return f"{table}|{self.on(self.site.group_path(group))}"

    def on_ranking(self, group: str, key: str) -> str:
        """A pattern for lists in which the first of a group can be told."""
        return f"{self.on_group(group)}|{self.on(self.site.path('/~list'))}(?=.*[?&]sort={key}-)"

    def on_comparison(self, *articles: Article) -> str:
        """A pattern for comparisons with these articles."""
        path = re.escape(self.site.path("/~compare"))
        return path + r"\?" + "".join(rf"(?=(?:.*&)?[ab]={re.escape(a.slug)}(?:&|$))" for a in articles)

    def boxed(self, article: Article, label: str, value: str, key: str = "") -> tuple[Evidence, ...]:
        """Where a row of the infobox can be read; ``key`` of a measure, or ``"year"``."""
        found = [
            Evidence((label, value), self.on_article(article)),
            Evidence((label, value), self.on_comparison(article)),
        ]
        if key in dict(self.site.sort_keys()):
            found.append(Evidence((article.title, value), self.on_lists()))
        if key == "year":
            found.append(Evidence((f"in {value}",), self.on_article(article)))
            found.append(Evidence((article.title, value), self.on(self.site.path("/~timeline"))))
            found.append(Evidence((article.title, value), self.on_person(article.person)))
        return tuple(found)

    def measured(self, article: Article, measure: Measure) -> tuple[Evidence, ...]:
        """Where a measure of an article can be read."""
        return self.boxed(article, measure.label, self.value(article, measure), measure.key)

    def value(self, article: Article, measure: Measure) -> str:
        """A measure as pages show it."""
        return measure.show(article.numbers[measure.key])


def _way(direction: str) -> tuple[str]:
    return ("down",) if direction == "desc" else ("up",)
