"""Cooking websites: recipes of one cuisine or style, with a shopping list and a meal planner."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from webgym.offline.families._finder import STYLES, Facet, Finder
from webgym.offline.families._listed import Listed
from webgym.offline.families.recipes import tasks
from webgym.offline.families.recipes.catalog import (
    DIETS,
    LEVELS,
    SERVINGS,
    Chart,
    Collection,
    Cook,
    HowTo,
    Recipe,
    amount,
    make_charts,
    make_collections,
    make_cooks,
    make_howtos,
    make_recipes,
)
from webgym.offline.families.recipes.words import WORDS
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import pick, stream
from webgym.offline.website import Response, State, Visit, page, redirect, slug

DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")
MEALS = ("Breakfast", "Lunch", "Dinner")
FREQUENCIES = ("Every day", "Once a week", "Once a month")
_LETTER: dict[str, Any] = {
    "often_options": [("", "Choose…"), *((text, text) for text in FREQUENCIES)],
    "diet_options": [("", "All recipes"), *((text, text) for text, _ in DIETS.values())],
}

_SAYS: dict[str, tuple[str, ...]] = {
    "search": ("Search recipes", "Find a dish", "What would you like to cook?", "Search by name"),
    "all": ("Recipes", "All recipes", "Cook", "Browse recipes"),
    "collections": ("Collections", "Menus", "Inspiration", "Themes"),
    "guide": ("Kitchen guide", "How-to", "Techniques", "Cooking school"),
    "cooks": ("Our cooks", "People", "Who cooks here", "The team"),
    "list": ("Shopping list", "Groceries", "My list", "To buy"),
    "plan": ("Meal planner", "My week", "Week plan", "Menu of the week"),
    "saved": ("Saved", "Favourites", "Cookbook", "Bookmarks"),
    "add": (
        "Add to shopping list",
        "Put it on my list",
        "Add the ingredients to my list",
        "Shop this recipe",
    ),
    "save": ("Save recipe", "Add to favourites", "Keep in my cookbook", "Bookmark this"),
    "put": ("Plan this meal", "Add to my week", "Cook it on…", "Schedule"),
    "course": ("Course", "Type of dish", "Category"),
    "diet": ("Diet", "Suitable for", "Dietary needs"),
    "time": ("Time", "Ready in", "How long"),
    "level": ("Difficulty", "Skill", "Level"),
    "sort": ("Sort by", "Order", "Sort recipes by"),
    "apply": ("Show recipes", "Apply filters", "Filter", "Update results"),
    "rated": ("Best rated", "Top rated", "Rating"),
    "quick": ("Quickest first", "Shortest time", "Time, short to long"),
    "light": ("Fewest calories", "Lightest first", "Calories, low to high"),
    "ingredients": ("Ingredients", "What you need", "You will need"),
    "method": ("Method", "Directions", "Step by step", "Preparation"),
    "nutrition": ("Nutrition", "Nutrition facts", "Per serving", "Nutritional values"),
    "storage": ("Storage", "Keeping and freezing", "Leftovers", "Make ahead"),
    "reviews": ("Reviews", "Comments", "What others say", "Tried it"),
    "letter": ("Newsletter", "Recipes by e-mail", "Sign up for our letter"),
    "join": ("Create account", "Join free", "Register", "Become a member"),
}
"""What websites call things; each takes one phrase of every row."""


@dataclass
class Recipes(Listed):
    """A cooking website."""

    family: ClassVar[str] = "recipes"
    first_section: ClassVar[str] = "ingredients"
    words: ClassVar[dict[str, tuple[str, ...]]] = {
        "all": ("recipes", "dishes", "browse", "index"),
        "one": ("recipe", "r", "cook", "dish"),
        "sets": ("collections", "menus", "themes"),
        "guide": ("guide", "how-to", "school", "kitchen"),
        "cooks": ("cooks", "people", "authors", "team"),
        "list": ("shopping-list", "groceries", "list"),
        "plan": ("planner", "week", "meal-plan"),
        "saved": ("saved", "favourites", "cookbook"),
        "letter": ("newsletter", "letter", "subscribe"),
        "join": ("join", "register", "account"),
    }

    style: str = field(init=False)
    cooks: tuple[Cook, ...] = field(init=False)
    recipes: tuple[Recipe, ...] = field(init=False)
    collections: tuple[Collection, ...] = field(init=False)
    charts: tuple[Chart, ...] = field(init=False)
    howtos: tuple[HowTo, ...] = field(init=False)
    members: bool = field(init=False)
    """Whether the planner and the favourites ask for an account."""
    dialog: bool = field(init=False)
    """Whether a meal is planned in a dialog, or in a form that is always there."""

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """The second word fits the cuisine."""
        brand = f"{stem} {pick(WORDS.cuisines[cls.style_of(seed)].suffixes, seed, 'brand')}"
        return brand, slug(brand)

    @staticmethod
    def style_of(seed: int) -> str:
        """The cuisine of a website."""
        return pick(sorted(WORDS.cuisines), seed, "style")

    def build(self) -> None:
        """Fill the catalogue."""
        self.domain, self.subdomain = "Lifestyle & Leisure", "Food & Cooking"
        self.style = self.style_of(self.seed)
        self.tagline = pick(WORDS.cuisines[self.style].taglines, self.seed, "tagline")
        self.says = {name: pick(texts, self.seed, "says", name) for name, texts in _SAYS.items()}
        self.members = stream(self.seed, "members").random() < 0.4
        self.cooks = make_cooks(self.seed, self.style)
        self.recipes = make_recipes(self.seed, self.style, self.cooks)
        self.collections = make_collections(self.seed, self.recipes, self.cooks)
        self.charts, self.howtos = make_charts(self.seed), make_howtos(self.seed)
        self.finder = self._make_finder()
        self.page_size = pick((9, 12, 15), self.seed, "page size")
        self.dialog = pick((True, False), self.seed, "dialog")

    def _make_finder(self) -> Finder:
        say = self.says
        courses = tuple(sorted({recipe.course for recipe in self.recipes}))
        return Finder(
            path=self.path("/~all"),
            facets=(
                Facet("course", say["course"], tuple((slug(name), name) for name in courses), "All"),
                Facet("diet", say["diet"], tuple((value, text) for value, (text, _) in DIETS.items())),
                Facet("time", say["time"], tuple((str(n), f"Up to {n} minutes") for n in (20, 30, 45, 60))),
                Facet("level", say["level"], tuple((name.lower(), name) for name in LEVELS)),
            ),
            sort=Facet(
                "sort",
                say["sort"],
                (
                    ("newest", "Newest"),
                    ("rating", say["rated"]),
                    ("time", say["quick"]),
                    ("energy", say["light"]),
                    ("title", "A to Z"),
                ),
            ),
            style=pick(STYLES, self.seed, "finder"),
            apply=say["apply"],
        )

    def menu(self) -> list[tuple[str, str]]:
        """The main navigation."""
        names = {"all": "all", "collections": "sets", "guide": "guide", "cooks": "cooks"}
        return [(self.says[text], self.path(f"/~{word}")) for text, word in names.items()]

    def report(self, state: State) -> dict[str, Any]:
        """Lists and plans by title, forms by what was entered."""
        return {
            "list": {self.of(key).title: servings for key, servings in state.get("list", {}).items()},
            "plan": {when: self.of(key).title for when, key in state.get("plan", {}).items()},
            "saved": {self.of(key).title: True for key in state.get("saved", [])},
            "reviews": {self.of(key).title: review for key, review in state.get("reviews", {}).items()},
            "letter": state.get("letter"),
            "account": state.get("account"),
        }

    def assignments(self) -> Iterable[Assignment]:
        """See ``tasks.py``."""
        return tasks.assignments(self)

    # --- finding ---------------------------------------------------------------------------------

    def of(self, key: str) -> Recipe:
        """The recipe with this slug.

        Raises:
            KeyError: there is none.
        """
        return {recipe.slug: recipe for recipe in self.recipes}[key]

    def find(self, **asked: str) -> list[Recipe]:
        """The recipes that a list with these choices shows, in its order."""
        words = asked.get("q", "").casefold().split()
        found = [
            recipe
            for recipe in self.recipes
            if all(word in f"{recipe.title} {recipe.course} {recipe.cook_name}".casefold() for word in words)
            and asked.get("course") in (None, slug(recipe.course))
            and ("diet" not in asked or recipe.suits(asked["diet"]))
            and recipe.total <= int(asked.get("time", "999"))
            and asked.get("level") in (None, recipe.level.lower())
        ]
        orders: dict[str, Any] = {
            "rating": lambda recipe: (-recipe.rating, -recipe.votes),
            "time": lambda recipe: (recipe.total, recipe.title),
            "energy": lambda recipe: (recipe.energy, recipe.title),
            "title": lambda recipe: recipe.title,
        }
        newest = sorted(found, key=lambda recipe: recipe.published, reverse=True)
        return sorted(newest, key=orders[asked["sort"]]) if asked.get("sort") in orders else newest

    def href(self, recipe: Recipe) -> str:
        """The address of a recipe."""
        return self.path("/~one/{slug}", slug=recipe.slug)

    def shopping(self, chosen: dict[str, int]) -> dict[str, list[str]]:
        """What to buy for these servings of these recipes, by aisle."""
        needed: dict[str, float] = {}
        known = {}
        for key, servings in chosen.items():
            for ingredient in self.of(key).ingredients:
                needed[ingredient.name] = needed.get(ingredient.name, 0) + servings
                known[ingredient.name] = ingredient
        aisles: dict[str, list[str]] = {}
        for name in sorted(needed):
            aisles.setdefault(known[name].aisle, []).append(amount(known[name], needed[name]))
        return dict(sorted(aisles.items()))

    def _named(self, visit: Visit) -> Recipe | None:
        key = visit.form.get("recipe", "")
        return next((recipe for recipe in self.recipes if recipe.slug == key), None)

    # --- reading ---------------------------------------------------------------------------------

    @page("/")
    def front(self, visit: Visit) -> Response:
        """Newest recipes and ways in."""
        return self.render(
            "recipes/front.html", visit, newest=self.find()[:8], courses=self.finder.facets[0].options
        )

    @page("/~all")
    def listing(self, visit: Visit) -> Response:
        """The filtered list."""
        asked = self.finder.asked(visit)
        found = paged(self.find(**asked), visit, self.page_size)
        return self.render("recipes/listing.html", visit, asked=asked, found=found)

    @page("/~one/{key}")
    def recipe(self, visit: Visit, key: str) -> Response:
        """One recipe, for the servings that are asked for."""
        if key not in {recipe.slug for recipe in self.recipes}:
            return self.missing(visit)
        recipe = self.of(key)
        given = visit.query.get("servings", "")
        servings = int(given) if given.isdecimal() and len(given) < 4 else recipe.serves
        servings = servings if servings in SERVINGS else recipe.serves
        return self.render(
            "recipes/recipe.html",
            visit,
            recipe=recipe,
            servings=servings,
            options=[(str(n), f"{n} servings" if n > 1 else "1 serving") for n in SERVINGS],
            lines=[amount(ingredient, servings) for ingredient in recipe.ingredients],
            days=DAYS,
            meals=MEALS,
            own=visit.state.get("reviews", {}).get(recipe.slug),
            cook=next(cook for cook in self.cooks if cook.name == recipe.cook_name),
        )

    @page("/~sets")
    def collection_list(self, visit: Visit) -> Response:
        """All collections."""
        return self.render("recipes/collections.html", visit)

    @page("/~sets/{key}")
    def collection(self, visit: Visit, key: str) -> Response:
        """One collection, with a table of its recipes."""
        found = next((one for one in self.collections if one.slug == key), None)
        if found is None:
            return self.missing(visit)
        return self.render("recipes/collection.html", visit, collection=found)

    @page("/~guide")
    def guide(self, visit: Visit) -> Response:
        """Charts and skills."""
        return self.render("recipes/guides.html", visit)

    @page("/~guide/{key}")
    def guide_page(self, visit: Visit, key: str) -> Response:
        """One chart, or one skill."""
        chart = next((one for one in self.charts if one.slug == key), None)
        howto = next((one for one in self.howtos if one.slug == key), None)
        if chart is None and howto is None:
            return self.missing(visit)
        return self.render("recipes/guide.html", visit, chart=chart, howto=howto)

    @page("/~cooks")
    def cook_list(self, visit: Visit) -> Response:
        """Everyone who writes here."""
        return self.render("recipes/cooks.html", visit)

    @page("/~cooks/{key}")
    def cook(self, visit: Visit, key: str) -> Response:
        """One cook and all of their recipes."""
        found = next((one for one in self.cooks if one.slug == key), None)
        if found is None:
            return self.missing(visit)
        theirs = sorted((r for r in self.recipes if r.cook_name == found.name), key=lambda r: r.title)
        return self.render("recipes/cook.html", visit, cook=found, theirs=theirs)

    # --- lists and plans -------------------------------------------------------------------------

    @page("/~list")
    def shopping_list(self, visit: Visit) -> Response:
        """What to buy."""
        chosen: dict[str, int] = visit.state.get("list", {})
        return self.render(
            "recipes/list.html",
            visit,
            chosen=[(self.of(key), servings) for key, servings in chosen.items()],
            aisles=self.shopping(chosen),
        )

    @page("/~list", method="POST")
    def change_list(self, visit: Visit) -> Response:
        """Put a recipe on the list, or take it off."""
        recipe = self._named(visit)
        if recipe is None:
            return self.missing(visit)
        chosen = visit.state.setdefault("list", {})
        servings = visit.form.get("servings", "0")
        if servings.isdecimal() and int(servings) in SERVINGS:
            chosen[recipe.slug] = int(servings)
        else:
            chosen.pop(recipe.slug, None)
        return redirect(self.path("/~list"))

    @page("/~plan")
    def planner(self, visit: Visit) -> Response:
        """The week."""
        if self.members and "account" not in visit.state:
            return redirect(self.path("/~join"))
        plan = {when: self.of(key) for when, key in visit.state.get("plan", {}).items()}
        added = visit.query.get("added", "")
        return self.render(
            "recipes/plan.html",
            visit,
            plan=plan,
            days=DAYS,
            meals=MEALS,
            added=added if added in plan else None,
        )

    @page("/~plan", method="POST")
    def change_plan(self, visit: Visit) -> Response:
        """Put a recipe on a day, or clear a meal."""
        if self.members and "account" not in visit.state:
            return redirect(self.path("/~join"))
        day, meal = visit.form.get("day", ""), visit.form.get("meal", "")
        if day not in DAYS or meal not in MEALS:
            return self.missing(visit)
        plan, recipe = visit.state.setdefault("plan", {}), self._named(visit)
        if recipe is None:
            plan.pop(f"{day} {meal.lower()}", None)
            return redirect(self.path("/~plan"))
        plan[f"{day} {meal.lower()}"] = recipe.slug
        return redirect(f"{self.path('/~plan')}?added={day}+{meal.lower()}")

    @page("/~saved")
    def saved(self, visit: Visit) -> Response:
        """Favourites."""
        if self.members and "account" not in visit.state:
            return redirect(self.path("/~join"))
        found = [self.of(key) for key in visit.state.get("saved", [])]
        return self.render("recipes/saved.html", visit, found=found)

    @page("/~saved", method="POST")
    def change_saved(self, visit: Visit) -> Response:
        """Save a recipe, or forget it."""
        if self.members and "account" not in visit.state:
            return redirect(self.path("/~join"))
        recipe = self._named(visit)
        if recipe is None:
            return self.missing(visit)
        saved = visit.state.setdefault("saved", [])
        if visit.form.get("forget"):
            visit.state["saved"] = [key for key in saved if key != recipe.slug]
        elif recipe.slug not in saved:
            saved.append(recipe.slug)
        return redirect(self.path("/~saved"))

    # --- forms -----------------------------------------------------------------------------------

    @page("/~one/{key}/review")
    def review_form(self, visit: Visit, key: str) -> Response:
        """An empty review."""
        if key not in {recipe.slug for recipe in self.recipes}:
            return self.missing(visit)
        return self.render("recipes/review.html", visit, recipe=self.of(key), values={}, errors={})

    @page("/~one/{key}/review", method="POST")
    def review(self, visit: Visit, key: str) -> Response:
        """Take a review, or say what is wrong with it."""
        if key not in {recipe.slug for recipe in self.recipes}:
            return self.missing(visit)
        values = {name: visit.form.get(name, "").strip() for name in ("stars", "name", "text")}
        errors = {}
        if values["stars"] not in ("1", "2", "3", "4", "5"):
            errors["stars"] = "Please choose between one and five stars."
        if not values["name"]:
            errors["name"] = "Please tell us your name."
        if len(values["text"]) < 10:
            errors["text"] = "A few more words, please: at least 10 characters."
        if errors:
            return self.render(
                "recipes/review.html", visit, status=422, recipe=self.of(key), values=values, errors=errors
            )
        visit.state.setdefault("reviews", {})[key] = {**values, "stars": int(values["stars"])}
        return redirect(self.path("/~one/{key}/thanks", key=key))

    @page("/~one/{key}/thanks")
    def thanks(self, visit: Visit, key: str) -> Response:
        """What was posted."""
        review = visit.state.get("reviews", {}).get(key)
        if review is None:
            return self.missing(visit)
        return self.render("recipes/thanks.html", visit, recipe=self.of(key), review=review)

    @page("/~letter")
    def letter_form(self, visit: Visit) -> Response:
        """The newsletter."""
        return self.render("recipes/letter.html", visit, values={}, errors={}, **_LETTER)

    @page("/~letter", method="POST")
    def letter(self, visit: Visit) -> Response:
        """Take a subscription, or say what is wrong with it."""
        values = {name: visit.form.get(name, "").strip() for name in ("often", "diet", "name", "email")}
        errors = self._contact_errors(values)
        if values["often"] not in FREQUENCIES:
            errors["often"] = "Please choose how often."
        if errors:
            return self.render(
                "recipes/letter.html", visit, status=422, values=values, errors=errors, **_LETTER
            )
        visit.state["letter"] = values
        return redirect(self.path("/~letter/welcome"))

    @page("/~letter/welcome")
    def letter_done(self, visit: Visit) -> Response:
        """What was subscribed to."""
        if "letter" not in visit.state:
            return redirect(self.path("/~letter"))
        return self.render("recipes/welcome.html", visit, kind="letter", values=visit.state["letter"])

    @page("/~join")
    def join_form(self, visit: Visit) -> Response:
        """A new account."""
        return self.render("recipes/join.html", visit, values={}, errors={})

    @page("/~join", method="POST")
    def join(self, visit: Visit) -> Response:
        """Open an account, or say what is wrong."""
        values = {name: visit.form.get(name, "").strip() for name in ("level", "name", "email")}
        errors = self._contact_errors(values)
        if values["level"] not in LEVELS:
            errors["level"] = "Please choose one."
        if errors:
            return self.render("recipes/join.html", visit, status=422, values=values, errors=errors)
        visit.state["account"] = values
        return redirect(self.path("/~join/welcome"))

    @page("/~join/welcome")
    def join_done(self, visit: Visit) -> Response:
        """Whose account it is."""
        if "account" not in visit.state:
            return redirect(self.path("/~join"))
        return self.render("recipes/welcome.html", visit, kind="account", values=visit.state["account"])

    @staticmethod
    def _contact_errors(values: dict[str, str]) -> dict[str, str]:
        errors = {}
        if len(values["name"]) < 2:
            errors["name"] = "Please enter your name."
        if not re.fullmatch(r"[^@\s]+@[^@\s]+\.[a-z]{2,}", values["email"]):
            errors["email"] = "That does not look like an e-mail address."
        return errors
