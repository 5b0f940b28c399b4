"""Questions about lists of recipes, collections and the kitchen guide of the cooking websites."""

from __future__ import annotations

from typing import TYPE_CHECKING

from webgym.core.truth import Click, Move, See
from webgym.offline.families._asking import exactly, minutes, pages_at_most, quantity, shown
from webgym.offline.families._listed import at, how_many, last_page
from webgym.offline.families.recipes.catalog import Chart, Recipe
from webgym.offline.families.recipes.one import grams
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.recipes import Recipes


def _degrees(text: str) -> tuple[str, ...]:
    return quantity(text.removesuffix(" °C"), "°C", "degrees", "C")


def _described(facet: str, text: str) -> str:
    return {
        "course": f"are filed under {text}",
        "diet": f"suit a {text.lower()} diet",
        "time": f"take at most {text.removeprefix('Up to ')}",
        "level": f"have the difficulty {text}",
    }[facet]


class Lists:
    """Things to find by filters, orders and menus."""

    def __init__(self, site: Recipes) -> None:
        self.site = site
        self.rng = stream(site.seed, "lists")

    def extreme(self, sort: str, turn: int, *, deeper: bool = False) -> Part | None:
        """The first in an order among the recipes of a course, or of a course and a diet."""
        site = self.site
        courses, diets = (facet.options for facet in site.finder.facets[:2])
        options = [(course, diet) for course in courses for diet in diets]
        stream(site.seed, "extreme", sort, turn).shuffle(options)
        for (course, course_text), (diet, diet_text) in options:
            chosen = {"course": course, "sort": sort} | ({"diet": diet} if turn % 2 else {})
            found = site.find(**chosen)
            values = {"time": [r.total for r in found], "energy": [r.energy for r in found]}
            if sort == "rating":
                values["rating"] = [round(r.rating * 10) for r in found]
            if len(found) < 4 or values[sort].count(values[sort][0]) > 1:
                continue
            kind = f"{course_text.lower()} that are {diet_text.lower()}" if turn % 2 else course_text.lower()
            return self._extreme(found, chosen, kind, deeper=deeper)
        return None

    def _extreme(self, found: list[Recipe], chosen: dict[str, str], kind: str, *, deeper: bool) -> Part:
        site, best = self.site, found[0]
        best_word, what, text, said = {
            "time": ("quickest one", "total time", f"{best.total} min", minutes(best.total)),
            "energy": (
                "one with the fewest calories per serving",
                "calories",
                f"{best.energy} kcal",
                quantity(str(best.energy), "kcal", "calories"),
            ),
            "rating": ("best rated one", "rating", f"{best.rating:.1f}", (f"{best.rating:.1f}",)),
        }[chosen["sort"]]
        lists = site.finder.regex(**{k: v for k, v in chosen.items() if k != "sort"})
        here = at(site, best)
        seen = (shown(lists, best.title, text), shown(here, best.title, text))
        value_seen = (shown(lists, best.title, text), shown(here, text))
        goal = f"look through the {kind} for the {best_word}"
        facts = [
            Fact(
                f"Among the {kind}, the {best_word} is found",
                seen,
                answer=(best.title,),
                wrong=tuple(recipe.title for recipe in found[1:4]),
            ),
            Fact(f"Its {what} is found", value_seen, answer=said),
        ]
        moves: list[Move] = [
            Click(path=site.finder.path),
            *site.finder.moves(**chosen),
            See((best.title, text)),
        ]
        says = f"It is {best.title}, with {text}."
        if deeper:
            prep = f"{best.prep} min prep"
            facts.append(
                Fact("Its preparation time is found", (shown(here, prep),), answer=minutes(best.prep))
            )
            moves += [Click(path=site.href(best)), See((prep,))]
            says += f" Its preparation takes {best.prep} min."
        asked = f"its name, its {what} and its preparation time" if deeper else f"its name and its {what}"
        return Part(
            f"{goal} and give {asked}", f"The {best_word} of the {kind}", tuple(facts), tuple(moves), says
        )

    def slowest(self) -> Part | None:
        """The last of an order, on the last page of a list of several."""
        site = self.site
        for course, text in site.finder.facets[0].options:
            found = site.find(course=course, sort="time")
            pages = -(-len(found) // site.page_size)
            if not 2 <= pages <= pages_at_most(site.look) or found[-1].total == found[-2].total:
                continue
            slow = found[-1]
            total = f"{slow.total} min"
            here = site.finder.regex(course=course)
            return Part(
                f"find out which of the {text.lower()} takes the longest in all, and how long",
                f"The slowest of the {text.lower()}",
                (
                    Fact(
                        f"Among the {text.lower()}, the one that takes the longest is found",
                        (shown(here, slow.title, total), shown(at(site, slow), slow.title, total)),
                        answer=(slow.title,),
                        wrong=tuple(recipe.title for recipe in found[-3:-1]),
                    ),
                    Fact(
                        "Its total time is found",
                        (shown(here, slow.title, total), shown(at(site, slow), total)),
                        answer=minutes(slow.total),
                    ),
                ),
                (
                    Click(path=site.finder.path),
                    *site.finder.moves(course=course, sort="time"),
                    *last_page(site, pages),
                    See((slow.title, total)),
                ),
                f"{slow.title} takes the longest: {total}.",
            )
        return None

    def count(self, turn: int) -> Part | None:
        """How many recipes two filters leave."""
        filters = [("course", "level"), ("diet", "time"), ("course", "diet")]
        return how_many(self.site, turn, filters, "recipes", self._kind, said="{} {}", most=30)

    def _kind(self, chosen: dict[str, str]) -> str:
        facets = [facet for facet in self.site.finder.facets if facet.name in chosen]
        return " and ".join(_described(facet.name, facet.text(chosen[facet.name])) for facet in facets)

    def either(self) -> Part | None:
        """Anything quick OR light will do."""
        site = self.site
        for course, text in site.finder.facets[0].options[::-1]:
            found = site.find(course=course)
            times, energies = sorted(r.total for r in found), sorted(r.energy for r in found)
            if len(found) < 5:
                continue
            quick, light = times[1], energies[1]
            good = [r for r in found if r.total <= quick or r.energy <= light]
            if not 2 <= len(good) <= 4 or len(good) == len(found):
                continue
            goal = f"takes at most {quick} minutes in all OR has at most {light} kcal per serving"
            lists = site.finder.regex(course=course)
            seen = [shown(lists, r.title, f"{r.total} min", f"{r.energy} kcal") for r in good]
            seen += [shown(at(site, r), r.title) for r in good]
            one = site.find(course=course, sort="time")[0]
            return Part(
                f"name one of the {text.lower()} that {goal}",
                f"{text} that are quick or light",
                (
                    Fact(
                        f"One of the {text.lower()} is found that {goal}",
                        tuple(seen),
                        answer=tuple(recipe.title for recipe in good),
                        wrong=tuple(recipe.title for recipe in found if recipe not in good)[:3],
                    ),
                ),
                (
                    Click(path=site.finder.path),
                    *site.finder.moves(course=course, sort="time"),
                    See((one.title, f"{one.total} min", f"{one.energy} kcal")),
                ),
                f"{one.title}.",
            )
        return None

    # --- collections and the guide ---------------------------------------------------------------

    def odd_one_out(self) -> Part | None:
        """The only recipe of a collection that does not suit a diet."""
        site = self.site
        for collection in site.collections:
            for diet in ("Vegetarian", "Gluten-free", "Dairy-free", "Nut-free"):
                odd = [recipe for recipe in collection.recipes if diet not in recipe.diets]
                if len(odd) != 1:
                    continue
                path = site.path("/~sets/{slug}", slug=collection.slug)
                return Part(
                    f"find out which recipe in the collection {collection.title} is not {diet.lower()}",
                    f"The collection {collection.title}",
                    (
                        Fact(
                            f"The recipe in {collection.title} that is not {diet.lower()} is found",
                            (shown(exactly(path), odd[0].title),),
                            answer=(odd[0].title,),
                            wrong=tuple(r.title for r in collection.recipes if r != odd[0])[:3],
                        ),
                    ),
                    (Click(path=site.path("/~sets")), Click(path=path), See((odd[0].title,))),
                    f"{odd[0].title} is the only one that is not {diet.lower()}.",
                )
        return None

    def collection(self) -> Part | None:
        """Curator, lightest recipe and time of all recipes of a collection."""
        site = self.site
        for one in site.collections[::-1]:
            ordered = sorted(one.recipes, key=lambda recipe: recipe.energy)
            light = ordered[0]
            if light.energy == ordered[1].energy:
                continue
            path = site.path("/~sets/{slug}", slug=one.slug)
            here, total = exactly(path), sum(recipe.total for recipe in one.recipes)
            kcal = f"{light.energy} kcal"
            rows = tuple(f"{recipe.total} min" for recipe in one.recipes)
            return Part(
                f"open the collection {one.title} and give who chose it, which of its recipes has the fewest "
                "calories and how many minutes all of its recipes take together",
                f"The collection {one.title}",
                (
                    Fact(
                        f"Who chose {one.title} is found", (shown(here, one.curator),), answer=(one.curator,)
                    ),
                    Fact(
                        f"The recipe in {one.title} with the fewest calories is found",
                        (shown(here, light.title, kcal),),
                        answer=(light.title,),
                        wrong=tuple(recipe.title for recipe in ordered[1:3]),
                    ),
                    Fact(
                        f"The time of all recipes in {one.title} is added up",
                        (shown(here, *dict.fromkeys(rows)),),
                        answer=minutes(total),
                    ),
                ),
                (
                    Click(path=site.path("/~sets")),
                    Click(path=path),
                    See((one.curator, light.title, kcal)),
                    See(tuple(dict.fromkeys(rows))),
                ),
                f"{one.curator} chose it; {light.title} has the fewest calories; "
                f"together they take {total} minutes.",
            )
        return None

    def howto(self, turn: int) -> Part:
        site = self.site
        howto = site.howtos[turn]
        path = site.path("/~guide/{slug}", slug=howto.slug)
        skill = howto.title.removeprefix("How to ")
        # The step with the key stands for the others, which are next to it.
        key_step = next(step for step in howto.steps if any(key in step for key in howto.key))
        return Part(
            f"look up in the website's guide how to {skill}, and explain it with the details it gives",
            f"How to {skill}",
            (
                Fact(
                    f"The instructions on how to {skill} are found",
                    (shown(exactly(path), key_step),),
                    answer=howto.key,
                ),
            ),
            (Click(path=site.path("/~guide")), Click(path=path), See((key_step,))),
            " ".join(howto.steps),
        )

    def _chart(self, slug: str) -> tuple[Chart, str]:
        chart = next(one for one in self.site.charts if one.slug == slug)
        return chart, self.site.path("/~guide/{slug}", slug=slug)

    def cups(self) -> Part:
        chart, path = self._chart("cups-to-grams")
        name, whole, _ = self.rng.choice(chart.rows)
        cups = self.rng.choice((3, 4, 5, 6))
        weight = int(whole.removesuffix(" g")) * cups
        return Part(
            f"work out from the website's table of cup weights how many grams {cups} cups of "
            f"{name.lower()} are",
            "Cups to grams",
            (
                Fact(
                    f"The weight of {cups} cups of {name.lower()} is worked out",
                    (shown(exactly(path), name, whole),),
                    answer=grams(weight),
                ),
            ),
            (Click(path=self.site.path("/~guide")), Click(path=path), See((name, whole))),
            f"{cups} cups are {weight} g.",
        )

    def roast(self) -> Part:
        chart, path = self._chart("roasting-times")
        name, oven, time, core = self.rng.choice(chart.rows)
        here = exactly(path)
        joint = name[0].lower() + name[1:]
        number = time.removesuffix(" min")
        return Part(
            f"look up in the website's roasting table the oven temperature, the time per kilogram and the "
            f"core temperature for {joint}",
            f"Roasting {joint}",
            (
                Fact(
                    f"The oven temperature for {joint} is found",
                    (shown(here, name, oven),),
                    answer=_degrees(oven),
                ),
                Fact(
                    f"The time per kilogram for {joint} is found",
                    (shown(here, name, time),),
                    answer=minutes(int(number)),
                ),
                Fact(
                    f"The core temperature for {joint} is found",
                    (shown(here, name, core),),
                    answer=_degrees(core),
                ),
            ),
            (Click(path=self.site.path("/~guide")), Click(path=path), See((name, oven, time, core))),
            f"{name}: oven {oven}, {time} per kilogram, core temperature {core}.",
        )
