"""Questions about single recipes of the cooking websites."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, See
from webgym.offline.families._asking import count, exactly, minutes, quantity, shown
from webgym.offline.families._listed import at, unfold
from webgym.offline.families.recipes import deeds
from webgym.offline.families.recipes.catalog import SERVINGS, Recipe, amount
from webgym.offline.families.recipes.words import Ingredient
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.recipes import Recipes


def weighed(recipe: Recipe, servings: int) -> list[Ingredient]:
    """Ingredients in grams or millilitres, of at least 10."""
    return [i for i in recipe.ingredients if i.unit in ("g", "ml") and i.each * servings >= 10]


def grams(value: int) -> tuple[str, ...]:
    """Ways to say a weight."""
    return quantity(str(value), "g", "grams")


def _units(text: str) -> tuple[str, ...]:
    return ("grams",) if text.endswith(" g") else ("millilitres", "milliliters")


class OneRecipe:
    """Things to look up on a recipe's page."""

    def __init__(self, site: Recipes) -> None:
        self.site = site
        self.rng = stream(site.seed, "parts")

    def calories(self, recipe: Recipe) -> Part:
        site = self.site
        text = f"{recipe.energy} kcal"
        return Part(
            f"find out how many calories one serving of {recipe.title} has",
            f"Nutrition of {recipe.title}",
            (
                Fact(
                    f"The energy of one serving of {recipe.title} is found",
                    (
                        shown(at(site, recipe), text),
                        shown(exactly(site.finder.path), recipe.title, text),
                    ),
                    answer=quantity(str(recipe.energy), "kcal", "calories", "kilocalories"),
                ),
            ),
            (*deeds.go(site, recipe), *unfold(site, "nutrition"), See((text,))),
            f"One serving has {text}.",
        )

    def times(self, recipe: Recipe | None) -> Part | None:
        if recipe is None:
            return None
        here = at(self.site, recipe)
        prep, cooking = f"{recipe.prep} min prep", f"{recipe.cooking} min cooking"
        title = recipe.title
        return Part(
            f"open the recipe for {title} and give its preparation time, its cooking time and "
            "how difficult it is",
            f"Times and difficulty of {title}",
            (
                Fact(
                    f"The preparation time of {title} is found",
                    (shown(here, prep),),
                    answer=minutes(recipe.prep),
                ),
                Fact(
                    f"The cooking time of {title} is found",
                    (shown(here, cooking),),
                    answer=minutes(recipe.cooking),
                ),
                Fact(
                    f"The difficulty of {title} is found",
                    (shown(here, prep, recipe.level),),
                    answer=(recipe.level,),
                ),
            ),
            (*deeds.go(self.site, recipe), See((prep, cooking, recipe.level))),
            f"Preparation {recipe.prep} min, cooking {recipe.cooking} min, difficulty {recipe.level}.",
        )

    def amounts(self, recipes: Iterable[Recipe], how_many: int) -> Part | None:
        """Amounts of ``how_many`` ingredients for another number of servings."""
        for recipe in recipes:
            servings = self.rng.choice([n for n in SERVINGS if n > 1 and n != recipe.serves])
            found = weighed(recipe, servings)
            if len(found) >= how_many:
                return self._amounts(recipe, servings, found[:how_many])
        return None

    def _amounts(self, recipe: Recipe, servings: int, found: Sequence[Ingredient]) -> Part:
        here = rf"{re.escape(self.site.href(recipe))}\?(?:.*&)?servings={servings}(?:&|$)"
        lines = [amount(ingredient, servings) for ingredient in found]
        names = [ingredient.name for ingredient in found]
        listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
        said = [line.removesuffix(f" {name}") for line, name in zip(lines, names, strict=True)]
        wrong = amount(found[0], recipe.serves).removesuffix(f" {names[0]}")
        return Part(
            f"find out how much of each of these it takes to make {recipe.title} for {servings} servings: "
            f"{listed}"
            if len(names) > 1
            else f"find out how much {listed} it takes to make {recipe.title} for {servings} servings",
            f"Amounts for {servings} servings of {recipe.title}",
            tuple(
                Fact(
                    f"The amount of {name} for {servings} servings of {recipe.title} is found",
                    (shown(here, line),),
                    answer=(line, *quantity(*text.split(" "), *_units(text))),
                    wrong=(wrong,) if len(names) == 1 else (),
                )
                for name, line, text in zip(names, lines, said, strict=True)
            ),
            (
                *deeds.go(self.site, recipe),
                Choose("Servings", f"{servings} servings"),
                See(tuple(lines)),
            ),
            f"For {servings} servings: {', '.join(lines)}.",
        )

    def storage(self, recipe: Recipe | None) -> Part | None:
        if recipe is None:
            return None
        here = at(self.site, recipe)
        days = f"{recipe.keeps} {'day' if recipe.keeps == 1 else 'days'}"
        months = f"{recipe.freezes} {'month' if recipe.freezes == 1 else 'months'}"
        fridge, freezer = f"Keeps for {days} in the fridge", f"up to {months}"
        return Part(
            f"find out how long leftovers of {recipe.title} keep in the fridge and how long in the freezer",
            f"Storage of {recipe.title}",
            (
                Fact(
                    f"How long {recipe.title} keeps in the fridge is found",
                    (shown(here, fridge),),
                    answer=(days,),
                ),
                Fact(
                    f"How long {recipe.title} can be frozen is found",
                    (shown(here, freezer),),
                    answer=(months,),
                ),
            ),
            (*deeds.go(self.site, recipe), *unfold(self.site, "storage"), See((fridge, freezer))),
            f"It keeps for {days} in the fridge and {months} in the freezer.",
        )

    def oven(self, recipe: Recipe | None) -> Part | None:
        if recipe is None:
            return None
        value = str(recipe.temperature)
        text = f"Oven: {value} °C"
        return Part(
            f"find out how hot the oven must be for {recipe.title}",
            f"Oven temperature for {recipe.title}",
            (
                Fact(
                    f"The oven temperature for {recipe.title} is found",
                    (shown(at(self.site, recipe), text),),
                    answer=quantity(value, "°C", "degrees", "C"),
                ),
            ),
            (*deeds.go(self.site, recipe), *unfold(self.site, "method"), See((text,))),
            f"The oven must be at {value} °C.",
        )

    def critic(self, recipes: Sequence[Recipe]) -> Part | None:
        """Who liked it least; only where exactly one reviewer did."""
        for recipe in recipes:
            by_stars = sorted(recipe.reviews, key=lambda review: review.stars)
            if by_stars[0].stars < by_stars[1].stars:
                low = by_stars[0]
                text = f"gave it {low.stars} stars"
                here = at(self.site, recipe)
                return Part(
                    f"find out who left the review with the fewest stars for {recipe.title}, "
                    "and how many stars it has",
                    f"The lowest review of {recipe.title}",
                    (
                        Fact(
                            f"Who reviewed {recipe.title} with the fewest stars is found",
                            (shown(here, low.name, text),),
                            answer=(low.name,),
                            wrong=tuple(review.name for review in by_stars[1:3]),
                        ),
                        Fact(
                            f"The number of stars of the lowest review of {recipe.title} is found",
                            (shown(here, low.name, text),),
                            answer=count(low.stars),
                        ),
                    ),
                    (
                        *deeds.go(self.site, recipe),
                        *unfold(self.site, "reviews"),
                        See((low.name, text)),
                    ),
                    f"{low.name} gave it {low.stars} stars.",
                )
        return None

    def fans(self, recipes: Sequence[Recipe]) -> Part | None:
        """How many reviewers gave all stars."""
        for recipe in recipes[::-1]:
            fans = [review.name for review in recipe.reviews if review.stars == 5]
            if len(fans) < 2:
                continue
            texts = (*fans, "gave it 5 stars")
            return Part(
                f"count how many of the reviews shown for {recipe.title} give it five stars",
                f"Reviews of {recipe.title}",
                (
                    Fact(
                        f"The number of five-star reviews of {recipe.title} is found",
                        (shown(at(self.site, recipe), *texts),),
                        answer=count(len(fans)),
                    ),
                ),
                (*deeds.go(self.site, recipe), *unfold(self.site, "reviews"), See(texts)),
                f"{len(fans)} reviews give it five stars.",
            )
        return None

    def author(self, recipe: Recipe) -> Part:
        site = self.site
        cook = next(one for one in site.cooks if one.name == recipe.cook_name)
        path = site.path("/~cooks/{slug}", slug=cook.slug)
        here, year = exactly(path), str(cook.since)
        return Part(
            f"find out who wrote the recipe for {recipe.title}, where that person lives and since what year "
            "they have written for the website",
            f"The cook behind {recipe.title}",
            (
                Fact(
                    f"The author of the recipe for {recipe.title} is found",
                    (shown(at(site, recipe), cook.name), shown(here, cook.name, recipe.title)),
                    answer=(cook.name,),
                    wrong=tuple(one.name for one in site.cooks if one != cook)[:2],
                ),
                Fact(
                    "Where the author lives is found",
                    (shown(here, "Lives in", cook.town),),
                    answer=(cook.town,),
                ),
                Fact(
                    "The year the author began to write for the website is found",
                    (shown(here, "Writes here since", year),),
                    answer=(year,),
                ),
            ),
            (
                *deeds.go(site, recipe),
                See((cook.name,)),
                Click(path=path),
                See(("Lives in", cook.town, "Writes here since", year)),
            ),
            f"{cook.name} wrote it, lives in {cook.town} and has written here since {year}.",
        )

    def compare(self, recipes: Sequence[Recipe]) -> Part | None:
        """Protein of two recipes, and the difference."""
        pairs = zip(recipes[::2], recipes[1::2], strict=False)
        for more, less in pairs:
            gap = more.protein - less.protein
            if gap < 4 or gap in (more.protein, less.protein):
                continue
            site = self.site
            first, second = f"{more.protein} g protein", f"{less.protein} g protein"
            seen = (shown(at(site, more), first), shown(at(site, less), second))
            return Part(
                f"compare the protein in one serving of {more.title} and of {less.title}: give both amounts "
                "and the difference",
                f"Protein of {more.title} and {less.title}",
                (
                    Fact(f"The protein in {more.title} is found", seen[:1], answer=grams(more.protein)),
                    Fact(f"The protein in {less.title} is found", seen[1:], answer=grams(less.protein)),
                    Fact("The difference in protein is worked out", seen, answer=grams(gap)),
                ),
                (
                    *deeds.go(site, more),
                    *unfold(site, "nutrition"),
                    See((first,)),
                    *deeds.go(site, less),
                    *unfold(site, "nutrition"),
                    See((second,)),
                ),
                f"{more.title} has {more.protein} g and {less.title} has {less.protein} g, "
                f"a difference of {gap} g.",
            )
        return None
