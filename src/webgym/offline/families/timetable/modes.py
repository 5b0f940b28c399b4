"""What kinds of operators there are, and what is particular to each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mode:
    """One kind of operator.

    Attributes:
        name: of the kind.
        suffixes: second words of its brands.
        subdomain: of the taxonomy, under "Travel & Transportation".
        stop, stops: what a place on its network is called.
        vehicle, vehicles: what departs.
        line: what stops in a row are called.
        bay: where at a stop it departs from.
        prefixes: first parts of service codes.
        stop_names: patterns for the names of stops.
        classes: fare classes with their price factors, the cheapest first.
        seats: seat preferences.
        step_km: least and greatest distance between neighbouring stops.
        speed: km/h.
        overhead: minutes that every journey takes on top.
        fare: basic fare and fare per km, in the website's currency.
        hours: earliest and latest departure, hours.
        a_day: fewest and most departures of a pair of stops on a day.
        facilities: what a stop may have.
        amenities: what a vehicle may have.
        extras: what can be added to a booking, with its price.
        causes: of disruptions.
        taglines: under the brand.
    """

    name: str
    suffixes: tuple[str, ...]
    subdomain: str
    stop: str
    stops: str
    vehicle: str
    vehicles: str
    line: str
    bay: str
    prefixes: tuple[str, ...]
    stop_names: tuple[str, ...]
    classes: tuple[tuple[str, float], ...]
    seats: tuple[str, ...]
    step_km: tuple[int, int]
    speed: int
    overhead: int
    fare: tuple[float, float]
    hours: tuple[int, int]
    a_day: tuple[int, int]
    facilities: tuple[str, ...]
    amenities: tuple[str, ...]
    extras: tuple[tuple[str, int], ...]
    causes: tuple[str, ...]
    taglines: tuple[str, ...]


_STATION = (
    "Ticket office",
    "Waiting room",
    "Luggage lockers",
    "Bicycle hire",
    "Step-free access",
    "Coffee bar",
    "Taxi rank",
    "Long-stay car park",
    "Lost property desk",
    "Baby changing room",
    "Showers",
    "Cash machine",
)

MODES: tuple[Mode, ...] = (
    Mode(
        name="train",
        suffixes=("Rail", "Railways", "Trains", "Intercity"),
        subdomain="Travel & Accommodation",
        stop="station",
        stops="stations",
        vehicle="train",
        vehicles="trains",
        line="Line",
        bay="Platform",
        prefixes=("IC", "RX", "EX", "IR"),
        stop_names=("{}", "{}", "{} Central", "{} Junction"),
        classes=(("Second class", 1.0), ("First class", 1.6)),
        seats=("Window seat", "Aisle seat", "Table seat", "Quiet coach"),
        step_km=(24, 88),
        speed=112,
        overhead=6,
        fare=(4.0, 0.19),
        hours=(5, 22),
        a_day=(9, 14),
        facilities=_STATION,
        amenities=("Wi-Fi", "Power sockets", "Restaurant car", "Bicycle space", "Quiet coach", "Family area"),
        extras=(("Bicycle ticket", 9), ("Large suitcase", 6), ("Breakfast box", 11), ("Dog ticket", 8)),
        causes=("Track renewal", "Signal failure", "Bridge inspection", "Fallen tree", "Staff shortage"),
        taglines=("trains between towns", "the country by rail", "every hour, every town"),
    ),
    Mode(
        name="night train",
        suffixes=("Night Trains", "Sleepers", "Night Express"),
        subdomain="Travel & Accommodation",
        stop="station",
        stops="stations",
        vehicle="night train",
        vehicles="night trains",
        line="Line",
        bay="Platform",
        prefixes=("NT", "SL", "EN"),
        stop_names=("{}", "{} Main Station", "{}", "{} West"),
        classes=(("Reclining seat", 1.0), ("Couchette", 1.7), ("Sleeper cabin", 3.1)),
        seats=("Lower berth", "Middle berth", "Upper berth"),
        step_km=(120, 260),
        speed=84,
        overhead=20,
        fare=(19.0, 0.07),
        hours=(16, 23),
        a_day=(6, 9),
        facilities=(*_STATION[:10], "Night lounge", "Left-luggage desk"),
        amenities=("Wi-Fi", "Power sockets", "Bar car", "Shower", "Breakfast service", "Bicycle space"),
        extras=(("Bicycle ticket", 14), ("Large suitcase", 9), ("Dinner tray", 18), ("Ear-plug kit", 4)),
        causes=("Track renewal", "Border checks", "Locomotive fault", "Storm damage", "Staff shortage"),
        taglines=("fall asleep here, wake up there", "beds on rails", "the slow night way"),
    ),
    Mode(
        name="ferry",
        suffixes=("Ferries", "Sea Link", "Ferry Line", "Crossings"),
        subdomain="Travel & Accommodation",
        stop="port",
        stops="ports",
        vehicle="ferry",
        vehicles="sailings",
        line="Crossing",
        bay="Berth",
        prefixes=("F", "SF", "MV"),
        stop_names=("{}", "Port {}", "{} Harbour", "{}"),
        classes=(("Deck seat", 1.0), ("Lounge seat", 1.4), ("Cabin", 2.6)),
        seats=("Starboard side", "Port side", "Upper deck", "Lower deck"),
        step_km=(14, 46),
        speed=38,
        overhead=10,
        fare=(8.0, 0.36),
        hours=(6, 21),
        a_day=(6, 11),
        facilities=(
            "Ticket office",
            "Waiting hall",
            "Vehicle lanes",
            "Bicycle hire",
            "Step-free access",
            "Fish kiosk",
            "Taxi rank",
            "Long-stay car park",
            "Left-luggage desk",
            "Showers",
            "Pet relief area",
            "Cash machine",
        ),
        amenities=("Wi-Fi", "Sun deck", "Cafeteria", "Play area", "Pet lounge", "Duty-free shop"),
        extras=(("Bicycle place", 7), ("Motorcycle place", 22), ("Kennel", 15), ("Breakfast buffet", 13)),
        causes=("High seas", "Berth repair", "Engine overhaul", "Dense fog", "Crew shortage"),
        taglines=("across the water since 1931", "islands within reach", "ships that keep time"),
    ),
    Mode(
        name="river boat",
        suffixes=("Riverboats", "River Lines", "Waterbus"),
        subdomain="Outdoor & Recreation",
        stop="pier",
        stops="piers",
        vehicle="boat",
        vehicles="boats",
        line="Run",
        bay="Pontoon",
        prefixes=("B", "RB", "W"),
        stop_names=("{} Pier", "{} Quay", "{} Lock", "{} Pier"),
        classes=(("Saloon", 1.0), ("Panorama deck", 1.5)),
        seats=("Bow", "Stern", "Open deck", "Indoors"),
        step_km=(4, 13),
        speed=17,
        overhead=4,
        fare=(3.0, 0.42),
        hours=(8, 19),
        a_day=(6, 10),
        facilities=(
            "Ticket kiosk",
            "Covered shelter",
            "Bicycle hire",
            "Step-free access",
            "Ice cream stand",
            "Canoe hire",
            "Riverside car park",
            "Picnic meadow",
            "Drinking water",
            "Toilets",
            "Playground",
        ),
        amenities=("Audio guide", "Bar", "Bicycle rack", "Open deck", "Toilets", "Heating"),
        extras=(("Bicycle place", 4), ("Picnic basket", 17), ("Audio guide", 3), ("Dog ticket", 2)),
        causes=("High water", "Low water", "Lock repair", "Rowing regatta", "Pontoon repair"),
        taglines=("the town from the water", "slow boats, wide views", "up and down the river"),
    ),
    Mode(
        name="coach",
        suffixes=("Coaches", "Bus Lines", "Express Coaches", "Coachways"),
        subdomain="Travel & Accommodation",
        stop="coach stop",
        stops="coach stops",
        vehicle="coach",
        vehicles="coaches",
        line="Line",
        bay="Bay",
        prefixes=("C", "NX", "LD"),
        stop_names=("{}", "{} Bus Station", "{}", "{} Park & Ride"),
        classes=(("Standard", 1.0), ("Legroom", 1.3), ("Business row", 1.7)),
        seats=("Front row", "Window seat", "Aisle seat", "Back row"),
        step_km=(26, 95),
        speed=72,
        overhead=8,
        fare=(3.0, 0.09),
        hours=(4, 23),
        a_day=(9, 14),
        facilities=(*_STATION[:4], "Heated shelter", *_STATION[4:8], "Vending machines", "Toilets"),
        amenities=("Wi-Fi", "USB sockets", "Toilet on board", "Reclining seats", "Bicycle rack", "Snacks"),
        extras=(("Second suitcase", 5), ("Bicycle place", 8), ("Skis", 7), ("Snack bag", 6)),
        causes=("Road works", "Marathon closure", "Heavy snow", "Driver shortage", "Bridge closure"),
        taglines=("long roads, small fares", "the cheap way across", "coaches day and night"),
    ),
    Mode(
        name="airport shuttle",
        suffixes=("Airport Shuttle", "Transfers", "Airlink"),
        subdomain="Travel & Accommodation",
        stop="stop",
        stops="stops",
        vehicle="shuttle",
        vehicles="shuttles",
        line="Loop",
        bay="Stand",
        prefixes=("A", "SH", "TX"),
        stop_names=("{}", "{} Hotel Quarter", "{} Terminal", "{} Town Hall"),
        classes=(("Shared", 1.0), ("Priority", 1.5), ("Private van", 3.8)),
        seats=("Front seat", "Window seat", "Aisle seat"),
        step_km=(6, 24),
        speed=46,
        overhead=5,
        fare=(5.0, 0.25),
        hours=(3, 23),
        a_day=(9, 14),
        facilities=(
            "Information desk",
            "Heated shelter",
            "Luggage trolleys",
            "Step-free access",
            "Coffee bar",
            "Taxi rank",
            "Drop-off zone",
            "Long-stay car park",
            "Live departure board",
            "Toilets",
        ),
        amenities=(
            "Wi-Fi",
            "USB sockets",
            "Luggage trailer",
            "Air conditioning",
            "Water bottles",
            "Child seat",
        ),
        extras=(("Extra suitcase", 4), ("Child seat", 5), ("Ski bag", 9), ("Meet and greet", 12)),
        causes=("Road works", "Terminal evacuation", "Heavy snow", "Driver shortage", "Tunnel closure"),
        taglines=("to the gate on time", "doorstep to departures", "fixed fares to the airport"),
    ),
    Mode(
        name="flight",
        suffixes=("Air", "Airways", "Airlines", "Wings"),
        subdomain="Travel & Accommodation",
        stop="airport",
        stops="airports",
        vehicle="flight",
        vehicles="flights",
        line="Corridor",
        bay="Gate",
        prefixes=("QJ", "VK", "ZW", "XB"),
        stop_names=("{}", "{}", "{} International", "{} City"),
        classes=(("Economy", 1.0), ("Economy Plus", 1.5), ("Business", 2.9)),
        seats=("Window seat", "Middle seat", "Aisle seat", "Exit row"),
        step_km=(240, 620),
        speed=640,
        overhead=38,
        fare=(21.0, 0.07),
        hours=(6, 21),
        a_day=(7, 11),
        facilities=(
            "Business lounge",
            "Prayer room",
            "Left-luggage desk",
            "Car hire desk",
            "Step-free access",
            "Sleeping pods",
            "Taxi rank",
            "Long-stay car park",
            "Currency exchange",
            "Play area",
            "Showers",
            "Rail link",
        ),
        amenities=("Wi-Fi", "Seat-back screens", "USB sockets", "Hot meals", "Fast boarding", "Bassinets"),
        extras=(("Checked bag", 32), ("Sports equipment", 45), ("Hot meal", 14), ("Lounge pass", 29)),
        causes=("Air traffic control strike", "Runway repair", "Volcanic ash", "Crew shortage", "Dense fog"),
        taglines=("small airports, short queues", "the friendly regional airline", "fly in an hour"),
    ),
    Mode(
        name="heritage railway",
        suffixes=("Steam Railway", "Heritage Railway", "Narrow Gauge Railway"),
        subdomain="Ticketed Activities",
        stop="station",
        stops="stations",
        vehicle="steam train",
        vehicles="steam trains",
        line="Branch",
        bay="Platform",
        prefixes=("S", "H", "NG"),
        stop_names=("{} Halt", "{}", "{} Road", "{} Mill"),
        classes=(("Third class", 1.0), ("First class", 1.8), ("Pullman", 3.2)),
        seats=("Window seat", "Compartment", "Open carriage"),
        step_km=(3, 9),
        speed=24,
        overhead=4,
        fare=(5.0, 0.8),
        hours=(9, 17),
        a_day=(6, 8),
        facilities=(
            "Booking hall",
            "Tea room",
            "Engine shed tours",
            "Gift shop",
            "Signal box visits",
            "Model railway",
            "Step-free access",
            "Free car park",
            "Picnic area",
            "Museum coach",
            "Toilets",
        ),
        amenities=(
            "Buffet car",
            "Guard's van",
            "Open balcony",
            "Wheelchair ramp",
            "Dog friendly",
            "Steam heating",
        ),
        extras=(("Cream tea", 12), ("Footplate visit", 35), ("Guidebook", 6), ("Dog ticket", 3)),
        causes=(
            "Boiler inspection",
            "Track renewal",
            "Dry weather fire risk",
            "Film shooting",
            "Volunteer shortage",
        ),
        taglines=("steam through the valley", "run by volunteers since 1974", "soot, brass and tea"),
    ),
    Mode(
        name="mountain railway",
        suffixes=("Mountain Railway", "Cableways", "Alpine Lines"),
        subdomain="Outdoor & Recreation",
        stop="mountain station",
        stops="mountain stations",
        vehicle="cabin",
        vehicles="ascents",
        line="Track",
        bay="Ramp",
        prefixes=("M", "G", "ZR"),
        stop_names=("{}", "{} Ridge", "{} Saddle", "{} Valley Station"),
        classes=(("Standard", 1.0), ("Panorama", 1.5)),
        seats=("Valley side", "Mountain side", "Front cabin"),
        step_km=(2, 6),
        speed=16,
        overhead=3,
        fare=(6.0, 1.4),
        hours=(7, 18),
        a_day=(8, 12),
        facilities=(
            "Ticket office",
            "Restaurant",
            "Ski depot",
            "Viewing platform",
            "Step-free access",
            "Paragliding launch",
            "Toboggan hire",
            "Free car park",
            "First aid room",
            "Playground",
            "Map shop",
        ),
        amenities=(
            "Panorama windows",
            "Ski racks",
            "Heated seats",
            "Bicycle hooks",
            "Audio guide",
            "Dog friendly",
        ),
        extras=(("Bicycle place", 6), ("Toboggan", 9), ("Fondue plate", 24), ("Trail map", 4)),
        causes=("High winds", "Rope inspection", "Avalanche risk", "Spring maintenance", "Thunderstorms"),
        taglines=("up, without the sweat", "the mountain in twenty minutes", "ropes, racks and views"),
    ),
)
