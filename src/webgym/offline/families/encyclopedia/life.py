"""Subjects of encyclopedias: living things."""

from __future__ import annotations

from webgym.offline.families.encyclopedia.schema import Detail, Lack, Measure, Section, Subject, Trait

_COLORS = (
    "Copper Ashen Golden Crimson Azure Ivory Dusky Spotted Banded Crested Veiled Silver Marbled Scarlet "
    "Cinnamon Jade Slate Painted Lesser Northern Southern Hooded Mottled Pale Striped Velvet"
)
_PEAKS = (
    "Aldra Borrun Calder Dovrek Eskan Farrin Galvar Hestra Iskar Jorund Keld Lofra Morven Nordal Orsk "
    "Pelver Quorn Rastad Skarn Torvik Ulven Varga Wendel Ystra Zorin Brannoch Corrie Dunvar Erland Fennick"
)
_GREEK = (
    "Acro Baro Cerato Dino Elapho Fulgo Gryphi Hadro Ischy Juro Kerato Lopho Megalo Nano Ornitho Pachy "
    "Rhampho Stego Titano Ulti Veloci Xeno Zephyro Brachi Campto Draco Euro Gallo"
)


BIRDS = Subject(
    noun="bird",
    plural="birds",
    domain="Lifestyle & Leisure",
    subdomain="Pets & Animal Welfare",
    brands=("Bird Atlas", "Birdpedia", "Book of Birds"),
    picture="bird",
    group_label="Family",
    groups=(
        ("Owls", "Owl Owlet Barn-owl"),
        ("Warblers", "Warbler Reedling Chiffchaff"),
        ("Herons", "Heron Egret Bittern"),
        ("Finches", "Finch Siskin Crossbill"),
        ("Plovers", "Plover Dotterel Lapwing"),
        ("Kingfishers", "Kingfisher Kookaburra Halcyon"),
        ("Thrushes", "Thrush Ouzel Robin"),
    ),
    first=_COLORS,
    second="",
    pattern="{first} {second}",
    measures=(
        Measure("wingspan", "Wingspan", "cm", 14, 190, 1, "longest", "shortest"),
        Measure("weight", "Weight", "g", 12, 3200, 4),
        Measure("flight", "Top speed", "km/h", 18, 122, 1, "highest", "lowest"),
        Measure("age", "Oldest ringed bird", "months", 28, 320, 1),
        Measure("range", "Range", "thousand km²", 15, 4100, 5),
    ),
    traits=(
        Trait("status", "Status", ("Least concern", "Near threatened", "Vulnerable", "Endangered")),
        Trait("diet", "Diet", ("Insects", "Fish", "Seeds", "Small mammals", "Berries")),
    ),
    lack=Lack("Subspecies", ("Two", "Three", "Four", "Six"), "has no known subspecies"),
    event=("First described", "was first described"),
    role="Described by",
    profession="ornithologist",
    place="Type locality",
    sections=(
        Section(
            "Behaviour",
            ("Pairs stay together for several years.", "It feeds at dusk and rests in dense cover by day."),
            Detail(
                "how many eggs were found in the record clutch survey",
                "the number of eggs in the record clutch survey",
                "The largest clutch survey so far examined {mark} in one season.",
                "{n} eggs",
                40,
                990,
            ),
        ),
        Section(
            "Conservation",
            ("Wet meadows matter more to it than any reserve.", "Local groups guard the best-known roosts."),
            Detail(
                "how many breeding pairs the latest survey counted",
                "the number of breeding pairs in the latest survey",
                "The latest survey counted {mark}.",
                "{n} breeding pairs",
                120,
                9800,
            ),
        ),
    ),
)


FISHES = Subject(
    noun="fish",
    plural="fishes",
    domain="Science & Research",
    subdomain="Research & Academia",
    brands=("Reef Index", "Fishbase", "Marine Compendium"),
    picture="fish",
    group_label="Family",
    groups=(
        ("Wrasses", "Wrasse Hogfish Cleaner"),
        ("Gobies", "Goby Dartfish Mudskipper"),
        ("Groupers", "Grouper Hind Anthias"),
        ("Blennies", "Blenny Fangblenny"),
        ("Rays", "Ray Stingray Skate"),
        ("Angelfishes", "Angelfish Pygmy-angel"),
    ),
    first=_COLORS,
    second="",
    pattern="{first} {second}",
    measures=(
        Measure("length", "Length", "cm", 4, 240, 1, "longest", "shortest"),
        Measure("depth", "Deepest sighting", "m", 12, 640, 2, "deepest", "shallowest"),
        Measure("age", "Maximum age", "months", 18, 480, 1, "highest", "lowest"),
        Measure("eggs", "Eggs per season", "", 300, 90000, 50, "largest", "smallest"),
        Measure("territory", "Territory", "m²", 3, 900, 1, "largest", "smallest"),
    ),
    traits=(
        Trait("reef", "Zone", ("Lagoon", "Reef crest", "Outer slope", "Seagrass", "Deep wall")),
        Trait("diet", "Diet", ("Plankton", "Algae", "Crustaceans", "Small fish")),
    ),
    lack=Lack("Venom", ("Mild", "Moderate", "Strong"), "has no venom"),
    event=("First collected", "was first collected"),
    role="Collected by",
    profession="marine biologist",
    place="Home port of the expedition",
    sections=(
        Section(
            "Habitat",
            ("Juveniles shelter among urchin spines.", "Adults rarely leave the ledge they were born near."),
            Detail(
                "how many individuals were tagged in the long-term study",
                "the number of individuals tagged in the long-term study",
                "In the long-term study {mark} were followed from spawning to old age.",
                "{n} tagged individuals",
                60,
                4400,
            ),
        ),
        Section(
            "Research",
            ("Its colour changes within seconds.", "Divers report that it follows slow swimmers."),
            Detail(
                "how many hours of footage the colour study used",
                "the hours of footage used in the colour study",
                "The colour study is based on {mark}.",
                "{n} hours of footage",
                35,
                980,
            ),
        ),
    ),
)


DINOSAURS = Subject(
    noun="dinosaur",
    plural="dinosaurs",
    domain="Science & Research",
    subdomain="Research & Academia",
    brands=("Fossil Archive", "Dinosaur Handbook", "Paleopedia"),
    picture="dino",
    group_label="Clade",
    groups=(
        ("Horned dinosaurs", "ceratops"),
        ("Duck-billed dinosaurs", "lophus saura"),
        ("Long-necked dinosaurs", "titan saurus"),
        ("Armoured dinosaurs", "pelta nodon"),
        ("Running hunters", "raptor venator"),
        ("Ostrich dinosaurs", "mimus dromeus"),
    ),
    first=_GREEK,
    second="",
    pattern="{first}{second}",
    measures=(
        Measure("length", "Length", "cm", 90, 3300, 10, "longest", "shortest"),
        Measure("mass", "Mass", "kg", 14, 42000, 2, "greatest", "smallest"),
        Measure("skull", "Skull length", "cm", 12, 240, 1, "longest", "shortest"),
        Measure("finds", "Known specimens", "", 11, 260, 1, "highest", "lowest"),
        Measure("speed", "Estimated speed", "km/h", 10, 82, 1, "highest", "lowest"),
    ),
    traits=(
        Trait("period", "Period", ("Late Triassic", "Early Jurassic", "Late Jurassic", "Cretaceous")),
        Trait("diet", "Diet", ("Plants", "Meat", "Fish", "Mixed")),
    ),
    lack=Lack("Skin impressions", ("Scales", "Bristles", "Feathers"), "has no skin impressions"),
    event=("First described", "was first described"),
    role="Described by",
    profession="palaeontologist",
    place="Type locality",
    sections=(
        Section(
            "Discovery",
            ("The first bones were taken for those of a giant.", "The quarry is now under a reservoir."),
            Detail(
                "how many bones the type specimen has",
                "the number of bones of the type specimen",
                "The type specimen consists of {mark}.",
                "{n} bones",
                11,
                310,
            ),
        ),
        Section(
            "Palaeobiology",
            ("Growth rings show that it grew in spurts.", "It may have lived in herds of mixed age."),
            Detail(
                "how many footprints its best trackway has",
                "the number of footprints in its best trackway",
                "Its best trackway preserves {mark}.",
                "{n} footprints",
                14,
                870,
            ),
        ),
    ),
)


HERBS = Subject(
    noun="herb",
    plural="herbs",
    domain="Lifestyle & Leisure",
    subdomain="Health & Medicine",
    brands=("Herbal", "Herb Lexicon", "Remedy Handbook"),
    picture="plant",
    group_label="Plant family",
    groups=(
        ("Mint family", "Mint Balm Savory"),
        ("Daisy family", "Tansy Yarrow Arnica"),
        ("Carrot family", "Fennel Lovage Angelica"),
        ("Rose family", "Burnet Avens Agrimony"),
        ("Mallow family", "Mallow Hibiscus"),
        ("Borage family", "Borage Comfrey Alkanet"),
    ),
    first=_COLORS.replace("Hooded", "Hill").replace("Banded", "Bitter").replace("Crested", "Marsh"),
    second="",
    pattern="{first} {second}",
    measures=(
        Measure("height", "Height", "cm", 12, 260, 1, "greatest", "smallest"),
        Measure("oil", "Essential oil", "mg per 100 g", 20, 2400, 5, "highest", "lowest"),
        Measure("drying", "Drying time", "hours", 11, 240, 1, "longest", "shortest"),
        Measure("yield", "Yield", "kg per hectare", 120, 5200, 5, "highest", "lowest"),
        Measure("flower", "Flowering", "days", 10, 140, 1, "longest", "shortest"),
    ),
    traits=(
        Trait("part", "Part used", ("Leaves", "Roots", "Flowers", "Seeds")),
        Trait("use", "Traditional use", ("Coughs", "Sleep", "Digestion", "Skin", "Headache")),
    ),
    lack=Lack("Known interactions", ("Few", "Several", "Many"), "has no known interactions"),
    event=("First recorded", "was first recorded"),
    role="Recorded by",
    profession="botanist",
    place="Botanical garden",
    sections=(
        Section(
            "Cultivation",
            ("It wants full sun and a gritty soil.", "Old plants are divided in autumn."),
            Detail(
                "how many seeds make a gram",
                "the number of seeds in a gram",
                "A gram holds {mark}.",
                "{n} seeds",
                40,
                4900,
            ),
        ),
        Section(
            "Medical use",
            ("A tea is drunk after heavy meals.", "Apothecaries kept it in blue jars."),
            Detail(
                "how many volunteers took part in the largest trial",
                "the number of volunteers in the largest trial",
                "The largest trial had {mark}.",
                "{n} volunteers",
                24,
                2800,
            ),
        ),
    ),
)


DOGS = Subject(
    noun="dog breed",
    plural="dog breeds",
    domain="Lifestyle & Leisure",
    subdomain="Pets & Animal Welfare",
    brands=("Dog Breed Guide", "Kennel Lexicon", "Dogpedia"),
    picture="paw",
    group_label="Breed group",
    groups=(
        ("Herding dogs", "Shepherd Collie Heeler"),
        ("Scent hounds", "Hound Bloodhound Harrier"),
        ("Terriers", "Terrier"),
        ("Water dogs", "Waterdog Retriever"),
        ("Spitz dogs", "Spitz Laika"),
        ("Mountain dogs", "Mastiff Sennenhund"),
    ),
    first=_PEAKS,
    second="",
    pattern="{first} {second}",
    measures=(
        Measure("height", "Shoulder height", "cm", 21, 96, 1, "greatest", "smallest"),
        Measure("weight", "Weight", "kg", 3, 92, 1, "greatest", "smallest"),
        Measure("walk", "Daily exercise", "minutes", 25, 190, 1, "longest", "shortest"),
        Measure("litters", "Puppies registered last year", "", 35, 9400, 3, "highest", "lowest"),
        Measure("price", "Usual price of a puppy", "dollars", 310, 4200, 10, "highest", "lowest"),
    ),
    traits=(
        Trait("coat", "Coat", ("Smooth", "Wiry", "Curly", "Long")),
        Trait("temper", "Temperament", ("Calm", "Lively", "Watchful", "Stubborn")),
    ),
    lack=Lack("Hereditary disease", ("Hips", "Eyes", "Heart"), "has no known hereditary disease"),
    event=("First standard", "got its first breed standard"),
    role="Standard written by",
    profession="kennel judge",
    place="Breed club",
    sections=(
        Section(
            "Character",
            ("It bonds with one person.", "Left alone it learns to open doors."),
            Detail(
                "how many commands the cleverest dog of the breed knew",
                "the number of commands the cleverest dog of the breed knew",
                "The cleverest dog on record knew {mark}.",
                "{n} commands",
                32,
                640,
            ),
        ),
        Section(
            "Care",
            ("Brush it twice a week.", "Puppies should not climb stairs in their first months."),
            Detail(
                "how many grams of dry food a grown dog eats a day",
                "the daily amount of dry food",
                "A grown dog eats {mark} a day.",
                "{n} grams",
                90,
                990,
            ),
        ),
    ),
)

SUBJECTS = (BIRDS, FISHES, DINOSAURS, HERBS, DOGS)
