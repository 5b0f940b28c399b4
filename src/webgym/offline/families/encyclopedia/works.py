"""Subjects of encyclopedias: what people built, made and ruled."""

from __future__ import annotations

from webgym.offline.families.encyclopedia.schema import Detail, Lack, Measure, Section, Subject, Trait

_PLACES = (
    "Aldra Borrun Calder Dovrek Eskan Farrin Galvar Hestra Iskar Jorund Keld Lofra Morven Nordal Orsk Pelver "
    "Quorn Rastad Skarn Torvik Ulven Varga Wendel Ystra Zorin Brannoch Corrie Dunvar Erland Fennick"
)

INVENTIONS = Subject(
    noun="invention",
    plural="inventions",
    domain="Science & Research",
    subdomain="Technology & Science",
    brands=("Book of Inventions", "Patent Museum", "Technology Lexicon"),
    picture="machine",
    group_label="Field",
    groups=(
        ("Optics", "Lens Prism Telescope"),
        ("Printing", "Press Typesetter Duplicator"),
        ("Agriculture", "Seeder Harvester Plough"),
        ("Navigation", "Compass Sextant Log"),
        ("Household machines", "Mangle Mixer Stove"),
        ("Telegraphy", "Telegraph Relay Sounder"),
    ),
    first="Borrun Calder Dovrek Eskan Farrin Galvar Hestra Iskar Keld Lofra Morven Orsk Pelver Quorn Skarn "
    "Torvik Ulven Varga Wendel Zorin Corrie Dunvar Erland Fennick Hartley Ingram",
    second="",
    pattern="{first} {second}",
    measures=(
        Measure("weight", "Weight", "kg", 10, 940, 1, "greatest", "smallest"),
        Measure("patent", "Patent fee", "dollars", 12, 480, 1, "highest", "lowest"),
        Measure("sold", "Pieces sold", "", 40, 24000, 5, "highest", "lowest"),
        Measure("parts", "Parts", "", 14, 2100, 1, "highest", "lowest"),
        Measure("tests", "Trial period", "days", 12, 760, 1, "longest", "shortest"),
    ),
    traits=(
        Trait("drive", "Drive", ("Hand", "Steam", "Clockwork", "Electric", "Water")),
        Trait("material", "Main material", ("Brass", "Cast iron", "Oak", "Glass")),
    ),
    lack=Lack("Surviving example", ("One", "Two", "Several"), "has no surviving example"),
    event=("Patented", "was patented"),
    role="Inventor",
    profession="inventor",
    place="Workshop",
    sections=(
        Section(
            "How it works",
            ("A crank lifts the inner frame.", "Two springs bring the arm back."),
            Detail(
                "how many turns of the crank one cycle takes",
                "the number of turns of the crank in one cycle",
                "One full cycle takes {mark}.",
                "{n} turns of the crank",
                11,
                180,
            ),
        ),
        Section(
            "Legacy",
            ("A lawsuit over the name lasted for years.", "Schools still build small copies of it."),
            Detail(
                "how many later patents cite it",
                "the number of later patents that cite it",
                "It is cited in {mark}.",
                "{n} later patents",
                11,
                640,
            ),
        ),
    ),
)

CASTLES = Subject(
    noun="castle",
    plural="castles",
    domain="Misc.",
    subdomain="General Info.",
    brands=("Castle Register", "Castles Guide", "Heritage Lexicon"),
    picture="castle",
    group_label="Region",
    groups=(
        ("Upper March", ""),
        ("Coastlands", ""),
        ("River Provinces", ""),
        ("Old Duchy", ""),
        ("Border Hills", ""),
        ("Lake District of Corin", ""),
    ),
    first=_PLACES,
    second="Castle Keep Fortress Tower",
    pattern="{first} {second}",
    measures=(
        Measure("rooms", "Rooms", "", 12, 420, 1, "highest", "lowest"),
        Measure("wall", "Outer wall", "m", 90, 1900, 3, "longest", "shortest"),
        Measure("tower", "Height of the keep", "m", 11, 92, 1, "greatest", "smallest"),
        Measure("visitors", "Visitors per year", "", 1200, 240000, 50, "highest", "lowest"),
        Measure("well", "Depth of the well", "m", 10, 138, 1, "greatest", "smallest"),
    ),
    traits=(
        Trait("style", "Style", ("Romanesque", "Gothic", "Renaissance", "Baroque")),
        Trait("state", "State", ("Ruin", "Restored", "Inhabited", "Museum")),
    ),
    lack=Lack("Chapel", ("Small", "Large", "Rebuilt"), "has no chapel"),
    event=("First mentioned", "was first mentioned"),
    role="Restored by",
    profession="architect",
    place="Nearest town",
    sections=(
        Section(
            "Architecture",
            ("The gate was moved after the great fire.", "Its kitchen has three hearths."),
            Detail(
                "how many steps lead up the keep",
                "the number of steps in the keep",
                "A spiral stair of {mark} leads up the keep.",
                "{n} steps",
                40,
                390,
            ),
        ),
        Section(
            "Sieges",
            ("It was taken once, by a trick.", "The moat froze in the winter of the second siege."),
            Detail(
                "how many days the longest siege lasted",
                "the length of the longest siege",
                "The longest siege lasted {mark}.",
                "{n} days",
                11,
                410,
            ),
        ),
    ),
)

RULERS = Subject(
    noun="ruler",
    plural="rulers",
    domain="Career & Education",
    subdomain="Education & Learning",
    brands=("History Lexicon", "Book of Reigns", "Dynasty Handbook"),
    picture="face",
    group_label="Dynasty",
    groups=(
        ("House of Alder", ""),
        ("House of Brenn", ""),
        ("House of Corvane", ""),
        ("House of Dorn", ""),
        ("House of Elmar", ""),
        ("House of Falk", ""),
    ),
    first="Alaric Berengar Cunegund Dagmar Edwyn Fredegar Gisela Hadrian Isolde Jocelyn Kunolf Leofric "
    "Mathilda Nicanor Osric Petronella Radomir Sigrun Theobald Ulfric Valdis Wenzel",
    second="Bold Mild Elder Younger Builder Silent Fair Wise Tall Lame",
    pattern="{first} the {second}",
    measures=(
        Measure("reign", "Reign", "months", 14, 640, 1, "longest", "shortest"),
        Measure("palace", "Palace rooms", "", 20, 900, 1, "highest", "lowest"),
        Measure("army", "Standing army", "men", 800, 64000, 50, "largest", "smallest"),
        Measure("laws", "Laws issued", "", 11, 780, 1, "highest", "lowest"),
        Measure("towns", "Town charters granted", "", 10, 140, 1, "highest", "lowest"),
    ),
    traits=(
        Trait("seat", "Residence", ("Summer Palace", "River Fort", "Old Citadel", "White Hall")),
        Trait("end", "End of reign", ("Death in battle", "Natural death", "Abdication", "Deposition")),
    ),
    lack=Lack("Heirs", ("One", "Two", "Three", "Five"), "had no heirs"),
    event=("Crowned", "was crowned"),
    role="Chronicler",
    profession="chronicler",
    place="Birthplace",
    era=(1402, 1640),
    sections=(
        Section(
            "Reign",
            ("The first years were spent on roads and mills.", "A quarrel over salt led to war."),
            Detail(
                "how many silver marks the yearly tax brought in",
                "the yield of the yearly tax",
                "The yearly tax brought in {mark}.",
                "{n} silver marks",
                900,
                98000,
            ),
        ),
        Section(
            "Court",
            ("Musicians from abroad were well paid.", "Foreign envoys mocked the food."),
            Detail(
                "how many servants the court had",
                "the number of servants at court",
                "At its height the court had {mark}.",
                "{n} servants",
                40,
                1900,
            ),
        ),
    ),
)

CHEESES = Subject(
    noun="cheese",
    plural="cheeses",
    domain="Lifestyle & Leisure",
    subdomain="Food & Cooking",
    brands=("Cheese Lexicon", "Cheese Atlas", "Dairy Handbook"),
    picture="dish",
    group_label="Kind",
    groups=(
        ("Hard cheeses", "Cheddar Gruyere Truckle"),
        ("Blue cheeses", "Blue Roquette"),
        ("Soft cheeses", "Brie Camembert Robiola"),
        ("Washed-rind cheeses", "Munster Limburger"),
        ("Fresh cheeses", "Ricotta Quark Curd"),
        ("Whey cheeses", "Brunost Whey-cheese"),
    ),
    first=_PLACES,
    second="",
    pattern="{first} {second}",
    measures=(
        Measure("age", "Ripening", "days", 10, 960, 1, "longest", "shortest"),
        Measure("fat", "Fat", "g per kg", 90, 720, 1, "highest", "lowest"),
        Measure("weight", "Weight of a wheel", "g", 120, 38000, 10, "greatest", "smallest"),
        Measure("farms", "Producing farms", "", 11, 480, 1, "highest", "lowest"),
        Measure("output", "Yearly output", "tonnes", 12, 9400, 2, "largest", "smallest"),
    ),
    traits=(
        Trait("milk", "Milk", ("Cow", "Goat", "Sheep", "Buffalo")),
        Trait("taste", "Taste", ("Nutty", "Sharp", "Buttery", "Smoky", "Sour")),
    ),
    lack=Lack("Added herbs", ("Chives", "Pepper", "Caraway"), "has no added herbs"),
    event=("First made", "was first made"),
    role="Recipe by",
    profession="dairy master",
    place="Market town",
    sections=(
        Section(
            "Making",
            ("The curd is cut to the size of peas.", "Wheels are turned every second day."),
            Detail(
                "how many litres of milk go into one wheel",
                "the litres of milk for one wheel",
                "One wheel takes {mark}.",
                "{n} litres of milk",
                11,
                420,
            ),
        ),
        Section(
            "Awards",
            ("It is sold out by Christmas.", "Chefs melt it over roast pears."),
            Detail(
                "how many medals it has won",
                "the number of medals it has won",
                "Its makers have won {mark} with it.",
                "{n} medals",
                11,
                140,
            ),
        ),
    ),
)

COINS = Subject(
    noun="coin",
    plural="coins",
    domain="Misc.",
    subdomain="Finance & Investment",
    brands=("Coin Catalogue", "Currency Archive", "Numismatic Lexicon"),
    picture="coin",
    group_label="Mint",
    groups=(
        ("Royal Mint", ""),
        ("Harbour Mint", ""),
        ("Abbey Mint", ""),
        ("City Mint", ""),
        ("Mountain Mint", ""),
        ("Colonial Mint", ""),
    ),
    first="Alder Brenn Corvane Dorn Elmar Falk Gisela Hadrian Isolde Leofric Mathilda Osric Radomir Sigrun "
    "Theobald Ulfric Valdis Wenzel Borrun Calder Keld Morven Quorn Skarn",
    second="Crown Ducat Penny Thaler Guilder Florin",
    pattern="{first} {second}",
    measures=(
        Measure("weight", "Weight", "mg", 420, 32000, 10, "greatest", "smallest"),
        Measure("thickness", "Thickness", "µm", 700, 4800, 10),
        Measure("mintage", "Mintage", "pieces", 900, 940000, 100, "largest", "smallest"),
        Measure("value", "Catalogue value", "dollars", 12, 8800, 1, "highest", "lowest"),
        Measure("known", "Known specimens", "", 11, 920, 1, "highest", "lowest"),
    ),
    traits=(
        Trait("metal", "Metal", ("Gold", "Silver", "Copper", "Billon", "Bronze")),
        Trait("edge", "Edge", ("Plain", "Reeded", "Lettered")),
    ),
    lack=Lack("Inscription", ("Latin", "Motto", "Name of the ruler"), "has no inscription"),
    event=("First struck", "was first struck"),
    role="Engraver",
    profession="engraver",
    place="Largest hoard found at",
    era=(1502, 1760),
    sections=(
        Section(
            "Design",
            ("The portrait looks left.", "A small star marks the second issue."),
            Detail(
                "how many dies were cut for it",
                "the number of dies that were cut",
                "For the whole issue {mark} were cut.",
                "{n} dies",
                11,
                240,
            ),
        ),
        Section(
            "Market",
            ("Forgeries are common and easy to tell.", "Worn pieces are sold by weight."),
            Detail(
                "how many bids the record auction drew",
                "the number of bids at the record auction",
                "The record auction drew {mark}.",
                "{n} bids",
                11,
                210,
            ),
        ),
    ),
)

STADIUMS = Subject(
    noun="stadium",
    plural="stadiums",
    domain="Lifestyle & Leisure",
    subdomain="Sports & Fitness",
    brands=("Stadium Guide", "Sports Lexicon", "Arena Register"),
    picture="stadium",
    group_label="League",
    groups=(
        ("Northern League", ""),
        ("Harbour League", ""),
        ("Lowland League", ""),
        ("Capital League", ""),
        ("Highland League", ""),
    ),
    first=_PLACES,
    second="Park Arena Ground Oval",
    pattern="{first} {second}",
    measures=(
        Measure("seats", "Seats", "", 1800, 88000, 50, "highest", "lowest"),
        Measure("record", "Record attendance", "", 2100, 99000, 7, "highest", "lowest"),
        Measure("cost", "Building cost", "thousand dollars", 90, 9800, 5, "highest", "lowest"),
        Measure("pitch", "Pitch length", "m", 92, 184, 1, "longest", "shortest"),
        Measure("parking", "Parking spaces", "", 40, 6200, 2, "highest", "lowest"),
    ),
    traits=(
        Trait("surface", "Surface", ("Grass", "Artificial turf", "Hybrid", "Clay")),
        Trait("sport", "Main sport", ("Football", "Cricket", "Athletics", "Rugby")),
    ),
    lack=Lack("Floodlights", ("Four masts", "Roof lights", "Mobile"), "has no floodlights"),
    event=("Opened", "was opened"),
    role="Architect",
    profession="architect",
    place="Nearest station",
    era=(1836, 1946),
    sections=(
        Section(
            "Building",
            ("The west stand is older than the rest.", "A storm took the first roof."),
            Detail(
                "how many turnstiles it has",
                "the number of turnstiles",
                "Spectators enter through {mark}.",
                "{n} turnstiles",
                11,
                160,
            ),
        ),
        Section(
            "Events",
            ("Concerts are limited to three a year.", "The cup final was moved here twice."),
            Detail(
                "how many matches last season saw",
                "the number of matches last season",
                "Last season saw {mark}.",
                "{n} matches",
                11,
                88,
            ),
        ),
    ),
)

SUBJECTS = (INVENTIONS, CASTLES, RULERS, CHEESES, COINS, STADIUMS)
