"""Operators of trains, ferries, coaches and flights: journeys, fares, bookings, stops and disruptions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import date
from functools import cached_property
from typing import Any, ClassVar

from webgym.offline.families.timetable.data import Booking, Operator, reference
from webgym.offline.families.timetable.forms import check_alert, check_passenger
from webgym.offline.families.timetable.modes import MODES, Mode
from webgym.offline.families.timetable.network import Departure, Offer, Stop, days_on_sale
from webgym.offline.families.timetable.spelling import Spelling
from webgym.offline.families.timetable.tasks import assignments
from webgym.offline.families.timetable.words import LABELS
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import pick, stream
from webgym.offline.website import Response, State, Visit, Website, page, redirect, slug

PERIODS = {"morning": (0, 12 * 60), "afternoon": (12 * 60, 18 * 60), "evening": (18 * 60, 30 * 60)}
SORTS: dict[str, Callable[[Offer], Any]] = {
    "": lambda offer: offer.departure.minute,
    "price": lambda offer: (offer.cents, offer.departure.minute),
    "length": lambda offer: (offer.departure.length, offer.departure.minute),
}
HOW_OFTEN = ("At once", "Once a day", "Once a week")
MOST_PEOPLE = 6


@dataclass
class Timetable(Spelling, Website):
    """A website of an operator."""

    family: ClassVar[str] = "timetable"
    suffixes: ClassVar[tuple[str, ...]] = tuple(suffix for mode in MODES for suffix in mode.suffixes)
    words: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "search": ("journeys", "search", "results", "connections", "trips"),
        "trip": ("trip", "departure", "service", "journey"),
        "book": ("book", "reserve", "checkout", "order"),
        "booked": ("booked", "confirmation", "thank-you", "ticket"),
        "stops": ("stops", "places", "locations", "stations"),
        "lines": ("lines", "network", "routes"),
        "fares": ("fares", "conditions", "ticket-guide", "tariff"),
        "status": ("status", "updates", "disruptions", "alerts"),
        "manage": ("manage", "my-booking", "bookings", "lookup"),
        "notify": ("notify", "subscribe", "alert-service"),
        "account": ("account", "club", "rewards", "members"),
        "help": ("help", "faq", "support"),
        "find": ("find", "site-search", "look-up"),
    }

    mode: Mode = field(init=False)
    network: Operator = field(init=False)
    say: dict[str, str] = field(init=False)
    """This website's labels."""
    periods: ClassVar[dict[str, tuple[int, int]]] = PERIODS
    often: ClassVar[tuple[str, ...]] = HOW_OFTEN
    typed: bool = field(init=False)
    """Whether stops are typed into the journey search, rather than chosen."""

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """Brand and hostname label; the second word says what kind of operator it is."""
        brand = f"{stem} {pick(pick(MODES, seed, 'mode').suffixes, seed, 'brand')}"
        return brand, slug(brand)

    def build(self) -> None:
        """Lay out the network and choose the words."""
        self.mode = pick(MODES, self.seed, "mode")
        self.domain, self.subdomain = "Travel & Transportation", self.mode.subdomain
        self.tagline = pick(self.mode.taglines, self.seed, "tagline")
        self.network = Operator(self.seed, self.mode)
        self.say = {key: pick(options, self.seed, "label", key) for key, options in LABELS.items()}
        self.typed = pick((True, False), self.seed, "typed")
        self.front = pick(("beside", "wide", "cards"), self.seed, "front")
        self.has_search = pick((True, True, False), self.seed, "has search")
        self.page_size = pick((6, 8, 10), self.seed, "page size")
        self.currency = pick(("€{}", "£{}", "${}", "{} €", "CHF {}", "{} kr"), self.seed, "currency")
        self.half_day = pick((False, False, False, True), self.seed, "clock")

    # --- how things are written ---------------------------------------------------------------------

    @cached_property
    def popular(self) -> list[tuple[Stop, Stop, str]]:
        """Pairs of stops for the front page, with the lowest price of the first day on sale."""
        pairs = stream(self.seed, "popular").sample(self.network.pairs(), 6)
        day = days_on_sale()[0]
        offers = [(a, b, self.network.offers(a, b, day)) for a, b in pairs]
        return [(a, b, self.money(min(offer.cents for offer in found))) for a, b, found in offers]

    def journey_url(self, origin: Stop, target: Stop, day: date | None = None, people: int = 1) -> str:
        """Address of the departures between two stops on a day; tomorrow by default."""
        day = day or days_on_sale()[0]
        start = self.path("/~search")
        return f"{start}?from={origin.slug}&to={target.slug}&date={day.isoformat()}&people={people}"

    def trip_url(self, departure: Departure, day: date, people: int = 1) -> str:
        """Address of a departure on a day."""
        url = self.path("/~trip/{code}/{day}", code=departure.slug, day=day.isoformat())
        return url if people == 1 else f"{url}?people={people}"

    def menu(self) -> list[tuple[str, str]]:
        """Pages of the main navigation: all sites have the same, under other names and in another order."""
        names = {
            "~stops": self.mode.stops.capitalize(),
            "~lines": self.say["lines"],
            "~fares": self.say["fares"],
            "~status": self.say["status"],
            "~manage": self.say["manage"],
            "~account": self.say["account"],
            "~help": self.say["help"],
        }
        entries = [(text, self.path(f"/{where}")) for where, text in names.items()]
        stream(self.seed, "menu").shuffle(entries)
        return entries

    def report(self, state: State) -> dict[str, Any]:
        """Bookings, changes to bookings, alerts and preferences."""
        return {key: state.get(key, {}) for key in ("booked", "extras", "cancelled", "alerts", "prefers")}

    def assignments(self) -> Iterable[Assignment]:
        """See ``tasks.py``."""
        return assignments(self)

    # --- journeys -----------------------------------------------------------------------------------

    @page("/")
    def home(self, visit: Visit) -> Response:
        """The front page with the journey search."""
        return self.render("timetable/front.html", visit, asked=self._asked(visit), errors={})

    def _asked(self, visit: Visit) -> dict[str, str]:
        asked = {key: visit.query.get(key, "") for key in ("from", "to")}
        isos = [iso for iso, _ in self.days]
        asked["date"] = visit.query["date"] if visit.query.get("date") in isos else isos[0]
        people = visit.query.get("people", "1")
        asked["people"] = people if people in dict(self.party) else "1"
        return asked

    @page("/~search")
    def search(self, visit: Visit) -> Response:
        """Departures between two stops, or the search form with what is wrong."""
        asked, stops, errors = self._asked(visit), {}, {}
        for key in ("from", "to"):
            found = self.network.stop(asked[key])
            if found is None:
                errors[key] = f"We do not know this {self.mode.stop}." if asked[key] else "Please fill in."
            else:
                stops[key] = found
        if not errors and stops["from"] == stops["to"]:
            errors["to"] = f"Please choose another {self.mode.stop}."
        if errors:
            return self.render("timetable/front.html", visit, asked=asked, errors=errors)
        canonical = {**asked, "from": stops["from"].slug, "to": stops["to"].slug}
        if canonical != {key: visit.query.get(key) for key in canonical}:
            return redirect(visit.url(**canonical))
        day = date.fromisoformat(asked["date"])
        offers = self.network.offers(stops["from"], stops["to"], day)
        return self.render(
            "timetable/results.html",
            visit,
            asked={"from": stops["from"].name, "to": stops["to"].name}
            | {k: asked[k] for k in ("date", "people")},
            errors={},
            origin=stops["from"],
            target=stops["to"],
            day=day,
            people=int(asked["people"]),
            near=dict(self._near(asked["date"])),
            results=paged(self.narrowed(offers, visit), visit, self.page_size),
        )

    def _near(self, iso: str) -> list[tuple[int, tuple[str, str]]]:
        place = [value for value, _ in self.days].index(iso)
        return [(step, self.days[place + step]) for step in (-1, 1) if 0 <= place + step < len(self.days)]

    @staticmethod
    def narrowed(offers: list[Offer], visit: Visit) -> list[Offer]:
        """Offers that pass the visit's filters, in its order."""
        query = visit.query
        earliest, latest = PERIODS.get(query.get("period", ""), (0, 9999))
        by = query.get("arrive", "")
        limit = int(by) * 60 if by.isdecimal() and len(by) < 3 else 9999
        kept = [
            offer
            for offer in offers
            if earliest <= offer.departure.minute < latest
            and offer.departure.minute + offer.departure.length <= limit
            and not (query.get("direct") and offer.departure.change)
        ]
        return sorted(kept, key=SORTS.get(query.get("sort", ""), SORTS[""]))

    def _offer(self, code: str, day: str) -> Offer | None:
        service = self.network.departure(code)
        when = next((d for d in days_on_sale() if d.isoformat() == day), None)
        if service is None or when is None or not service.runs_on(when):
            return None
        return self.network.offer(service, when)

    @page("/~trip/{code}/{day}")
    def trip(self, visit: Visit, code: str, day: str) -> Response:
        """One departure: its stops, its prices, what is on board."""
        offer = self._offer(code, day)
        if offer is None:
            return self.missing(visit)
        people = int(self._asked(visit)["people"])
        return self.render("timetable/trip.html", visit, offer=offer, trip=offer.departure, people=people)

    # --- bookings -----------------------------------------------------------------------------------

    @page("/~book/{code}/{day}/{klass}")
    def book(self, visit: Visit, code: str, day: str, klass: str) -> Response:
        """Passenger details."""
        return self._book(visit, code, day, klass, {}, 200)

    def _book(
        self, visit: Visit, code: str, day: str, klass: str, errors: dict[str, str], status: int
    ) -> Response:
        offer, chosen = self._offer(code, day), self.klass(klass)
        if offer is None or chosen is None:
            return self.missing(visit)
        return self.render(
            "timetable/book.html",
            visit,
            status=status,
            offer=offer,
            trip=offer.departure,
            klass=chosen,
            people=int(self._asked(visit)["people"]),
            errors=errors,
            given=visit.form,
        )

    def klass(self, wanted: str) -> str | None:
        """The fare class with this slug."""
        return next((name for name, _ in self.mode.classes if slug(name) == wanted), None)

    @page("/~book/{code}/{day}/{klass}", method="POST")
    def booked(self, visit: Visit, code: str, day: str, klass: str) -> Response:
        """Check the passenger details and book."""
        offer, chosen = self._offer(code, day), self.klass(klass)
        if offer is None or chosen is None:
            return self.missing(visit)
        form, errors = check_passenger(self, visit.form)
        if errors:
            return self._book(visit, code, day, klass, errors, 422)
        extras = dict(self.mode.extras)
        people = int(self._asked(visit)["people"])
        total = self.network.fare(offer, chosen) * people + 100 * extras.get(form["extra"], 0)
        booking = {
            "class": chosen,
            "people": people,
            "seat": form["seat"],
            "extra": form["extra"] if form["extra"] in extras else "",
            "name": form["name"],
            "email": form["email"],
            "total": self.money(total),
            "code": code,
            "day": day,
        }
        number = self.reference(offer, chosen, people, form["name"])
        booking["reference"] = number
        visit.state.setdefault("booked", {})[f"{offer.departure.code} {day}"] = booking
        return redirect(self.path("/~booked/{number}", number=number))

    def reference(self, offer: Offer, klass: str, people: int, name: str) -> str:
        """The reference that a booking gets."""
        return reference(self.seed, offer.departure.code, offer.day, klass, people, name.casefold())

    @page("/~booked/{number}")
    def confirmation(self, visit: Visit, number: str) -> Response:
        """What was booked."""
        for booking in visit.state.get("booked", {}).values():
            if booking["reference"] == number:
                offer = self._offer(booking["code"], booking["day"])
                assert offer is not None
                return self.render(
                    "timetable/booked.html", visit, booking=booking, offer=offer, trip=offer.departure
                )
        return self.missing(visit)

    @page("/~manage")
    def manage(self, visit: Visit) -> Response:
        """Look a booking up."""
        return self.render("timetable/manage.html", visit, given={}, error=None)

    @page("/~manage", method="POST")
    def look_up(self, visit: Visit) -> Response:
        """Check reference and surname."""
        number = visit.form.get("reference", "").strip().upper()
        surname = visit.form.get("surname", "").strip().casefold()
        booking = self._booking(number)
        if booking is not None and booking.surname.casefold() == surname:
            opened = visit.state.setdefault("opened", [])
            if number not in opened:
                opened.append(number)
            return redirect(self.path("/~manage/{number}", number=number))
        for own in visit.state.get("booked", {}).values():
            if own["reference"] == number and own["name"].split()[-1].casefold() == surname:
                return redirect(self.path("/~booked/{number}", number=number))
        error = "There is no booking with this reference and this surname."
        return self.render("timetable/manage.html", visit, status=422, given=visit.form, error=error)

    def _booking(self, number: str) -> Booking | None:
        return next((item for item in self.network.bookings if item.reference == number), None)

    @page("/~manage/{number}")
    def managed(self, visit: Visit, number: str) -> Response:
        """A booking that was looked up."""
        booking = self._booking(number)
        if booking is None or number not in visit.state.get("opened", ()):
            return redirect(self.path("/~manage"))
        return self.render(
            "timetable/managed.html",
            visit,
            booking=booking,
            trip=booking.departure,
            extras=visit.state.get("extras", {}).get(number, []),
            cancelled=visit.state.get("cancelled", {}).get(number, False),
        )

    @page("/~manage/{number}", method="POST")
    def change(self, visit: Visit, number: str) -> Response:
        """Add an extra to a booking, or cancel it."""
        if number in visit.state.get("opened", ()):
            extra = visit.form.get("extra", "")
            if visit.form.get("act") == "cancel":
                visit.state.setdefault("cancelled", {})[number] = True
            elif extra in dict(self.mode.extras):
                added = visit.state.setdefault("extras", {}).setdefault(number, [])
                if extra not in added:
                    added.append(extra)
        return redirect(self.path("/~manage/{number}", number=number))

    # --- everything else -----------------------------------------------------------------------------

    @page("/~stops")
    def stops(self, visit: Visit) -> Response:
        """All stops, by line and facility."""
        wanted = [item for item in self.mode.facilities if visit.query.get(slug(item))]
        line = self.network.line(visit.query.get("line", ""))
        found = [
            stop
            for stop in self.network.stops
            if set(wanted) <= set(stop.facilities) and (line is None or stop in line.stops)
        ]
        results = paged(found, visit, self.page_size)
        return self.render("timetable/stops.html", visit, results=results, wanted=wanted)

    @page("/~stops/{name}")
    def stop(self, visit: Visit, name: str) -> Response:
        """One stop."""
        found = self.network.stop(name)
        if found is None:
            return self.missing(visit)
        return self.render("timetable/stop.html", visit, stop=found, lines=self.network.lines_of(found))

    @page("/~lines")
    def lines(self, visit: Visit) -> Response:
        """All lines."""
        return self.render("timetable/lines.html", visit, lines=self.network.lines)

    @page("/~lines/{name}")
    def line(self, visit: Visit, name: str) -> Response:
        """One line with its stops."""
        found = self.network.line(name)
        if found is None:
            return self.missing(visit)
        return self.render("timetable/line.html", visit, line=found)

    @page("/~fares")
    def fares(self, visit: Visit) -> Response:
        """Kinds of tickets and the conditions of carriage."""
        return self.render("timetable/fares.html", visit, rules=self.network.rules)

    @page("/~status")
    def status(self, visit: Visit) -> Response:
        """Disruptions, by line and state."""
        line, state = visit.query.get("line", ""), visit.query.get("state", "")
        found = [
            item
            for item in self.network.disruptions
            if line in ("", item.line.slug) and state in ("", item.status.lower())
        ]
        return self.render("timetable/status.html", visit, results=paged(found, visit, 5))

    @page("/~notify")
    def notify(self, visit: Visit) -> Response:
        """Sign up for alerts."""
        return self.render("timetable/notify.html", visit, given={}, errors={}, often=HOW_OFTEN)

    @page("/~notify", method="POST")
    def notified(self, visit: Visit) -> Response:
        """Check the sign-up."""
        form, errors = check_alert(self, visit.form)
        line = self.network.line(form["line"])
        if errors or line is None:
            return self.render(
                "timetable/notify.html", visit, status=422, given=form, errors=errors, often=HOW_OFTEN
            )
        alert = {"line": line.name, "often": form["often"]}
        visit.state.setdefault("alerts", {})[form["email"].lower()] = alert
        visit.state["last alert"] = form["email"].lower()
        return redirect(self.path("/~notify/done"))

    @page("/~notify/done")
    def thanks(self, visit: Visit) -> Response:
        """The last sign-up."""
        email = visit.state.get("last alert")
        if email is None:
            return redirect(self.path("/~notify"))
        return self.render("timetable/thanks.html", visit, email=email, alert=visit.state["alerts"][email])

    @page("/~account")
    def account(self, visit: Visit) -> Response:
        """The account of somebody who signed in, else the form to do so."""
        if visit.state.get("member"):
            return self.render("timetable/account.html", visit, member=self.network.member)
        return self.render("timetable/login.html", visit, given={}, error=None)

    @page("/~account", method="POST")
    def sign_in(self, visit: Visit) -> Response:
        """Sign in, or save a preference."""
        member = self.network.member
        prefers = visit.form.get("class", "")
        if visit.state.get("member") and self.klass(slug(prefers)):
            visit.state.setdefault("prefers", {})["class"] = prefers
            return redirect(self.path("/~account"))
        email, password = visit.form.get("email", "").strip().lower(), visit.form.get("password", "")
        if (email, password) == (member.email, member.password):
            visit.state["member"] = True
            return redirect(self.path("/~account"))
        error = "E-mail or password is wrong."
        return self.render("timetable/login.html", visit, status=422, given=visit.form, error=error)

    @page("/~help")
    def help(self, visit: Visit) -> Response:
        """Questions and answers."""
        return self.render("timetable/help.html", visit, topics=self.network.topics)

    @page("/~find")
    def find(self, visit: Visit) -> Response:
        """Search the website."""
        words = slug(visit.query.get("q", "")).replace("-", " ")
        found: list[tuple[str, str, str]] = []
        if words:
            for stop in self.network.stops:
                if words in slug(stop.name).replace("-", " "):
                    where = self.path("/~stops/{name}", name=stop.slug)
                    found.append((stop.name, where, self.mode.stop.capitalize()))
            found += [
                (line.name, self.path("/~lines/{name}", name=line.slug), self.mode.line)
                for line in self.network.lines
                if words in line.name.lower()
            ]
            found += [
                (topic.question, self.path("/~help"), self.say["help"])
                for topic in self.network.topics
                if words in topic.question.lower()
            ]
        return self.render("timetable/find.html", visit, found=found)
