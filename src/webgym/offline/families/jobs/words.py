"""Word stock of the job boards: sectors with their fields, roles, and what they ask for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sector:
    """What a job board is about.

    Attributes:
        suffixes: second words of brands.
        taglines: one is taken.
        fields: parts of the sector with their roles.
        specials: what stands before a role.
        skills: what adverts ask for.
        papers: certificates that adverts ask for.
        duties: what one does there.
        companies: second words of employers.
        pay: yearly pay of a middling role, in thousands.
        shifts: whether its adverts name shifts rather than say from where one works.
    """

    suffixes: tuple[str, ...]
    taglines: tuple[str, ...]
    fields: dict[str, tuple[str, ...]]
    specials: tuple[str, ...]
    skills: tuple[str, ...]
    papers: tuple[str, ...]
    duties: tuple[str, ...]
    companies: tuple[str, ...]
    pay: int
    shifts: bool = False


SECTORS: dict[str, Sector] = {
    "Health": Sector(
        ("Care Jobs", "Health Careers", "Wards"),
        ("Jobs for people who look after people", "Hospitals, practices and homes near you"),
        {
            "Nursing": ("Nurse", "Ward Sister", "Nurse Educator"),
            "Therapy": ("Physiotherapist", "Speech Therapist", "Occupational Therapist"),
            "Laboratory": ("Laboratory Technician", "Histologist"),
            "Administration": ("Practice Manager", "Medical Secretary", "Records Officer"),
        },
        (
            "Paediatric",
            "Community",
            "Palliative",
            "Acute Care",
            "Outpatient",
            "Rehabilitation",
            "Mobile",
            "Geriatric",
        ),
        (
            "wound care",
            "triage",
            "patient records",
            "medication rounds",
            "infection control",
            "shift planning",
        ),
        ("Basic life support", "Safeguarding level 2", "Manual handling", "State registration"),
        (
            "Plan and give care together with the patients.",
            "Keep records that the next shift can rely on.",
            "Guide students through their placements.",
            "Speak with families, also about hard news.",
        ),
        ("Hospital Trust", "Clinics", "Care Homes", "Medical Centre", "Health Group"),
        41,
        shifts=True,
    ),
    "Software": Sector(
        ("Devs", "Tech Jobs", "Stack Careers"),
        ("Engineering jobs without the buzzwords", "Teams that ship, and what they pay"),
        {
            "Backend": ("Backend Engineer", "Platform Engineer", "Database Engineer"),
            "Frontend": ("Frontend Engineer", "Accessibility Engineer"),
            "Data": ("Data Engineer", "Data Analyst", "Machine Learning Engineer"),
            "Quality": ("Test Engineer", "Release Manager"),
        },
        ("Payments", "Search", "Mobile", "Embedded", "Cloud", "Security", "Mapping", "Growth"),
        ("Python", "SQL", "Rust", "TypeScript", "Kubernetes", "observability", "code review"),
        ("Cloud practitioner", "Security clearance", "Scrum certificate"),
        (
            "Own services from the design to the pager.",
            "Review the code of others kindly and thoroughly.",
            "Turn vague wishes into small releases.",
            "Write down decisions so that nobody has to guess.",
        ),
        ("Systems", "Labs", "Software", "Networks", "Analytics"),
        62,
    ),
    "Teaching": Sector(
        ("Teacher Jobs", "Classroom", "School Posts"),
        ("Posts in schools, colleges and nurseries", "From reception class to sixth form"),
        {
            "Primary": ("Class Teacher", "Teaching Assistant", "Deputy Head"),
            "Secondary": ("Subject Teacher", "Head of Year", "Careers Adviser"),
            "Special needs": ("Support Teacher", "Learning Mentor"),
            "Early years": ("Nursery Teacher", "Playgroup Leader"),
        },
        ("Mathematics", "Bilingual", "Music", "Science", "Drama", "Literacy", "Outdoor", "Evening"),
        ("lesson planning", "assessment", "class management", "parents' evenings", "phonics", "mentoring"),
        ("Qualified teacher status", "First aid for children", "Safeguarding level 2"),
        (
            "Teach mixed classes and make room for every child.",
            "Prepare pupils for their exams without panic.",
            "Run one club a week after lessons.",
            "Keep parents in the picture.",
        ),
        ("Academy", "Primary School", "College", "Learning Trust", "Grammar School"),
        38,
    ),
    "Hospitality": Sector(
        ("Hotel Jobs", "Front of House", "Hospitality Hub"),
        ("Kitchens, bars and front desks are hiring", "Work where others are on holiday"),
        {
            "Kitchen": ("Chef de Partie", "Sous Chef", "Pastry Chef", "Kitchen Porter"),
            "Service": ("Waiter", "Restaurant Manager", "Bartender"),
            "Front desk": ("Receptionist", "Concierge"),
            "Housekeeping": ("Housekeeper", "Linen Supervisor"),
        },
        ("Breakfast", "Banqueting", "Seasonal", "Fine Dining", "Seaside", "Poolside", "Rooftop", "Spa"),
        ("menu costing", "wine service", "till systems", "allergen rules", "second language", "stock taking"),
        ("Food hygiene level 2", "Personal licence", "First aid at work"),
        (
            "Keep the pass calm when the room is full.",
            "Know the regulars and what they drink.",
            "Train new colleagues on quiet days.",
            "Leave the station cleaner than you found it.",
        ),
        ("Hotels", "Restaurants", "Inns", "Resorts", "Catering"),
        31,
        shifts=True,
    ),
    "Logistics": Sector(
        ("Freight Jobs", "Moving Careers", "Dock to Door"),
        ("Drivers, packers and planners wanted", "Keep things moving, get paid for it"),
        {
            "Driving": ("Van Driver", "Lorry Driver", "Tram Driver"),
            "Warehouse": ("Forklift Operator", "Picker", "Shift Supervisor"),
            "Planning": ("Transport Planner", "Customs Clerk", "Fleet Analyst"),
            "Workshop": ("Vehicle Mechanic", "Tyre Fitter"),
        },
        ("Long-Distance", "Express", "Chilled Goods", "City", "Port", "Parcel", "Rail", "Weekend"),
        ("route planning", "tachograph rules", "stock systems", "load securing", "customs forms"),
        ("Lorry licence", "Forklift licence", "Dangerous goods certificate"),
        (
            "Bring goods there whole and on time.",
            "Check vehicles before every shift.",
            "Find a way around when the road is closed.",
            "Keep the paperwork as tidy as the load.",
        ),
        ("Freight", "Haulage", "Parcels", "Shipping", "Depots"),
        34,
        shifts=True,
    ),
    "Building": Sector(
        ("Trades", "Site Jobs", "Builders Board"),
        ("Trades, sites and drawing offices", "Hands-on work, fairly paid"),
        {
            "Trades": ("Electrician", "Plumber", "Carpenter", "Bricklayer"),
            "Site": ("Site Manager", "Crane Operator", "Safety Officer"),
            "Design": ("Architect", "Structural Engineer"),
            "Surveying": ("Quantity Surveyor", "Land Surveyor"),
        },
        ("Heritage", "Bridge", "Housing", "Timber Frame", "Tunnel", "Retrofit", "Harbour", "Solar"),
        ("reading drawings", "scaffold checks", "cost control", "soil reports", "handover"),
        ("Site safety card", "Working at height", "Crane licence"),
        (
            "Set out the work and see that it is done safely.",
            "Order material before it is missing.",
            "Walk the site with the client every week.",
            "Pass on what you know to the apprentices.",
        ),
        ("Construction", "Builders", "Contractors", "Engineering", "Joinery"),
        43,
        shifts=True,
    ),
    "Design": Sector(
        ("Creatives", "Studio Jobs", "Portfolio Board"),
        ("Studios, agencies and in-house teams", "Work worth putting in a portfolio"),
        {
            "Graphic": ("Graphic Designer", "Typesetter", "Art Director"),
            "Product": ("Product Designer", "Interaction Designer", "Design Researcher"),
            "Film and sound": ("Video Editor", "Sound Designer"),
            "Writing": ("Copywriter", "Content Editor"),
        },
        ("Packaging", "Exhibition", "Brand", "Editorial", "Games", "Museum", "Motion", "Retail"),
        ("layout", "prototyping", "colour grading", "interviews", "print production", "storyboards"),
        ("Driving licence", "Portfolio of five projects", "Drone permit"),
        (
            "Turn a brief into three ideas and defend one.",
            "Prepare files that printers do not call about.",
            "Show work in progress early and often.",
            "Look after a client from pitch to delivery.",
        ),
        ("Studio", "Agency", "Pictures", "Press", "Collective"),
        40,
    ),
    "Finance": Sector(
        ("Ledger Jobs", "Finance Careers", "Numbers"),
        ("Posts in banking, audit and insurance", "For people who like it when things add up"),
        {
            "Accounting": ("Accountant", "Payroll Clerk", "Tax Adviser"),
            "Banking": ("Branch Adviser", "Credit Analyst", "Compliance Officer"),
            "Insurance": ("Claims Handler", "Underwriter"),
            "Audit": ("Auditor", "Audit Manager"),
        },
        (
            "Corporate",
            "Private Client",
            "Agricultural",
            "Marine",
            "Regional",
            "Treasury",
            "Pensions",
            "Forensic",
        ),
        ("month-end closing", "spreadsheets", "tax law", "risk models", "client meetings", "reporting"),
        ("Chartered status", "Anti-money-laundering course", "Actuarial exam"),
        (
            "Close the books on time and explain them.",
            "Spot what does not fit before the auditor does.",
            "Advise clients in words that they understand.",
            "Improve the reports that nobody reads.",
        ),
        ("Bank", "Partners", "Insurance", "Advisers", "Holdings"),
        52,
    ),
    "Science": Sector(
        ("Lab Jobs", "Research Posts", "Bench"),
        ("Posts at the bench and in the field", "From technician to group leader"),
        {
            "Biology": ("Research Assistant", "Microbiologist", "Field Ecologist"),
            "Chemistry": ("Analytical Chemist", "Process Chemist"),
            "Physics": ("Optics Engineer", "Instrument Scientist"),
            "Support": ("Lab Manager", "Animal Technician", "Grants Officer"),
        },
        ("Marine", "Polymer", "Plant", "Vaccine", "Laser", "Climate", "Soil", "Protein"),
        ("statistics", "microscopy", "method validation", "field work", "grant writing", "chromatography"),
        ("Doctorate", "Laser safety", "Diving certificate"),
        (
            "Plan experiments that can fail usefully.",
            "Keep the instruments calibrated and booked.",
            "Write up results with the group.",
            "Look after the stores and the safety sheets.",
        ),
        ("Institute", "Research Centre", "Biosciences", "University", "Observatory"),
        45,
    ),
    "Public service": Sector(
        ("Civic Careers", "Council Jobs", "Public Posts"),
        ("Work for your town", "Councils, libraries and rescue services"),
        {
            "Administration": ("Case Officer", "Registrar", "Clerk to the Council"),
            "Planning": ("Town Planner", "Traffic Engineer"),
            "Culture": ("Librarian", "Museum Educator", "Archivist"),
            "Safety": ("Firefighter", "Food Inspector", "Emergency Planner"),
        },
        ("District", "Housing", "Youth", "Environmental", "Coastal", "Rural", "Digital", "Senior Citizens'"),
        ("public law", "citizen advice", "minutes", "procurement", "data protection", "events"),
        ("Driving licence", "Security check", "First aid at work"),
        (
            "Decide cases fairly and in good time.",
            "Explain rules to people who did not make them.",
            "Prepare papers for the council.",
            "Work with volunteers and associations.",
        ),
        ("Borough Council", "County Office", "Library Service", "Fire Service", "Port Authority"),
        39,
    ),
    "Farming": Sector(
        ("Farm Jobs", "Green Careers", "Field Hands"),
        ("Work outdoors, all seasons", "Farms, forests and gardens are hiring"),
        {
            "Animals": ("Herdsperson", "Shepherd", "Poultry Keeper"),
            "Crops": ("Agronomist", "Tractor Driver", "Vineyard Hand"),
            "Forestry": ("Forester", "Tree Surgeon"),
            "Gardens": ("Gardener", "Nursery Grower", "Landscape Designer"),
        },
        ("Organic", "Dairy", "Orchard", "Hill", "Glasshouse", "Estate", "Harvest", "Wetland"),
        ("machinery", "soil sampling", "milking", "pruning", "record keeping", "lambing"),
        ("Chainsaw certificate", "Tractor licence", "Spraying certificate"),
        (
            "Look after animals and land as if they were yours.",
            "Keep machines running through the season.",
            "Record yields and treatments.",
            "Be up before the birds, at least in May.",
        ),
        ("Farms", "Estates", "Vineyards", "Nurseries", "Forests"),
        30,
        shifts=True,
    ),
    "Energy": Sector(
        ("Energy Jobs", "Grid Careers", "Watt Works"),
        ("Wind, water, grid and storage", "Jobs that keep the lights on"),
        {
            "Wind": ("Turbine Technician", "Blade Inspector", "Wind Analyst"),
            "Grid": ("Grid Planner", "Substation Engineer", "Control Room Operator"),
            "Buildings": ("Heat Pump Installer", "Energy Adviser"),
            "Business": ("Power Trader", "Permit Manager"),
        },
        ("Offshore", "Hydro", "High-Voltage", "Battery", "District Heating", "Tidal", "Rooftop", "Hydrogen"),
        ("rope access", "fault finding", "load forecasts", "permits", "thermal imaging", "switching"),
        ("Working at height", "High-voltage authorisation", "Sea survival"),
        (
            "Find faults before they find the customer.",
            "Plan outages that nobody notices.",
            "Explain tariffs in plain words.",
            "Climb, measure, mend, and write it down.",
        ),
        ("Energy", "Power", "Grid", "Renewables", "Utilities"),
        49,
    ),
}

BENEFITS = (
    "Childcare on site",
    "Free local transport",
    "Bicycle leasing",
    "Canteen",
    "Four-day week possible",
    "Company flat for the first months",
    "Training budget",
    "Private health cover",
    "Extra pension",
    "Dogs are welcome",
    "Sabbatical after five years",
    "Gym membership",
)

STAGES = (
    "Received",
    "In review",
    "Telephone call arranged",
    "Interview arranged",
    "References asked for",
)
"""How far an application has come."""

ADVICE: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    # title, steps with {key} in one, and what {key} may be
    (
        "How to write a covering letter",
        (
            "Address it to a person, not to a department.",
            "Say in the first sentence what you can do for them.",
            "Keep it to {key}.",
            "Close with when you can start.",
        ),
        ("250 words", "300 words", "180 words", "350 words"),
    ),
    (
        "How to prepare for an interview",
        (
            "Read the advert again and mark every verb.",
            "Prepare {key} from your own work, each with a result.",
            "Travel the way there once, at the same hour.",
            "Write down two questions of your own.",
        ),
        ("three stories", "four stories", "five stories"),
    ),
    (
        "How to ask for a higher salary",
        (
            "Look up the median for your role in our table.",
            "Name a figure {key} above what you would accept.",
            "Then be silent and let the other side speak.",
            "Get the result in writing.",
        ),
        ("8 percent", "10 percent", "12 percent", "15 percent"),
    ),
    (
        "How to resign politely",
        (
            "Tell your manager in person before anyone else.",
            "Hand in the letter {key} before your last day, unless your contract says otherwise.",
            "List what is open and who should take it over.",
            "Say thank you, and mean it.",
        ),
        ("four weeks", "six weeks", "two months", "three weeks"),
    ),
    (
        "How to explain a gap in your CV",
        (
            "Name the years and the reason in one line.",
            "Add one thing that you learned in that time.",
            "Speak about it for at most {key} when asked.",
            "Turn back to the job.",
        ),
        ("30 seconds", "60 seconds", "90 seconds"),
    ),
    (
        "How to find references",
        (
            "Ask people who saw you work in the last {key}.",
            "Send them the advert and your CV.",
            "Tell them how it went.",
        ),
        ("two years", "three years", "five years"),
    ),
)
