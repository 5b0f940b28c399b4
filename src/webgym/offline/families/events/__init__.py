"""Organisers of concerts, plays, matches, screenings, tours and conferences, and their tickets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import date, timedelta
from functools import cached_property
from typing import Any, ClassVar

from webgym.offline.families.events.data import (
    MONTHS,
    SEASONS,
    Band,
    Event,
    Past,
    Season,
    month_key,
    reference,
)
from webgym.offline.families.events.forms import check_buyer, check_choice, check_news
from webgym.offline.families.events.kinds import KINDS, LABELS, Kind
from webgym.offline.families.events.tasks import assignments
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import pick, stream
from webgym.offline.website import Response, State, Visit, Website, page, redirect, slug

SORTS: dict[str, Callable[[Event], Any]] = {
    "": lambda event: (event.day, event.start, event.title),
    "price": lambda event: (event.cents, event.day),
    "length": lambda event: (-event.minutes, event.day),
}
MOST_TICKETS = 8
HOW_OFTEN = ("Every week", "Every month", "Only for premieres")


@dataclass
class Events(Website):
    """A website of an organiser."""

    family: ClassVar[str] = "events"
    suffixes: ClassVar[tuple[str, ...]] = tuple(suffix for kind in KINDS for suffix in kind.suffixes)
    words: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "listing": ("whats-on", "programme", "events", "listings"),
        "calendar": ("calendar", "diary", "month"),
        "event": ("event", "show", "date", "e"),
        "venues": ("venues", "places", "houses"),
        "people": ("people", "line-up", "who", "artists"),
        "past": ("archive", "past", "results", "history"),
        "standings": ("table", "standings", "ranking"),
        "visit": ("visit", "info", "plan-your-visit"),
        "news": ("newsletter", "mailing-list", "updates"),
        "saved": ("saved", "my-list", "reminders"),
        "basket": ("basket", "bag", "cart"),
        "order": ("order", "confirmation", "thanks"),
    }
    often: ClassVar[tuple[str, ...]] = HOW_OFTEN
    seasons: ClassVar[tuple[int, ...]] = SEASONS

    kind: Kind = field(init=False)
    season: Season = field(init=False)
    say: dict[str, str] = field(init=False)
    """This website's labels."""

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """Brand and hostname label; the second word says what kind of organiser it is."""
        brand = f"{stem} {pick(pick(KINDS, seed, 'kind').suffixes, seed, 'brand')}"
        return brand, slug(brand)

    def build(self) -> None:
        """Make the season and choose the words."""
        self.kind = pick(KINDS, self.seed, "kind")
        self.domain, self.subdomain = self.kind.domain, self.kind.subdomain
        self.tagline = pick(self.kind.taglines, self.seed, "tagline")
        self.season = Season(self.seed, self.kind)
        self.say = {key: pick(options, self.seed, "label", key) for key, options in LABELS.items()}
        self.front = pick(("posters", "agenda", "split"), self.seed, "front")
        self.page_size = pick((8, 9, 12), self.seed, "page size")
        self.currency = pick(("€{}", "£{}", "${}", "{} €", "CHF {}"), self.seed, "currency")
        self.half_day = pick((False, False, True), self.seed, "clock")
        self.has_basket = pick((True, False), self.seed, "basket")
        self.prices_on_top = pick((True, False, False), self.seed, "prices on top")

    # --- how things are written -----------------------------------------------------------------------

    def money(self, cents: int) -> str:
        """A price: ``€24.50``."""
        return self.currency.format(f"{cents / 100:,.2f}")

    def clock(self, minute: int) -> str:
        """A time of day: ``19:30`` or ``7:30 pm``."""
        hour, rest = divmod(minute % 1440, 60)
        if self.half_day:
            return f"{hour % 12 or 12}:{rest:02d} {'am' if hour < 12 else 'pm'}"
        return f"{hour:02d}:{rest:02d}"

    @staticmethod
    def spell(day: date) -> str:
        """``Sat 6 Jun 2026``."""
        return f"{day:%a} {day.day} {day:%b %Y}"

    @staticmethod
    def pairs(texts: Iterable[str]) -> list[tuple[str, str]]:
        """Options of a dropdown whose values are their texts."""
        return [(text, text) for text in texts]

    @cached_property
    def months(self) -> list[tuple[str, str]]:
        """Months on sale: (``2026-05``, ``May 2026``)."""
        return [(f"{year}-{month:02d}", f"{date(year, month, 1):%B %Y}") for year, month in MONTHS]

    @cached_property
    def categories(self) -> list[tuple[str, str]]:
        """Categories: (slug, name)."""
        return [(slug(name), name) for name in self.kind.categories]

    @cached_property
    def counts(self) -> list[tuple[str, str]]:
        """Numbers of tickets."""
        return [(str(n), str(n)) for n in range(1, MOST_TICKETS + 1)]

    @cached_property
    def venue_options(self) -> list[tuple[str, str]]:
        """Venues, for dropdowns."""
        return [(venue.slug, venue.name) for venue in self.season.venues]

    @cached_property
    def role_options(self) -> list[tuple[str, str]]:
        """What people play, write or do, for dropdowns."""
        return [(slug(role), role) for role in self.kind.role[1]]

    @cached_property
    def season_options(self) -> list[tuple[str, str]]:
        """Seasons that are over, for dropdowns."""
        return self.pairs(str(season) for season in SEASONS)

    def band_text(self, band: Band) -> str:
        """A price band in a dropdown."""
        return f"{band.name}, {self.money(band.cents)}"

    def band_options(self, event: Event) -> list[tuple[str, str]]:
        """Price bands that have tickets left."""
        return [(band.name, self.band_text(band)) for band in event.bands if band.left]

    def event_url(self, event: Event) -> str:
        """Address of an event."""
        return self.path("/~event/{name}", name=event.slug)

    def menu(self) -> list[tuple[str, str]]:
        """Pages of the main navigation, under other names and in another order on every website."""
        entries = [
            (self.say["listing"], self.path("/~listing")),
            (self.say["calendar"], self.path("/~calendar/{month}", month=self.months[0][0])),
            (self.say["venues"], self.path("/~venues")),
            (self.kind.people.capitalize(), self.path("/~people")),
            (self.kind.past, self.path("/~past")),
            (self.say["visit"], self.path("/~visit")),
        ]
        if self.kind.league:
            entries.append((self.say["standings"], self.path("/~standings")))
        stream(self.seed, "menu").shuffle(entries)
        return entries

    def report(self, state: State) -> dict[str, Any]:
        """Tickets bought and in the basket, what was saved, and sign-ups."""
        basket = {title: dict(line) for title, line in state.get("basket", {}).items()}
        saved = dict.fromkeys(state.get("saved", ()), True)
        return {
            "bought": state.get("bought", {}),
            "basket": basket,
            "saved": saved,
            "news": state.get("news", {}),
        }

    def assignments(self) -> Iterable[Assignment]:
        """See ``tasks.py``."""
        return assignments(self)

    # --- the programme ---------------------------------------------------------------------------------

    @page("/")
    def home(self, visit: Visit) -> Response:
        """The front page."""
        return self.render("events/front.html", visit, coming=self.season.events[:6])

    def narrowed(self, query: Mapping[str, str]) -> list[Event]:
        """Events that pass the filters, in the order asked for."""
        words = slug(query.get("q", ""))
        found = [
            event
            for event in self.season.events
            if query.get("month", "") in ("", month_key(event.day))
            and query.get("category", "") in ("", slug(event.category))
            and query.get("venue", "") in ("", event.venue.slug)
            and not (query.get("left") and event.sold_out)
            and (not words or words in slug(f"{event.title} {event.category} {event.venue.name}"))
        ]
        return sorted(found, key=SORTS.get(query.get("sort", ""), SORTS[""]))

    @page("/~listing")
    def listing(self, visit: Visit) -> Response:
        """All events, filtered."""
        found = self.narrowed(visit.query)
        return self.render("events/listing.html", visit, results=paged(found, visit, self.page_size))

    @page("/~calendar/{month}")
    def calendar(self, visit: Visit, month: str) -> Response:
        """A month with its events."""
        keys = [key for key, _ in self.months]
        if month not in keys:
            return self.missing(visit)
        year, number = (int(part) for part in month.split("-"))
        first = date(year, number, 1)
        start = first - timedelta(days=first.weekday())
        weeks = [[start + timedelta(days=7 * week + day) for day in range(7)] for week in range(6)]
        at = keys.index(month)
        return self.render(
            "events/calendar.html",
            visit,
            title=dict(self.months)[month],
            weeks=[week for week in weeks if any(day.month == number for day in week)],
            number=number,
            on={day: [e for e in self.season.events if e.day == day] for week in weeks for day in week},
            before=self.months[at - 1] if at else None,
            after=self.months[at + 1] if at + 1 < len(keys) else None,
        )

    @page("/~event/{name}")
    def event(self, visit: Visit, name: str) -> Response:
        """One event."""
        return self._event(visit, name, {}, 200)

    def _event(self, visit: Visit, name: str, errors: dict[str, str], status: int) -> Response:
        event = self.season.event(name)
        if event is None:
            return self.missing(visit)
        saved = event.title in visit.state.get("saved", ())
        return self.render(
            "events/event.html",
            visit,
            status=status,
            event=event,
            errors=errors,
            given=visit.form,
            saved=saved,
        )

    # --- tickets ---------------------------------------------------------------------------------------

    @page("/~event/{name}", method="POST")
    def choose(self, visit: Visit, name: str) -> Response:
        """Save an event, put tickets into the basket, or buy them at once."""
        event = self.season.event(name)
        if event is None:
            return self.missing(visit)
        if visit.form.get("act") == "save":
            saved = visit.state.setdefault("saved", [])
            if event.title not in saved:
                saved.append(event.title)
            return redirect(self.path("/~saved"))
        errors = check_choice(event, visit.form)
        if not self.has_basket:
            errors |= check_buyer(visit.form)
        if errors:
            return self._event(visit, name, errors, 422)
        band = next(band for band in event.bands if band.name == visit.form["band"])
        line = {"band": band.name, "count": int(visit.form["count"])}
        if not self.has_basket:
            return self._buy(visit, {event.title: line})
        visit.state.setdefault("basket", {})[event.title] = line
        return redirect(self.path("/~basket"))

    def cost(self, title: str, line: Mapping[str, Any]) -> int:
        """What a line of a basket costs, in cents."""
        event = next(event for event in self.season.events if event.title == title)
        cents = next(band.cents for band in event.bands if band.name == line["band"])
        return int(cents * line["count"])

    @page("/~basket")
    def basket(self, visit: Visit) -> Response:
        """What was chosen, and the buyer's details."""
        return self._basket(visit, {}, 200)

    def _basket(self, visit: Visit, errors: dict[str, str], status: int) -> Response:
        lines = visit.state.get("basket", {})
        total = sum(self.cost(title, line) for title, line in lines.items())
        return self.render(
            "events/basket.html",
            visit,
            status=status,
            lines=lines,
            total=total,
            errors=errors,
            given=visit.form,
        )

    @page("/~basket", method="POST")
    def check_out(self, visit: Visit) -> Response:
        """Remove something from the basket, or buy all of it."""
        lines = visit.state.get("basket", {})
        if gone := visit.form.get("remove"):
            lines.pop(gone, None)
            return redirect(self.path("/~basket"))
        errors = check_buyer(visit.form)
        if errors or not lines:
            return self._basket(visit, errors, 422)
        visit.state["basket"] = {}
        return self._buy(visit, lines)

    def _buy(self, visit: Visit, lines: Mapping[str, Mapping[str, Any]]) -> Response:
        name, email = visit.form["name"].strip(), visit.form["email"].strip()
        number = self.order_number(name, lines)
        for title, line in lines.items():
            visit.state.setdefault("bought", {})[title] = {
                **line,
                "name": name,
                "email": email,
                "order": number,
            }
        return redirect(self.path("/~order/{number}", number=number))

    def order_number(self, name: str, lines: Mapping[str, Mapping[str, Any]]) -> str:
        """The number that an order gets."""
        what = [(title, line["band"], line["count"]) for title, line in sorted(lines.items())]
        return reference(self.seed, name.casefold(), what)

    @page("/~order/{number}")
    def order(self, visit: Visit, number: str) -> Response:
        """What was bought."""
        bought = {t: line for t, line in visit.state.get("bought", {}).items() if line["order"] == number}
        if not bought:
            return self.missing(visit)
        return self.render("events/order.html", visit, number=number, lines=bought)

    @page("/~saved")
    def saved(self, visit: Visit) -> Response:
        """Events that were saved."""
        titles = visit.state.get("saved", ())
        found = [event for event in self.season.events if event.title in titles]
        return self.render("events/saved.html", visit, found=found)

    # --- everything else ---------------------------------------------------------------------------------

    @page("/~venues")
    def venues(self, visit: Visit) -> Response:
        """All venues."""
        return self.render("events/venues.html", visit, venues=self.season.venues)

    @page("/~venues/{name}")
    def venue(self, visit: Visit, name: str) -> Response:
        """One venue."""
        venue = self.season.venue(name)
        if venue is None:
            return self.missing(visit)
        coming = [event for event in self.season.events if event.venue == venue][:5]
        return self.render("events/venue.html", visit, venue=venue, coming=coming)

    @page("/~people")
    def people(self, visit: Visit) -> Response:
        """Everybody who appears."""
        role = visit.query.get("role", "")
        found = [person for person in self.season.people if role in ("", slug(person.role))]
        return self.render("events/people.html", visit, results=paged(found, visit, self.page_size))

    @page("/~people/{name}")
    def person(self, visit: Visit, name: str) -> Response:
        """Somebody who appears."""
        person = self.season.person(name)
        if person is None:
            return self.missing(visit)
        return self.render("events/person.html", visit, person=person, coming=self.season.with_person(person))

    @page("/~past")
    def past(self, visit: Visit) -> Response:
        """What took place before."""
        found = self.past_of(visit.query.get("season", ""))
        if visit.query.get("sort") == "visitors":
            found = sorted(found, key=lambda past: -past.visitors)
        return self.render("events/past.html", visit, results=paged(found, visit, 10))

    def past_of(self, season: str) -> list[Past]:
        """What took place in a season, or in all."""
        return [past for past in self.season.past if season in ("", str(past.season))]

    @page("/~standings")
    def standings(self, visit: Visit) -> Response:
        """A league's table."""
        if not self.kind.league:
            return self.missing(visit)
        return self.render("events/standings.html", visit, rows=self.season.standings)

    @page("/~visit")
    def visit_us(self, visit: Visit) -> Response:
        """Information for visitors."""
        return self.render("events/visit.html", visit, rules=self.season.rules)

    @page("/~news")
    def news(self, visit: Visit) -> Response:
        """The newsletter's form."""
        return self.render("events/news.html", visit, given={}, errors={})

    @page("/~news", method="POST")
    def subscribe(self, visit: Visit) -> Response:
        """Check the sign-up."""
        form, errors = check_news(self, visit.form)
        if errors:
            return self.render("events/news.html", visit, status=422, given=form, errors=errors)
        about = dict(self.categories)[form["about"]]
        wishes = {"about": about, "often": form["often"], "name": form["name"]}
        visit.state.setdefault("news", {})[form["email"].lower()] = wishes
        visit.state["last news"] = form["email"].lower()
        return redirect(self.path("/~news/done"))

    @page("/~news/done")
    def subscribed(self, visit: Visit) -> Response:
        """The last sign-up."""
        email = visit.state.get("last news")
        if email is None:
            return redirect(self.path("/~news"))
        return self.render("events/subscribed.html", visit, email=email, wishes=visit.state["news"][email])
