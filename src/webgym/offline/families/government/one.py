"""Questions about single pages of the authorities' websites."""

from __future__ import annotations

from typing import TYPE_CHECKING

from webgym.core.truth import Click, Move, See
from webgym.offline.families._asking import count, exactly, shown
from webgym.offline.families._listed import at, unfold
from webgym.offline.families.government import deeds
from webgym.offline.families.government.catalog import WEEKDAYS, Service
from webgym.offline.families.government.ways import fee_of, working_days
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.government import Government


class OnePage:
    """Things to look up on single pages."""

    def __init__(self, site: Government) -> None:
        self.site = site
        self.rng = stream(site.seed, "one")
        self._offices = iter(self.rng.sample(site.offices, len(site.offices)))

    # --- services --------------------------------------------------------------------------------

    def fee(self, service: Service) -> Part:
        site, text = self.site, self.site.fee(service)
        return Part(
            f'find out what the service "{service.name}" costs',
            f"Fee: {service.name}",
            (
                Fact(
                    f'The fee for "{service.name}" is found',
                    (
                        shown(at(site, service), text),
                        shown(exactly(site.finder.path), service.name, text),
                    ),
                    answer=fee_of(site, service),
                ),
            ),
            (*deeds.go(site, service), See((text,))),
            f"It costs {site.money(service.fee)}.",
        )

    def papers(self, service: Service) -> Part:
        site = self.site
        return Part(
            f'find out how many documents are needed for the service "{service.name}"',
            f"Documents: {service.name}",
            (
                Fact(
                    f'The number of documents needed for "{service.name}" is found',
                    (shown(at(site, service), *service.papers),),
                    answer=count(len(service.papers)),
                ),
            ),
            (*deeds.go(site, service), *unfold(site, "papers"), See(service.papers)),
            f"{len(service.papers)} documents are needed.",
        )

    def validity(self, service: Service) -> Part:
        site = self.site
        years = f"{service.valid} {'year' if service.valid == 1 else 'years'}"
        return Part(
            f'find out for how long the result of the service "{service.name}" is valid',
            f"Validity: {service.name}",
            (
                Fact(
                    f'How long "{service.name}" is valid for is found',
                    (shown(at(site, service), "Valid for", years),),
                    answer=(years,),
                ),
            ),
            (*deeds.go(site, service), See(("Valid for", years))),
            f"It is valid for {years}.",
        )

    def howto(self, service: Service) -> Part:
        site = self.site
        step = next(step for step in service.steps if service.key in step)
        return Part(
            f'find out how to apply for the service "{service.name}" and sum up the steps, with the '
            "deadline for "
            "payment",
            f"How to apply: {service.name}",
            (
                Fact(
                    f'The instructions on how to apply for "{service.name}" are found',
                    (shown(at(site, service), step),),
                    answer=(service.key, *_figures(service.key)),
                ),
            ),
            (*deeds.go(site, service), *unfold(site, "steps"), See((step,))),
            " ".join(service.steps),
        )

    def service(self, service: Service) -> Part:
        """Time, office and its telephone."""
        site, here, office = self.site, at(self.site, service), service.office
        days = working_days(service)
        place = exactly(site.path("/~offices/{slug}", slug=office.slug))
        return Part(
            f'find out how long the service "{service.name}" takes to process, which office is '
            "responsible for it "
            "and that office's telephone number",
            f"The service {service.name}",
            (
                Fact(
                    f'The processing time of "{service.name}" is found',
                    (shown(here, days[0]), shown(exactly(site.finder.path), service.name, days[0])),
                    answer=days,
                ),
                Fact(
                    f'The office responsible for "{service.name}" is found',
                    (shown(here, office.name, office.phone), shown(place, office.name, service.name)),
                    answer=(office.name,),
                ),
                Fact(
                    "The telephone number of the office is found",
                    (shown(here, office.phone), shown(place, office.phone)),
                    answer=(office.phone, office.phone.replace(" ", "")),
                ),
            ),
            (
                *deeds.go(site, service),
                See((days[0],)),
                *unfold(site, "where"),
                See((office.name, office.phone)),
            ),
            f"It takes {days[0]}; the {office.name} is responsible, telephone {office.phone}.",
        )

    # --- offices ---------------------------------------------------------------------------------

    def _to(self, slug_of: str) -> tuple[str, tuple[Move, ...]]:
        path = self.site.path("/~offices/{slug}", slug=slug_of)
        return exactly(path), (Click(path=self.site.path("/~offices")), Click(path=path))

    def closing_time(self) -> Part:
        office = next(self._offices)
        weekday = self.rng.choice([d for d, hours in zip(WEEKDAYS, office.hours, strict=True) if hours])
        hours = office.on(weekday)
        opens, closes = hours.split(" to ")
        here, moves = self._to(office.slug)
        return Part(
            f"find out at what time the {office.name} opens and closes on {weekday}s",
            f"Opening hours of the {office.name}",
            (
                Fact(
                    f"When the {office.name} opens on {weekday}s is found",
                    (shown(here, weekday, hours),),
                    answer=_clock(opens),
                ),
                Fact(
                    f"When the {office.name} closes on {weekday}s is found",
                    (shown(here, weekday, hours),),
                    answer=_clock(closes),
                ),
            ),
            (*moves, See((weekday, hours))),
            f"It is open from {hours}.",
        )

    def office(self) -> Part:
        """Street, telephone and hours on a day."""
        site = self.site
        office = next(self._offices)
        weekday = self.rng.choice([d for d, h in zip(WEEKDAYS[:5], office.hours[:5], strict=True) if h])
        hours = office.on(weekday)
        closes = hours.split(" to ")[1]
        here, moves = self._to(office.slug)
        return Part(
            f"look up the {office.name}: give its street, its telephone number and the time at which "
            "it closes on "
            f"{weekday}s",
            f"The {office.name}",
            (
                Fact(
                    f"The street of the {office.name} is found",
                    (
                        shown(here, office.street),
                        shown(exactly(site.path("/~offices")), office.name, office.street),
                    ),
                    answer=(office.street,),
                ),
                Fact(
                    f"The telephone number of the {office.name} is found",
                    (shown(here, office.phone),),
                    answer=(office.phone, office.phone.replace(" ", "")),
                ),
                Fact(
                    f"When the {office.name} closes on {weekday}s is found",
                    (shown(here, weekday, hours),),
                    answer=_clock(closes),
                ),
            ),
            (*moves, See((office.street, office.phone, weekday, hours))),
            f"It is at {office.street}, telephone {office.phone}, and closes at {closes} on {weekday}s.",
        )

    def steps_at_the_door(self) -> Part:
        """The one office that wheelchairs cannot enter."""
        site = self.site
        office = next(one for one in site.offices if not one.step_free)
        path = site.path("/~offices")
        text = "steps at the entrance"
        return Part(
            "find out which office is not step-free",
            "Access to the offices",
            (
                Fact(
                    "The office that is not step-free is found",
                    (
                        shown(exactly(path), office.name, text),
                        shown(self._to(office.slug)[0], office.name, text),
                    ),
                    answer=(office.name,),
                    wrong=tuple(one.name for one in site.offices if one.step_free)[:3],
                ),
            ),
            (Click(path=path), See((office.name, text))),
            f"The {office.name} has steps at the entrance.",
        )

    def early_or_saturday(self) -> Part | None:
        """Any office that opens early on Mondays OR at all on Saturdays will do."""
        site = self.site
        good = []
        for office in site.offices:
            monday, saturday = office.hours[0], office.hours[5]
            if monday and monday[0] < "08:30":
                good.append((office, "Monday", office.on("Monday")))
            elif saturday:
                good.append((office, "Saturday", office.on("Saturday")))
        if not good or len(good) == len(site.offices):
            return None
        offices = [office for office, _, _ in good]
        listed = exactly(site.path("/~offices"))
        seen = [shown(self._to(office.slug)[0], office.name, day, hours) for office, day, hours in good]
        seen += [shown(listed, one.name, one.on("Saturday")) for one in offices if one.hours[5]]
        office, day, hours = good[0]
        goal = "opens before 8:30 on Mondays OR is open on Saturdays"
        return Part(
            f"name one office that {goal}",
            "An office with long hours",
            (
                Fact(
                    f"An office is found that {goal}",
                    tuple(seen),
                    answer=tuple(one.name for one in offices),
                    wrong=tuple(one.name for one in site.offices if one not in offices)[:3],
                ),
            ),
            (*self._to(office.slug)[1], See((office.name, day, hours))),
            f"The {office.name}.",
        )


def _clock(text: str) -> tuple[str, ...]:
    hour, minute = (int(part) for part in text.split(":"))
    half, twelve = "pm" if hour >= 12 else "am", (hour - 1) % 12 + 1
    said = [text, f"{hour}:{minute:02d}", f"{twelve}:{minute:02d} {half}", f"{twelve}:{minute:02d}{half}"]
    return (*said, f"{twelve} {half}", f"{twelve}{half}") if minute == 0 else tuple(said)


_WORDS = {"two": "2", "three": "3", "ten": "10", "five": "5", "six": "6", "one": "1"}


def _figures(key: str) -> tuple[str, ...]:
    word, _, rest = key.partition(" ")
    return (f"{_WORDS[word]} {rest}",)
