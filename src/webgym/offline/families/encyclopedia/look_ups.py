"""Parts that are solved by reading articles."""

from __future__ import annotations

from webgym.core.truth import Choose, Click, Evidence, Move, See
from webgym.offline.families._phrases import day_texts, figure, listing, word
from webgym.offline.families.encyclopedia.desk import Desk
from webgym.offline.families.encyclopedia.schema import Article
from webgym.offline.parts import Fact, Part


class LookUps(Desk):
    """Writes parts about one or two known articles."""

    def _readable(self, article: Article) -> list[tuple[str, Fact, str]]:
        """What can be asked about an article's infobox: (words, fact, value)."""
        subject, title = self.subject, article.title
        found = []
        for measure in self.stock.measures:
            name, value = self.name_of(measure), self.value(article, measure)
            fact = Fact(
                f"the {name} of {title} is found",
                self.measured(article, measure),
                answer=figure(article.numbers[measure.key]),
            )
            found.append((f"its {name}" if measure.unit else f"the {name}", fact, value))
        for label, value in ((t.label, article.traits[t.key]) for t in subject.traits):
            fact = Fact(
                f"what is said about {title} under “{label}” is found",
                self.boxed(article, label, value),
                answer=word(value),
            )
            found.append((f"what it says under “{label}”", fact, value))
        fact = Fact(
            f"the year for “{subject.event[0]}” of {title} is found",
            self.boxed(article, subject.event[0], str(article.year), "year"),
            answer=(str(article.year),),
        )
        found.append((f"the year given under “{subject.event[0]}”", fact, str(article.year)))
        fact = Fact(
            f"the place for “{subject.place}” of {title} is found",
            self.boxed(article, subject.place, article.place),
            answer=(article.place,),
        )
        found.append((f"the place given under “{subject.place}”", fact, article.place))
        return found

    def look_up(self, count: int) -> Part | None:
        """Some rows of an infobox."""
        article = self.fresh()
        if article is None:
            return None
        readable = self._readable(article)
        rows = sorted(self.rng.sample(range(len(readable)), count))
        chosen = [readable[row] for row in rows]
        return Part(
            ask=f"{self.opening()} {article.title} and give {listing([words for words, _, _ in chosen])}",
            description=f"Infobox of {article.title}",
            facts=tuple(fact for _, fact, _ in chosen),
            moves=(*self.open(article), *self._see_rows([value for _, _, value in chosen])),
            says=f"{article.title}: {', '.join(value for _, _, value in chosen)}.",
        )

    def _see_rows(self, values: list[str]) -> list[Move]:
        # One after the other: two rows of an infobox may not fit into one view.
        return [See((value,)) for value in values]

    def detail(self) -> Part | None:
        """A number in the running text."""
        article = self.fresh()
        if article is None:
            return None
        section = self.rng.choice(self.subject.sections)
        value = article.details[section.title]
        mark = section.detail.mark.format(n=f"{value:,}")
        moves: list[Move] = [*self.open(article)]
        if self.site.look.detail == "tabs":
            moves.append(Click(name=section.title, role="tab"))
        elif self.site.look.detail == "accordion":
            moves.append(Click(name=section.title))
        return Part(
            ask=f"{self.opening()} {article.title} and find out {section.detail.ask}",
            description=f"“{section.title}” of {article.title}",
            facts=(
                Fact(
                    f"{section.detail.fact} is found for {article.title}",
                    (Evidence((mark,), self.on_article(article)),),
                    answer=figure(value),
                ),
            ),
            moves=(*moves, See((mark,))),
            says=f"{article.title}: {mark}.",
        )

    def _pair(self) -> tuple[Article, Article] | None:
        first = self.fresh()
        second = self.fresh()
        return (first, second) if first and second else None

    def _compared(self, first: Article, second: Article) -> list[Move]:
        noun = self.subject.noun
        return [
            self.go("compare"),
            Choose(f"First {noun}", first.title),
            Choose(f"Second {noun}", second.title),
            Click(name="Show comparison", role="button"),
        ]

    def difference(self) -> Part | None:
        """Two figures and what lies between them."""
        pair = self._pair()
        if pair is None:
            return None
        measure = self.rng.choice(self.stock.measures)
        values = [self.value(article, measure) for article in pair]
        gap = abs(pair[0].numbers[measure.key] - pair[1].numbers[measure.key])
        name = self.name_of(measure)
        facts = [
            Fact(
                f"the {name} of {article.title} is found",
                self.measured(article, measure),
                answer=figure(article.numbers[measure.key]),
            )
            for article in pair
        ]
        computed = Fact(
            f"the difference between the two in {name} is given",
            self.measured(pair[0], measure) + self.measured(pair[1], measure),
            answer=figure(gap),
        )
        return Part(
            ask=f"give the {name} of {pair[0].title} and of {pair[1].title}, and the difference between "
            "the two",
            description=f"{measure.label} of {pair[0].title} and {pair[1].title}",
            facts=(*facts, computed),
            moves=(*self._compared(*pair), See((measure.label, *values))),
            says=f"{pair[0].title}: {values[0]}, {pair[1].title}: {values[1]}, "
            f"difference: {measure.show(gap)}.",
        )

    def which(self) -> Part | None:
        """Which of two has more."""
        pair = self._pair()
        if pair is None:
            return None
        measure = self.rng.choice(self.stock.measures)
        most = self.rng.random() < 0.6
        winner = (max if most else min)(pair, key=lambda article: article.numbers[measure.key])
        loser = pair[0] if winner is pair[1] else pair[1]
        values = tuple(self.value(article, measure) for article in pair)
        evidence = [Evidence((measure.label, *values), self.on_comparison(*pair))]
        if measure in self.stock.measures[:2]:
            titles = tuple(article.title for article in pair)
            evidence.append(Evidence((*titles, *values), self.on_lists()))
        kind = "larger" if most else "smaller"
        return Part(
            ask=f"use the comparison of two {self.subject.plural} to find out which has the {kind} "
            f"{self.name_of(measure)}, {pair[0].title} or {pair[1].title}, and name that one alone",
            description=f"Comparison of {pair[0].title} and {pair[1].title}",
            facts=(
                Fact(
                    f"the one of the two with the {kind} {self.name_of(measure)} is named",
                    tuple(evidence),
                    answer=(winner.title,),
                    wrong=(loser.title,),
                ),
            ),
            moves=(*self._compared(*pair), See((measure.label, *values))),
            says=f"It is {winner.title}.",
        )

    def origin(self) -> Part | None:
        """The person behind an article, and where and when they were born."""
        article = self.fresh()
        if article is None:
            return None
        person, subject = article.person, self.subject
        page = self.on_person(person)
        years = f"{person.born}–{person.died}"
        return Part(
            ask=f"find out who is named as “{subject.role}” in the {self.site.word('entry')} on "
            f"{article.title}, and in which year and in which town that person was born",
            description=f"“{subject.role}” of {article.title}",
            facts=(
                Fact(
                    f"the person named as “{subject.role}” of {article.title} is found",
                    (Evidence((subject.role, person.name), self.on_article(article)),),
                    answer=(person.name,),
                ),
                Fact(
                    "the year in which that person was born is found",
                    (
                        Evidence(("Born", str(person.born)), page),
                        Evidence((person.name, years), self.on(self.site.path("/~people"))),
                    ),
                    answer=(str(person.born),),
                ),
                Fact(
                    "the town in which that person was born is found",
                    (Evidence(("Birthplace", person.birthplace), page),),
                    answer=(person.birthplace,),
                ),
            ),
            moves=(
                *self.open(article),
                See((subject.role, person.name)),
                Click(path=self.site.person_path(person)),
                See(("Born", str(person.born), person.birthplace)),
            ),
            says=f"{subject.role}: {person.name}, born in {person.born} in {person.birthplace}.",
        )

    def earliest(self) -> Part | None:
        """The first of several articles of the same person."""
        people = self.rng.sample(self.stock.people, len(self.stock.people))
        for person in people:
            works = self.stock.works(person)
            if len(works) < 3 or works[0].year == works[1].year or not self.take(works):
                continue
            first, asked = works[0], self.rng.choice(works[1:])
            role = self.subject.role
            proof = (first.title, str(first.year))
            return Part(
                ask=f"find out who is named as “{role}” in the {self.site.word('entry')} on {asked.title}, "
                f"and which of the {self.subject.plural} listed in that person's biography is the earliest",
                description=f"“{role}” of {asked.title}",
                facts=(
                    Fact(
                        f"the person named as “{role}” of {asked.title} is found",
                        (Evidence((role, person.name), self.on_article(asked)),),
                        answer=(person.name,),
                    ),
                    Fact(
                        f"the earliest {self.subject.noun} in that person's biography is found",
                        (Evidence(proof, self.on_person(person)),),
                        answer=(first.title,),
                        wrong=tuple(work.title for work in works[1:4] if work is not asked),
                    ),
                ),
                moves=(
                    *self.open(asked),
                    See((role, person.name)),
                    Click(path=self.site.person_path(person)),
                    See(proof),
                ),
                says=f"{person.name}; the earliest is {first.title} ({first.year}).",
            )
        return None

    def version(self) -> Part | None:
        """The last edit of an article."""
        article = self.fresh()
        if article is None:
            return None
        last = article.revisions[0]
        dates = day_texts(last.day)
        day = dates[0]
        path = f"{self.site.article_path(article)}/history"
        row = (day, last.editor, last.comment)
        proof = [Evidence(row, self.on(path))]
        if (article, last) in self.stock.changes:
            proof.append(Evidence((article.title, *row), self.on(self.site.path("/~changes"))))
        what = f"the last change to the {self.site.word('entry')} on {article.title}"
        return Part(
            ask=f"find out on which day {what} was made, which editor made it, and what its summary says",
            description=f"Last change to {article.title}",
            facts=(
                Fact(
                    f"the day of {what} is found",
                    (*proof, Evidence((f"Last changed on {day}",), self.on_article(article))),
                    answer=dates,
                ),
                Fact(f"the editor of {what} is found", tuple(proof), answer=(last.editor,)),
                Fact(f"the summary of {what} is found", tuple(proof), answer=(last.comment,)),
            ),
            moves=(*self.open(article), Click(path=path), See(row)),
            says=f"{day}, {last.editor}: {last.comment}.",
        )

    def citation(self) -> Part | None:
        """The number in the dialog that tells how to cite."""
        article = self.fresh()
        if article is None:
            return None
        return Part(
            ask=f"{self.opening()} {article.title} and give the permanent number under which it is cited",
            description=f"Citation of {article.title}",
            facts=(
                Fact(
                    f"the permanent number for citing {article.title} is found",
                    (Evidence(("Permanent number", str(article.number)), self.on_article(article)),),
                    answer=(str(article.number), f"{article.number:,}"),
                ),
            ),
            moves=(
                *self.open(article),
                Click(name=self.site.word("cite"), role="button"),
                See(("Permanent number", str(article.number))),
                Click(name="Close", role="button"),
            ),
            says=f"{article.title} has the permanent number {article.number}.",
        )
