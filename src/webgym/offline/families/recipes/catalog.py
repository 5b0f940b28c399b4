"""What a cooking website offers: recipes, cooks, collections, and its kitchen guide."""

from __future__ import annotations

import random
from dataclasses import dataclass
from datetime import date, timedelta

from webgym.offline import names
from webgym.offline.families.recipes.words import INGREDIENTS, WORDS, Cuisine, Form, Ingredient
from webgym.offline.seeds import stream
from webgym.offline.website import TODAY, slug

SERVINGS = (1, 2, 3, 4, 6, 8, 10, 12)
LEVELS = ("Easy", "Moderate", "Challenging")
DIETS: dict[str, tuple[str, str]] = {
    # value: (text, flags of ingredients that rule it out)
    "vegan": ("Vegan", "mfdeh"),
    "vegetarian": ("Vegetarian", "mf"),
    "gluten-free": ("Gluten-free", "g"),
    "dairy-free": ("Dairy-free", "d"),
    "nut-free": ("Nut-free", "n"),
}
_FRACTIONS = {0: "", 1: "¼", 2: "½", 3: "¾"}


@dataclass(frozen=True)
class Review:
    """What a visitor wrote under a recipe."""

    name: str
    stars: int
    text: str


@dataclass(frozen=True)
class Recipe:
    """One recipe. Times in minutes; nutrition in grams and kilocalories for one serving.

    Attributes:
        serves: servings that the page shows unless asked for others.
        ingredients: what it needs; amounts follow from :attr:`Ingredient.each`.
        keeps: days in the fridge.
        freezes: months in the freezer; 0 if it should not be frozen.
        temperature: of the oven in °C; 0 without one.
    """

    slug: str
    title: str
    course: str
    cook_name: str
    prep: int
    cooking: int
    serves: int
    level: str
    rating: float
    votes: int
    published: date
    ingredients: tuple[Ingredient, ...]
    steps: tuple[str, ...]
    energy: int
    protein: int
    carbohydrates: int
    fat: int
    fibre: int
    salt: float
    keeps: int
    freezes: int
    temperature: int
    reviews: tuple[Review, ...]

    @property
    def total(self) -> int:
        """Minutes from start to table."""
        return self.prep + self.cooking

    @property
    def flags(self) -> frozenset[str]:
        """Flags of all ingredients."""
        return frozenset("".join(ingredient.flags for ingredient in self.ingredients))

    @property
    def diets(self) -> list[str]:
        """The diets it suits, as the page names them."""
        return [text for text, out in DIETS.values() if not self.flags & set(out)]

    def suits(self, diet: str) -> bool:
        """Whether it suits a diet, given by its value in an address."""
        return not self.flags & set(DIETS[diet][1])


def amount(ingredient: Ingredient, servings: float) -> str:
    """An amount and what it is of: ``"300 g carrots"``, ``"1½ lemons"``."""
    value = ingredient.each * servings
    if ingredient.unit in ("g", "ml"):
        number = f"{value:.0f}" if value >= 10 else f"{value:.1f}".removesuffix(".0")
        return f"{number} {ingredient.unit} {ingredient.name}"
    whole, quarters = divmod(round(value * 4), 4)
    number = (str(whole) if whole else "") + _FRACTIONS[quarters]
    if ingredient.unit:
        return f"{number} {ingredient.unit} {ingredient.name}"
    return f"{number} {ingredient.name.removesuffix('s') if value <= 1 else ingredient.name}"


@dataclass(frozen=True)
class Cook:
    """Someone who writes recipes."""

    slug: str
    name: str
    town: str
    since: int
    role: str
    bio: str


@dataclass(frozen=True)
class Collection:
    """Recipes that a cook put together."""

    slug: str
    title: str
    intro: str
    curator: str
    recipes: tuple[Recipe, ...]


_ROLES = ("Head of recipes", "Food writer", "Test cook", "Guest cook", "Pastry cook", "Founder")


def _shape(rng: random.Random, cuisine: Cuisine) -> tuple[Form, str, str, str]:
    """A form, its main ingredient, its flavour's ingredient, and the title."""
    groups = set(cuisine.mains or WORDS.mains)
    kinds = [kind for kind in cuisine.names if groups & set(WORDS.forms[kind].mains)]
    kind = rng.choice(kinds)
    form = WORDS.forms[kind]
    group = rng.choice([group for group in form.mains if group in groups])
    word, main = rng.choice([item for item in WORDS.mains[group].items() if item[0] not in cuisine.without])
    flavours = WORDS.sweet if group == "fruit" else cuisine.flavours
    flavour, spice = rng.choice(list(flavours.items()))
    return form, main, spice, f"{flavour} {word} {rng.choice(cuisine.names[kind])}"


def _clashes(title: str, taken: list[str]) -> bool:
    # A title inside another would make "the page shows this title" ambiguous.
    folded = title.casefold()
    return any(folded in other or other in folded for other in taken)


def _ingredients(form: Form, main: str, spice: str, cuisine: Cuisine) -> tuple[Ingredient, ...]:
    base = [name.format(fat=cuisine.fat, herb=cuisine.herb) for name in form.base]
    return tuple(INGREDIENTS[name] for name in dict.fromkeys((main, spice, *base)))


def _reviews(rng: random.Random) -> tuple[Review, ...]:
    count = rng.randint(3, 5)
    texts = rng.sample(WORDS.praise, count)
    return tuple(
        Review(name, rng.choice((2, 3, 4, 4, 5, 5)), text)
        for name, text in zip(names.people(rng, count), texts, strict=True)
    )


def make_recipes(seed: int, style: str, cooks: tuple[Cook, ...]) -> tuple[Recipe, ...]:
    """Between 36 and 60 recipes, no title of which is part of another."""
    rng = stream(seed, "recipes")
    cuisine = WORDS.cuisines[style]
    count = rng.randint(36, 60)
    days = rng.sample(range(2, 900), count)
    found: list[Recipe] = []
    taken: list[str] = []
    while len(found) < count:
        form, main, spice, title = _shape(rng, cuisine)
        if main == spice or _clashes(title, taken):
            continue
        taken.append(title.casefold())
        found.append(_recipe(rng, form, title, (main, spice), cuisine, rng.choice(cooks), days[len(found)]))
    return tuple(found)


def _recipe(
    rng: random.Random, form: Form, title: str, parts: tuple[str, str], cuisine: Cuisine, cook: Cook, age: int
) -> Recipe:
    main, spice = parts
    prep, cooking = rng.randint(*form.prep), rng.randint(*form.cook)
    energy = rng.randint(*form.energy)
    hearty = INGREDIENTS[main].flags in ("m", "f")
    protein = rng.randint(24, 42) if hearty else rng.randint(2, max(4, energy // 28))
    fat = rng.randint(3, max(4, energy // 22))
    carbohydrates = max(3, (energy - 4 * protein - 9 * fat) // 4)
    temperature = rng.choice((160, 170, 175, 180, 190, 200, 210, 220)) if form.oven else 0
    said = {
        "main": main,
        "flavour": spice,
        "fat": cuisine.fat,
        "herb": cuisine.herb,
        "cook": max(cooking, 1),
        "temp": temperature,
    }
    return Recipe(
        slug=slug(title),
        title=title,
        course=form.course,
        cook_name=cook.name,
        prep=prep,
        cooking=cooking,
        serves=rng.choice((2, 4, 4, 4, 6)),
        level=rng.choice(LEVELS),
        rating=rng.randint(31, 50) / 10,
        votes=rng.randint(8, 640),
        published=TODAY - timedelta(days=age),
        ingredients=_ingredients(form, main, spice, cuisine),
        steps=tuple(step.format(**said) for step in form.steps),
        energy=4 * protein + 4 * carbohydrates + 9 * fat,
        protein=protein,
        carbohydrates=carbohydrates,
        fat=fat,
        fibre=rng.randint(1, 14),
        salt=rng.randint(1, 28) / 10,
        keeps=rng.randint(1, 6),
        freezes=rng.choice((0, 1, 2, 3, 4, 6)),
        temperature=temperature,
        reviews=_reviews(rng),
    )


def make_cooks(seed: int, style: str) -> tuple[Cook, ...]:
    """Five to seven cooks."""
    rng = stream(seed, "cooks")
    count = rng.randint(5, 7)
    years = rng.sample(range(2009, 2026), count)
    found = []
    for name, town, year in zip(names.people(rng, count), names.towns(rng, count), years, strict=True):
        bio = rng.choice(
            (
                f"Grew up above a bakery in {town} and has written about {style.lower()} food ever since.",
                f"Ran a lunch counter in {town} before swapping it for a test kitchen.",
                f"Learned to cook from two grandmothers in {town} who agreed on nothing.",
                f"Teaches evening classes in {town} and tests every recipe on the students.",
            )
        )
        found.append(Cook(slug(name), name, town, year, rng.choice(_ROLES), bio))
    return tuple(found)


def make_collections(
    seed: int, recipes: tuple[Recipe, ...], cooks: tuple[Cook, ...]
) -> tuple[Collection, ...]:
    """Four to six collections of five or six recipes."""
    rng = stream(seed, "collections")
    return tuple(
        Collection(
            slug(title), title, intro, rng.choice(cooks).name, tuple(rng.sample(recipes, rng.randint(5, 6)))
        )
        for title, intro in rng.sample(WORDS.collections, rng.randint(4, 6))
    )


# --- the kitchen guide -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Chart:
    """A table to look things up in. Every row is (name, values…)."""

    slug: str
    title: str
    intro: str
    subject: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class HowTo:
    """A skill, explained in steps.

    Attributes:
        key: alternatives, one of which every summary of the steps must contain.
    """

    slug: str
    title: str
    steps: tuple[str, ...]
    key: tuple[str, ...]


def make_charts(seed: int) -> tuple[Chart, ...]:
    """Cup weights, roasting times and storage times, a little different on every website."""
    rng = stream(seed, "charts")
    cups = {
        "Plain flour": 125, "Caster sugar": 200, "Brown sugar": 215, "Rolled oats": 90, "Butter": 227,
        "Honey": 340, "Ground almonds": 96, "Long-grain rice": 185, "Cocoa powder": 100, "Icing sugar": 120,
        "Dried lentils": 192, "Grated cheese": 113,
    }  # fmt: skip
    weights = [(name, grams + rng.randint(-4, 4)) for name, grams in rng.sample(sorted(cups.items()), 9)]
    cores = {
        "Whole chicken": 74, "Rack of lamb": 60, "Beef joint": 57, "Pork loin": 68, "Salmon side": 52,
        "Turkey crown": 72, "Duck legs": 78, "Nut roast": 70,
    }  # fmt: skip
    roasts = [
        (
            name,
            f"{rng.choice((160, 170, 180, 190, 200, 220))} °C",
            f"{rng.randint(25, 110)} min",
            f"{core} °C",
        )
        for name, core in rng.sample(sorted(cores.items()), 7)
    ]
    kept = (
        "Cooked rice",
        "Vegetable stock",
        "Fresh pesto",
        "Bean stew",
        "Raw dough",
        "Baked cake",
        "Cooked pasta",
    )
    storage = [(name, f"{rng.randint(1, 9)} days", f"{rng.randint(1, 12)} months") for name in kept]
    return (
        Chart(
            "cups-to-grams",
            "Cups to grams",
            "One level cup, not packed, unless the recipe says otherwise.",
            "weighs per cup",
            ("Ingredient", "One cup", "Half a cup"),
            tuple((name, f"{grams} g", f"{grams / 2:g} g") for name, grams in weights),
        ),
        Chart(
            "roasting-times",
            "Roasting times",
            "Times are per kilogram. Use a thermometer in the thickest part.",
            "is roasted",
            ("Joint", "Oven", "Time per kilogram", "Core temperature"),
            tuple(roasts),
        ),
        Chart(
            "how-long-it-keeps",
            "How long it keeps",
            "In closed containers, cooled before they go in.",
            "keeps",
            ("Food", "In the fridge", "In the freezer"),
            tuple(storage),
        ),
    )


def make_howtos(seed: int) -> tuple[HowTo, ...]:
    """Four skills out of seven."""
    rng = stream(seed, "howtos")
    pan, rest, egg = rng.choice((220, 230, 240, 250)), rng.randint(12, 40), rng.randint(3, 5)
    soak, salt = rng.choice((8, 10, 12, 16)), rng.choice((5, 10, 15, 20))
    known = [
        HowTo("", "How to season a cast-iron pan", (
            "Wash the pan with hot water and dry it over a low flame.",
            "Rub a thin film of oil all over, inside and out, and wipe off what you can.",
            f"Bake it upside down at {pan} °C for one hour.",
            "Let it cool in the oven and repeat twice.",
        ), (f"{pan} °C", f"{pan}°C", f"{pan} degrees", f"{pan} C")),
        HowTo("", "How to poach an egg", (
            "Bring a wide pan of water to a bare tremble, with a spoonful of vinegar.",
            "Crack the egg into a cup and slide it in close to the surface.",
            f"Leave it alone for {egg} minutes.",
            "Lift out with a slotted spoon and drain on a cloth.",
        ), (f"{egg} minutes", f"{egg} min")),
        HowTo("", "How to rest roast meat", (
            "Lift the meat onto a warm board.",
            "Cover it loosely with foil, never tightly.",
            f"Wait {rest} minutes before you carve.",
            "Pour what has run out into the gravy.",
        ), (f"{rest} minutes", f"{rest} min")),
        HowTo("", "How to soak dried beans", (
            "Pick out stones and broken beans.",
            f"Cover with three times as much cold water and leave for {soak} hours.",
            "Drain, rinse, and cook in fresh water.",
        ), (f"{soak} hours", f"{soak} h")),
        HowTo("", "How to salt pasta water", (
            "Use a litre of water for every hundred grams of pasta.",
            f"Add {salt} g of salt per litre once it boils.",
            "Taste it: it should remind you of the sea.",
        ), (f"{salt} g", f"{salt} grams", f"{salt}g")),
        HowTo("", "How to keep herbs fresh", (
            "Trim the stems as you would those of flowers.",
            f"Wrap them in a damp {(cloth := rng.choice(('tea towel', 'paper towel', 'muslin cloth')))}.",
            "Store in a box in the bottom drawer of the fridge.",
        ), (cloth,)),
        HowTo("", "How to sharpen a knife", (
            "Soak the stone until it stops bubbling.",
            f"Hold the blade at {(angle := rng.choice((12, 15, 17, 20)))} degrees to the stone.",
            "Draw it across from heel to tip, ten strokes a side.",
            "Finish on the fine side and wipe clean.",
        ), (f"{angle} degrees", f"{angle}°")),
    ]  # fmt: skip
    return tuple(HowTo(slug(one.title), one.title, one.steps, one.key) for one in rng.sample(known, 4))
