"""What kinds of organisers there are, and what is particular to each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
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


_FUN = "Entertainment"

KINDS: tuple[Kind, ...] = (
    Kind(
        name="concert hall",
        suffixes=("Philharmonic", "Concert Hall", "Symphony"),
        domain=_FUN,
        subdomain="Music",
        event="concert",
        events="concerts",
        person="soloist",
        people="soloists",
        role=("Instrument", ("Violin", "Piano", "Cello", "Soprano", "Clarinet", "Organ", "Trumpet", "Harp")),
        categories=("Symphonic", "Chamber music", "Early music", "Choral", "Family concerts", "Contemporary"),
        titles=("{one} {two}", "{who} plays {one} {two}", "{one} {two} at Noon"),
        ones=tuple("Winter Autumn Northern Pastoral Silent Golden Baroque Midnight Distant Festive".split()),
        twos=tuple("Serenade Variations Requiem Nocturnes Sonatas Suite Overtures Fantasia Dances".split()),
        bands=(("Gallery", 1.0), ("Circle", 1.6), ("Stalls", 2.3)),
        price=(12, 34),
        minutes=(60, 140),
        hours=(11, 20),
        venues=("{} Hall", "Great Hall {}", "{} Chapel", "{} Music Room"),
        picture="pattern",
        past="Past concerts",
        taglines=("live music since 1902", "an orchestra and its house", "listen closely"),
    ),
    Kind(
        name="theatre",
        suffixes=("Theatre", "Playhouse", "Stage"),
        domain=_FUN,
        subdomain="Live Shows & Performances",
        event="performance",
        events="performances",
        person="actor",
        people="company",
        role=("Trained in", ("Mime", "Classical acting", "Puppetry", "Dance", "Stage combat", "Clowning")),
        categories=("Drama", "Comedy", "Musical", "Dance", "Children's theatre", "Opera"),
        titles=("The {one} {two}", "A {two} for {one} Days", "{one} {two}"),
        ones=tuple("Glass Crooked Salt Borrowed Lost Paper Burning Velvet Hollow Last Seventh Quiet".split()),
        twos=tuple(
            "Orchard Tailor Window Inheritance Lighthouse Suitcase Widow Harvest Mirror Guest".split()
        ),
        bands=(("Balcony", 1.0), ("Dress circle", 1.5), ("Stalls", 1.9)),
        price=(14, 38),
        minutes=(75, 190),
        hours=(14, 20),
        venues=("{} Main Stage", "{} Studio", "The {} Cellar", "{} Courtyard"),
        picture="face",
        past="Past seasons",
        taglines=("four stages under one roof", "plays old and new", "the curtain is up"),
    ),
    Kind(
        name="music festival",
        suffixes=("Festival", "Open Air", "Sounds"),
        domain=_FUN,
        subdomain="Music",
        event="show",
        events="shows",
        person="act",
        people="line-up",
        role=("Style", ("Folk", "Techno", "Jazz", "Indie rock", "Hip-hop", "Ska", "Ambient", "Soul")),
        categories=("Main stage", "Night sessions", "Acoustic", "Workshops", "After-show", "Kids' field"),
        titles=("{who} live", "{one} {two}", "{one} {two} with {who}"),
        ones=tuple("Electric Sunset River Neon Barefoot Thunder Moonlit Dusty Wild Backyard".split()),
        twos=tuple("Session Rave Jam Parade Picnic Blowout Circle Marathon Lounge Takeover".split()),
        bands=(("Day ticket", 1.0), ("Weekend pass", 2.2), ("Backstage pass", 4.1)),
        price=(22, 55),
        minutes=(45, 120),
        hours=(12, 22),
        venues=("{} Meadow", "{} Barn", "{} Lakeside", "Tent {}"),
        picture="pattern",
        past="Former years",
        taglines=("three fields, one summer", "bring your tent", "loud and muddy"),
    ),
    Kind(
        name="museum",
        suffixes=("Museum", "Gallery", "Collections"),
        domain="Travel & Transportation",
        subdomain="Ticketed Activities",
        event="exhibition tour",
        events="tours and talks",
        person="curator",
        people="curators",
        role=("Department", ("Paintings", "Textiles", "Coins", "Natural history", "Maps", "Ceramics")),
        categories=("Guided tours", "Talks", "Workshops", "Family days", "Late openings", "Concerts"),
        titles=("{one} {two}", "Inside the {one} {two}", "{who} on {one} {two}"),
        ones=tuple("Roman Bronze Painted Forgotten Polar Woven Medieval Hidden Travelling Gilded".split()),
        twos=tuple("Coins Portraits Maps Tapestries Fossils Clocks Manuscripts Masks Gardens".split()),
        bands=(("Child", 1.0), ("Concession", 1.7), ("Adult", 2.4)),
        price=(3, 9),
        minutes=(40, 120),
        hours=(10, 18),
        venues=("{} Wing", "{} House", "{} Room", "{} Court"),
        picture="scene",
        past="Past exhibitions",
        taglines=("two thousand years in nine rooms", "free on Sundays", "look again"),
    ),
    Kind(
        name="football league",
        suffixes=("Football League", "Premier Division", "Football"),
        domain="Lifestyle & Leisure",
        subdomain="Sports & Fitness",
        event="match",
        events="matches",
        person="club",
        people="clubs",
        role=(
            "Colours",
            ("Red and white", "Blue", "Green and gold", "Black and amber", "Maroon", "Sky blue"),
        ),
        categories=("League", "Cup", "Youth league", "Women's league", "Friendlies"),
        titles=("{who} v {other}",),
        ones=(),
        twos=(),
        bands=(("Terrace", 1.0), ("North stand", 1.5), ("Main stand", 2.1)),
        price=(8, 24),
        minutes=(105, 120),
        hours=(13, 20),
        venues=("{} Park", "{} Road", "The {} Ground", "{} Arena"),
        picture="pattern",
        past="Results",
        taglines=("every match, every goal", "the league of small towns", "ninety minutes"),
        league=True,
    ),
    Kind(
        name="ice hockey league",
        suffixes=("Hockey League", "Ice League"),
        domain="Lifestyle & Leisure",
        subdomain="Sports & Fitness",
        event="game",
        events="games",
        person="team",
        people="teams",
        role=("Mascot", ("Bear", "Wolf", "Eagle", "Moose", "Pike", "Fox", "Otter", "Badger")),
        categories=("Regular season", "Cup", "Junior league", "All-star", "Play-offs"),
        titles=("{who} v {other}",),
        ones=(),
        twos=(),
        bands=(("Standing", 1.0), ("Corner seat", 1.6), ("Centre ice", 2.5)),
        price=(11, 29),
        minutes=(130, 160),
        hours=(15, 20),
        venues=("{} Rink", "{} Ice Dome", "{} Arena"),
        picture="pattern",
        past="Results",
        taglines=("cold hands, warm hearts", "three periods of noise", "faceoff"),
        league=True,
    ),
    Kind(
        name="cinema",
        suffixes=("Cinemas", "Picture House", "Film Theatre"),
        domain=_FUN,
        subdomain="Films & TV Shows",
        event="screening",
        events="screenings",
        person="director",
        people="directors",
        role=(
            "Known for",
            ("Thrillers", "Documentaries", "Animation", "Westerns", "Melodrama", "Silent films"),
        ),
        categories=("New releases", "Classics", "Documentary", "Family films", "Late night", "Silent films"),
        titles=("The {one} {two}", "{one} {two}", "Return of the {two}"),
        ones=tuple("Midnight Concrete Lonely Scarlet Broken Invisible Frozen Second Electric Hungry".split()),
        twos=tuple("Detective Astronaut Motel Passenger Clown Highway Sisters Island Robot Summer".split()),
        bands=(("Front rows", 1.0), ("Standard", 1.3), ("Sofa", 2.0)),
        price=(5, 12),
        minutes=(72, 178),
        hours=(11, 22),
        venues=("{} Screen", "{} Palace", "{} Odeon", "{} Kino"),
        picture="scene",
        past="Already shown",
        taglines=("popcorn and subtitles", "seven screens", "films on film"),
    ),
    Kind(
        name="comedy club",
        suffixes=("Comedy Club", "Laughs", "Stand-up"),
        domain=_FUN,
        subdomain="Live Shows & Performances",
        event="show",
        events="shows",
        person="comedian",
        people="comedians",
        role=(
            "Style",
            ("Deadpan", "Musical comedy", "Improv", "Storytelling", "One-liners", "Character comedy"),
        ),
        categories=("Stand-up", "Improv", "Open mic", "Musical comedy", "Try-outs", "Panel shows"),
        titles=("{who}: {one} {two}", "{one} {two}", "{who} tries out {one} {two}"),
        ones=tuple("Mildly Badly Almost Deeply Politely Wildly Barely Loudly Suspiciously".split()),
        twos=tuple("Employed Famous Dressed Organised Married Qualified Awake Vegan Grown-up".split()),
        bands=(("Back tables", 1.0), ("Front tables", 1.4), ("Dinner and show", 3.0)),
        price=(9, 21),
        minutes=(50, 130),
        hours=(18, 22),
        venues=("{} Cellar", "{} Basement", "The {} Bar", "{} Room"),
        picture="face",
        past="Shows gone by",
        taglines=("two drinks minimum, no heckling", "a laugh or a full refund", "downstairs"),
    ),
    Kind(
        name="conference",
        suffixes=("Conference", "Summit", "Forum"),
        domain="Science & Research",
        subdomain="Technology & Science",
        event="session",
        events="sessions",
        person="speaker",
        people="speakers",
        role=(
            "Field",
            ("Robotics", "Batteries", "Soil science", "Databases", "Astronomy", "Genetics", "Optics"),
        ),
        categories=("Keynotes", "Talks", "Workshops", "Panels", "Poster session", "Lab visits"),
        titles=("{one} {two}", "{who} on {one} {two}", "A Practical Guide to {one} {two}"),
        ones=tuple("Reliable Sustainable Tiny Distributed Quantum Affordable Edible Resilient Open".split()),
        twos=tuple(
            "Sensors Batteries Networks Telescopes Datasets Materials Robots Satellites Enzymes".split()
        ),
        bands=(("Online", 1.0), ("Day pass", 2.8), ("Full pass", 5.4)),
        price=(20, 60),
        minutes=(25, 180),
        hours=(9, 17),
        venues=("{} Auditorium", "Room {}", "{} Lab", "{} Pavilion"),
        picture="pattern",
        past="Earlier editions",
        taglines=("people who build things", "three days of questions", "research in the open"),
    ),
    Kind(
        name="literary festival",
        suffixes=("Book Festival", "Literature House", "Readings"),
        domain=_FUN,
        subdomain="Books & Reading",
        event="reading",
        events="readings",
        person="author",
        people="authors",
        role=(
            "Writes",
            ("Novels", "Poetry", "Crime fiction", "Essays", "Travel writing", "Children's books"),
        ),
        categories=("Readings", "Debates", "Children's hour", "Poetry", "Writing classes", "Translations"),
        titles=("{who} reads {one} {two}", "{one} {two}", "{who} and {other} in Conversation"),
        ones=tuple("Unsent Lost Small Coastal Winter Secret Ordinary Translated Inherited Foreign".split()),
        twos=tuple("Letters Islands Kitchens Borders Mothers Rivers Ghosts Gardens Trains Alphabets".split()),
        bands=(("Standing", 1.0), ("Seated", 1.5), ("Seat and signed book", 3.6)),
        price=(6, 16),
        minutes=(45, 110),
        hours=(10, 20),
        venues=("{} Library", "{} Bookshop", "{} Reading Room", "Café {}"),
        picture="scene",
        past="Earlier readings",
        taglines=("books out loud", "a town that reads", "bring your own pencil"),
    ),
    Kind(
        name="gaming convention",
        suffixes=("Con", "Game Fest", "Game Fair"),
        domain=_FUN,
        subdomain="Gaming & Virtual Worlds",
        event="tournament",
        events="tournaments and panels",
        person="guest",
        people="guests",
        role=("Known as", ("Speedrunner", "Level designer", "Streamer", "Composer", "Voice actor", "Modder")),
        categories=("Tournaments", "Panels", "Retro arcade", "Board games", "Cosplay", "Workshops"),
        titles=("{one} {two}", "{who} presents {one} {two}", "{one} {two} Finals"),
        ones=tuple("Pixel Dungeon Turbo Galaxy Ninja Retro Shadow Dragon Cyber Turnip".split()),
        twos=tuple("Cup League Quest Clash Showdown Relay Marathon Heist Kingdom Derby".split()),
        bands=(("Spectator", 1.0), ("Player", 1.8), ("Collector's badge", 4.2)),
        price=(7, 25),
        minutes=(45, 240),
        hours=(10, 20),
        venues=("Hall {}", "{} Arena", "{} Dome", "{} Lounge"),
        picture="thing",
        past="Earlier editions",
        taglines=("press start", "dice, sticks and keyboards", "one weekend, all genres"),
    ),
)

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

ACCESS = (
    "Wheelchair places",
    "Induction loop",
    "Sign language interpreter",
    "Audio description",
    "Step-free entrance",
    "Relaxed atmosphere",
    "Captions",
    "Companion seats free",
)

STREETS = "Chapel Station Castle Market Abbey Orchard Tanner Bishop Mill Harbour Garden Bell".split()

ABOUT = (
    "An evening that took two years to prepare.",
    "Back after a long absence, by popular demand.",
    "For those who come for the first time and for those who never miss one.",
    "Seen once, not easily forgotten.",
    "A rare chance: it will not be repeated this season.",
    "Come early, the doors open on time.",
    "Small, close and without a microphone.",
    "Part of a series that runs through the summer.",
)
