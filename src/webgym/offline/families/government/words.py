"""Word stock of the public authorities' websites."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Body:
    """A kind of authority.

    Attributes:
        suffixes: second words of brands.
        taglines: one is taken.
        groups: the groups of services it offers.
        council: what its decisions are made by.
        matters: what it decides on.
        troubles: what people report to it.
        permits: what people apply for in one form.
        price: what the calculator works out: a name, and the answers to two of its questions.
        rounds: what the calendar by street is called, and what comes by in a street.
    """

    suffixes: tuple[str, ...]
    taglines: tuple[str, ...]
    groups: tuple[str, ...]
    council: tuple[str, ...]
    matters: tuple[str, ...]
    troubles: tuple[str, ...]
    permits: tuple[str, ...]
    price: tuple[str, tuple[str, ...], tuple[str, ...]]
    rounds: tuple[tuple[str, ...], tuple[str, str, str, str]]


SERVICES: dict[str, tuple[str, ...]] = {
    "Identity and residence": (
        "Passport renewal",
        "Identity card",
        "Child travel document",
        "Registration of residence",
        "Residence certificate",
        "Certified copy",
        "Change of name",
    ),
    "Births, marriages, deaths": (
        "Birth certificate",
        "Marriage appointment",
        "Civil partnership notice",
        "Death registration",
        "Family record extract",
    ),
    "Vehicles and parking": (
        "Residents' parking permit",
        "Visitor parking voucher",
        "Driving licence exchange",
        "Vehicle registration",
        "Disabled parking badge",
        "Trailer registration",
        "Taxi licence",
    ),
    "Building and land": (
        "Building permit",
        "Tree felling consent",
        "Land register extract",
        "Demolition notice",
        "Site plan copy",
        "Change of use consent",
        "Scaffold licence",
    ),
    "Business and trade": (
        "Market stall pitch",
        "Street trading licence",
        "Alcohol licence",
        "Business registration",
        "Pavement café permit",
        "Food stall inspection",
        "Shop sign approval",
    ),
    "Waste and environment": (
        "Bulky waste collection",
        "Additional recycling bin",
        "Garden waste subscription",
        "Hazardous waste drop-off",
        "Compost bin grant",
        "Bin exchange",
        "Skip placement permit",
    ),
    "Family and school": (
        "Nursery place",
        "School enrolment",
        "School meal allowance",
        "Holiday camp place",
        "School bus pass",
        "Library card",
    ),
    "Animals and leisure": (
        "Dog registration",
        "Fishing permit",
        "Allotment garden",
        "Sports hall booking",
        "Event notice",
        "Barbecue site booking",
        "Boat mooring permit",
    ),
    "Housing and support": (
        "Housing allowance",
        "Heating grant",
        "Social flat application",
        "Senior citizens' pass",
        "Debt advice appointment",
        "Moving grant",
    ),
    "Transport": (
        "Commuter pass",
        "Bicycle box rental",
        "Lost property search",
        "Bus stop shelter request",
        "Road closure request",
        "Charging point request",
    ),
}

_TOWN_TROUBLES = (
    "Pothole",
    "Broken street light",
    "Graffiti",
    "Fly-tipping",
    "Blocked drain",
    "Damaged bench",
)
_TOWN_PERMITS = ("Street party", "Skip on the road", "Market stall", "Busking", "Film shoot", "Bonfire")

_BINS = (
    ("Collection days", "Bin calendar", "When are bins emptied?"),
    ("General waste", "Recycling", "Paper", "Garden waste"),
)

BODIES: dict[str, Body] = {
    "town": Body(
        ("Town Council", "City Council", "Borough"),
        ("Your council, close by", "Services for everyone who lives here"),
        (
            "Identity and residence",
            "Vehicles and parking",
            "Waste and environment",
            "Family and school",
            "Animals and leisure",
        ),
        ("Full Council", "Planning Committee", "Culture Committee"),
        (
            "New playground at the mill pond",
            "Lower speed limit in the old town",
            "Opening hours of the library",
            "Trees for the market square",
            "Repairs to the swimming hall",
            "Summer festival budget",
            "Cycle lane on the ring road",
            "Sale of the former fire station",
        ),
        _TOWN_TROUBLES,
        _TOWN_PERMITS,
        ("Residents' parking", ("Zone A", "Zone B", "Zone C"), ("Electric car", "Small car", "Large car")),
        _BINS,
    ),
    "county": Body(
        ("County", "District Office", "Shire Council"),
        ("One county, many villages", "Public services across the county"),
        (
            "Vehicles and parking",
            "Building and land",
            "Housing and support",
            "Family and school",
            "Births, marriages, deaths",
        ),
        ("County Assembly", "Roads Committee", "Schools Committee"),
        (
            "Merger of two village schools",
            "Resurfacing of the valley road",
            "Rural bus timetable",
            "Flood wall at the weir",
            "Grants for village halls",
            "New ambulance station",
            "Broadband for hill farms",
            "Winter road plan",
        ),
        (
            "Pothole",
            "Fallen tree",
            "Flooded road",
            "Missing road sign",
            "Damaged bridge",
            "Dead animal on the road",
        ),
        (
            "Road race",
            "Agricultural show",
            "Heavy transport",
            "Village fair",
            "Drone flight",
            "Camping meadow",
        ),
        (
            "Heavy transport",
            ("Valley route", "Hill route", "Coast route"),
            ("Up to 20 t", "Up to 40 t", "Over 40 t"),
        ),
        _BINS,
    ),
    "registry": Body(
        ("Registry Office", "Civil Registry", "Records Office"),
        ("Certificates, names and family matters", "Your papers in order"),
        ("Identity and residence", "Births, marriages, deaths", "Land and records", "Family and school"),
        ("Registry Board", "Archive Committee", "Fees Committee"),
        (
            "New reading room",
            "Digital copies of old registers",
            "Saturday weddings",
            "Fees for certified copies",
            "Opening of the 1925 census",
            "Ramp at the main entrance",
            "Shorter waiting times",
            "Wedding room in the tower",
        ),
        (
            "Error in a certificate",
            "Letter not received",
            "Long waiting time",
            "Wrong fee",
            "Website problem",
            "Lost papers",
        ),
        (
            "Garden wedding",
            "Archive visit",
            "Foreign marriage record",
            "Late registration",
            "Name declaration",
            "Family tree search",
        ),
        (
            "Certificate",
            ("Birth", "Marriage", "Residence"),
            ("Plain copy", "Certified copy", "Multilingual copy"),
        ),
        (("Mobile registry", "The registry bus"), ("Certificates", "Identity cards", "Passports", "Advice")),
    ),
    "waste": Body(
        ("Waste Service", "Recycling", "Clean Streets"),
        ("We take it away", "Less waste, more sorted"),
        ("Waste and environment", "Housing and support", "Business and trade", "Animals and leisure"),
        ("Service Board", "Recycling Committee", "Fees Committee"),
        (
            "Weekly collection of food waste",
            "A third recycling yard",
            "Electric collection lorries",
            "Deposit on takeaway cups",
            "Repair café subsidy",
            "Underground bins at the station",
            "Earlier collection in summer",
            "Free compost for schools",
        ),
        (
            "Missed collection",
            "Overflowing bin",
            "Broken bin",
            "Fly-tipping",
            "Noise at the depot",
            "Glass on the street",
        ),
        (
            "Skip on the road",
            "Large event bins",
            "Garden bonfire",
            "Asbestos transport",
            "Scrap collection",
            "Compost site",
        ),
        ("Bulky waste", ("Inner town", "Suburbs", "Villages"), ("Up to 2 m³", "Up to 5 m³", "Up to 10 m³")),
        _BINS,
    ),
    "building": Body(
        ("Building Authority", "Planning Office", "Land Office"),
        ("Plans, permits and property", "Build well, build legally"),
        ("Building and land", "Business and trade", "Transport", "Waste and environment"),
        ("Planning Board", "Heritage Committee", "Appeals Committee"),
        (
            "Roof terraces in the old town",
            "Height limit at the harbour",
            "Solar panels on listed houses",
            "Conversion of the tannery",
            "Student flats by the canal",
            "Shop signs in the high street",
            "New quarter at the station",
            "Protection of the lime avenue",
        ),
        (
            "Building noise",
            "Unsafe scaffold",
            "Dust and dirt",
            "Work without a permit",
            "Blocked pavement",
            "Neighbour's wall",
        ),
        ("Garage", "Garden house", "Loft conversion", "Conservatory", "Fence", "Roof window"),
        (
            "Building permit",
            ("Detached house", "Terraced house", "Flat"),
            ("Up to 20 m²", "Up to 60 m²", "Over 60 m²"),
        ),
        (
            ("Inspection days", "Inspections by street"),
            ("Scaffold check", "Noise control", "Chimney check", "Road works check"),
        ),
    ),
    "transport": Body(
        ("Transport Authority", "Roads Agency", "Mobility Office"),
        ("Getting around, made simple", "Roads, parking, buses and bicycles"),
        ("Vehicles and parking", "Transport", "Business and trade", "Identity and residence"),
        ("Transport Board", "Cycling Committee", "Fares Committee"),
        (
            "Night buses at weekends",
            "Bicycle street along the river",
            "Free parking for carers",
            "Low fares for trainees",
            "Tram to the hospital",
            "Toll on the old bridge",
            "Charging points in side streets",
            "Car-free Sundays",
        ),
        (
            "Broken traffic light",
            "Damaged shelter",
            "Late bus",
            "Blocked cycle lane",
            "Faded road marking",
            "Illegal parking",
        ),
        (
            "Removal lorry space",
            "Road closure",
            "Crane on the road",
            "Oversize load",
            "Taxi rank",
            "Bicycle race",
        ),
        ("Trade parking", ("Centre", "Harbour", "Station"), ("Bicycle trailer", "Van", "Lorry")),
        (
            ("Street care", "Works by street"),
            ("Street sweeping", "Drain cleaning", "Line painting", "Lamp check"),
        ),
    ),
    "parks": Body(
        ("Parks Agency", "Parks and Waters", "Green Spaces"),
        ("Parks, lakes and forests for all", "Look after it, enjoy it"),
        ("Animals and leisure", "Waste and environment", "Family and school", "Transport"),
        ("Parks Board", "Nature Committee", "Sports Committee"),
        (
            "Otter bridge under the road",
            "Dog-free lawn",
            "Rowing boats on the lake",
            "Wild meadow in the city park",
            "Barrier-free forest path",
            "Opening of the bathing season",
            "Lights along the running track",
            "Kiosk at the rose garden",
        ),
        ("Fallen tree", "Dirty water", "Broken bench", "Damaged playground", "Loose dog", "Litter"),
        (
            "Picnic for a group",
            "Wedding photos",
            "Outdoor class",
            "Fun run",
            "Concert on the lawn",
            "Fishing contest",
        ),
        ("Mooring", ("North shore", "South shore", "Island"), ("Canoe", "Rowing boat", "Sailing boat")),
        (("Garden rounds", "Green care by street"), ("Mowing", "Watering", "Pruning", "Leaf clearing")),
    ),
}
SERVICES["Land and records"] = (
    "Land register extract",
    "Old census page",
    "Ship register extract",
    "Inheritance certificate",
    "Archive reader's card",
)

PAPERS = (
    "Identity card or passport",
    "Proof of address",
    "Recent photograph",
    "Completed form",
    "Birth certificate",
    "Rental contract",
    "Site plan",
    "Proof of insurance",
    "Income statement",
    "Written consent of the owner",
)

STREETS = (
    "Alder Lane",
    "Baker Street",
    "Canal Row",
    "Castle Hill",
    "Chapel Close",
    "Dyer's Yard",
    "Elm Grove",
    "Ferry Road",
    "Garden Walk",
    "Harbour Street",
    "Ivy Court",
    "King's Road",
    "Lime Avenue",
    "Market Square",
    "Mill Lane",
    "Nightingale Way",
    "Orchard Road",
    "Park Terrace",
    "Quarry Hill",
    "River Bank",
    "School Street",
    "Station Road",
    "Tanner's Row",
    "Upper Green",
    "Vine Street",
    "Weaver's Lane",
)

OFFICES = (
    "Main Office",
    "North Office",
    "South Office",
    "Harbour Office",
    "Station Office",
    "Old Town Office",
    "West Office",
    "Hill Office",
)
