"""Questions about single adverts, employers, pay and advice of the job boards."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Move, See
from webgym.offline.families._asking import count, exactly, quantity, shown
from webgym.offline.families._listed import at, unfold
from webgym.offline.families.jobs import deeds
from webgym.offline.families.jobs.catalog import LEVELS, Job
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream
from webgym.offline.website import slug

if TYPE_CHECKING:
    from webgym.offline.families.jobs import Jobs


def money(site: Jobs, value: int) -> tuple[str, ...]:
    """Ways to say an amount: "£38,500", "38,500", "38500"."""
    return site.money(value), f"{site.currency}{value}", f"{value:,}", str(value)


class OneAdvert:
    """Things to look up on single pages."""

    def __init__(self, site: Jobs) -> None:
        self.site = site
        self.rng = stream(site.seed, "one")
        rows = [(level, row) for level in LEVELS[1:] for row in site.pay[level]]
        self._rows = iter(self.rng.sample(rows, len(rows)))

    # --- adverts ---------------------------------------------------------------------------------

    def pay(self, job: Job) -> Part:
        site, called = self.site, deeds.named(job)
        text = site.range(job)
        seen = (
            shown(at(site, job), text),
            shown(exactly(site.finder.path), job.title, text),
            shown(exactly(site.path("/~firms/{slug}", slug=job.company.slug)), job.title, text),
        )
        return Part(
            f"find out what the job {called} pays a year at least and at most",
            f"Pay of {called}",
            (
                Fact(f"The lowest pay for {called} is found", seen, answer=money(site, job.low)),
                Fact(f"The highest pay for {called} is found", seen, answer=money(site, job.high)),
            ),
            (*deeds.go(site, job), See((text,))),
            f"It pays {text} a year.",
        )

    def terms(self, job: Job) -> Part:
        site, called, here = self.site, deeds.named(job), at(self.site, job)
        hours, leave = f"{job.hours} hours a week", f"{job.leave} days of holiday"
        start = f"Starts on {job.starts}"
        day, month = job.starts.split(" ")
        return Part(
            f"look up the weekly hours, the days of holiday and the starting date of the job {called}",
            f"Conditions of {called}",
            (
                Fact(
                    f"The weekly hours of {called} are found",
                    (shown(here, hours),),
                    answer=quantity(str(job.hours), "hours", "h"),
                ),
                Fact(
                    f"The days of holiday of {called} are found",
                    (shown(here, leave),),
                    answer=quantity(str(job.leave), "days"),
                ),
                Fact(
                    f"The starting date of {called} is found",
                    (shown(here, start),),
                    answer=(job.starts, f"{month} {day}", f"{day}st {month}", f"{month} {day}st"),
                ),
            ),
            (*deeds.go(site, job), *unfold(site, "terms"), See((hours, leave, start))),
            f"{hours}, {leave}, starting on {job.starts}.",
        )

    def contact(self, job: Job) -> Part:
        site, called, here = self.site, deeds.named(job), at(self.site, job)
        day = f"{job.closes.day} {job.closes:%B %Y}"
        return Part(
            f"find the contact person, the reference number and the last day to apply for the job {called}",
            f"How to apply for {called}",
            (
                Fact(
                    f"The contact person for {called} is found",
                    (shown(here, job.contact),),
                    answer=(job.contact,),
                ),
                Fact(
                    f"The reference number of {called} is found",
                    (shown(here, job.reference),),
                    answer=(job.reference,),
                ),
                Fact(
                    f"The last day to apply for {called} is found",
                    (shown(here, day), shown(exactly(site.finder.path), job.title, _short(job))),
                    answer=_dates(job),
                ),
            ),
            (*deeds.go(site, job), *unfold(site, "how"), See((job.contact, job.reference, day))),
            f"The contact is {job.contact}, the reference {job.reference}, the last day {day}.",
        )

    def profile(self, job: Job) -> Part:
        site, called, here = self.site, deeds.named(job), at(self.site, job)
        years = f"{job.years} {'year' if job.years == 1 else 'years'}"
        first, second = f"at least {years} of experience", f"Needed certificate: {job.paper}"
        return Part(
            f"find out how much experience and which certificate the job {called} asks for",
            f"What {called} asks for",
            (
                Fact(
                    f"The experience that {called} asks for is found", (shown(here, first),), answer=(years,)
                ),
                Fact(
                    f"The certificate that {called} asks for is found",
                    (shown(here, second),),
                    answer=(job.paper,),
                ),
            ),
            (*deeds.go(site, job), *unfold(site, "profile"), See((first, second))),
            f"It asks for {years} of experience and this certificate: {job.paper}.",
        )

    def employer(self, job: Job) -> Part:
        site, company = self.site, job.company
        path = site.path("/~firms/{slug}", slug=company.slug)
        here, staff = exactly(path), f"{company.employees:,} employees"
        lists = exactly(site.path("/~firms"))
        return Part(
            f"find out which employer has the opening {job.title}, in what year it was founded and "
            "how many people "
            "it employs",
            f"The employer behind {job.title}",
            (
                Fact(
                    f"The employer with the opening {job.title} is found",
                    (shown(at(site, job), company.name), shown(here, company.name, job.title)),
                    answer=(company.name,),
                    wrong=tuple(one.name for one in site.companies if one != company)[:2],
                ),
                Fact(
                    "The year the employer was founded is found",
                    (
                        shown(here, f"since {company.founded}"),
                        shown(lists, company.name, f"since {company.founded}"),
                    ),
                    answer=(str(company.founded),),
                ),
                Fact(
                    "The number of the employer's employees is found",
                    (shown(here, staff), shown(lists, company.name, staff)),
                    answer=(f"{company.employees:,}", str(company.employees)),
                ),
            ),
            (
                *deeds.go(site, job),
                See((company.name,)),
                Click(path=path),
                See((f"since {company.founded}", staff)),
            ),
            f"{company.name} has it; it was founded in {company.founded} and employs "
            f"{company.employees:,} people.",
        )

    def compare(self, jobs: Sequence[Job]) -> Part | None:
        """Holiday of two jobs, and the difference."""
        for more, less in zip(jobs[::2], jobs[1::2], strict=False):
            gap = more.leave - less.leave
            if gap < 2:
                continue
            site = self.site
            texts = [f"{job.leave} days of holiday" for job in (more, less)]
            seen = (shown(at(site, more), texts[0]), shown(at(site, less), texts[1]))
            moves: list[Move] = []
            for job, text in zip((more, less), texts, strict=True):
                moves += [*deeds.go(site, job), *unfold(site, "terms"), See((text,))]
            one, other = deeds.named(more), deeds.named(less)
            return Part(
                f"compare the holiday of the jobs {one} and {other}: give the days of both and the "
                "difference",
                "Holiday compared",
                (
                    Fact(
                        f"The days of holiday of {one} are found",
                        seen[:1],
                        answer=quantity(str(more.leave), "days"),
                    ),
                    Fact(
                        f"The days of holiday of {other} are found",
                        seen[1:],
                        answer=quantity(str(less.leave), "days"),
                    ),
                    Fact(
                        "The difference is worked out",
                        seen,
                        answer=quantity(str(gap), "days", "more", "days more"),
                    ),
                ),
                tuple(moves),
                f"{more.title} has {more.leave} days, {less.title} has {less.leave} days, a "
                f"difference of {gap} days.",
            )
        return None

    # --- employers -------------------------------------------------------------------------------

    def largest(self) -> Part:
        site = self.site
        ordered = sorted(site.companies, key=lambda company: -company.employees)
        big = ordered[0]
        staff = f"{big.employees:,} employees"
        path = site.path("/~firms")
        seen = (
            shown(exactly(path), big.name, staff),
            shown(exactly(site.path("/~firms/{slug}", slug=big.slug)), big.name, staff),
        )
        return Part(
            "find out which employer on the website has the most employees, and how many",
            "The largest employer",
            (
                Fact(
                    "The employer with the most employees is found",
                    seen,
                    answer=(big.name,),
                    wrong=tuple(company.name for company in ordered[1:3]),
                ),
                Fact(
                    "The number of its employees is found",
                    seen,
                    answer=(f"{big.employees:,}", str(big.employees)),
                ),
            ),
            (Click(path=path), See((big.name, staff))),
            f"It is {big.name} with {big.employees:,} employees.",
        )

    def old_or_big(self) -> Part | None:
        """Any employer that is old OR large will do."""
        site = self.site
        years = sorted(company.founded for company in site.companies)
        sizes = sorted((company.employees for company in site.companies), reverse=True)
        before, over = years[1] + 1, sizes[1] - 1
        good = [one for one in site.companies if one.founded < before or one.employees > over]
        if len(good) == len(site.companies):
            return None
        path = site.path("/~firms")
        goal = f"was founded before {before} OR has more than {over:,} employees"
        seen = [
            shown(place, one.name, f"since {one.founded}", f"{one.employees:,} employees")
            for one in good
            for place in (exactly(path), exactly(site.path("/~firms/{slug}", slug=one.slug)))
        ]
        best = good[0]
        return Part(
            f"name one employer on the website that {goal}",
            "An old or a large employer",
            (
                Fact(
                    f"An employer that {goal} is found",
                    tuple(seen),
                    answer=tuple(one.name for one in good),
                    wrong=tuple(one.name for one in site.companies if one not in good)[:3],
                ),
            ),
            (Click(path=path), See((best.name, f"since {best.founded}", f"{best.employees:,} employees"))),
            f"{best.name}.",
        )

    def without(self) -> Part | None:
        """The only advert of an employer that is not full-time."""
        site = self.site
        for company in site.companies:
            theirs = [job for job in site.jobs if job.company == company]
            odd = [job for job in theirs if job.contract != "Full-time"]
            if len(theirs) < 2 or len(odd) != 1:
                continue
            path = site.path("/~firms/{slug}", slug=company.slug)
            return Part(
                f"find out which of the open posts at {company.name} is not full-time",
                f"Open posts at {company.name}",
                (
                    Fact(
                        f"The post at {company.name} that is not full-time is found",
                        (
                            shown(exactly(path), odd[0].title, odd[0].contract),
                            shown(at(site, odd[0]), odd[0].title, odd[0].contract),
                        ),
                        answer=(odd[0].title,),
                        wrong=tuple(job.title for job in theirs if job != odd[0])[:3],
                    ),
                ),
                (Click(path=site.path("/~firms")), Click(path=path), See((odd[0].title, odd[0].contract))),
                f"{odd[0].title} is the only one.",
            )
        return None

    def benefit(self) -> Part:
        """How many benefits an employer names."""
        site = self.site
        company = self.rng.choice(site.companies)
        path = site.path("/~firms/{slug}", slug=company.slug)
        return Part(
            f"count the benefits that {company.name} offers",
            f"Benefits at {company.name}",
            (
                Fact(
                    f"The number of benefits at {company.name} is found",
                    (shown(exactly(path), *company.benefits),),
                    answer=count(len(company.benefits)),
                ),
            ),
            (Click(path=site.path("/~firms")), Click(path=path), See(company.benefits)),
            f"It offers {len(company.benefits)} benefits.",
        )

    # --- pay and advice --------------------------------------------------------------------------

    def _pay_at(self, level: str) -> tuple[str, tuple[Move, ...]]:
        path = self.site.path("/~pay")
        moves: tuple[Move, ...] = (Click(path=path),)
        if level == LEVELS[0]:
            return exactly(path), moves
        return rf"{re.escape(path)}\?(?:.*&)?level={slug(level)}(?:&|$)", (*moves, Choose("Level", level))

    def quarters(self) -> Part:
        """A row of the statistics."""
        site, (level, row) = self.site, next(self._rows)
        here, moves = self._pay_at(level)
        values = {"lower quarter": row.lower, "median": row.median, "upper quarter": row.upper}
        texts = tuple(site.money(value) for value in values.values())
        return Part(
            f"look up in the salary statistics the lower quarter, the median and the upper quarter of pay in "
            f"{row.field} for the level {level}",
            f"Pay in {row.field}, {level}",
            tuple(
                Fact(
                    f"The {name} of pay in {row.field} for the level {level} is found",
                    (shown(here, row.field, site.money(value)),),
                    answer=money(site, value),
                )
                for name, value in values.items()
            ),
            (*moves, See((row.field, *texts))),
            f"Lower quarter {texts[0]}, median {texts[1]}, upper quarter {texts[2]}.",
        )

    def top_median(self) -> Part | None:
        """The field with the highest median."""
        site, level = self.site, self.rng.choice(LEVELS)
        rows = sorted(site.pay[level], key=lambda row: -row.median)
        if rows[0].median == rows[1].median:
            return None
        best, text = rows[0], site.money(rows[0].median)
        here, moves = self._pay_at(level)
        return Part(
            "find out from the salary statistics which field has the highest median pay for the "
            f"level {level}, "
            "and how much it is",
            f"Highest median, {level}",
            (
                Fact(
                    f"The field with the highest median pay for the level {level} is found",
                    (shown(here, best.field, text),),
                    answer=(best.field,),
                    wrong=tuple(row.field for row in rows[1:3]),
                ),
                Fact(
                    "Its median pay is found",
                    (shown(here, best.field, text),),
                    answer=money(site, best.median),
                ),
            ),
            (*moves, See((best.field, text))),
            f"It is {best.field} with {text}.",
        )

    def spread(self) -> Part:
        """The distance between the quarters: one computation."""
        site, level = self.site, self.rng.choice(LEVELS)
        row = self.rng.choice(site.pay[level])
        here, moves = self._pay_at(level)
        low, high, gap = site.money(row.lower), site.money(row.upper), row.upper - row.lower
        return Part(
            f"work out from the salary statistics how far the upper quarter of pay in {row.field} is "
            "above the "
            f"lower quarter for the level {level}",
            f"Spread of pay in {row.field}",
            (
                Fact(
                    f"The distance between the quarters of pay in {row.field} for the level {level} "
                    "is worked out",
                    (shown(here, row.field, low, high),),
                    answer=money(site, gap),
                ),
            ),
            (*moves, See((row.field, low, high))),
            f"The upper quarter is {site.money(gap)} above the lower one.",
        )

    def advice(self, turn: int) -> Part:
        """Instructions, as one fact."""
        site = self.site
        guide = site.guides[turn]
        path = site.path("/~advice/{slug}", slug=guide.slug)
        skill = guide.title.removeprefix("How to ")
        key_step = next(step for step in guide.steps if guide.key in step)
        return Part(
            f"read the website's advice on how to {skill} and sum it up, with the figure it gives",
            f"How to {skill}",
            (
                Fact(
                    f"The instructions on how to {skill} are found",
                    (shown(exactly(path), key_step),),
                    answer=_figure(guide.key),
                ),
            ),
            (Click(path=site.path("/~advice")), Click(path=path), See((key_step,))),
            " ".join(guide.steps),
        )


_WORDS = {"two": "2", "three": "3", "four": "4", "five": "5", "six": "6"}


def _figure(key: str) -> tuple[str, ...]:
    word, _, rest = key.partition(" ")
    if word in _WORDS:
        return key, f"{_WORDS[word]} {rest}"
    return (key, f"{word}%", f"{word} %", f"{word} per cent") if rest == "percent" else (key,)


def _short(job: Job) -> str:
    return f"{job.closes.day} {job.closes:%b %Y}"


def _dates(job: Job) -> tuple[str, ...]:
    day = job.closes
    return (
        f"{day.day} {day:%B}",
        f"{day:%B} {day.day}",
        _short(job),
        f"{day.day} {day:%b}",
        f"{day:%b} {day.day}",
        day.isoformat(),
    )
