"""What is asked for on the job boards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from webgym.core.truth import Click, Move, See
from webgym.offline.families._asking import compose, pages_at_most, shown
from webgym.offline.families._listed import at, how_many, last_page, unfold
from webgym.offline.families.jobs import deeds
from webgym.offline.families.jobs.catalog import Job, sector_of
from webgym.offline.families.jobs.one import OneAdvert, money
from webgym.offline.parts import Assignment, Fact, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.jobs import Jobs


_SETTINGS = {
    "On site": "are done on site",
    "Hybrid": "are hybrid",
    "Remote": "are remote",
    "Day shifts": "are in day shifts",
    "Night shifts": "are in night shifts",
    "Rotating shifts": "are in rotating shifts",
}


def assignments(site: Jobs) -> Iterator[Assignment]:
    """About 25 tasks before decomposition."""
    rng = stream(site.seed, "tasks")
    jobs = list(site.jobs)
    rng.shuffle(jobs)
    draw = iter(jobs)
    one, many, do = OneAdvert(site), Lists(site), deeds.Deeds(site)
    singles: dict[str, Part | None] = {
        "pay": one.pay(next(draw)),
        "profile": one.profile(next(draw)),
        "terms": one.terms(next(draw)),
        "largest": one.largest(),
        "old-or-big": one.old_or_big(),
        "not-full-time": one.without(),
        "benefits": one.benefit(),
        "top-median": one.top_median(),
        "spread": one.spread(),
        "advice": one.advice(0),
        "best-paid": many.extreme("pay", 0),
        "closing": many.extreme("closing", 1),
        "worst-paid": many.worst_paid(),
        "count": many.count(0),
        "either": many.either(),
        "apply": do.apply(next(draw)),
        "alert": do.alert(0),
        "save": do.save(next(draw)),
        "status": do.status(),
        "withdraw": do.withdraw(),
    }
    for name, part in singles.items():
        yield from compose(name, [part])
    composed: dict[str, list[Part | None]] = {
        "contact-and-quarters": [one.contact(next(draw)), one.quarters()],
        "employer-and-count": [one.employer(next(draw)), many.count(1)],
        "best-and-terms": [many.extreme("pay", 3, deeper=True), one.terms(next(draw))],
        "compare-apply-advice": [one.compare(jobs), do.apply(next(draw)), one.advice(1)],
        "closing-and-alert": [many.extreme("closing", 4, deeper=True), do.alert(1)],
        "quarters-contact-save": [one.quarters(), one.contact(next(draw)), do.save(next(draw))],
    }
    for name, parts in composed.items():
        yield from compose(name, parts)


class Lists:
    """Things to find by filters and orders."""

    def __init__(self, site: Jobs) -> None:
        self.site = site

    def extreme(self, sort: str, turn: int, *, deeper: bool = False) -> Part | None:
        """The first in an order among the jobs that one or two filters leave."""
        site = self.site
        facets = [
            facet for facet in site.finder.facets if facet.name in ("field", "town", "place", "contract")
        ]
        first, second = stream(site.seed, "facets", turn).sample(facets, 2)
        options: list[dict[str, str]] = [
            {first.name: a} | ({second.name: b} if turn % 2 else {})
            for a, _ in first.options
            for b, _ in second.options
        ]
        stream(site.seed, "extreme", sort, turn).shuffle(options)
        for chosen in options:
            found = site.find(**chosen, sort=sort)
            values = [job.high if sort == "pay" else job.closes.toordinal() for job in found]
            if len(found) >= 3 and values[0] != values[1]:
                kind = " and ".join(self._described(name, value) for name, value in sorted(chosen.items()))
                return self._extreme(found, chosen, sort, kind, deeper=deeper)
        return None

    def _extreme(
        self, found: list[Job], chosen: dict[str, str], sort: str, kind: str, *, deeper: bool
    ) -> Part:
        site, best = self.site, found[0]
        lists, here = site.finder.regex(**chosen), at(site, best)
        day = best.closes
        if sort == "pay":
            rank, what, text, answer = (
                "can pay the most",
                "highest pay",
                site.range(best),
                money(site, best.high),
            )
            says = f"{best.title}, with up to {site.money(best.high)}"
        else:
            text = f"{day.day} {day:%b %Y}"
            rank, what = "closes first", "closing date"
            answer = (
                text,
                f"{day.day} {day:%B}",
                f"{day:%B} {day.day}",
                f"{day:%b} {day.day}",
                day.isoformat(),
            )
            says = f"{best.title}, which closes on {text}"
        inside = text if sort == "pay" else f"{day.day} {day:%B %Y}"
        seen = (shown(lists, best.title, text), shown(here, best.title, inside))
        values = (shown(lists, best.title, text), shown(here, inside))
        facts = [
            Fact(
                f"Of the jobs that {kind}, the one that {rank} is found",
                seen,
                answer=(best.title,),
                wrong=tuple(job.title for job in found[1:4]),
            ),
            Fact(f"Its {what} is found", values, answer=answer),
        ]
        moves: list[Move] = [
            Click(path=site.finder.path),
            *site.finder.moves(**chosen, sort=sort),
            See((best.title, text)),
        ]
        if deeper:
            facts.append(
                Fact("Its contact person is found", (shown(here, best.contact),), answer=(best.contact,))
            )
            moves += [Click(path=site.href(best)), *unfold(site, "how"), See((best.contact,))]
            says += f"; the contact is {best.contact}"
        asked = f"its title, its {what} and its contact person" if deeper else f"its title and its {what}"
        return Part(
            f"find out which of the jobs that {kind} {rank}, and give {asked}",
            f"The job that {rank}",
            tuple(facts),
            tuple(moves),
            f"It is {says}.",
        )

    def _described(self, name: str, value: str) -> str:
        facet = next(facet for facet in self.site.finder.facets if facet.name == name)
        text = facet.text(value)
        return {
            "field": f"are in {text}",
            "town": f"are in the town of {text}",
            "place": _SETTINGS.get(text, ""),
            "contract": f"are {text.lower()}",
            "level": f"are for the level {text}",
            "floor": f"pay at least {text}",
        }[name]

    def worst_paid(self) -> Part | None:
        """The last of an order, on the last page of a list of several."""
        site = self.site
        for field, text in site.finder.facets[0].options:
            found = site.find(field=field, sort="pay")
            pages = -(-len(found) // site.page_size)
            if not 2 <= pages <= pages_at_most(site.look) or found[-1].high == found[-2].high:
                continue
            last = found[-1]
            pay = site.range(last)
            here = site.finder.regex(field=field)
            seen = (shown(here, last.title, pay), shown(at(site, last), last.title, pay))
            return Part(
                f"find out which of the jobs in {text} has the lowest upper end of the salary range, "
                "and how much that is",
                f"The job in {text} with the lowest top pay",
                (
                    Fact(
                        f"Of the jobs in {text}, the one whose highest pay is the lowest is found",
                        seen,
                        answer=(last.title,),
                        wrong=tuple(job.title for job in found[-3:-1]),
                    ),
                    Fact("Its highest pay is found", seen, answer=money(site, last.high)),
                ),
                (
                    Click(path=site.finder.path),
                    *site.finder.moves(field=field, sort="pay"),
                    *last_page(site, pages),
                    See((last.title, pay)),
                ),
                f"{last.title} pays {site.money(last.high)} at most.",
            )
        return None

    def count(self, turn: int) -> Part | None:
        """How many jobs two filters leave."""
        filters = [("field", "place"), ("town", "contract"), ("contract", "floor")]
        return how_many(self.site, turn, filters, "jobs", self._kind)

    def _kind(self, chosen: dict[str, str]) -> str:
        return " and ".join(self._described(name, value) for name, value in chosen.items())

    def either(self) -> Part | None:
        """Any job in a field that is remote OR pays well will do."""
        site = self.site
        for field, text in site.finder.facets[0].options[::-1]:
            found = site.find(field=field, sort="pay")
            if len(found) < 5:
                continue
            top = found[1].low // 1000 * 1000
            good = [job for job in found if job.place in ("Remote", "Night shifts") or job.low >= top]
            if not 2 <= len(good) <= 6 or len(good) == len(found) or found[1] not in good:
                continue
            special = "is remote" if not sector_of(site.sector).shifts else "is in night shifts"
            goal = f"{special} OR pays at least {site.money(top)}"
            lists, best = site.finder.regex(field=field), found[1]
            seen = [shown(lists, job.title, job.place, site.range(job)) for job in good]
            seen += [shown(at(site, job), job.title) for job in good]
            return Part(
                f"name one job in {text} that {goal} a year even at the lower end",
                f"A remote or well paid job in {text}",
                (
                    Fact(
                        f"A job in {text} is found that {goal} a year even at the lower end",
                        tuple(seen),
                        answer=tuple(job.title for job in good),
                        wrong=tuple(job.title for job in found if job not in good)[:3],
                    ),
                ),
                (
                    Click(path=site.finder.path),
                    *site.finder.moves(field=field, sort="pay"),
                    See((best.title, best.place, site.range(best))),
                ),
                f"{best.title}.",
            )
        return None
