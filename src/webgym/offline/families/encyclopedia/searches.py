"""Parts that are solved with lists, filters and registers."""

from __future__ import annotations

from webgym.core.truth import Click, Evidence, Move, See
from webgym.offline.families._phrases import figure, nice_between
from webgym.offline.families.encyclopedia import stock
from webgym.offline.families.encyclopedia.desk import Desk
from webgym.offline.families.encyclopedia.schema import NONE, Article
from webgym.offline.parts import Fact, Part
from webgym.offline.website import slug


class Searches(Desk):
    """Writes parts that look for an article, or count articles."""

    def _ranked(self, group: str, key: str, *, most: bool) -> list[Article]:
        return sorted(self.stock.members(group), key=lambda a: a.numbers[key], reverse=most)

    def extreme(self) -> Part | None:
        """The first of a group by a measure."""
        measure = self.rng.choice(self.stock.measures[:2])
        most = self.rng.random() < 0.6
        for group in self.shuffled_groups():
            ranked = self._ranked(group, measure.key, most=most)
            first = ranked[0]
            if not self.take([first]):
                continue
            name, value = self.name_of(measure), self.value(first, measure)
            kind = measure.most if most else measure.least
            return Part(
                ask=f"find the {self.subject.noun} with the {kind} {name} in {self.group_words(group)} and "
                f"give that {name} too",
                description=f"{kind.capitalize()} {name} in {group}",
                facts=(
                    Fact(
                        f"the {self.subject.noun} with the {kind} {name} in {group} is found",
                        (Evidence((first.title, value), self.on_ranking(group, measure.key)),),
                        answer=(first.title,),
                        wrong=self.others(ranked[1:4], first),
                    ),
                    Fact(
                        f"its {name} is found",
                        self.measured(first, measure),
                        answer=figure(first.numbers[measure.key]),
                    ),
                ),
                moves=(*self._rank_moves(group, measure.label, most=most), See((first.title, value))),
                says=f"{first.title} with {value}.",
            )
        return None

    def _rank_moves(self, group: str, label: str, *, most: bool) -> list[Move]:
        chosen = (self.subject.group_label, group)
        return self.filtered(chosen, sort=(label, "desc" if most else "asc"))

    def top_three(self) -> Part | None:
        """The first three of a group, in order."""
        measure = self.rng.choice(self.stock.measures[:2])
        most = self.rng.random() < 0.7
        kind = measure.most if most else measure.least
        name = self.name_of(measure)
        for group in self.shuffled_groups():
            ranked = self._ranked(group, measure.key, most=most)
            top = ranked[:3]
            if not self.take(top):
                continue
            ranks = (f"the {kind}", f"the second {kind}", f"the third {kind}")
            wrong = self.others(ranked[3:6])
            values = [self.value(article, measure) for article in top]
            return Part(
                ask=f"name the three {self.subject.plural} with the {kind} {name} in "
                f"{self.group_words(group)}, in order",
                description=f"Three {self.subject.plural} with the {kind} {name} in {group}",
                facts=tuple(
                    Fact(
                        f"the {self.subject.noun} with {rank} {name} in {group} is found",
                        (Evidence((article.title, value), self.on_ranking(group, measure.key)),),
                        answer=(article.title,),
                        wrong=wrong,
                    )
                    for rank, article, value in zip(ranks, top, values, strict=True)
                ),
                moves=(
                    *self._rank_moves(group, measure.label, most=most),
                    *(See((article.title, value)) for article, value in zip(top, values, strict=True)),
                ),
                says=f"{top[0].title}, {top[1].title} and {top[2].title}.",
            )
        return None

    def count(self) -> Part | None:
        """How many articles of a group pass a filter."""
        trait = self.subject.traits[0]
        for group in self.shuffled_groups():
            members = self.stock.members(group)
            for value in self.rng.sample(trait.values, len(trait.values)):
                number = sum(article.traits[trait.key] == value for article in members)
                if number < 2:
                    continue
                pattern = self.on(self.site.path("/~list"), **{"group": slug(group), trait.key: slug(value)})
                said = self.site.count(number)
                return Part(
                    ask=f"find out how many {self.subject.plural} in {self.group_words(group)} are listed "
                    f"with “{value}” under “{trait.label}”",
                    description=f"{group} with {trait.label} {value}",
                    facts=(
                        Fact(
                            f"the number of {self.subject.plural} in {group} with “{value}” under "
                            f"“{trait.label}” is found",
                            (Evidence((said,), pattern),),
                            answer=figure(number),
                        ),
                    ),
                    moves=(
                        *self.filtered((self.subject.group_label, group), (trait.label, value)),
                        See((said,)),
                    ),
                    says=f"There are {said} of that kind.",
                )
        return None

    def lacking(self) -> Part | None:
        """The one of a group without something."""
        lack = self.subject.lack
        for group in self.shuffled_groups():
            members = self.stock.members(group)
            missing = [article for article in members if article.lacking == NONE]
            if len(missing) != 1 or not self.take(missing):
                continue
            found = missing[0]
            narrowed = f"{self.on_group(group)}|{self.on(self.site.path('/~list'), lack=slug(NONE))}"
            return Part(
                ask=f"find out which {self.subject.noun} in {self.group_words(group)} {lack.phrase}",
                description=f"{group}: {lack.label}",
                facts=(
                    Fact(
                        f"the {self.subject.noun} in {group} that {lack.phrase} is found",
                        (Evidence((found.title, NONE), narrowed),),
                        answer=(found.title,),
                        wrong=self.others(members, found),
                    ),
                ),
                moves=(
                    *self.filtered((self.subject.group_label, group), (lack.label, NONE)),
                    See((found.title, NONE)),
                ),
                says=f"It is {found.title}.",
            )
        return None

    def either(self) -> Part | None:
        """The one of a group of which one thing or another is true."""
        measure = self.rng.choice(self.stock.measures[:2])
        for group in self.shuffled_groups():
            first, second, *rest = self._ranked(group, measure.key, most=True)
            over = nice_between(second.numbers[measure.key], first.numbers[measure.key])
            before = min(article.year for article in (second, *rest)) // 5 * 5
            if not self.take([first]):
                continue
            name, value = self.name_of(measure), self.value(first, measure)
            terms = f"a {name} of more than {measure.show(over)} OR a year before {before} under "
            terms += f"“{self.subject.event[0]}”"
            return Part(
                ask=f"find the one {self.subject.noun} in {self.group_words(group)} that has {terms}",
                description=f"{group}: either of two conditions",
                facts=(
                    Fact(
                        f"the {self.subject.noun} in {group} that has {terms} is found",
                        (Evidence((first.title, value), self.on_ranking(group, f"(?:{measure.key}|year)")),),
                        answer=(first.title,),
                        wrong=self.others([second, *rest]),
                    ),
                ),
                moves=(*self._rank_moves(group, measure.label, most=True), See((first.title, value))),
                says=f"It is {first.title}.",
            )
        return None

    def in_year(self) -> Part | None:
        """The only article with a certain year."""
        years = [article.year for article in self.stock.articles]
        alone = [article for article in self.stock.articles if years.count(article.year) == 1]
        found = self.fresh(alone)
        if found is None:
            return None
        path = self.site.path("/~timeline")
        return Part(
            ask=f"find out which {self.subject.noun} {self.subject.event[1]} in {found.year}, and to which "
            f"{self.subject.group_label.lower()} it belongs",
            description=f"{self.subject.event[0]} {found.year}",
            facts=(
                Fact(
                    f"the {self.subject.noun} that {self.subject.event[1]} in {found.year} is found",
                    self.boxed(found, self.subject.event[0], str(found.year), "year"),
                    answer=(found.title,),
                    wrong=self.others(self.stock.articles, found),
                ),
                Fact(
                    f"its {self.subject.group_label.lower()} is found",
                    (
                        Evidence((self.subject.group_label, found.group), self.on_article(found)),
                        Evidence((found.title, found.group), self.on_lists()),
                        Evidence((found.title, found.group), self.on(self.site.path("/~index"))),
                    ),
                    answer=(found.group,),
                ),
            ),
            moves=(
                Click(path=path),
                See((str(found.year), found.title)),
                Click(path=self.site.article_path(found)),
                See((self.subject.group_label, found.group)),
            ),
            says=f"{found.title} ({found.group}).",
        )

    def letter_count(self) -> Part | None:
        """How many titles begin with a letter."""
        counts = {
            letter: sum(stock.initial(article.title) == letter for article in self.stock.articles)
            for letter in self.stock.letters()[1:]
        }
        letters = [letter for letter, number in counts.items() if number > 1]
        if not letters:
            return None
        letter = self.rng.choice(letters)
        said = self.site.count(counts[letter])
        path = self.site.path("/~index")
        return Part(
            ask=f"find out how many {self.subject.plural} the {self.site.word('index')} lists under the "
            f"letter {letter}",
            description=f"Letter {letter} of the register",
            facts=(
                Fact(
                    f"the number of {self.subject.plural} under the letter {letter} is found",
                    (Evidence((f"Letter {letter}", said), self.on(path, letter=letter)),),
                    answer=figure(counts[letter]),
                ),
            ),
            moves=(Click(path=path), Click(path=f"{path}?letter={letter}"), See((f"Letter {letter}", said))),
            says=f"There are {said} under {letter}.",
        )

    def busiest(self) -> Part | None:
        """The person with the most articles."""
        ranked = sorted(self.stock.people, key=lambda p: len(self.stock.works(p)), reverse=True)
        first, second = (len(self.stock.works(person)) for person in ranked[:2])
        if first == second:
            return None
        name = ranked[0].name
        path = self.site.path("/~people")
        return Part(
            ask=f"find out which person in the list “{self.site.word('people')}” has the most "
            f"{self.subject.plural}, and how many",
            description=f"Person with the most {self.subject.plural}",
            facts=(
                Fact(
                    f"the person with the most {self.subject.plural} is found",
                    (Evidence((name, str(first)), self.on(path)),),
                    answer=(name,),
                    wrong=tuple(person.name for person in ranked[1:4]),
                ),
                Fact(
                    f"the number of {self.subject.plural} of that person is found",
                    (Evidence((name, str(first)), self.on(path)),),
                    answer=figure(first),
                ),
            ),
            moves=(Click(path=path), See((name, str(first)))),
            says=f"{name} has {first}.",
        )

    def changes(self) -> Part | None:
        """An edit on a later page of the recent changes."""
        edits = self.stock.changes
        titles = [article.title for article, _ in edits]
        later = [
            (article, edit)
            for article, edit in edits[stock.CHANGES_PER_PAGE : 2 * stock.CHANGES_PER_PAGE]
            if titles.count(article.title) == 1 and article.title not in self.taken
        ]
        if not later:
            return None
        article, edit = self.rng.choice(later)
        self.taken.add(article.title)
        path = self.site.path("/~changes")
        row = (article.title, edit.editor, edit.comment)
        proof = (
            Evidence(row, self.on(path)),
            Evidence(row[1:], self.on(f"{self.site.article_path(article)}/history")),
        )
        name = self.site.word("changes")
        return Part(
            ask=f"look through “{name}” and find out who edited the {self.site.word('entry')} on "
            f"{article.title}, and with which summary",
            description=f"Edit of {article.title}",
            facts=(
                Fact(f"the editor of {article.title} is found", proof, answer=(edit.editor,)),
                Fact("the summary of that edit is found", proof, answer=(edit.comment,)),
            ),
            moves=(Click(path=path), self.next_page(path, 2), See(row)),
            says=f"{edit.editor}: {edit.comment}.",
        )
