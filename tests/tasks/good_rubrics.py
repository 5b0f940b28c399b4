"""Rubrics that a careful person would write, for tasks of the sources' kinds. No rule may refuse one."""

from __future__ import annotations

from typing import TypeAlias

Good: TypeAlias = tuple[str, list[tuple[str, list[str]]]]
"""A task, and its groups as (description, facts)."""

GOOD: list[Good] = [
    (
        "Find a vegetarian curry with at least 150 reviews and a rating of 4.5 stars or more that serves 4.",
        [
            (
                "The recipe",
                [
                    "The recipe is a vegetarian curry",
                    "The recipe has at least 150 reviews",
                    "The recipe is rated 4.5 stars or more",
                    "The recipe serves 4",
                ],
            )
        ],
    ),
    (
        "Find a round trip by air from Oslo to Lisbon OR Porto, out on 3 May, back on 10 May, under €400.",
        [
            (
                "The flight",
                [
                    "The flight is a round trip from Oslo to Lisbon OR Porto",
                    "The flight out is on 3 May",
                    "The flight back is on 10 May",
                    "The price is under €400",
                ],
            )
        ],
    ),
    (
        "How do I change the filter of the AquaPure 300 jug?",
        [("Changing the filter", ["Instructions for changing the filter of the AquaPure 300 jug are found"])],
    ),
    (
        "How much taller is the Shard than the Gherkin?",
        [("Heights compared", ["The difference in height between the Shard and the Gherkin is found"])],
    ),
    (
        "Give the contact details of Hexham's library.",
        [("Library", ["The contact details are found"])],
    ),
    (
        "Find outdoor activities such as climbing or kayaking for families near Bled.",
        [("Activities", ["Outdoor activities for families near Bled are found"])],
    ),
    (
        "Plan 3 days from Dayton to Ann Arbor, March 4th to March 6th, 2022, on a budget of $1,400.",
        [
            (
                "The trip",
                [
                    "The trip goes from Dayton to Ann Arbor",
                    "The plan covers the 3 days from March 4th to March 6th, 2022",
                    "The cost stays within $1,400",
                ],
            )
        ],
    ),
    (
        "Identify three state parks near South Bend. For each park give its name, its address and a "
        "link to its official page.",
        [
            (
                "First park",
                [
                    "The name of park 1 is given",
                    "The address of park 1 is given",
                    "A link to park 1 is given",
                ],
            ),
            (
                "Second park",
                [
                    "The name of park 2 is given",
                    "The address of park 2 is given",
                    "A link to park 2 is given",
                ],
            ),
            (
                "Third park",
                [
                    "The name of park 3 is given",
                    "The address of park 3 is given",
                    "A link to park 3 is given",
                ],
            ),
        ],
    ),
    (
        "Search for a wireless ergonomic keyboard with backlighting, at least 4 stars, between $40 and $60.",
        [
            (
                "The keyboard",
                [
                    "The keyboard is wireless",
                    "The keyboard is ergonomic",
                    "The keyboard has backlighting",
                    "The keyboard is rated at least 4 stars",
                    "The price lies between $40 and $60",
                ],
            )
        ],
    ),
    (
        "Sort the running shoes by price and rating and show the first one.",
        [("The shoe", ["The first running shoe, sorted by price and rating, is shown"])],
    ),
    (
        "What are the terms and conditions of the student discount at Lumen Books?",
        [("Discount", ["The terms and conditions of the student discount at Lumen Books are found"])],
    ),
    (
        "Click through to the 'Volunteers' page and report who coordinates volunteers.",
        [("Volunteers", ["The coordinator of volunteers is reported"])],
    ),
    (
        "Give the date and time of the next NYC marathon and the number of runners last year.",
        [
            ("Next race", ["The date and time of the next New York City marathon are given"]),
            ("Last race", ["The number of runners in last year's marathon is given"]),
        ],
    ),
    (
        "Search for jobs in Bergen in nursing or teaching, full time, posted in the last seven days.",
        [
            (
                "The jobs",
                [
                    "The jobs are in Bergen",
                    "The jobs are in nursing OR teaching",
                    "The jobs are full time",
                    "The jobs were posted in the last 7 days",
                ],
            )
        ],
    ),
    (
        "Who directed 'Pride & Prejudice' (2005), and who wrote its score?",
        [
            (
                "The film",
                [
                    "The director of 'Pride & Prejudice' (2005) is found",
                    "The composer of the score of 'Pride & Prejudice' (2005) is found",
                ],
            )
        ],
    ),
    (
        "Add two bags of the cheapest whole-bean coffee to the cart, then report the total with delivery.",
        [
            (
                "The cart",
                [
                    "The coffee in the cart is the cheapest whole-bean coffee",
                    "2 bags are in the cart",
                    "The total with delivery is reported",
                ],
            )
        ],
    ),
    (
        "Report the prices of the Vega tent and the Lyra tent, and the difference between them.",
        [
            (
                "Prices",
                [
                    "The price of the Vega tent is reported",
                    "The price of the Lyra tent is reported",
                    "The difference between the two prices is reported",
                ],
            )
        ],
    ),
    (
        "Find a flat in Ghent with 2 or more bedrooms that allows cats or dogs, at most 1200 euros a month.",
        [
            (
                "The apartment",
                [
                    "The flat is in Ghent",
                    "It has 2 or more bedrooms",
                    "It allows cats OR dogs",
                    "It costs at most 1,200 euros a month",
                ],
            )
        ],
    ),
    (
        "Go to the settings of the forum and turn on dark mode.",
        [("Settings", ["Dark mode is turned on in the settings of the forum"])],
    ),
    (
        "Which author of a detective novel set in Kyoto from 1990 to 1999 was born in a year of the Rooster?",
        [("The author", ["The author who fits all that is said is named"])],
    ),
    (
        "Find the opening hours of the Tiergarten museum and whether it is open on Monday.",
        [
            (
                "The museum",
                [
                    "The opening hours of the Tiergarten museum are found",
                    "Whether the Tiergarten museum is open on Monday is found",
                ],
            )
        ],
    ),
    (
        "Calculate the monthly payment for a loan of $250,000 over 30 years at 6.5%.",
        [("The loan", ["The monthly payment for $250,000 over 30 years at 6.5% is calculated"])],
    ),
    (
        "Find a paper on diffusion models on arXiv from the last two days and say how many authors it has.",
        [
            (
                "The paper",
                [
                    "The paper is about diffusion models",
                    "The paper was submitted to arXiv in the last 2 days",
                    "The number of its authors is given",
                ],
            )
        ],
    ),
    (
        "Look up the recipe of Nonna Pia's ragù; I need the ingredients and the cooking time.",
        [("The recipe", ["The ingredients of Nonna Pia's ragù are found", "The cooking time is found"])],
    ),
    (
        "Is the 10 million dollar fund of the city of Tartu still open for applications?",
        [
            (
                "The fund",
                ["Whether Tartu's fund of 10,000,000 dollars is still open for applications is found"],
            )
        ],
    ),
]
