"""Rubrics that rules must tell apart: what may not be cut into facts, and what only looks so."""

from __future__ import annotations

CUT_WRONGLY: list[tuple[str, list[str]]] = [
    (
        "Buy the cheapest whole-bean coffee on Petal.",
        ["The product page is opened", "The coffee is added to the cart", "The checkout is completed"],
    ),
    (
        "Order two large margherita pizzas.",
        ["Two pizzas are in the basket", "The delivery address is entered", "Payment is made"],
    ),
    (
        "Book a table for four at Odette on Friday.",
        ["The date is selected", "Contact details are filled in", "The reservation is confirmed"],
    ),
    (
        "Purchase tickets for the zoo.",
        ["Number of tickets selected", "Payment details entered", "Order placed"],
    ),
    ("How can I buy tickets for the zoo?", ["Open the tickets page", "Select the date", "Pay"]),
    ("How do I return a parcel to Zed?", ["Print the label", "Drop the parcel at a shop"]),
    ("How do I renew my passport?", ["The form is filled in", "The fee is paid", "The form is submitted"]),
    (
        "How much taller is the Shard than the Gherkin?",
        [
            "The height of the Shard is found",
            "The height of the Gherkin is found",
            "The difference in height is calculated",
        ],
    ),
    (
        "How much taller is the Shard than the Gherkin?",
        ["The height of the Shard is found", "The height of the Gherkin is found"],
    ),
    (
        "How many more people live in Oslo than in Bergen?",
        [
            "The population of Oslo is found",
            "The population of Bergen is found",
            "The difference is reported",
        ],
    ),
    (
        "What is the total of the fares of the red line and the blue line?",
        [
            "The fare of the red line is identified",
            "The fare of the blue line is identified",
            "The sum of both fares is given",
        ],
    ),
    (
        "Calculate the cost of three nights at the Inn with breakfast.",
        [
            "The nightly rate is found",
            "The price of breakfast is found",
            "The cost of three nights is calculated",
        ],
    ),
    (
        "Convert the price of the Vega tent to euros.",
        ["The price in dollars is found", "The exchange rate is found", "The converted price is reported"],
    ),
    (
        "What percentage of the seats did the Greens win?",
        [
            "The number of seats of the Greens is found",
            "The total number of seats is found",
            "The percentage is calculated",
        ],
    ),
    (
        "What is the average of the scores of Ann and Bob?",
        ["The score of Ann is found", "The score of Bob is found", "The average is computed"],
    ),
    (
        "How old was Ada when Emma was published?",
        [
            "Ada's year of birth is found",
            "The year in which Emma was published is found",
            "The age is calculated by subtracting",
        ],
    ),
    (
        "Find a hotel in Riga with a pool or a gym.",
        ["The hotel has a swimming pool", "There is a gym in the hotel", "The hotel is in Riga"],
    ),
    (
        "Find a flight to Boston or New York.",
        ["A flight to Boston is found", "A flight going to New York is found"],
    ),
    (
        "Find a laptop by Dell, HP or Lenovo under $900.",
        ["The laptop is a Dell", "HP laptop found", "It costs under $900"],
    ),
    (
        "Give the phone number or the e-mail of the club.",
        ["The phone number of the club is given", "The e-mail of the club is given"],
    ),
    (
        "Show vegan or gluten-free recipes for lunch.",
        ["The recipes are vegan", "Gluten-free recipes are shown"],
    ),
    ("Pick a red or blue shirt in size M.", ["The shirt is red", "A blue shirt is picked", "The size is M"]),
]
"""Steps of a purchase, of instructions or of a computation, and alternatives, as facts of their own."""

CUT_RIGHTLY: list[tuple[str, list[str]]] = [
    (
        "Which is cheaper, the Vega tent or the Lyra tent?",
        [
            "The price of the Vega tent is found",
            "The price of the Lyra tent is found",
            "The cheaper tent is named",
        ],
    ),
    (
        "Is the Vega or the Lyra lighter?",
        ["The weight of the Vega is found", "The weight of the Lyra is found"],
    ),
    ("Compare the plans of Basic or Pro.", ["The price of Basic is given", "The price of Pro is given"]),
    (
        "Find out whether Bonn or Ulm has more museums.",
        ["The number of museums in Bonn is found", "The number of museums in Ulm is found"],
    ),
    (
        "Who won more medals in 2012, Phelps or Lochte?",
        ["The number of Phelps's medals in 2012 is found", "The number of Lochte's medals in 2012 is found"],
    ),
    (
        "Find hotels with 4 stars or more in Riga or Tartu.",
        ["The hotel has 4 stars or more", "The hotel is in Riga OR Tartu"],
    ),
    (
        "Find a desk in oak or walnut; also name a chair in oak.",
        ["The desk is oak OR walnut", "The chair is oak"],
    ),
    ("Buy the cheapest kettle.", ["The kettle is the cheapest", "The kettle is ordered"]),
    (
        "Add the blue mug and two plates to the cart and go to checkout.",
        ["The blue mug is in the cart", "2 plates are in the cart", "The checkout is reached"],
    ),
    (
        "Book a table for two at Odette at 7 pm and give the confirmation number.",
        [
            "The table is for 2",
            "The reservation is at Odette",
            "The reservation is for 7 pm",
            "The confirmation number is given",
        ],
    ),
    (
        "List the five best sellers in order of price.",
        ["The five best sellers are listed", "They are in order of price"],
    ),
    (
        "Report the prices of both tents and the total.",
        ["The price of the Vega is reported", "The price of the Lyra is reported", "The total is reported"],
    ),
    (
        "Find two laptops with an average rating over 4 and give the price of each.",
        [
            "The price of laptop 1 is given",
            "The price of laptop 2 is given",
            "Both have an average rating over 4",
        ],
    ),
    (
        "Find a recipe with a total time under 40 minutes and give its author and its calories.",
        ["The total time is under 40 minutes", "The author is given", "The calories are given"],
    ),
    (
        "What is the difference between the Basic and the Pro plan?",
        ["The difference between the Basic and the Pro plan is found"],
    ),
    (
        "How do I cancel an order, and what does the return cost?",
        ["Instructions for cancelling an order are found", "The cost of the return is found"],
    ),
    (
        "Find the address of the vegan restaurant Soil in Bergen near the old harbour, and its phone number.",
        [
            "The address of the vegan restaurant Soil in Bergen near the old harbour is given",
            "The phone number of the vegan restaurant Soil in Bergen near the old harbour is given",
        ],
    ),
    (
        "Find the tallest building in Ulm and calculate its height in feet.",
        ["The tallest building in Ulm is named", "Its height in feet is calculated"],
    ),
    (
        "Find how many flights leave today, and the name of the pilot of the first or the last one.",
        ["The number of flights is found", "The name of the pilot of the first OR the last one is found"],
    ),
    (
        "Give directions to the museum and its opening hours.",
        ["Directions to the museum are given", "The opening hours are given"],
    ),
    (
        "Calculate the monthly payment for a $300,000 mortgage at 5% and report the total interest.",
        ["The monthly payment for $300,000 at 5% is reported", "The total interest is reported"],
    ),
    (
        "Register for the newsletter with the e-mail a@b.example.",
        ["The newsletter is subscribed to", "The e-mail is a@b.example"],
    ),
]
"""What looks like those and is right: every fact is asked for."""

SAME_NUMBER: list[tuple[str, list[str]]] = [
    ("Find flats available within two weeks", ["The flat is free within 14 days"]),
    ("What percentage ... at least half of the students", ["At least 0.5 of the students"]),
    ("What percentage ... at least half of the students", ["at least 50% of the students"]),
    ("What percentage ... at least half of the students", ["1/2 of the students"]),
    ("A recipe ready in half an hour", ["ready within 30 minutes"]),
    ("in one and a half hours", ["within 1.5 hours"]),
    ("in one and a half hours", ["within 90 minutes"]),
    ("an internship of a year", ["lasts 12 months"]),
    ("an internship of a year", ["365 days"]),
    ("A laptop with 1 TB", ["storage is 1000 GB"]),
    ("open at 7 pm", ["open at 19:00"]),
    ("open at 19:30", ["open at 7:30 PM"]),
    ("novels of the 1990s", ["published between 1990 and 1999"]),
    ("novels of the nineteenth century", ["published between 1801 and 1900"]),
    ("find twenty-five recipes", ["25 recipes are found"]),
    ("two hundred and fifty dollars", ["at most $250"]),
    ("a room for two adults and one child", ["for 3 guests"]),
    ("Super Bowl XLV", ["Super Bowl 45"]),
    ("List the top three teams", ["The team in 2nd position is given"]),
    ("List the top three teams", ["Position #3 is given"]),
    ("List the top three teams", ["#2: the name"]),
    ("Who was the runner-up?", ["The 2nd position is named"]),
    (
        "List all authors",
        ["Author 1 name is provided", "Author 2 name is provided", "Author 3 name is provided"],
    ),
    ("Find two sheds", ["the name of shed 2 is given"]),
    ("Find two sheds", ["a 2nd shed is found"]),
    ("next week", ["within 7 days"]),
    ("a 20% discount", ["a discount of 0.2"]),
    ("quarter of a mile", ["0.25 mile"]),
    ("six feet tall", ["72 inches"]),
    ("weigh 2 kg", ["2000 g"]),
    ("weigh 2 kg", ["2000g"]),
    ("$1.5 million", ["1,500,000"]),
    ("1,500,000 dollars", ["1.5 million dollars"]),
    ("three quarters of a mile", ["0.75 mile"]),
]
"""The fact states a number of the task in another form."""

OTHER_NUMBER: list[tuple[str, list[str]]] = [
    ("Find shoes under $80", ["under $75"]),
    ("shoes for the trip in May", ["the trip starts on May 3rd"]),
    ("two weeks in Rome", ["15 days"]),
    ("the museum's hours", ["open at 9:30"]),
    ("a hotel", ["hotel 2"]),
    ("the short commit ID", ["the ID matches 44b5506"]),
    ("Find the release date", ["released on the 12th of March"]),
    ("Find the release date", ["released in 2019"]),
    ("find sheds", ["The 3rd shed is found"]),
]
"""The fact states a number that the task does not."""
