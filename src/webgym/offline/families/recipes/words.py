"""Word stock of the cooking websites: ingredients, kinds of dishes, and what cuisines make of them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Ingredient:
    """What a shop sells.

    Attributes:
        name: as it stands behind the amount.
        aisle: where the shopping list puts it.
        unit: of the amount; ``""`` counts pieces.
        each: amount for one serving, in ``unit``.
        flags: ``m`` meat, ``f`` fish, ``d`` dairy, ``e`` egg, ``g`` gluten, ``n`` nuts, ``h`` honey.
    """

    name: str
    aisle: str
    unit: str
    each: float
    flags: str


_STOCK = """
chicken thighs|Meat|g|150|m
beef shin|Meat|g|160|m
lamb shoulder|Meat|g|170|m
pork fillet|Meat|g|140|m
turkey breast|Meat|g|145|m
salmon fillet|Fish|g|125|f
cod loin|Fish|g|135|f
raw prawns|Fish|g|110|f
smoked trout|Fish|g|80|f
cooked chickpeas|Dry goods|g|120|
brown lentils|Dry goods|g|75|
black beans|Dry goods|g|115|
firm tofu|Chilled|g|130|
aubergines|Vegetables|g|180|
cauliflower florets|Vegetables|g|190|
brown mushrooms|Vegetables|g|135|
pumpkin|Vegetables|g|210|
baby spinach|Vegetables|g|90|
waxy potatoes|Vegetables|g|220|
sweet potatoes|Vegetables|g|195|
courgettes|Vegetables|g|165|
leeks|Vegetables|g|145|
beetroot|Vegetables|g|155|
carrots|Vegetables|g|85|
celery sticks|Vegetables||0.5|
red onions|Vegetables||0.5|
garlic cloves|Vegetables||1|
fresh ginger|Vegetables|g|8|
ripe tomatoes|Vegetables|g|125|
cucumbers|Vegetables||0.25|
red peppers|Vegetables||0.5|
spring onions|Vegetables||1|
white cabbage|Vegetables|g|95|
lemons|Fruit||0.25|
limes|Fruit||0.25|
cooking apples|Fruit|g|130|
pears|Fruit|g|140|
plums|Fruit|g|115|
cherries|Fruit|g|105|
apricots|Fruit|g|110|
raspberries|Fruit|g|65|
oranges|Fruit|g|150|
rhubarb|Fruit|g|125|
bananas|Fruit||0.5|
blueberries|Fruit|g|60|
mangoes|Fruit|g|120|
vegetable stock|Dry goods|ml|225|
chopped tomatoes|Dry goods|g|105|
coconut milk|Dry goods|ml|100|
long-grain rice|Dry goods|g|70|
risotto rice|Dry goods|g|80|
dried pasta|Dry goods|g|95|g
rice noodles|Dry goods|g|85|
rolled oats|Dry goods|g|45|
plain flour|Baking|g|50|g
ground almonds|Baking|g|40|n
caster sugar|Baking|g|35|
brown sugar|Baking|g|30|
baking powder|Baking|tsp|0.25|
vanilla extract|Baking|tsp|0.25|
dark chocolate|Baking|g|28|
eggs|Chilled||0.5|e
butter|Chilled|g|22|d
whole milk|Chilled|ml|75|d
oat drink|Chilled|ml|80|
double cream|Chilled|ml|60|d
Greek yoghurt|Chilled|g|70|d
feta|Chilled|g|38|d
hard cheese|Chilled|g|24|d
olive oil|Oils and sauces|tbsp|0.5|
rapeseed oil|Oils and sauces|tbsp|0.5|
sesame oil|Oils and sauces|tbsp|0.25|
coconut oil|Oils and sauces|g|18|
soy sauce|Oils and sauces|tbsp|0.5|g
tahini|Oils and sauces|g|25|
wine vinegar|Oils and sauces|tbsp|0.25|
honey|Oils and sauces|g|14|h
maple syrup|Oils and sauces|g|16|
harissa paste|Oils and sauces|g|12|
miso paste|Oils and sauces|g|15|g
gochujang|Oils and sauces|g|13|
red curry paste|Oils and sauces|g|17|
green curry paste|Oils and sauces|g|19|
tamarind paste|Oils and sauces|g|11|
basil pesto|Oils and sauces|g|26|dn
Dijon mustard|Oils and sauces|g|9|
wholegrain mustard|Oils and sauces|g|7|
barbecue sauce|Oils and sauces|g|42|
chipotle paste|Oils and sauces|g|6|
green olives|Oils and sauces|g|32|
capers|Oils and sauces|g|5|
dried apricots|Dry goods|g|27|
sun-dried tomatoes|Dry goods|g|23|
walnuts|Dry goods|g|20|n
hazelnuts|Dry goods|g|29|n
pistachios|Dry goods|g|21|n
peanuts|Dry goods|g|31|n
pine nuts|Dry goods|g|12|n
sesame seeds|Spices|tsp|0.5|
cumin seeds|Spices|tsp|0.25|
smoked paprika|Spices|tsp|0.5|
ground turmeric|Spices|tsp|0.25|
garam masala|Spices|tsp|0.5|
saffron threads|Spices|g|0.25|
ground cinnamon|Spices|tsp|0.25|
ground cardamom|Spices|tsp|0.25|
juniper berries|Spices|tsp|0.25|
fennel seeds|Spices|tsp|0.25|
sumac|Spices|tsp|0.5|
black pepper|Spices|tsp|0.25|
fresh basil|Herbs|g|6|
fresh coriander|Herbs|g|7|
flat-leaf parsley|Herbs|g|8|
fresh dill|Herbs|g|5|
fresh mint|Herbs|g|4|
fresh thyme|Herbs|g|3|
rosemary sprigs|Herbs||0.5|
tortillas|Bakery||2|g
flatbreads|Bakery||1|g
sourdough slices|Bakery||2|g
"""

INGREDIENTS: dict[str, Ingredient] = {
    name: Ingredient(name, aisle, unit, float(each), flags)
    for name, aisle, unit, each, flags in (line.split("|") for line in _STOCK.strip().splitlines())
}

MAINS: dict[str, dict[str, str]] = {
    # word in the title: ingredient
    "meat": {
        "Chicken": "chicken thighs",
        "Beef": "beef shin",
        "Lamb": "lamb shoulder",
        "Pork": "pork fillet",
        "Turkey": "turkey breast",
    },
    "fish": {"Salmon": "salmon fillet", "Cod": "cod loin", "Prawn": "raw prawns", "Trout": "smoked trout"},
    "veg": {
        "Chickpea": "cooked chickpeas",
        "Lentil": "brown lentils",
        "Black Bean": "black beans",
        "Tofu": "firm tofu",
        "Aubergine": "aubergines",
        "Cauliflower": "cauliflower florets",
        "Mushroom": "brown mushrooms",
        "Pumpkin": "pumpkin",
        "Spinach": "baby spinach",
        "Potato": "waxy potatoes",
        "Sweet Potato": "sweet potatoes",
        "Courgette": "courgettes",
        "Leek": "leeks",
        "Beetroot": "beetroot",
        "Carrot": "carrots",
    },
    "fruit": {
        "Apple": "cooking apples",
        "Pear": "pears",
        "Plum": "plums",
        "Cherry": "cherries",
        "Apricot": "apricots",
        "Raspberry": "raspberries",
        "Orange": "oranges",
        "Rhubarb": "rhubarb",
        "Banana": "bananas",
        "Blueberry": "blueberries",
        "Mango": "mangoes",
    },
}

SWEET: dict[str, str] = {
    "Cinnamon": "ground cinnamon",
    "Cardamom": "ground cardamom",
    "Vanilla": "vanilla extract",
    "Hazelnut": "hazelnuts",
    "Pistachio": "pistachios",
    "Walnut": "walnuts",
    "Dark Chocolate": "dark chocolate",
    "Honeyed": "honey",
    "Maple": "maple syrup",
    "Saffron": "saffron threads",
}
"""Flavours of sweet dishes."""


@dataclass(frozen=True)
class Form:
    """A kind of dish, whatever it is made of.

    Attributes:
        course: where the website files it.
        mains: groups of :data:`MAINS` it goes with.
        base: what it always needs; ``{fat}`` and ``{herb}`` are the cuisine's.
        prep, cook: minutes, from and to.
        steps: ``{main}``, ``{flavour}``, ``{fat}``, ``{herb}``, ``{cook}`` and ``{temp}`` are filled in.
        energy: kilocalories of a serving, from and to.
    """

    course: str
    mains: tuple[str, ...]
    base: tuple[str, ...]
    prep: tuple[int, int]
    cook: tuple[int, int]
    steps: tuple[str, ...]
    energy: tuple[int, int]

    @property
    def oven(self) -> bool:
        """Whether it is made in the oven."""
        return any("{temp}" in step for step in self.steps)


FORMS: dict[str, Form] = {
    "soup": Form(
        "Soups",
        ("veg", "veg", "fish", "meat"),
        ("red onions", "garlic cloves", "vegetable stock", "{fat}", "{herb}"),
        (10, 20),
        (18, 50),
        (
            "Warm the {fat} in a large pot and soften the chopped onion and garlic over a low heat.",
            "Stir in the {flavour} and let it toast for a minute, until the kitchen smells of it.",
            "Add the {main} and the stock, bring to the boil, then simmer for {cook} minutes.",
            "Blend half of the soup, return it to the pot and season to taste.",
            "Ladle into warm bowls and scatter with {herb}.",
        ),
        (180, 420),
    ),
    "stew": Form(
        "Main courses",
        ("meat", "veg", "veg", "fish"),
        ("red onions", "garlic cloves", "chopped tomatoes", "carrots", "{fat}", "{herb}"),
        (15, 25),
        (35, 130),
        (
            "Brown the {main} in the {fat}, in batches, and set aside.",
            "In the same pot cook the onion, garlic and carrots until they begin to colour.",
            "Add the {flavour} and the tomatoes and scrape up what sticks to the bottom.",
            "Return the {main}, cover, and cook gently for {cook} minutes.",
            "Rest off the heat with the lid on, then stir in the {herb}.",
        ),
        (380, 680),
    ),
    "tray": Form(
        "Main courses",
        ("meat", "fish", "veg", "veg"),
        ("red peppers", "red onions", "lemons", "{fat}", "{herb}"),
        (10, 20),
        (22, 65),
        (
            "Heat the oven to {temp} °C and line a deep tray.",
            "Toss the {main}, peppers and onions with the {fat} and the {flavour}.",
            "Roast for {cook} minutes, turning everything once.",
            "Squeeze the lemon over the tray and finish with {herb}.",
        ),
        (340, 620),
    ),
    "grill": Form(
        "Main courses",
        ("meat", "fish", "veg"),
        ("{fat}", "lemons", "garlic cloves", "{herb}"),
        (15, 40),
        (8, 26),
        (
            "Stir the {flavour}, crushed garlic and {fat} into a marinade.",
            "Coat the {main} and leave it in the fridge while the grill heats up.",
            "Grill over a high heat for {cook} minutes, turning often.",
            "Rest under foil, then serve with lemon and {herb}.",
        ),
        (290, 560),
    ),
    "pasta": Form(
        "Main courses",
        ("veg", "fish", "meat"),
        ("dried pasta", "garlic cloves", "hard cheese", "{fat}", "{herb}"),
        (5, 15),
        (11, 35),
        (
            "Boil the pasta in plenty of salted water and keep a cup of it.",
            "Meanwhile cook the garlic and the {main} in the {fat}.",
            "Add the {flavour} and a splash of the water; the sauce needs {cook} minutes in all.",
            "Toss with the pasta and the cheese and top with {herb}.",
        ),
        (430, 720),
    ),
    "noodles": Form(
        "Main courses",
        ("veg", "fish", "meat"),
        ("rice noodles", "spring onions", "fresh ginger", "{fat}", "{herb}"),
        (10, 20),
        (7, 24),
        (
            "Soak the noodles in hot water until they bend, then drain.",
            "Stir-fry the ginger and the {main} in the {fat} over a high heat.",
            "Add the {flavour} and the noodles and toss; {cook} minutes in the wok are enough.",
            "Serve with spring onions and {herb}.",
        ),
        (390, 640),
    ),
    "rice": Form(
        "Main courses",
        ("veg", "meat", "fish"),
        ("long-grain rice", "vegetable stock", "red onions", "{fat}", "{herb}"),
        (10, 20),
        (20, 48),
        (
            "Rinse the rice until the water runs clear.",
            "Soften the onion in the {fat}, then add the {main} and the {flavour}.",
            "Stir in the rice, pour in the stock, cover and cook for {cook} minutes.",
            "Leave to steam off the heat, fluff with a fork and fold in the {herb}.",
        ),
        (410, 660),
    ),
    "salad": Form(
        "Salads",
        ("veg", "veg", "fish"),
        ("cucumbers", "lemons", "{fat}", "{herb}"),
        (8, 30),
        (0, 0),
        (
            "Slice the cucumber thinly and salt it lightly.",
            "Whisk the {flavour}, lemon juice and {fat} into a dressing.",
            "Toss the {main} with the cucumber and the dressing.",
            "Pile onto a platter and finish with {herb}.",
        ),
        (150, 390),
    ),
    "wrap": Form(
        "Light lunches",
        ("veg", "meat", "fish"),
        ("flatbreads", "white cabbage", "limes", "{herb}"),
        (10, 25),
        (5, 20),
        (
            "Shred the cabbage and dress it with lime juice and salt.",
            "Fry the {main} with the {flavour} for {cook} minutes.",
            "Warm the breads, fill them with cabbage and {main}, and tuck in the {herb}.",
        ),
        (320, 560),
    ),
    "dip": Form(
        "Sides and dips",
        ("veg",),
        ("lemons", "garlic cloves", "{fat}", "{herb}"),
        (5, 25),
        (0, 40),
        (
            "Cook the {main} until completely soft and let it cool.",
            "Blend with the garlic, the {flavour}, lemon juice and {fat} until smooth.",
            "Spread in a bowl, make a well in the middle and scatter with {herb}.",
        ),
        (110, 290),
    ),
    "cake": Form(
        "Cakes and bakes",
        ("fruit",),
        ("plain flour", "caster sugar", "butter", "eggs", "baking powder"),
        (15, 35),
        (28, 70),
        (
            "Heat the oven to {temp} °C and butter a tin.",
            "Beat the butter and sugar until pale, then add the eggs one by one.",
            "Fold in the flour, baking powder and {flavour}.",
            "Scrape into the tin, press in the {main} and bake for {cook} minutes.",
            "Cool in the tin before turning out.",
        ),
        (290, 520),
    ),
    "biscuit": Form(
        "Cakes and bakes",
        ("fruit",),
        ("rolled oats", "brown sugar", "coconut oil", "ground almonds"),
        (10, 30),
        (9, 26),
        (
            "Heat the oven to {temp} °C and line two trays.",
            "Melt the coconut oil with the sugar and stir in the oats, almonds and {flavour}.",
            "Chop the {main} small and work it into the dough.",
            "Shape, leave room between them and bake for {cook} minutes.",
        ),
        (120, 310),
    ),
    "cream": Form(
        "Desserts",
        ("fruit",),
        ("double cream", "caster sugar", "vanilla extract"),
        (10, 30),
        (0, 16),
        (
            "Cook the {main} with half of the sugar until it collapses, then chill.",
            "Whip the cream with the rest of the sugar and the {flavour}.",
            "Layer cream and fruit in glasses and chill before serving.",
        ),
        (240, 480),
    ),
    "sorbet": Form(
        "Desserts",
        ("fruit",),
        ("caster sugar", "lemons"),
        (10, 35),
        (4, 14),
        (
            "Simmer the sugar with the same weight of water and the {flavour} into a syrup.",
            "Blend the {main} with the syrup and lemon juice and push through a sieve.",
            "Freeze, stirring every half hour, until it holds its shape.",
        ),
        (90, 220),
    ),
    "porridge": Form(
        "Breakfast",
        ("fruit",),
        ("rolled oats", "oat drink", "maple syrup"),
        (3, 12),
        (4, 18),
        (
            "Bring the oats and the oat drink to a gentle simmer.",
            "Stir in the {flavour} and cook for {cook} minutes, stirring now and then.",
            "Top with the {main} and a thread of maple syrup.",
        ),
        (210, 430),
    ),
    "toast": Form(
        "Breakfast",
        ("veg", "fish"),
        ("sourdough slices", "eggs", "{fat}", "{herb}"),
        (5, 12),
        (5, 16),
        (
            "Fry the {main} in the {fat} with the {flavour}.",
            "Poach the eggs and toast the bread; all in all {cook} minutes at the stove.",
            "Pile everything onto the toast and finish with {herb}.",
        ),
        (260, 470),
    ),
    "drink": Form(
        "Drinks",
        ("fruit",),
        ("limes", "honey", "fresh mint"),
        (4, 15),
        (0, 0),
        (
            "Blend the {main} with the honey and the {flavour}.",
            "Strain over ice, add lime juice and top up with cold water.",
            "Serve with a sprig of mint.",
        ),
        (60, 190),
    ),
}


@dataclass(frozen=True)
class Cuisine:
    """What a website cooks.

    Attributes:
        suffixes: second words of brands.
        taglines: one is taken.
        fat, herb: what ``{fat}`` and ``{herb}`` stand for.
        flavours: word in the title and its ingredient.
        names: for every form, what the cuisine calls it.
        mains: groups it uses; all if empty.
        without: words for main ingredients that it does not use.
    """

    suffixes: tuple[str, ...]
    taglines: tuple[str, ...]
    fat: str
    herb: str
    flavours: dict[str, str]
    names: dict[str, tuple[str, ...]]
    mains: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
