"""Subjects of encyclopedias: the earth and the sky."""

from __future__ import annotations

from webgym.offline.families.encyclopedia.schema import Detail, Lack, Measure, Section, Subject, Trait

_PEAKS = (
    "Aldra Borrun Calder Dovrek Eskan Farrin Galvar Hestra Iskar Jorund Keld Lofra Morven Nordal Orsk "
    "Pelver Quorn Rastad Skarn Torvik Ulven Varga Wendel Ystra Zorin Brannoch Corrie Dunvar Erland Fennick"
)
_WATERS = (
    "Amber Brena Corva Delwin Esker Fallow Gelda Hurn Issel Jura Kestra Lorn Medra Nairn Ostra Pellen Quay "
    "Rhenna Solva Tamsel Ursa Velda Wharr Yarra Zelva Orlen Dunna Marrow Teal Severa"
)
_STONES = (
    "Adelard Borric Caldon Dellaven Erskin Folgor Garrick Halvor Istrian Jorvan Kellner Lazar Morrow Nordin "
    "Orpin Pellar Quarren Rostov Selen Tarrant Umbral Vostok Wexler Ystad Zander Brennan Cobern Durran"
)


MOUNTAINS = Subject(
    noun="mountain",
    plural="mountains",
    domain="Travel & Transportation",
    subdomain="Outdoor & Recreation",
    brands=("Summit Register", "Mountain Atlas", "Peakpedia"),
    picture="scene",
    group_label="Range",
    groups=(
        ("Kestrel Range", ""),
        ("Iron Teeth", ""),
        ("White Causeway", ""),
        ("Harrow Hills", ""),
        ("Sable Massif", ""),
        ("Lantern Alps", ""),
        ("Northern Spine", ""),
    ),
    first=_PEAKS,
    second="Peak Horn Dome Needle Tooth Crown",
    pattern="{first} {second}",
    measures=(
        Measure("height", "Height", "m", 1804, 7412, 2, "greatest", "smallest"),
        Measure("prominence", "Prominence", "m", 140, 2400, 3),
        Measure("route", "Normal route", "km", 7, 164, 1, "longest", "shortest"),
        Measure("huts", "Ascents per year", "", 12, 2900, 3, "highest", "lowest"),
        Measure("glacier", "Glacier area", "ha", 10, 870, 1, "largest", "smallest"),
    ),
    traits=(
        Trait("rock", "Rock", ("Granite", "Limestone", "Basalt", "Gneiss", "Sandstone")),
        Trait("grade", "Grade", ("Easy", "Moderate", "Difficult", "Severe")),
    ),
    lack=Lack("Mountain hut", ("One", "Two", "Three"), "has no mountain hut"),
    event=("First ascent", "was first climbed"),
    role="First climbed by",
    profession="mountaineer",
    place="Nearest town",
    sections=(
        Section(
            "Climbing",
            ("Most parties start before dawn.", "The descent by the east gully is not advised after rain."),
            Detail(
                "how many metres of fixed rope lie on the normal route",
                "the length of fixed rope on the normal route",
                "The normal route is secured with {mark}.",
                "{n} metres of fixed rope",
                30,
                960,
            ),
        ),
        Section(
            "Geology",
            (
                "Folded layers are plain to see in the west wall.",
                "The summit block is younger than its base.",
            ),
            Detail(
                "how old its summit rock is in million years",
                "the age of the summit rock",
                "Dating of the summit rock gave an age of {mark}.",
                "{n} million years",
                14,
                620,
            ),
        ),
    ),
)


RIVERS = Subject(
    noun="river",
    plural="rivers",
    domain="Travel & Transportation",
    subdomain="Outdoor & Recreation",
    brands=("River Atlas", "Waterways Guide", "Riverbase"),
    picture="scene",
    group_label="Basin",
    groups=(
        ("Great Meadow Basin", ""),
        ("Copper Gulf Basin", ""),
        ("Lake Corin Basin", ""),
        ("Eastern Fjords", ""),
        ("Saltmarsh Basin", ""),
        ("High Moor Basin", ""),
    ),
    first=_WATERS,
    second="River Water Brook Burn",
    pattern="{first} {second}",
    measures=(
        Measure("length", "Length", "km", 21, 1480, 1, "longest", "shortest"),
        Measure("discharge", "Mean discharge", "m³/s", 3, 940, 1, "largest", "smallest"),
        Measure("source", "Source elevation", "m", 160, 3100, 2, "highest", "lowest"),
        Measure("width", "Width at the mouth", "m", 12, 2100, 3, "greatest", "smallest"),
        Measure("basin", "Basin area", "km²", 90, 48000, 10, "largest", "smallest"),
    ),
    traits=(
        Trait("mouth", "Mouth", ("Delta", "Estuary", "Lake", "Fjord")),
        Trait("use", "Main use", ("Canoeing", "Irrigation", "Timber rafting", "Fishing", "Power")),
    ),
    lack=Lack("Dams", ("One", "Two", "Five", "Eight"), "has no dam"),
    event=("First mapped", "was first mapped"),
    role="Mapped by",
    profession="surveyor",
    place="Largest town",
    sections=(
        Section(
            "Course",
            ("Below the gorge it slows and begins to wander.", "Two ferries still cross the lower reach."),
            Detail(
                "how many bridges cross it",
                "the number of bridges across it",
                "From source to mouth it is crossed by {mark}.",
                "{n} bridges",
                11,
                240,
            ),
        ),
        Section(
            "Wildlife",
            ("Otters have come back to the side arms.", "Anglers know it for its early salmon."),
            Detail(
                "how many kilometres of its banks are protected",
                "the protected length of its banks",
                "Today {mark} are protected.",
                "{n} kilometres of banks",
                12,
                480,
            ),
        ),
    ),
)


ISLANDS = Subject(
    noun="island",
    plural="islands",
    domain="Travel & Transportation",
    subdomain="Travel & Accommodation",
    brands=("Island Gazetteer", "Islands Guide", "Book of Islands"),
    picture="scene",
    group_label="Archipelago",
    groups=(
        ("Lantern Isles", ""),
        ("Outer Skerries", ""),
        ("Saint Orla Islands", ""),
        ("Windward Chain", ""),
        ("Ember Islands", ""),
        ("Pearl Shoals", ""),
    ),
    first=_PEAKS,
    second="Island Holm Cay Skerry",
    pattern="{first} {second}",
    measures=(
        Measure("area", "Area", "km²", 2, 1900, 1, "largest", "smallest"),
        Measure("people", "Population", "", 110, 48000, 7, "largest", "smallest"),
        Measure("coast", "Coastline", "km", 6, 640, 1, "longest", "shortest"),
        Measure("top", "Highest point", "m", 14, 2240, 1, "highest", "lowest"),
        Measure("ferry", "Ferry crossing", "minutes", 15, 560, 1, "longest", "shortest"),
    ),
    traits=(
        Trait("origin", "Origin", ("Volcanic", "Coral", "Continental", "Sandbank")),
        Trait("climate", "Climate", ("Mild", "Rainy", "Dry", "Stormy")),
    ),
    lack=Lack("Lighthouse", ("Automatic", "Manned", "Museum"), "has no lighthouse"),
    event=("First charted", "was first charted"),
    role="Charted by",
    profession="navigator",
    place="Ferry port",
    sections=(
        Section(
            "Economy",
            (
                "Sheep outnumber people on the western side.",
                "The harbour was deepened for the herring fleet.",
            ),
            Detail(
                "how many boats its fishing fleet has",
                "the size of its fishing fleet",
                "Its fishing fleet numbers {mark}.",
                "{n} boats",
                12,
                380,
            ),
        ),
        Section(
            "Tourism",
            ("Guest houses close from November to March.", "The cliff path takes a full day."),
            Detail(
                "how many visitors came last summer",
                "the number of visitors last summer",
                "Last summer {mark} were counted at the pier.",
                "{n} visitors",
                900,
                98000,
            ),
        ),
    ),
)


MINERALS = Subject(
    noun="mineral",
    plural="minerals",
    domain="Science & Research",
    subdomain="Technology & Science",
    brands=("Mineral Handbook", "Mineralogy Archive", "Stonepedia"),
    picture="crystal",
    group_label="Class",
    groups=(
        ("Silicates", ""),
        ("Oxides", ""),
        ("Sulfides", ""),
        ("Carbonates", ""),
        ("Phosphates", ""),
        ("Halides", ""),
    ),
    first=_STONES,
    second="ite ine olite",
    pattern="{first}{second}",
    measures=(
        Measure("density", "Density", "kg/m³", 1800, 9600, 10, "highest", "lowest"),
        Measure("melting", "Melting point", "°C", 310, 2400, 1, "highest", "lowest"),
        Measure("crystal", "Largest crystal", "mm", 4, 860, 1),
        Measure("sites", "Known sites", "", 11, 930, 1, "highest", "lowest"),
        Measure("price", "Collector's price", "dollars per gram", 10, 990, 1, "highest", "lowest"),
    ),
    traits=(
        Trait("system", "Crystal system", ("Cubic", "Hexagonal", "Monoclinic", "Triclinic", "Tetragonal")),
        Trait("lustre", "Lustre", ("Glassy", "Metallic", "Pearly", "Dull", "Silky")),
    ),
    lack=Lack("Fluorescence", ("Blue", "Green", "Orange"), "has no fluorescence"),
    event=("First identified", "was first identified"),
    role="Identified by",
    profession="mineralogist",
    place="Type locality",
    sections=(
        Section(
            "Occurrence",
            ("It lines cavities in old lava flows.", "Miners once threw it away as waste."),
            Detail(
                "how many tonnes the best known mine has yielded",
                "the yield of the best known mine",
                "The best known mine has yielded {mark}.",
                "{n} tonnes",
                20,
                8800,
            ),
        ),
        Section(
            "Uses",
            ("Jewellers avoid it because it splits.", "Powdered, it was used in ceramic glazes."),
            Detail(
                "how many patents mention it",
                "the number of patents that mention it",
                "So far it has been mentioned in {mark}.",
                "{n} patents",
                11,
                720,
            ),
        ),
    ),
)


MOONS = Subject(
    noun="moon",
    plural="moons",
    domain="Science & Research",
    subdomain="Technology & Science",
    brands=("Moon Catalogue", "Astropedia", "Sky Almanac"),
    picture="moon",
    group_label="Planet",
    groups=(
        ("Arvos", ""),
        ("Belthar", ""),
        ("Corundra", ""),
        ("Delphos", ""),
        ("Erythra", ""),
        ("Fomal", ""),
    ),
    first=_WATERS,
    second="Prime Minor Alpha Beta",
    pattern="{first} {second}",
    measures=(
        Measure("diameter", "Diameter", "km", 12, 5100, 3, "largest", "smallest"),
        Measure("period", "Orbital period", "hours", 9, 4100, 2, "longest", "shortest"),
        Measure("distance", "Distance from planet", "thousand km", 40, 9800, 5),
        Measure("cold", "Surface temperature", "kelvin", 28, 390, 1, "highest", "lowest"),
        Measure("craters", "Named craters", "", 10, 640, 1, "highest", "lowest"),
    ),
    traits=(
        Trait("surface", "Surface", ("Ice", "Rock", "Dust", "Sulphur")),
        Trait("orbit", "Orbit", ("Regular", "Irregular", "Retrograde")),
    ),
    lack=Lack("Atmosphere", ("Thin", "Dense", "Seasonal"), "has no atmosphere"),
    event=("Discovered", "was discovered"),
    role="Discovered by",
    profession="astronomer",
    place="Observatory",
    sections=(
        Section(
            "Observation",
            ("It is lost in the planet's glare for weeks.", "Amateurs time its eclipses to the second."),
            Detail(
                "how many photographic plates led to its discovery",
                "the number of photographic plates that led to its discovery",
                "It was recognised after the comparison of {mark}.",
                "{n} photographic plates",
                12,
                780,
            ),
        ),
        Section(
            "Exploration",
            ("A lander was planned and given up.", "Its gravity bends the paths of passing probes."),
            Detail(
                "how many pictures the fly-by sent home",
                "the number of pictures from the fly-by",
                "The only fly-by sent home {mark}.",
                "{n} pictures",
                30,
                9700,
            ),
        ),
    ),
)

SUBJECTS = (MOUNTAINS, RIVERS, ISLANDS, MINERALS, MOONS)
