"""What is asked for on the cooking websites."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from webgym.offline.families._asking import compose
from webgym.offline.families.recipes.catalog import Recipe
from webgym.offline.families.recipes.deeds import Deeds
from webgym.offline.families.recipes.lists import Lists
from webgym.offline.families.recipes.one import OneRecipe
from webgym.offline.parts import Assignment, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.recipes import Recipes


def assignments(site: Recipes) -> Iterator[Assignment]:
    """About 24 tasks before decomposition."""
    rng = stream(site.seed, "tasks")
    recipes = list(site.recipes)
    rng.shuffle(recipes)
    draw = iter(recipes)
    one, many, do = OneRecipe(site), Lists(site), Deeds(site)

    singles: dict[str, Part | None] = {
        "calories": one.calories(next(draw)),
        "amount": one.amounts(draw, 1),
        "leftovers": one.storage(_first(draw, lambda r: r.freezes > 0)),
        "oven": one.oven(next((r for r in recipes if r.temperature), None)),
        "critic": one.critic(recipes),
        "fans": one.fans(recipes),
        "quickest": many.extreme("time", 0),
        "lightest": many.extreme("energy", 1),
        "best": many.extreme("rating", 2),
        "slowest": many.slowest(),
        "count": many.count(0),
        "either": many.either(),
        "odd-one-out": many.odd_one_out(),
        "how-to": many.howto(0),
        "cups": many.cups(),
        "shop": do.shop_one(next(draw)),
        "review": do.review(next(draw), 0),
        "letter": do.letter(0),
        **({"join": do.join_and_save(next(draw))} if site.members else {"plan": do.plan(next(draw), 0)}),
    }
    for name, part in singles.items():
        yield from compose(name, [part])
    last = do.plan(next(draw), 1) if not site.members else many.howto(1)
    composed: dict[str, list[Part | None]] = {
        "times-and-amounts": [one.times(_cooked(draw)), one.amounts(draw, 3)],
        "cook-and-count": [one.author(next(draw)), many.count(1)],
        "find-and-shop": [many.extreme("energy", 3, deeper=True), do.shop_two(recipes)],
        "compare-review-plan": [one.compare(recipes), do.review(next(draw), 1), last],
        "collection-and-letter": [many.collection(), do.letter(1)],
        "roast-amounts-leftovers": [
            many.roast(),
            one.amounts(iter(recipes[::-1]), 3),
            one.storage(_first(draw, lambda r: r.freezes > 1)),
        ],
    }
    for name, parts in composed.items():
        yield from compose(name, parts)


def _first(recipes: Iterable[Recipe], wanted: Callable[[Recipe], bool]) -> Recipe | None:
    return next((recipe for recipe in recipes if wanted(recipe)), None)


def _cooked(recipes: Iterable[Recipe]) -> Recipe | None:
    return _first(recipes, lambda r: r.cooking > 0 and r.cooking != r.prep)
