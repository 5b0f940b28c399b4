"""What shops sell for going out and staying in."""

from __future__ import annotations

from webgym.offline.families.shop.schema import LIFESTYLE, Category, Sector

LEISURE: tuple[Sector, ...] = (
    Sector(
        "outdoor",
        "Travel & Transportation",
        "Outdoor & Recreation",
        ("Outfitters", "Outdoor", "Trail Supply", "Alpine"),
        ("Made for weather", "Carry less, see more", "Gear for the far side of the hill"),
        "Brand",
        ("Material", "ripstop nylon, merino wool, waxed canvas, aluminium, down, recycled polyester"),
        (("Colour", "moss, rust, granite, midnight, sand"), ("Size", "S, M, L, XL")),
        "long trails, wet summers, winter camps, weekend walks, bikepacking",
        (
            Category(
                "Tents",
                "Tunnel Tent, Dome Tent, Ridge Tent, Bivouac Tent",
                120,
                780,
                "Weight 0.9-5.8 kg; Pitching time 3-20 min; Water column 1500-6000 mm",
            ),
            Category(
                "Sleeping Bags",
                "Sleeping Bag, Quilt, Mummy Bag, Camp Blanket",
                60,
                520,
                "Weight 420-2100 g; Comfort limit 1-14 °C; Packed length 18-42 cm",
            ),
            Category(
                "Backpacks",
                "Daypack, Trekking Pack, Roll-Top Pack, Hip Pack",
                35,
                310,
                "Volume 4-85 l; Weight 240-2600 g; Back length 38-56 cm",
            ),
            Category(
                "Stoves",
                "Gas Stove, Wood Stove, Spirit Burner, Canister Stove",
                22,
                190,
                "Weight 70-980 g; Power 1200-3400 W; Boil time 2.2-8.4 min",
            ),
            Category(
                "Jackets",
                "Rain Jacket, Down Jacket, Wind Shell, Insulated Vest",
                59,
                430,
                "Weight 110-890 g; Water column 2000-28000 mm; Pockets 1-8",
            ),
            Category(
                "Lamps",
                "Headlamp, Camp Lantern, Clip Lamp, Torch",
                14,
                120,
                "Brightness 80-1400 lm; Burn time 4-160 h; Weight 38-420 g",
            ),
        ),
    ),
    Sector(
        "toys",
        LIFESTYLE,
        "Shopping",
        ("Toys", "Playroom", "Toy Chest", "Toybox"),
        ("Play is serious", "Toys that outlast childhoods", "For rainy afternoons"),
        "Brand",
        ("Material", "beech wood, organic cotton, felt, recycled plastic, cardboard"),
        (("Colour", "rainbow, natural, ocean, sunset"),),
        "toddlers, rainy days, long car rides, siblings, patient builders",
        (
            Category(
                "Building Sets",
                "Block Set, Marble Run, Plank Set, Bridge Kit",
                14,
                160,
                "Pieces 18-420; Weight 300-6200 g; Minimum age 1-9 years",
            ),
            Category(
                "Puzzles",
                "Floor Puzzle, Layer Puzzle, World Map Puzzle, Night Puzzle",
                7,
                48,
                "Pieces 12-1500; Width 24-98 cm; Minimum age 2-12 years",
            ),
            Category(
                "Dolls & Figures",
                "Rag Doll, Knight Figure, Animal Family, Finger Puppets",
                6,
                85,
                "Height 6-52 cm; Weight 30-720 g; Minimum age 1-6 years",
            ),
            Category(
                "Vehicles",
                "Dump Truck, Steam Train, Pull Tractor, Fire Engine",
                9,
                95,
                "Length 9-58 cm; Weight 80-2400 g; Wheels 3-18",
            ),
            Category(
                "Craft Kits",
                "Loom Kit, Lantern Kit, Clay Kit, Kite Kit",
                8,
                55,
                "Pieces 6-140; Working time 20-240 min; Minimum age 4-12 years",
            ),
            Category(
                "Ride-Ons",
                "Balance Bike, Scooter, Rocking Horse, Wagon",
                39,
                260,
                "Weight 1.8-11.5 kg; Load limit 20-60 kg; Seat height 22-48 cm",
            ),
        ),
    ),
    Sector(
        "music",
        "Entertainment",
        "Music",
        ("Music", "Strings & Keys", "Instruments", "Sound Room"),
        ("Play it again", "Instruments, tuned before they leave", "For first notes and last encores"),
        "Maker",
        ("Wood", "spruce, mahogany, maple, rosewood, walnut, cedar"),
        (("Finish", "natural, sunburst, satin black, cherry"),),
        "beginners, stage players, small rooms, teachers, folk sessions",
        (
            Category(
                "Guitars",
                "Concert Guitar, Dreadnought, Parlour Guitar, Semi-Hollow Guitar",
                89,
                1900,
                "Scale length 56-66 cm; Weight 1.2-4.1 kg; Frets 18-24",
            ),
            Category(
                "Ukuleles",
                "Soprano Ukulele, Tenor Ukulele, Concert Ukulele, Bass Ukulele",
                29,
                340,
                "Scale length 33-54 cm; Weight 340-1100 g; Frets 12-21",
            ),
            Category(
                "Violins",
                "Student Violin, Viola, Fiddle, Travel Violin",
                99,
                2400,
                "Body length 24-42 cm; Weight 360-720 g; Bow weight 48-72 g",
            ),
            Category(
                "Keyboards",
                "Stage Piano, Synthesizer, Reed Organ, Practice Keyboard",
                79,
                2100,
                "Keys 25-88; Weight 1.4-24.0 kg; Sounds 8-900",
            ),
            Category(
                "Drums",
                "Snare Drum, Cajon, Frame Drum, Bongo Pair",
                35,
                780,
                "Diameter 15-56 cm; Depth 6-48 cm; Weight 0.6-9.8 kg",
            ),
            Category(
                "Accessories",
                "Instrument Stand, Metronome, Gig Bag, Clip Tuner",
                8,
                120,
                "Weight 30-2400 g; Height 4-130 cm; Guarantee 1-8 years",
            ),
        ),
    ),
    Sector(
        "books",
        "Entertainment",
        "Books & Reading",
        ("Books", "Bookshop", "Readers", "Book House"),
        ("A good book finds you", "Independent since the first page", "Read slowly"),
        "Author",
        ("Language", "English, French, Spanish, German, Italian"),
        (("Format", "Hardcover, Paperback, E-book"),),
        "long evenings, train rides, book clubs, patient readers, holidays",
        (
            Category("Novels", "Novel", 8, 34, "Pages 140-720; Year 1998-2026; Weight 180-980 g"),
            Category("Crime", "Mystery", 7, 29, "Pages 160-560; Year 1996-2026; Weight 170-760 g"),
            Category("History", "History", 12, 58, "Pages 190-890; Year 1990-2026; Maps 2-48"),
            Category("Nature", "Field Guide", 9, 49, "Pages 96-520; Year 1994-2026; Illustrations 12-380"),
            Category(
                "Children", "Picture Book", 6, 26, "Pages 18-180; Year 2001-2026; Minimum age 2-12 years"
            ),
            Category("Cookery", "Cookbook", 14, 52, "Pages 90-440; Year 2002-2026; Recipes 30-260"),
            Category("Poetry", "Collection", 6, 28, "Pages 36-260; Year 1988-2026; Poems 18-160"),
        ),
        naming="title",
    ),
    Sector(
        "films",
        "Entertainment",
        "Films & TV Shows",
        ("Films", "Film Store", "Cinema Shop", "Reels"),
        ("Cinema for your shelf", "Restored, boxed and posted", "Films that do not leave"),
        "Director",
        ("Language", "English, French, Japanese, Danish, Portuguese"),
        (("Format", "DVD, Blu-ray, 4K disc"),),
        "film nights, collectors, students of light, Sunday afternoons, families",
        (
            Category(
                "Drama", "Film", 8, 42, "Running time 78-214 min; Year 1948-2025; Bonus material 5-190 min"
            ),
            Category(
                "Comedy", "Film", 7, 34, "Running time 71-148 min; Year 1952-2025; Bonus material 5-120 min"
            ),
            Category(
                "Thrillers",
                "Film",
                8,
                39,
                "Running time 82-176 min; Year 1955-2025; Bonus material 5-140 min",
            ),
            Category(
                "Documentaries", "Film", 9, 45, "Running time 52-240 min; Year 1961-2025; Booklet 8-96 pages"
            ),
            Category(
                "Animation", "Film", 9, 44, "Running time 44-132 min; Year 1963-2025; Minimum age 0-16 years"
            ),
            Category("Series", "Box Set", 18, 98, "Episodes 4-86; Discs 2-18; Year 1974-2025"),
        ),
        naming="title",
    ),
    Sector(
        "games",
        "Entertainment",
        "Gaming & Virtual Worlds",
        ("Games", "Board & Dice", "Game Room", "Tabletop"),
        ("Your turn", "Games worth a whole evening", "Roll, draw, trade, bluff"),
        "Designer",
        ("Language", "English, French, German, Polish, Czech"),
        (("Edition", "Standard, Deluxe, Collector"),),
        "two players, large groups, game nights, families, strategists",
        (
            Category("Strategy", "Game", 24, 120, "Playing time 45-240 min; Cards 20-340; Weight 0.8-4.6 kg"),
            Category(
                "Family", "Game", 14, 58, "Playing time 15-90 min; Minimum age 4-12 years; Weight 0.3-2.4 kg"
            ),
            Category("Party", "Game", 9, 45, "Playing time 10-60 min; Cards 40-520; Maximum players 5-20"),
            Category(
                "Cooperative", "Game", 18, 84, "Playing time 20-150 min; Scenarios 3-40; Weight 0.6-3.8 kg"
            ),
            Category("Card Games", "Game", 7, 36, "Playing time 10-75 min; Cards 32-220; Weight 90-720 g"),
            Category("Solo", "Game", 11, 62, "Playing time 12-120 min; Cards 18-190; Scenarios 4-60"),
        ),
        naming="title",
    ),
    Sector(
        "cycling",
        LIFESTYLE,
        "Sports & Fitness",
        ("Cycles", "Sports", "Velo", "Bike Works"),
        ("Ride further", "Bikes and what they need", "Two wheels, all weather"),
        "Brand",
        ("Material", "aluminium, carbon fibre, steel, titanium, nylon"),
        (("Colour", "matt black, racing green, signal red, pearl"), ("Size", "S, M, L, XL")),
        "commuters, gravel roads, tours, races, family rides",
        (
            Category(
                "Bicycles",
                "City Bike, Gravel Bike, Folding Bike, Touring Bike",
                340,
                2900,
                "Weight 7.8-17.9 kg; Gears 1-27; Wheel size 16-29 in",
            ),
            Category(
                "Helmets",
                "Road Helmet, City Helmet, Trail Helmet, Kids Helmet",
                29,
                240,
                "Weight 190-520 g; Vents 2-28; Guarantee 1-8 years",
            ),
            Category(
                "Lights",
                "Front Light, Rear Light, Light Set, Helmet Light",
                12,
                130,
                "Brightness 15-1600 lm; Burn time 2-90 h; Weight 18-240 g",
            ),
            Category(
                "Bags",
                "Pannier, Frame Bag, Saddle Bag, Handlebar Bag",
                19,
                160,
                "Volume 1-28 l; Weight 90-1400 g; Load limit 2-18 kg",
            ),
            Category(
                "Locks",
                "Folding Lock, Chain Lock, Cable Lock, Frame Lock",
                14,
                140,
                "Weight 0.2-3.6 kg; Length 40-180 cm; Security level 1-15",
            ),
            Category(
                "Pumps & Tools",
                "Floor Pump, Mini Pump, Multi Tool, Repair Kit",
                9,
                98,
                "Weight 60-1900 g; Maximum pressure 4-16 bar; Functions 2-26",
            ),
        ),
    ),
)
