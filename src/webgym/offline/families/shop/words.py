"""Words of shops: model names, titles, what buttons say, what buyers write."""

from __future__ import annotations

from collections.abc import Mapping

MAKERS = (
    "Tarnby Velmo Ostrand Kellin Brask Nordvik Halden Mirova Castano Peltier Ravik Solvane Dunmore Elvet "
    "Fabrizi Grundel Hollin Ibsta Jorvik Kaldera Lumero Marquand Nestor Oakridge Pavone Quillon Rosmarin "
    "Sandviken Tolmie Ursino Valtari Westrow Yarrick Zanetta Amberly Bexhill Corvane Delmar Eskil Florin "
    "Garonne Hexter Isolde Janssen Korda Lorimer Montague Nilfort Orsay Prestwick"
).split()

SERIES = (
    "Alma Brio Corda Dalen Ebba Fjord Gaia Hilda Iris Jola Kivo Lumi Mara Nilo Orla Pavo Quint Rika Sola "
    "Tove Una Vega Wilma Xeno Ylva Zita Arlo Bento Cleo Dino Elio Fenno Gusto Hugo Ilmo Jasko Koto Lenno "
    "Mio Nova Otis Pico Runa Santo Tikka Umbra Vito Wanda Yuma Zeno Astra Bora Ceres Delta Echo Flora "
    "Greta Helio Indra Juno Kaia Lyra Mika Nero Opal Petra Rhea Selma Terra Ulma Vesta Willa Yoko Zora "
    "Atlas Bravo Cosmo Duna Etna Figo Garda Hedda Isla Jura Karo Luna Malta Nola Oslo Parma Riga Siena "
    "Turin Urba Volta Wessex Ypsa Zara Anton Basto Ciro Dorra Elba Fauno Gilda Haldis Igor Janko Kendo "
    "Limba Moto Nanda Odda Polka Rondo Salto Tundra Ulric Valmo Wolda Yarra Zorro Ando Bilbo Candela "
    "Domino Estra Fresno Ginko Havana Isar Jolie Kanto Largo Mondo Natura Ondo Presto Ravel Sierra Tempo "
    "Unio Vista Wando Yeti Zenit Aria Bolero Cadenza"
).split()

TITLE_ADJECTIVES = (
    "Quiet Salt Hollow Last Borrowed Northern Paper Crooked Silver Patient Forgotten Burning Second "
    "Hidden Blue Winter Open Slow Broken Glass Distant Copper Wandering Empty Seventh Painted Restless "
    "Gentle Sunken Early"
).split()
TITLE_NOUNS = (
    "Orchard Harbour Letter Mountain Clockmaker Garden Lighthouse Bridge Summer River Stairway Neighbour "
    "Island Kingdom Market Telescope Fox Cartographer Violin Winter Station Window Harvest Tide Machine "
    "Daughter Forest Lantern Archive Ferryman Kitchen Desert Choir Sparrow Compass Museum Voyage Theatre "
    "Valley Storm"
).split()
TITLE_PATTERNS = (
    "The {adjective} {noun}",
    "The {noun} of {town}",
    "{adjective} {noun}, {adjective2} Sky",
    "A {noun} for {given}",
    "{given} and the {noun}",
    "What the {noun} Knew",
    "Under the {adjective} {noun}",
    "Letters from {town}",
)

DESCRIPTIONS = (
    "{Name} comes from {maker} and was made with {use} in mind.",
    "Made for {use}: {name} is one of {maker}'s most asked-for pieces.",
    "{maker} has worked on {name} for two years. It is at its best with {use}.",
    "A sound choice for {use}. {maker} tests every piece before it leaves the house.",
)
DESCRIPTIONS_MORE = (
    "It arrives in plain cardboard, without plastic.",
    "Spare parts can be had for ten years.",
    "We have used one in our own office since last spring.",
    "The team picked it as a favourite of the season.",
    "A card with instructions in four languages lies in the box.",
    "Please note that small differences in appearance are normal.",
    "If you are not sure whether it is right for you, ask us: we answer within a day.",
    "It makes a good present, and we wrap it if you wish.",
)

REVIEW_TITLES = (
    "Does what it should", "Better than I hoped", "Not for me", "Would buy again", "A little dear", "Solid",
    "Lovely present", "Had to send it back", "Exactly as described", "Second one I own", "Good value",
    "Smaller than expected", "Everyone asks where I got it", "Took its time to arrive", "Very pleased",
    "Fine, nothing more", "Worth the wait", "I expected more", "A small joy", "Sturdy and simple",
)  # fmt: skip
REVIEW_GOOD = (
    "We use it nearly every day and it has not let us down.",
    "It looks even better than in the pictures.",
    "My sister wanted one as soon as she saw it.",
    "Well packed, quickly delivered, no complaints.",
    "I compared four of these and this was the one that felt right.",
    "After three months it is still like new.",
    "You can tell that somebody thought about the details.",
)
REVIEW_FAIR = (
    "It does the job, but I would not call it special.",
    "Good in itself, though the instructions could be clearer.",
    "Nice, but the colour is a little different from the picture.",
    "Fine for the price. The next one will be a better one.",
)
REVIEW_BAD = (
    "Mine arrived with a scratch and had to go back.",
    "It did not last the month.",
    "I had hoped for more at this price.",
    "Not what I had imagined from the description.",
)

VOICE: Mapping[str, tuple[str, ...]] = {
    "cart": ("cart", "basket", "bag"),
    "wish": ("Wish list", "Favourites", "Saved items"),
    "save": ("Add to {wish}", "Save to {wish}", "Put on {wish}"),
    "enter": ("Sign in", "Log in"),
    "leave": ("Sign out", "Log out"),
    "account": ("My account", "Your account", "Account"),
    "password": ("Password", "Your password"),
    "email": ("E-mail address", "E-mail", "Your e-mail"),
    "checkout": ("Go to checkout", "Checkout", "Proceed to checkout"),
    "order": ("Place order", "Buy now", "Confirm order"),
    "review": ("Continue", "Continue to review", "Check my order"),
    "person": ("Full name", "Name", "First and last name"),
    "street": ("Street and number", "Street address", "Address"),
    "town": ("Town", "City", "Town or city"),
    "postcode": ("Postcode", "Postal code", "ZIP code"),
    "delivery": ("Delivery method", "Delivery", "Shipping method"),
    "payment": ("Payment", "Payment method", "Pay by"),
    "code": ("Discount code", "Promo code", "Voucher code"),
    "apply": ("Apply", "Apply code", "Redeem"),
    "facts": ("Specifications", "Technical details", "Product details", "Data sheet"),
    "about": ("Description", "About this item", "Overview"),
    "terms": ("Delivery & returns", "Shipping and returns", "Delivery information"),
    "opinions": ("Reviews", "Customer reviews", "What customers say"),
    "nearby": ("Check store stock", "Available in stores?", "Stock in our stores"),
    "compare": ("Compare", "Compare items", "Side by side"),
    "hint": ("Search", "Search the shop", "What are you looking for?", "Search products"),
    "sorting": ("Sort by", "Sort", "Order by"),
    "featured": ("Recommended", "Featured", "Our choice"),
    "cheap": ("Price: low to high", "Lowest price", "Cheapest first", "Price ascending"),
    "dear": ("Price: high to low", "Highest price", "Most expensive first", "Price descending"),
    "best": ("Customer rating", "Best rated", "Top rated", "Rating: high to low"),
    "most": ("Most ratings", "Most rated", "Number of ratings"),
    "alphabet": ("Name A-Z", "Alphabetical", "By name"),
    "price": ("Price", "Price range"),
    "rating": ("Rating", "Customer rating at least"),
    "stock": ("In stock only", "Available now", "In stock"),
    "sale": ("On sale", "Reduced items", "Special offers"),
    "any": ("Any", "All", "Show all"),
    "filter": ("Apply filters", "Show results", "Filter"),
    "items": ("products", "items", "results", "articles"),
    "everything": ("All products", "Whole range", "Shop all"),
    "bargains": ("Sale", "Offers", "Reduced"),
    "help": ("Help", "Customer service", "Help centre"),
    "stores": ("Our stores", "Stores", "Find a store"),
    "contact": ("Contact us", "Contact", "Write to us"),
    "send": ("Send message", "Send", "Submit"),
    "news": ("Subscribe", "Sign me up", "Get the newsletter"),
    "quantity": ("Quantity", "Qty", "Number of pieces"),
    "empty": ("Your {cart} is empty.", "There is nothing in your {cart} yet."),
    "thanks": ("Thank you for your order", "Your order is placed", "We have received your order"),
}
"""What a shop calls things; every shop takes one of each."""

CODES = ("SPRING", "HELLO", "MAY", "FRIEND", "WELCOME", "SUNNY", "EXTRA", "THANKS")

RETURNS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (
        "Open your order in the account, choose “Return” and print the label. "
        "Stick it on the parcel and drop it at any parcel point.",
        ("print the label", "printed label", "label"),
    ),
    (
        "Write to the returns team by e-mail with your order number. "
        "A courier picks the parcel up at your door within three days.",
        ("courier",),
    ),
    (
        "Fill in the green return slip that lies in the parcel, put it in with the goods "
        "and hand the parcel in at a post office.",
        ("return slip", "slip"),
    ),
    (
        "Take the goods and the receipt to one of our stores. The money goes back to you at the till.",
        ("stores", "store"),
    ),
)
"""How to send something back, with the words that an answer about it must contain."""

GIFT_CARDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (
        "Type the sixteen digits of the card into the voucher field of your order summary.",
        ("voucher field", "sixteen digits", "16 digits"),
    ),
    (
        "Scratch the silver field free and enter the code under “Balance” in your account.",
        ("balance", "scratch"),
    ),
    (
        "Choose “Gift card” as the way to pay and enter the number on the back.",
        ("on the back", "way to pay"),
    ),
)

TOPICS = ("A question about an item", "My order", "Returns", "Invoices", "Something else")
