"""Subjects of encyclopedias: music, stage, film, books and games."""

from __future__ import annotations

from webgym.offline.families.encyclopedia.schema import Detail, Lack, Measure, Section, Subject, Trait

_MOODS = (
    "Silent Burning Hidden Broken Winter Golden Distant Hollow Patient Restless Crimson Sleeping Wandering "
    "Forgotten Paper Midnight Borrowed Salt Glass Scarlet Last Stone Gentle Crooked Velvet Secret Seventh"
)
_THINGS = "Harbour Orchard Lantern Garden Mirror Letter Tower Island Clock River Door Crown Bridge Forest"

OPERAS = Subject(
    noun="opera",
    plural="operas",
    domain="Entertainment",
    subdomain="Live Shows & Performances",
    brands=("Opera Guide", "Opera Handbook", "Stage Lexicon"),
    picture="poster",
    group_label="Genre",
    groups=(
        ("Comic opera", ""),
        ("Grand opera", ""),
        ("Chamber opera", ""),
        ("Fairy-tale opera", ""),
        ("Historical opera", ""),
        ("Operetta", ""),
    ),
    first=_MOODS,
    second=_THINGS,
    pattern="The {first} {second}",
    measures=(
        Measure("length", "Duration", "minutes", 48, 312, 1, "longest", "shortest"),
        Measure("orchestra", "Orchestra", "players", 14, 128, 1, "largest", "smallest"),
        Measure("chorus", "Chorus", "singers", 12, 140, 1, "largest", "smallest"),
        Measure("stagings", "Stagings", "", 12, 1900, 1, "highest", "lowest"),
        Measure("score", "Length of the score", "pages", 90, 980, 1, "longest", "shortest"),
    ),
    traits=(
        Trait("language", "Language", ("Italian", "German", "French", "Czech", "English")),
        Trait("lead", "Leading voice", ("Soprano", "Tenor", "Baritone", "Mezzo-soprano")),
    ),
    lack=Lack("Overture", ("Short", "Long", "In two parts"), "has no overture"),
    event=("First performed", "was first performed"),
    role="Composer",
    profession="composer",
    place="Place of the first performance",
    sections=(
        Section(
            "Synopsis",
            ("A letter goes to the wrong house.", "In the last act everyone is forgiven but the notary."),
            Detail(
                "how many bars the finale has",
                "the number of bars in the finale",
                "The finale alone takes {mark}.",
                "{n} bars",
                120,
                1900,
            ),
        ),
        Section(
            "Reception",
            ("The critics of the capital stayed away.", "It was revived with a new second act."),
            Detail(
                "how many curtain calls the first night ended with",
                "the number of curtain calls on the first night",
                "The first night ended with {mark}.",
                "{n} curtain calls",
                11,
                64,
            ),
        ),
    ),
)

SYMPHONIES = Subject(
    noun="symphony",
    plural="symphonies",
    domain="Entertainment",
    subdomain="Music",
    brands=("Music Lexicon", "Symphony Guide", "Classical Archive"),
    picture="sheet",
    group_label="School",
    groups=(
        ("Court school", ""),
        ("Northern romantics", ""),
        ("Modernists", ""),
        ("Late romantics", ""),
        ("Pastoral school", ""),
        ("Conservatory circle", ""),
    ),
    first=_MOODS,
    second="Symphony Sinfonietta Sinfonia",
    pattern="{first} {second}",
    measures=(
        Measure("length", "Duration", "minutes", 14, 104, 1, "longest", "shortest"),
        Measure("orchestra", "Orchestra", "players", 22, 130, 1, "largest", "smallest"),
        Measure("recordings", "Recordings", "", 10, 420, 1, "highest", "lowest"),
        Measure("bars", "Bars", "", 420, 3900, 3, "highest", "lowest"),
        Measure("tempo", "Tempo of the finale", "beats per minute", 52, 208, 1, "highest", "lowest"),
    ),
    traits=(
        Trait("key", "Key", ("C major", "D minor", "E-flat major", "G minor", "A major")),
        Trait("form", "Movements", ("Three", "Four", "Five", "One")),
    ),
    lack=Lack("Chorus", ("Mixed", "Children's", "Female"), "has no chorus"),
    event=("Premiered", "was premiered"),
    role="Composer",
    profession="composer",
    place="Place of the premiere",
    sections=(
        Section(
            "Music",
            ("The slow movement quotes a harvest song.", "Horns open the work off stage."),
            Detail(
                "how many bars the scherzo has",
                "the number of bars in the scherzo",
                "The scherzo runs to {mark}.",
                "{n} bars",
                80,
                780,
            ),
        ),
        Section(
            "Performances",
            ("The parts were thought lost in a fire.", "It opened the festival three years in a row."),
            Detail(
                "how many performances the year of the revival saw",
                "the number of performances in the year of the revival",
                "The year of its revival saw {mark}.",
                "{n} performances",
                12,
                340,
            ),
        ),
    ),
)

FILMS = Subject(
    noun="film",
    plural="films",
    domain="Entertainment",
    subdomain="Films & TV Shows",
    brands=("Film Lexicon", "Cinema Archive", "Filmpedia"),
    picture="poster",
    group_label="Genre",
    groups=(
        ("Thrillers", ""),
        ("Comedies", ""),
        ("Westerns", ""),
        ("Musicals", ""),
        ("Mysteries", ""),
        ("War films", ""),
        ("Melodramas", ""),
    ),
    first=_MOODS,
    second=_THINGS,
    pattern="{first} {second}",
    measures=(
        Measure("length", "Running time", "minutes", 68, 224, 1, "longest", "shortest"),
        Measure("budget", "Budget", "thousand dollars", 40, 8900, 5, "highest", "lowest"),
        Measure("copies", "Opening screens", "", 12, 1400, 1, "highest", "lowest"),
        Measure("shoot", "Shooting", "days", 14, 260, 1, "longest", "shortest"),
        Measure("extras", "Extras", "", 20, 4800, 2, "highest", "lowest"),
    ),
    traits=(
        Trait("format", "Format", ("Black and white", "Technicolor", "Widescreen", "Silent")),
        Trait("language", "Language", ("English", "French", "Italian", "Swedish")),
    ),
    lack=Lack("Surviving print", ("Complete", "Restored", "Incomplete"), "has no surviving print"),
    event=("Released", "was released"),
    role="Director",
    profession="film director",
    place="Filmed in",
    era=(1876, 1944),
    sections=(
        Section(
            "Production",
            ("Rain delayed the outdoor scenes.", "The script was finished on the first day of shooting."),
            Detail(
                "how many takes the opening scene needed",
                "the number of takes of the opening scene",
                "The opening scene needed {mark}.",
                "{n} takes",
                11,
                140,
            ),
        ),
        Section(
            "Release",
            ("The distributor asked for a happier ending.", "A cut version ran on television for years."),
            Detail(
                "how many tickets the first week sold",
                "the number of tickets sold in the first week",
                "In the first week {mark} were sold.",
                "{n} tickets",
                1200,
                99000,
            ),
        ),
    ),
)

NOVELS = Subject(
    noun="novel",
    plural="novels",
    domain="Entertainment",
    subdomain="Books & Reading",
    brands=("Book Lexicon", "Novel Guide", "Reader's Encyclopedia"),
    picture="poster",
    group_label="Genre",
    groups=(
        ("Adventure novels", ""),
        ("Family sagas", ""),
        ("Gothic novels", ""),
        ("Sea stories", ""),
        ("Detective novels", ""),
        ("Satires", ""),
    ),
    first=_MOODS,
    second=_THINGS,
    pattern="A {first} {second}",
    measures=(
        Measure("pages", "Pages", "", 112, 1240, 1, "highest", "lowest"),
        Measure("print", "First printing", "copies", 300, 48000, 50, "largest", "smallest"),
        Measure("weight", "Weight of the first edition", "g", 190, 1400, 5),
        Measure("chapters", "Chapters", "", 10, 128, 1, "highest", "lowest"),
        Measure("time", "Time of writing", "months", 10, 160, 1, "longest", "shortest"),
    ),
    traits=(
        Trait("person", "Narration", ("First person", "Third person", "Letters", "Diary")),
        Trait("ending", "Ending", ("Happy", "Tragic", "Open")),
    ),
    lack=Lack("Film version", ("One", "Two", "Three"), "has no film version"),
    event=("First published", "was first published"),
    role="Author",
    profession="novelist",
    place="Place of publication",
    era=(1760, 1946),
    sections=(
        Section(
            "Plot",
            ("Two cousins inherit one house.", "The narrator turns out to be the thief."),
            Detail(
                "how many letters the heroine writes",
                "the number of letters the heroine writes",
                "In the course of the story the heroine writes {mark}.",
                "{n} letters",
                11,
                190,
            ),
        ),
        Section(
            "Publication",
            ("The publisher asked for a shorter title.", "It first ran as a serial in a newspaper."),
            Detail(
                "how many instalments it first appeared in",
                "the number of instalments it first appeared in",
                "It first appeared in {mark}.",
                "{n} instalments",
                11,
                96,
            ),
        ),
    ),
)

GAMES = Subject(
    noun="video game",
    plural="video games",
    domain="Entertainment",
    subdomain="Gaming & Virtual Worlds",
    brands=("Game Archive", "Arcade Lexicon", "Gamepedia"),
    picture="poster",
    group_label="Genre",
    groups=(
        ("Platformers", "Jump Runner Quest"),
        ("Puzzle games", "Blocks Maze Tiles"),
        ("Racing games", "Rally Racer Circuit"),
        ("Strategy games", "Empires Tactics Wars"),
        ("Role-playing games", "Saga Chronicles Tales"),
        ("Simulations", "Tycoon Harbour Valley"),
    ),
    first="Pixel Turbo Astro Crystal Shadow Dragon Neon Robo Frost Solar Micro Hyper Iron Jungle Ghost Comet "
    "Sky Lunar Thunder Mystic Atomic Cyber Golden Wild Star",
    second="",
    pattern="{first} {second}",
    measures=(
        Measure("sold", "Copies sold", "thousand", 12, 9400, 2, "highest", "lowest"),
        Measure("levels", "Levels", "", 10, 240, 1, "highest", "lowest"),
        Measure("length", "Playing time", "hours", 10, 160, 1, "longest", "shortest"),
        Measure("score", "Record score", "points", 9800, 990000, 100, "highest", "lowest"),
        Measure("team", "Team", "people", 10, 320, 1, "largest", "smallest"),
    ),
    traits=(
        Trait("system", "Platform", ("Home computer", "Console", "Arcade", "Handheld")),
        Trait("graphics", "Graphics", ("Pixel art", "Vector", "Isometric", "3D")),
    ),
    lack=Lack("Sequel", ("One", "Two", "Four"), "has no sequel"),
    event=("Released", "was released"),
    role="Lead designer",
    profession="game designer",
    place="Studio in",
    era=(1946, 1966),
    sections=(
        Section(
            "Gameplay",
            ("A second player can join at any time.", "Lives are earned by finishing without damage."),
            Detail(
                "how many secret rooms players have found",
                "the number of secret rooms that players have found",
                "Players have found {mark} so far.",
                "{n} secret rooms",
                11,
                180,
            ),
        ),
        Section(
            "Development",
            ("The music was written before the levels.", "An early version ran at half the speed."),
            Detail(
                "how many weeks of testing it had",
                "the weeks of testing",
                "Before the release it had {mark}.",
                "{n} weeks of testing",
                10,
                98,
            ),
        ),
    ),
)

TEXTILES = Subject(
    noun="fabric",
    plural="fabrics",
    domain="Lifestyle & Leisure",
    subdomain="Fashion & Beauty",
    brands=("Textile Lexicon", "Fabric Handbook", "Costume Archive"),
    picture="weave",
    group_label="Fibre",
    groups=(
        ("Wool fabrics", "Tweed Flannel Loden"),
        ("Silk fabrics", "Satin Taffeta Brocade"),
        ("Cotton fabrics", "Calico Chintz Poplin"),
        ("Linen fabrics", "Cambric Damask Batiste"),
        ("Mixed fabrics", "Fustian Corduroy Velveteen"),
    ),
    first="Aldra Borrun Calder Dovrek Eskan Farrin Galvar Hestra Iskar Jorund Keld Lofra Morven Nordal Orsk "
    "Pelver Quorn Rastad Skarn Torvik Ulven Varga Wendel",
    second="",
    pattern="{first} {second}",
    measures=(
        Measure("weight", "Weight", "g/m²", 38, 690, 1, "greatest", "smallest"),
        Measure("threads", "Thread count", "", 40, 640, 1, "highest", "lowest"),
        Measure("width", "Loom width", "cm", 44, 240, 1, "greatest", "smallest"),
        Measure("output", "Yearly output", "metres", 900, 88000, 50, "largest", "smallest"),
        Measure("rub", "Abrasion resistance", "rubs", 4000, 78000, 500, "highest", "lowest"),
    ),
    traits=(
        Trait("weave", "Weave", ("Plain", "Twill", "Satin weave", "Jacquard")),
        Trait("use", "Typical use", ("Coats", "Shirts", "Curtains", "Gowns", "Sails")),
    ),
    lack=Lack("Protected name", ("National", "Regional", "International"), "has no protected name"),
    event=("First woven", "was first woven"),
    role="Developed by",
    profession="weaver",
    place="Weaving town",
    sections=(
        Section(
            "Manufacture",
            ("The yarn is washed in soft water only.", "Damp air keeps the threads from breaking."),
            Detail(
                "how many knots a bolt may have",
                "the number of knots that a bolt may have",
                "Inspectors pass a bolt with up to {mark}.",
                "{n} knots",
                10,
                96,
            ),
        ),
        Section(
            "Fashion",
            ("Court tailors lined their sleeves with it.", "It came back with the folk revival."),
            Detail(
                "how many costumes of the museum are made of it",
                "the number of museum costumes made of it",
                "The museum owns {mark} made of it.",
                "{n} costumes",
                11,
                320,
            ),
        ),
    ),
)

SUBJECTS = (OPERAS, SYMPHONIES, FILMS, NOVELS, GAMES, TEXTILES)
