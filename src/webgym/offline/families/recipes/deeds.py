"""Ways through the cooking websites, and the tasks that leave something on their servers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Fill, Move, See, StateCheck
from webgym.offline.families._asking import exactly, quantity, shown
from webgym.offline.families._listed import unfold
from webgym.offline.families.recipes.catalog import SERVINGS, Recipe, amount
from webgym.offline.names import person
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.recipes import Recipes

COMMENTS = (
    "Crisp edges and a soft middle",
    "We had seconds and then thirds",
    "Needs a squeeze more lemon",
    "Quick enough for a school night",
    "My new favourite for guests",
)


def go(site: Recipes, recipe: Recipe) -> tuple[Move, ...]:
    """To a recipe, from anywhere."""
    return Fill(site.says["search"], recipe.title), Click(path=site.href(recipe))


class Deeds:
    """Things to do."""

    def __init__(self, site: Recipes) -> None:
        self.site = site
        self.rng = stream(site.seed, "deeds")

    def _someone(self) -> tuple[str, str]:
        name = person(self.rng)
        given, family = name.lower().split(" ")
        return name, f"{given}.{family}@{self.rng.choice(('mailbox', 'postal', 'letters'))}.example"

    def _put(self, recipe: Recipe, servings: int) -> tuple[Move, ...]:
        choose = (Choose("Servings", f"{servings} servings"),) if servings != recipe.serves else ()
        return (*go(self.site, recipe), *choose, Click(name=self.site.says["add"], role="button"))

    def _on_list(self, recipe: Recipe, servings: int) -> Fact:
        here = exactly(self.site.path("/~list"))
        return Fact(
            f"{recipe.title} for {servings} servings is on the shopping list",
            (shown(here, recipe.title, f"for {servings} servings"),),
            (StateCheck(("list", recipe.title), servings),),
        )

    def shop_one(self, recipe: Recipe) -> Part:
        """A recipe on the shopping list."""
        servings = self.rng.choice([n for n in SERVINGS if n > 1 and n != recipe.serves])
        fact = self._on_list(recipe, servings)
        return Part(
            f"put the ingredients of {recipe.title} for {servings} servings on the shopping list",
            "Shopping list",
            (fact,),
            (*self._put(recipe, servings), See(fact.evidence[0].texts)),
        )

    def shop_two(self, recipes: Sequence[Recipe]) -> Part | None:
        """Two recipes that share an ingredient, and how much of it is needed."""
        for first in recipes:
            for second in recipes:
                shared = [i for i in first.ingredients if i in second.ingredients and i.unit in ("g", "ml")]
                if first is not second and shared:
                    return self._shop_two(first, second, shared[0].name)
        return None

    def _shop_two(self, first: Recipe, second: Recipe, shared: str) -> Part:
        ingredient = next(i for i in first.ingredients if i.name == shared)
        one, two = self.rng.sample((4, 6, 8, 10), 2)
        line = amount(ingredient, one + two)
        number, unit = line.removesuffix(f" {shared}").split(" ")
        here = exactly(self.site.path("/~list"))
        unit_word = "grams" if unit == "g" else "millilitres"
        return Part(
            f"put {first.title} for {one} servings and {second.title} for {two} servings on the shopping "
            f"list, and say how much {shared} the list then asks for",
            "Shopping list",
            (
                self._on_list(first, one),
                self._on_list(second, two),
                Fact(
                    f"The amount of {shared} on the shopping list is found",
                    (shown(here, line),),
                    answer=(line, *quantity(number, unit, unit_word)),
                ),
            ),
            (
                *self._put(first, one),
                See((first.title, f"for {one} servings")),
                *self._put(second, two),
                See((second.title, f"for {two} servings")),
                See((line,)),
            ),
            f"The list asks for {line}.",
        )

    def plan(self, recipe: Recipe, turn: int) -> Part:
        """A recipe on a day of the planner."""
        rng = stream(self.site.seed, "plan", turn)
        day = rng.choice(("Tuesday", "Wednesday", "Thursday", "Friday", "Saturday"))
        meal = rng.choice(("Lunch", "Dinner"))
        when = f"{day} {meal.lower()}"
        text = f"is planned for {when}"
        opening = (Click(name=self.site.says["put"], role="button"),) if self.site.dialog else ()
        return Part(
            f"plan {recipe.title} for {meal.lower()} on {day} in the meal planner",
            "Meal planner",
            (
                Fact(
                    f"{recipe.title} is planned for {meal.lower()} on {day}",
                    (
                        shown(exactly(self.site.path("/~plan")), recipe.title, text),
                        shown(exactly(self.site.path("/~plan")), recipe.title, day),
                    ),
                    (StateCheck(("plan", when), recipe.title),),
                ),
            ),
            (
                *go(self.site, recipe),
                *opening,
                Choose("Day", day),
                Choose("Meal", meal),
                Click(name="Add to plan", role="button"),
                See((recipe.title, text)),
            ),
        )

    def review(self, recipe: Recipe, turn: int) -> Part:
        """A review with stars, name and comment."""
        rng = stream(self.site.seed, "review", turn)
        stars, comment, name = rng.choice((3, 4, 5)), rng.choice(COMMENTS), person(rng)
        here = exactly(self.site.path("/~one/{key}/thanks", key=recipe.slug))
        key = ("reviews", recipe.title)
        return Part(
            f"write a review of {recipe.title} with {stars} stars under the name {name} that says "
            f'"{comment}"',
            f"Review of {recipe.title}",
            (
                Fact(
                    f"A review of {recipe.title} with {stars} stars is posted",
                    (shown(here, recipe.title, f"{stars} stars"),),
                    (StateCheck((*key, "stars"), stars),),
                ),
                Fact(
                    f"The review is written under the name {name}",
                    (shown(here, f"Thank you, {name}"),),
                    (StateCheck((*key, "name"), name),),
                ),
                Fact(
                    f'The review says "{comment}"',
                    (shown(here, f"with {stars} stars", comment),),
                    (StateCheck((*key, "text"), comment),),
                ),
            ),
            (
                *go(self.site, recipe),
                *unfold(self.site, "reviews"),
                Click(path=f"{self.site.href(recipe)}/review"),
                Choose("Your rating", f"{stars} stars"),
                Fill("Your name", name),
                Fill("Your comment", comment),
                Click(name="Post review", role="button"),
                See((recipe.title, f"{stars} stars", f"Thank you, {name}", comment)),
            ),
        )

    def letter(self, turn: int) -> Part:
        """A subscription to the newsletter."""
        rng = stream(self.site.seed, "letter", turn)
        often = rng.choice(("Every day", "Once a week", "Once a month"))
        diet = rng.choice(("Vegan", "Vegetarian", "Gluten-free"))
        name, email = self._someone()
        path = self.site.path("/~letter/welcome")
        here = exactly(path)
        return Part(
            f"subscribe {name} with the address {email} to the newsletter, to come {often.lower()} with "
            f"{diet.lower()} recipes only",
            "Newsletter",
            (
                Fact(
                    f"The newsletter is subscribed to for {name} at {email}",
                    (shown(here, f"You are on the list, {name}", email),),
                    (StateCheck(("letter", "email"), email), StateCheck(("letter", "name"), name)),
                ),
                Fact(
                    f"It is to come {often.lower()}",
                    (shown(here, often),),
                    (StateCheck(("letter", "often"), often),),
                ),
                Fact(
                    f"It is to bring {diet.lower()} recipes",
                    (shown(here, diet),),
                    (StateCheck(("letter", "diet"), diet),),
                ),
            ),
            (
                Click(path=self.site.path("/~letter")),
                Choose("How often", often),
                Choose("Recipes to send", diet),
                Fill("Name", name),
                Fill("E-mail", email),
                Click(name="Sign me up", role="button"),
                See((f"You are on the list, {name}", email, often, diet)),
            ),
        )

    def join_and_save(self, recipe: Recipe) -> Part:
        """A new account, and a recipe in its favourites."""
        site, (name, email) = self.site, self._someone()
        return Part(
            f"open an account for {name} with the address {email} and the cooking level moderate, and "
            f"then save the recipe for {recipe.title}",
            "Account and favourites",
            (
                Fact(
                    f"An account is open for {name} at {email}",
                    (shown(exactly(site.path("/~join/welcome")), f"Welcome, {name}", email),),
                    (StateCheck(("account", "name"), name), StateCheck(("account", "email"), email)),
                ),
                Fact(
                    "The account has the level moderate",
                    (shown(exactly(site.path("/~join/welcome")), "Moderate"),),
                    (StateCheck(("account", "level"), "Moderate"),),
                ),
                Fact(
                    f"{recipe.title} is saved",
                    (shown(exactly(site.path("/~saved")), site.says["saved"], recipe.title),),
                    (StateCheck(("saved", recipe.title), True),),
                ),
            ),
            (
                Click(path=site.path("/~join")),
                Choose("How well do you cook?", "Moderate"),
                Fill("Name", name),
                Fill("E-mail", email),
                Click(name="Open my account", role="button"),
                See((f"Welcome, {name}", email, "Moderate")),
                *go(site, recipe),
                Click(name=site.says["save"], role="button"),
                See((recipe.title,)),
            ),
        )
