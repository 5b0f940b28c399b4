"""Websites of towns and agencies: services, offices, minutes, dates by street, fees, permits and reports."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from webgym.offline import names
from webgym.offline.families._finder import STYLES, Facet, Finder
from webgym.offline.families._listed import Listed
from webgym.offline.families.government import tasks
from webgym.offline.families.government.catalog import (
    CHANNELS,
    MONTHS,
    WEEKDAYS,
    Case,
    Meeting,
    Office,
    Round,
    Service,
    make_cases,
    make_meetings,
    make_offices,
    make_rounds,
    make_services,
    make_tariff,
)
from webgym.offline.families.government.words import WORDS, Body
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import number, pick, stream
from webgym.offline.website import Response, State, Visit, page, redirect, slug

URGENCY = ("Can wait", "Within a week", "Dangerous")
CURRENCIES = ("£", "€", "$")

_SAYS: dict[str, tuple[str, ...]] = {
    "search": ("Search services", "How can we help?", "Find a service", "What are you looking for?"),
    "all": ("Services A–Z", "All services", "What we do", "Services"),
    "offices": ("Offices", "Visit us", "Opening hours", "Where to find us"),
    "minutes": ("Meetings and minutes", "Minutes", "Decisions", "Council papers"),
    "price": ("Fee calculator", "What does it cost?", "Work out your fee"),
    "permit": ("Apply for a permit", "Permits", "Permit application"),
    "trouble": ("Report a problem", "Tell us what is wrong", "Something broken?"),
    "track": ("Track a case", "Where is my case?", "Case status"),
    "group": ("Subject", "Topic", "Area of life"),
    "channel": ("How to apply", "Way of applying", "Channel"),
    "top": ("Fee up to", "Costs at most", "Highest fee"),
    "sort": ("Sort by", "Order", "Sort services by"),
    "apply": ("Show services", "Apply filters", "Update list"),
    "cheap": ("Lowest fee", "Fee, low to high", "Cheapest first"),
    "fast": ("Fastest first", "Shortest processing time", "Processing time"),
    "fees": ("Fees and times", "Cost and duration", "Fee and processing"),
    "papers": ("Documents", "What to bring", "Documents needed"),
    "steps": ("Step by step", "How it works", "What to do"),
    "where": ("Responsible office", "Where to go", "Your contact"),
    "body": ("Committee", "Body", "Meeting of"),
}
"""What websites call things; each takes one phrase of every row."""


@dataclass
class Government(Listed):
    """The website of a public authority."""

    family: ClassVar[str] = "government"
    first_section: ClassVar[str] = "fees"
    words: ClassVar[dict[str, tuple[str, ...]]] = {
        "all": ("services", "a-z", "topics"),
        "one": ("service", "s", "apply-for"),
        "offices": ("offices", "visit", "contact"),
        "minutes": ("minutes", "meetings", "decisions"),
        "rounds": ("by-street", "calendar", "rounds"),
        "price": ("fees", "calculator", "cost"),
        "permit": ("permit", "permits", "application"),
        "trouble": ("report", "problem", "complaints"),
        "track": ("track", "case", "status"),
    }

    kind: str = field(init=False)
    currency: str = field(init=False)
    body: Body = field(init=False)
    offices: tuple[Office, ...] = field(init=False)
    services: tuple[Service, ...] = field(init=False)
    meetings: tuple[Meeting, ...] = field(init=False)
    rounds: tuple[Round, ...] = field(init=False)
    tariff: dict[tuple[str, str, int], int] = field(init=False)
    cases: tuple[Case, ...] = field(init=False)
    minutes: Finder = field(init=False)
    typed: bool = field(init=False)
    """Whether the calendar asks for the street's name rather than lists the streets."""

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """The second word fits the kind of authority."""
        brand = f"{stem} {pick(WORDS.bodies[cls.kind_of(seed)].suffixes, seed, 'brand')}"
        return brand, slug(brand)

    @staticmethod
    def kind_of(seed: int) -> str:
        """The kind of authority."""
        return pick(sorted(WORDS.bodies), seed, "kind")

    def build(self) -> None:
        """Fill the catalogue."""
        self.domain, self.subdomain = "Misc.", "Legal & Government Services"
        self.kind = self.kind_of(self.seed)
        self.body = WORDS.bodies[self.kind]
        self.tagline = pick(self.body.taglines, self.seed, "tagline")
        self.says = {name: pick(texts, self.seed, "says", name) for name, texts in _SAYS.items()}
        self.says["rounds"] = pick(self.body.rounds[0], self.seed, "says", "rounds")
        self.currency = pick(CURRENCIES, self.seed, "currency")
        self.offices = make_offices(self.seed)
        self.services = make_services(self.seed, self.body, self.offices)
        self.meetings, self.rounds = (
            make_meetings(self.seed, self.body),
            make_rounds(self.seed, len(self.body.rounds[1])),
        )
        self.tariff, self.cases = make_tariff(self.seed, self.body), make_cases(self.seed, self.services)
        self.page_size = 16 if self.look.pager == "more" else pick((8, 9, 12), self.seed, "page size")
        self.typed = stream(self.seed, "typed").random() < 0.5
        self.finder, self.minutes = self._make_finders()

    def _make_finders(self) -> tuple[Finder, Finder]:
        say, style = self.says, pick(STYLES, self.seed, "finder")

        def options(texts: Iterable[str]) -> tuple[tuple[str, str], ...]:
            return tuple((slug(text), text) for text in texts)

        fees = tuple((str(n), self.money(n)) for n in (20, 50, 100))
        services = Finder(
            path=self.path("/~all"),
            facets=(
                Facet("group", say["group"], options(sorted(self.body.groups)), "All"),
                Facet("channel", say["channel"], options(CHANNELS)),
                Facet("top", say["top"], fees),
            ),
            sort=Facet(
                "sort", say["sort"], (("name", "A to Z"), ("fee", say["cheap"]), ("days", say["fast"]))
            ),
            style=style,
            apply=say["apply"],
        )
        minutes = Finder(
            path=self.path("/~minutes"),
            facets=(Facet("body", say["body"], options(self.body.council), "All"),),
            sort=Facet("sort", "Order", (("newest", "Newest first"), ("oldest", "Oldest first"))),
            style=style,
            apply="Show meetings",
        )
        return services, minutes

    def money(self, value: int) -> str:
        """An amount in whole units of the currency."""
        return f"{self.currency}{value}"

    def fee(self, service: Service) -> str:
        """What a service costs, as the pages write it."""
        return f"{self.money(service.fee)} fee" if service.fee else "no fee"

    def menu(self) -> list[tuple[str, str]]:
        """The main navigation."""
        return [(self.says[word], self.path(f"/~{word}")) for word in ("all", "offices", "minutes", "rounds")]

    def report(self, state: State) -> dict[str, Any]:
        """The last permit applied for and the last problem reported."""
        return {"permit": state.get("permit"), "trouble": state.get("trouble")}

    def assignments(self) -> Iterable[Assignment]:
        """See ``tasks.py``."""
        return tasks.assignments(self)

    # --- finding ---------------------------------------------------------------------------------

    def find(self, **asked: str) -> list[Service]:
        """The services that a list with these choices shows, in its order."""
        words = asked.get("q", "").casefold().split()
        found = [
            service
            for service in self.services
            if all(word in f"{service.name} {service.group}".casefold() for word in words)
            and asked.get("group") in (None, slug(service.group))
            and asked.get("channel") in (None, slug(service.channel))
            and service.fee <= int(asked.get("top", "9999"))
        ]
        orders: dict[str, Any] = {
            "fee": lambda service: (service.fee, service.name),
            "days": lambda service: (service.days, service.name),
        }
        return sorted(found, key=orders[asked["sort"]]) if asked.get("sort") in orders else found

    def sittings(self, **asked: str) -> list[Meeting]:
        """The meetings that a list with these choices shows, in its order."""
        found = [one for one in self.meetings if asked.get("body") in (None, slug(one.body))]
        return found[::-1] if asked.get("sort") == "oldest" else found

    def href(self, service: Service) -> str:
        """The address of a service."""
        return self.path("/~one/{slug}", slug=service.slug)

    def receipt(self, kind: str, *names_of: str) -> str:
        """The number that a form's sender gets."""
        return f"{kind}-{number(self.seed, 'receipt', kind, *names_of) % 90000 + 10000}"

    # --- reading ---------------------------------------------------------------------------------

    @page("/")
    def front(self, visit: Visit) -> Response:
        """Ways in."""
        popular = stream(self.seed, "popular").sample(self.services, 6)
        return self.render(
            "government/front.html", visit, popular=popular, groups=self.finder.facets[0].options
        )

    @page("/~all")
    def listing(self, visit: Visit) -> Response:
        """The filtered list of services."""
        asked = self.finder.asked(visit)
        found = paged(self.find(**asked), visit, self.page_size)
        return self.render("government/listing.html", visit, asked=asked, found=found)

    @page("/~one/{key}")
    def service(self, visit: Visit, key: str) -> Response:
        """One service."""
        found = next((one for one in self.services if one.slug == key), None)
        if found is None:
            return self.missing(visit)
        return self.render("government/service.html", visit, service=found)

    @page("/~offices")
    def office_list(self, visit: Visit) -> Response:
        """All offices."""
        return self.render("government/offices.html", visit)

    @page("/~offices/{key}")
    def office(self, visit: Visit, key: str) -> Response:
        """One office and its hours."""
        found = next((one for one in self.offices if one.slug == key), None)
        if found is None:
            return self.missing(visit)
        theirs = [service for service in self.services if service.office == found]
        return self.render("government/office.html", visit, office=found, weekdays=WEEKDAYS, theirs=theirs)

    @page("/~minutes")
    def meeting_list(self, visit: Visit) -> Response:
        """Meetings."""
        asked = self.minutes.asked(visit)
        found = paged(self.sittings(**asked), visit, 7)
        return self.render("government/meetings.html", visit, asked=asked, found=found)

    @page("/~minutes/{key}")
    def meeting(self, visit: Visit, key: str) -> Response:
        """The minutes of one meeting."""
        found = next((one for one in self.meetings if one.slug == key), None)
        if found is None:
            return self.missing(visit)
        return self.render("government/meeting.html", visit, meeting=found)

    @page("/~rounds")
    def calendar(self, visit: Visit) -> Response:
        """Dates in a street, by its name or its value."""
        asked = " ".join(visit.query.get("street", "").split())
        found = next((one for one in self.rounds if slug(one.street) == slug(asked)), None) if asked else None
        days = list(zip(self.body.rounds[1], found.days, strict=True)) if found else []
        options = [("", "Choose…"), *((slug(one.street), one.street) for one in self.rounds)]
        return self.render(
            "government/rounds.html", visit, asked=asked, found=found, days=days, options=options
        )

    @page("/~price")
    def calculator(self, visit: Visit) -> Response:
        """The fee for three answers."""
        _, places, kinds = self.body.price
        asked = {name: visit.query.get(name, "") for name in ("place", "kind", "months")}
        found = [
            (key, fee)
            for key, fee in self.tariff.items()
            if (slug(key[0]), slug(key[1]), str(key[2])) == tuple(asked.values())
        ]
        choices = {
            "place": [(slug(text), text) for text in places],
            "kind": [(slug(text), text) for text in kinds],
            "months": [(str(n), f"{n} months") for n in MONTHS],
        }
        result = found[0] if found else None
        return self.render("government/price.html", visit, asked=asked, choices=choices, result=result)

    @page("/~track")
    def track(self, visit: Visit) -> Response:
        """A case by its number."""
        asked = visit.query.get("number", "").strip().upper()
        found = next((case for case in self.cases if case.number == asked), None)
        return self.render("government/track.html", visit, asked=asked, case=found)

    # --- forms -----------------------------------------------------------------------------------

    def _form(
        self, visit: Visit, kind: str, values: dict[str, str], errors: dict[str, str], status: int = 200
    ) -> Response:
        lists: dict[str, tuple[str, ...]] = {
            "what": ("", *(self.body.permits if kind == "permit" else self.body.troubles)),
            "office": ("", *(office.name for office in self.offices)),
            "urgency": ("", *URGENCY),
        }
        choices = {name: [(text, text or "Choose…") for text in texts] for name, texts in lists.items()}
        return self.render(
            f"government/{kind}.html", visit, status=status, values=values, errors=errors, choices=choices
        )

    @staticmethod
    def _faults(values: dict[str, str], allowed: dict[str, tuple[str, ...]]) -> dict[str, str]:
        errors = {name: "Please choose one." for name, texts in allowed.items() if values[name] not in texts}
        if "email" in values and not re.fullmatch(r"[^@\s]+@[^@\s]+\.[a-z]{2,}", values["email"]):
            errors["email"] = "That does not look like an e-mail address."
        for name in ("name", "street", "text"):
            if name in values and len(values[name]) < 5:
                errors[name] = "Please write at least 5 characters."
        return errors

    @page("/~permit")
    def permit_form(self, visit: Visit) -> Response:
        """An empty application."""
        return self._form(visit, "permit", {}, {})

    @page("/~permit", method="POST")
    def permit(self, visit: Visit) -> Response:
        """Take an application, or say what is wrong with it."""
        values = {
            name: visit.form.get(name, "").strip() for name in ("what", "office", "name", "email", "street")
        }
        offices = tuple(office.name for office in self.offices)
        errors = self._faults(values, {"what": self.body.permits, "office": offices})
        if errors:
            return self._form(visit, "permit", values, errors, 422)
        visit.state["permit"] = values
        return redirect(self.path("/~permit/done"))

    @page("/~permit/done")
    def permit_done(self, visit: Visit) -> Response:
        """What was applied for."""
        if "permit" not in visit.state:
            return redirect(self.path("/~permit"))
        return self.render("government/done.html", visit, kind="permit", values=visit.state["permit"])

    @page("/~trouble")
    def trouble_form(self, visit: Visit) -> Response:
        """An empty report."""
        return self._form(visit, "trouble", {}, {})

    @page("/~trouble", method="POST")
    def trouble(self, visit: Visit) -> Response:
        """Take a report, or say what is wrong with it."""
        values = {name: visit.form.get(name, "").strip() for name in ("what", "urgency", "street", "text")}
        errors = self._faults(values, {"what": self.body.troubles, "urgency": URGENCY})
        if errors:
            return self._form(visit, "trouble", values, errors, 422)
        visit.state["trouble"] = values
        return redirect(self.path("/~trouble/done"))

    @page("/~trouble/done")
    def trouble_done(self, visit: Visit) -> Response:
        """What was reported."""
        if "trouble" not in visit.state:
            return redirect(self.path("/~trouble"))
        return self.render("government/done.html", visit, kind="trouble", values=visit.state["trouble"])

    @property
    def mayor(self) -> str:
        """Who signs the greeting on the front page."""
        return names.person(stream(self.seed, "mayor"))
