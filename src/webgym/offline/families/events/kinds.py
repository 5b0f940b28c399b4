"""What kinds of organisers there are, and what is particular to each."""

from __future__ import annotations

from webgym.offline.data import Table, load


class Kind(Table, frozen=True):
    """One kind of organiser.

    Attributes:
        name: of the kind.
        suffixes: second words of its brands.
        domain, subdomain: of the taxonomy.
        event, events: what takes place.
        person, people: who appears.
        role: what is told about those, and the values it takes.
        categories: kinds of events; also what a newsletter is about.
        titles: patterns of titles, with ``{one}`` and ``{two}`` from the words below, ``{who}`` for who
            appears and ``{other}`` for a second one.
        ones, twos: words of titles.
        bands: price bands with their factors, the cheapest first.
        price: lowest and highest basic price, whole units of currency.
        minutes: shortest and longest duration.
        hours: earliest and latest start.
        venues: patterns for names of venues.
        picture: kind of illustration.
        past: what the page of results is called.
        taglines: under the brand.
        league: whether events are matches with scores.
    """

    name: str
    suffixes: tuple[str, ...]
    domain: str
    subdomain: str
    event: str
    events: str
    person: str
    people: str
    role: tuple[str, tuple[str, ...]]
    categories: tuple[str, ...]
    titles: tuple[str, ...]
    ones: tuple[str, ...]
    twos: tuple[str, ...]
    bands: tuple[tuple[str, float], ...]
    price: tuple[int, int]
    minutes: tuple[int, int]
    hours: tuple[int, int]
    venues: tuple[str, ...]
    picture: str
    past: str
    taglines: tuple[str, ...]
    league: bool = False


class Words(Table, frozen=True):
    """``kinds.toml``.

    Attributes:
        access: what a venue has for visitors who need it.
        about: sentences about an event.
    """

    access: tuple[str, ...]
    streets: tuple[str, ...]
    about: tuple[str, ...]
    kinds: tuple[Kind, ...]


WORDS = load("webgym.offline.families.events", "kinds.toml", Words)
KINDS = WORDS.kinds

LABELS: dict[str, tuple[str, ...]] = {
    "listing": ("What's on", "Programme", "Events", "Dates and tickets", "Listings"),
    "calendar": ("Calendar", "Month view", "Diary", "By date"),
    "venues": ("Venues", "Places", "Where we are", "Our houses"),
    "visit": ("Your visit", "Good to know", "Before you come", "Information"),
    "news": ("Newsletter", "Stay in touch", "Mailing list", "Join our list"),
    "saved": ("My list", "Saved", "Watch list", "Reminders"),
    "basket": ("Basket", "Bag", "My tickets", "Order"),
    "standings": ("Table", "Standings", "Rankings"),
    "month": ("Month", "When", "Show month", "In"),
    "category": ("Category", "Type", "Kind", "What"),
    "venue": ("Venue", "Place", "Where"),
    "sort": ("Sort by", "Order", "Arrange by"),
    "by_date": ("Date", "Soonest first", "By date"),
    "by_price": ("Price, lowest first", "Cheapest first", "Lowest price"),
    "by_length": ("Longest first", "Duration, longest first", "Length"),
    "seats": ("Available only", "Hide sold out", "Tickets left"),
    "search": ("Search the programme", "Search", "Find an event", "Looking for something?"),
    "band": ("Price band", "Ticket type", "Area", "Category of ticket"),
    "count": ("Number of tickets", "Quantity", "How many"),
    "add": ("Add to basket", "Choose these tickets", "Put in basket"),
    "save": ("Save for later", "Remind me", "Add to my list"),
    "name": ("Full name", "Name", "Your name", "Name on the tickets"),
    "email": ("E-mail", "E-mail address", "Your e-mail"),
    "about": ("About", "Description", "The event"),
    "tickets": ("Tickets", "Prices", "What it costs"),
    "access": ("Access", "Accessibility", "Getting in"),
    "refunds": ("Refunds", "Returns and exchanges", "If you cannot come"),
    "groups": ("Groups and discounts", "Discounts", "Reductions"),
    "bags": ("Bags and cameras", "Cloakroom", "What to bring"),
    "young": ("Children", "Families", "Young visitors"),
    "season": ("Season", "Year"),
}
"""Words a website chooses from: one of every row."""
