"""Word stock of the cooking websites: ingredients, kinds of dishes, and what cuisines make of them."""

from __future__ import annotations

from webgym.offline.data import Row, Table, load


class Ingredient(Row, frozen=True):
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
    flags: str = ""


class Form(Table, frozen=True):
    """A kind of dish, whatever it is made of.

    Attributes:
        course: where the website files it.
        mains: groups of main ingredients it goes with.
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


class Cuisine(Table, frozen=True):
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


class Words(Table, frozen=True):
    """``words.toml``.

    Attributes:
        ingredients: all there are.
        praise: what readers write.
        collections: titles with what stands below.
        sweet: flavours of sweet dishes: word in the title and its ingredient.
        mains: by group, word in the title and its ingredient.
        forms: by name.
        cuisines: by name.
    """

    ingredients: tuple[Ingredient, ...]
    praise: tuple[str, ...]
    collections: tuple[tuple[str, str], ...]
    sweet: dict[str, str]
    mains: dict[str, dict[str, str]]
    forms: dict[str, Form]
    cuisines: dict[str, Cuisine]


WORDS = load("webgym.offline.families.recipes", "words.toml", Words)
INGREDIENTS = {ingredient.name: ingredient for ingredient in WORDS.ingredients}
