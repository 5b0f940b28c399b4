"""What a job board holds: employers, adverts, pay statistics, advice, and one visitor's account."""

from __future__ import annotations

import random
from dataclasses import dataclass
from datetime import date, timedelta

from webgym.offline import names
from webgym.offline.families.jobs.words import WORDS, Sector
from webgym.offline.seeds import stream
from webgym.offline.website import TODAY, slug

LEVELS = ("Entry level", "Mid level", "Senior", "Lead")
CONTRACTS = ("Full-time", "Part-time", "Fixed-term", "Freelance")
PLACES = ("On site", "Hybrid", "Remote")
SHIFTS = ("Day shifts", "Night shifts", "Rotating shifts")
CURRENCIES = ("£", "€", "$")


@dataclass(frozen=True)
class Company:
    """An employer."""

    slug: str
    name: str
    town: str
    founded: int
    employees: int
    rating: float
    benefits: tuple[str, ...]
    about: str


@dataclass(frozen=True)
class Job:
    """An advert. Pay is yearly, in the board's currency.

    Attributes:
        place: from where one works, or in what shifts.
        posted, closes: the first and the last day.
        hours: in a week.
        leave: days of holiday in a year.
        years: of experience asked for.
    """

    slug: str
    title: str
    reference: str
    field: str
    company: Company
    town: str
    level: str
    contract: str
    place: str
    low: int
    high: int
    posted: date
    closes: date
    starts: str
    hours: int
    leave: int
    years: int
    paper: str
    skills: tuple[str, ...]
    duties: tuple[str, ...]
    contact: str

    @property
    def age(self) -> int:
        """Days since it was posted."""
        return (TODAY - self.posted).days


@dataclass(frozen=True)
class PayRow:
    """Yearly pay in one field at one level."""

    field: str
    lower: int
    median: int
    upper: int
    adverts: int


@dataclass(frozen=True)
class Guide:
    """A piece of advice; ``key`` is what every summary must contain."""

    slug: str
    title: str
    steps: tuple[str, ...]
    key: str


@dataclass(frozen=True)
class Application:
    """One that the visitor's account sent before."""

    job: Job
    sent: date
    stage: str
    next_day: date


@dataclass(frozen=True)
class Account:
    """The account that a visitor can sign in to."""

    name: str
    email: str
    password: str
    applications: tuple[Application, ...]


def make_companies(seed: int, sector: Sector, towns: list[str]) -> tuple[Company, ...]:
    """Nine to thirteen employers, no two with the same size or year."""
    rng = stream(seed, "companies")
    count = rng.randint(9, 13)
    stems = names.stems(seed, "companies")[:count]
    years = rng.sample(range(1891, 2021), count)
    sizes = rng.sample(range(14, 6200), count)
    ratings = rng.sample(range(29, 50), count)
    found = []
    for stem, year, size, rating in zip(stems, years, sizes, ratings, strict=True):
        name, town = f"{stem} {rng.choice(sector.companies)}", rng.choice(towns)
        about = rng.choice(
            (
                f"Started in {town} with one room and a borrowed van, and still run by its own people.",
                f"The best known name of the trade in {town}, often asked for advice by the others.",
                f"A quiet employer in {town} where most people stay for a decade.",
                f"Growing in {town} and around, and looking for people who like to build things up.",
            )
        )
        benefits = tuple(rng.sample(WORDS.benefits, rng.randint(3, 5)))
        found.append(Company(slug(name), name, town, year, size, rating / 10, benefits, about))
    return tuple(found)


def make_jobs(seed: int, sector: Sector, towns: list[str], companies: tuple[Company, ...]) -> tuple[Job, ...]:
    """Between 38 and 64 adverts; no title is part of another."""
    rng = stream(seed, "jobs")
    titles = [
        (field, f"{special} {role}")
        for field, roles in sector.fields.items()
        for role in roles
        for special in sector.specials
    ]
    rng.shuffle(titles)
    count = rng.randint(38, 64)
    found: list[Job] = []
    for field, title in titles:
        # A title inside another would make "the page shows this title" ambiguous.
        if len(found) < count and not any(title in job.title or job.title in title for job in found):
            found.append(_job(rng, sector, towns, rng.choice(companies), field, title, len(found)))
    return tuple(found)


def _job(
    rng: random.Random,
    sector: Sector,
    towns: list[str],
    company: Company,
    field: str,
    title: str,
    nth: int,
) -> Job:
    level = rng.choice(LEVELS)
    middle = sector.pay * (0.72, 0.95, 1.25, 1.5)[LEVELS.index(level)] * rng.uniform(0.88, 1.14)
    low = round(middle * 10) * 100
    return Job(
        slug=slug(title),
        title=title,
        reference=f"{title[0]}{field[0]}-{rng.randint(20, 99)}{nth:02d}",
        field=field,
        company=company,
        town=company.town if rng.random() < 0.5 else rng.choice(towns),
        level=level,
        contract=rng.choice((*CONTRACTS, "Full-time", "Full-time")),
        place=rng.choice((*SHIFTS, SHIFTS[0]) if sector.shifts else (*PLACES, PLACES[0])),
        low=low,
        high=low + rng.randint(20, 140) * 100,
        posted=TODAY - timedelta(days=rng.randint(1, 40)),
        closes=TODAY + timedelta(days=rng.randint(3, 60)),
        starts=rng.choice(("1 June", "15 June", "1 July", "1 August", "1 September", "1 October")),
        hours=rng.choice((20, 24, 28, 30, 35, 36, 37, 38, 39, 40)),
        leave=rng.randint(24, 34),
        years=rng.randint(1, 9),
        paper=rng.choice(sector.papers),
        skills=tuple(rng.sample(sector.skills, 3)),
        duties=tuple(rng.sample(sector.duties, 3)),
        contact=names.person(rng),
    )


def make_pay(seed: int, sector: Sector) -> dict[str, tuple[PayRow, ...]]:
    """Pay statistics by level, a row for every field."""
    rng = stream(seed, "pay")
    table = {}
    for level, factor in zip(LEVELS, (0.72, 0.95, 1.25, 1.5), strict=True):
        rows = []
        for field in sector.fields:
            median = round(sector.pay * factor * rng.uniform(0.86, 1.16) * 100) * 10
            lower = median - rng.randint(180, 640) * 10
            upper = median + rng.randint(180, 880) * 10
            rows.append(PayRow(field, lower, median, upper, rng.randint(12, 480)))
        table[level] = tuple(rows)
    return table


def make_guides(seed: int) -> tuple[Guide, ...]:
    """Four pieces of advice."""
    rng = stream(seed, "guides")
    found = []
    for advice in rng.sample(WORDS.advice, 4):
        key = rng.choice(advice.keys)
        steps = tuple(step.format(key=key) for step in advice.steps)
        found.append(Guide(slug(advice.title), advice.title, steps, key))
    return tuple(found)


def make_account(seed: int, jobs: tuple[Job, ...]) -> Account:
    """A visitor with three applications under way, no two at the same stage."""
    rng = stream(seed, "account")
    name = names.person(rng)
    stages = rng.sample(WORDS.stages, 3)
    days = rng.sample(range(2, 30), 3)
    applications = tuple(
        Application(job, TODAY - timedelta(days=rng.randint(2, 30)), stage, TODAY + timedelta(days=day))
        for job, stage, day in zip(rng.sample(jobs, 3), stages, days, strict=True)
    )
    word = rng.choice(("Lantern", "Harbour", "Meadow", "Copper", "Juniper", "Saffron"))
    email = f"{name.lower().replace(' ', '.')}@postbox.example"
    return Account(name, email, f"{word}-{rng.randint(100, 999)}", applications)


def sector_of(name: str) -> Sector:
    """The sector with this name."""
    return WORDS.sectors[name]
