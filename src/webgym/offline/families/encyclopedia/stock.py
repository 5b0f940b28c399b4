"""The contents of an encyclopedia, made from a seed and a subject."""

from __future__ import annotations

import random
from dataclasses import dataclass
from datetime import timedelta
from functools import cached_property

from webgym.offline import names
from webgym.offline.families.encyclopedia.schema import (
    NONE,
    STOCK,
    Article,
    Measure,
    Person,
    Revision,
    Subject,
)
from webgym.offline.seeds import stream
from webgym.offline.website import TODAY, slug

KINDS = ("Wrong figure", "Outdated figure", "Spelling", "Missing source", "Wrong picture", "Broken link")
"""What a correction can be about."""
OFTEN = ("Every week", "Every month", "Every quarter")
"""How often the newsletter can come."""
OVERVIEW = "Overview"
"""Title of the first section, which has no detail."""
RECENT = 44
"""How many of the latest edits the page of recent changes lists."""
CHANGES_PER_PAGE = 12


@dataclass(frozen=True)
class Catalogue:
    """Everything that stands in one encyclopedia.

    Attributes:
        measures: the numbers that this encyclopedia gives, the first two also in lists.
        groups: names of groups that it covers.
        articles: in alphabetical order.
    """

    subject: Subject
    measures: tuple[Measure, ...]
    groups: tuple[str, ...]
    articles: tuple[Article, ...]
    people: tuple[Person, ...]

    @cached_property
    def by_slug(self) -> dict[str, Article]:
        """Articles by slug."""
        return {article.slug: article for article in self.articles}

    @cached_property
    def person_by_slug(self) -> dict[str, Person]:
        """People by slug."""
        return {person.slug: person for person in self.people}

    @cached_property
    def changes(self) -> list[tuple[Article, Revision]]:
        """The latest edits, newest first."""
        edits = [(article, revision) for article in self.articles for revision in article.revisions]
        edits.sort(key=lambda edit: (-edit[1].day.toordinal(), edit[0].title))
        return edits[:RECENT]

    def members(self, group: str) -> list[Article]:
        """The articles of a group, in alphabetical order."""
        return [article for article in self.articles if article.group == group]

    def works(self, person: Person) -> list[Article]:
        """The articles that name a person, oldest first."""
        found = [article for article in self.articles if article.person == person]
        return sorted(found, key=lambda article: (article.year, article.title))

    def letters(self) -> list[str]:
        """First letters of titles, in order."""
        return sorted({initial(article.title) for article in self.articles})


def initial(title: str) -> str:
    """The letter under which a title is listed; an article in front does not count."""
    for lead in ("The ", "A "):
        title = title.removeprefix(lead)
    return title[0]


def make(seed: int, subject: Subject) -> Catalogue:
    """The contents that belong to a seed."""
    rng = stream(seed, "encyclopedia")
    measures = tuple(rng.sample(subject.measures, 4))
    groups = rng.sample(list(subject.groups.items()), min(len(subject.groups), rng.randint(5, 6)))
    per_group = rng.randint(6, 9)
    titles = _titles(rng, subject, groups, per_group)
    people = _people(rng, subject, max(6, len(titles) // 4))
    places = names.towns(rng, rng.randint(7, 12))
    values = {m.key: _different(rng, m, len(titles)) for m in measures}
    lacking = {group: rng.choice([t for t, g in titles if g == group]) for group, _ in groups}
    editors = [f"{given}{rng.choice(names.SECOND).title()}" for given in rng.sample(names.GIVEN, 14)]
    articles = []
    for index, (title, group) in enumerate(titles):
        person = rng.choice(people)
        place = rng.choice(places)
        numbers = {key: column[index] for key, column in values.items()}
        year = rng.randint(person.born + 22, min(person.died, 2012))
        lacks = lacking[group] == title
        articles.append(
            Article(
                title=title,
                slug=slug(title),
                group=group,
                numbers=numbers,
                traits={trait.key: rng.choice(trait.values) for trait in subject.traits},
                lacking=NONE if lacks else rng.choice(subject.lack.values),
                year=year,
                person=person,
                place=place,
                texts=_texts(rng, subject, title, group, place, person),
                details={s.title: rng.randint(s.detail.low, s.detail.high) for s in subject.sections},
                seealso=tuple(slug(other) for other, _ in rng.sample(titles, 4) if other != title)[:3],
                revisions=_revisions(rng, editors),
                number=rng.randint(100_000, 999_999),
            )
        )
    articles.sort(key=lambda article: (article.title.removeprefix("The ").removeprefix("A "), article.title))
    return Catalogue(subject, measures, tuple(sorted(group for group, _ in groups)), tuple(articles), people)


def _titles(
    rng: random.Random, subject: Subject, groups: list[tuple[str, tuple[str, ...]]], per_group: int
) -> list[tuple[str, str]]:
    """Different titles with their groups; in one group a first word comes once."""
    found: dict[str, str] = {}
    for group, seconds in groups:
        size = per_group + rng.randint(-1, 2)
        firsts = STOCK.words[subject.first]
        for first in rng.sample(firsts, len(firsts)):
            second = rng.choice(seconds or subject.second)
            title = subject.pattern.format(first=first, second=second)
            if title not in found:
                found[title] = group
                size -= 1
            if not size:
                break
    return list(found.items())


def _people(rng: random.Random, subject: Subject, count: int) -> tuple[Person, ...]:
    towns = names.towns(rng, count)  # each born in a town of their own
    made = []
    for name, town in zip(names.people(rng, count), towns, strict=True):
        born = rng.randint(*subject.era)
        died = min(born + rng.randint(48, 91), 2014)
        made.append(Person(name, slug(name), born, died, town, rng.choice(STOCK.schools), subject.profession))
    return tuple(sorted(made, key=lambda person: person.name.split()[::-1]))


def _different(rng: random.Random, measure: Measure, count: int) -> list[int]:
    """Values for ``count`` articles, no two the same."""
    return rng.sample(range(measure.low, measure.high + 1, measure.step), count)


def _texts(
    rng: random.Random, subject: Subject, title: str, group: str, place: str, person: Person
) -> dict[str, list[str]]:
    """For every section, sentences that stand before and after the one with the detail."""
    sentences = rng.sample(STOCK.fillers, 8)
    texts = {}
    for heading, fillers in ((OVERVIEW, ()), *((s.title, s.fillers) for s in subject.sections)):
        own = [*fillers, *(sentences.pop() for _ in range(2 if fillers else 4))]
        texts[heading] = [
            text.format(title=title, plural=subject.plural, group=group, place=place, person=person.name)
            for text in own
        ]
    return texts


def _revisions(rng: random.Random, editors: list[str]) -> tuple[Revision, ...]:
    ages = sorted(rng.sample(range(3, 520), rng.randint(3, 6)))
    return tuple(
        Revision(
            TODAY - timedelta(days=age),
            rng.choice(editors),
            rng.choice(STOCK.comments),
            rng.randint(-180, 940),
        )
        for age in ages
    )
