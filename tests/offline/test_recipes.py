"""The cooking websites: what their forms refuse, what they keep, and how amounts scale."""

from __future__ import annotations

from typing import Any

import pytest

from webgym.offline.families.recipes import Recipes
from webgym.offline.families.recipes.catalog import amount
from webgym.offline.families.recipes.words import INGREDIENTS
from webgym.offline.look import look
from webgym.offline.seeds import number
from webgym.offline.website import Response, State, Visit


def make(index: int) -> Recipes:
    seed = number("recipes", index)
    brand, label = Recipes.christen("Fernhill", seed)
    return Recipes(seed=seed, brand=brand, label=label, look=look(seed))


@pytest.fixture
def site() -> Recipes:
    return next(site for site in map(make, range(20)) if not site.members)


def post(site: Recipes, path: str, state: State, **form: str) -> Response:
    return site.handle(Visit("POST", path, {}, {}, form, state))


def get(site: Recipes, path: str, state: State | None = None, query: dict[str, str] | None = None) -> str:
    return site.handle(
        Visit("GET", path, query or {}, {}, {}, state if state is not None else {})
    ).body.decode()


def test_a_review_without_stars_is_refused_and_keeps_what_was_written(site: Recipes) -> None:
    state: State = {}
    recipe = site.recipes[0]
    answer = post(
        site, f"{site.href(recipe)}/review", state, stars="", name="Ada Novak", text="Very good indeed"
    )
    assert answer.status == 422
    assert 'value="Ada Novak"' in answer.body.decode()
    assert 'value="Very good indeed"' in answer.body.decode()
    assert site.report(state)["reviews"] == {}


def test_a_short_review_is_refused(site: Recipes) -> None:
    answer = post(site, f"{site.href(site.recipes[0])}/review", {}, stars="4", name="Ada", text="Nice")
    assert answer.status == 422
    assert "at least 10 characters" in answer.body.decode()


@pytest.mark.parametrize("email", ["", "ada", "ada@", "@letters.example", "a b@letters.example"])
def test_the_newsletter_refuses_what_is_no_address(site: Recipes, email: str) -> None:
    state: State = {}
    path = site.path("/~letter")
    answer = post(site, path, state, often="Once a week", diet="Vegan", name="Ada Novak", email=email)
    assert answer.status == 422
    assert '<option value="Once a week" selected>' in answer.body.decode()
    assert site.report(state)["letter"] is None


def test_the_shopping_list_adds_up_and_forgets(site: Recipes) -> None:
    state: State = {}
    path, (first, second) = site.path("/~list"), _sharing(site)
    shared = next(i for i in first.ingredients if i in second.ingredients and i.unit == "g")
    post(site, path, state, recipe=first.slug, servings="4")
    post(site, path, state, recipe=second.slug, servings="6")
    assert site.report(state)["list"] == {first.title: 4, second.title: 6}
    assert amount(shared, 10) in get(site, path, state)
    post(site, path, state, recipe=first.slug)
    assert site.report(state)["list"] == {second.title: 6}


def _sharing(site: Recipes) -> Any:
    for first in site.recipes:
        for second in site.recipes:
            if first is not second and any(
                i in second.ingredients and i.unit == "g" for i in first.ingredients
            ):
                return first, second
    raise AssertionError("no two recipes share an ingredient")


def test_a_meal_is_planned_and_cleared(site: Recipes) -> None:
    state: State = {}
    path, recipe = site.path("/~plan"), site.recipes[0]
    answer = post(site, path, state, recipe=recipe.slug, day="Friday", meal="Dinner")
    assert answer.location is not None
    assert site.report(state)["plan"] == {"Friday dinner": recipe.title}
    assert post(site, path, state, recipe=recipe.slug, day="Someday", meal="Dinner").status == 404
    post(site, path, state, day="Friday", meal="Dinner")
    assert site.report(state)["plan"] == {}


def test_members_only_pages_lead_to_the_account_form() -> None:
    site = next(site for site in map(make, range(20)) if site.members)
    state: State = {}
    saved, join = site.path("/~saved"), site.path("/~join")
    recipe = site.recipes[0]
    assert post(site, saved, state, recipe=recipe.slug).location == join
    post(site, join, state, level="Easy", name="Ada Novak", email="ada@letters.example")
    assert post(site, saved, state, recipe=recipe.slug).location == saved
    assert site.report(state)["saved"] == {recipe.title: True}


def test_filters_and_orders_hold(site: Recipes) -> None:
    for diet in ("vegan", "gluten-free"):
        found = site.find(diet=diet, sort="time")
        assert all(recipe.suits(diet) for recipe in found)
        assert [r.total for r in found] == sorted(r.total for r in found)
    assert len(site.find(time="30")) + len([r for r in site.recipes if r.total > 30]) == len(site.recipes)


@pytest.mark.parametrize(
    "query", [{"page": "99"}, {"page": "-1"}, {"page": "x"}, {"sort": "?"}, {"course": "no"}]
)
def test_odd_queries_still_give_a_page(site: Recipes, query: dict[str, str]) -> None:
    assert "recipes" in get(site, site.path("/~all"), query=query)


@pytest.mark.parametrize("servings", ["0", "5", "-2", "99999999999", "four"])
def test_odd_servings_give_the_recipe_as_it_is(site: Recipes, servings: str) -> None:
    recipe = site.recipes[0]
    assert amount(recipe.ingredients[0], recipe.serves) in get(
        site, site.href(recipe), query={"servings": servings}
    )


def test_amounts_are_written_as_cooks_do() -> None:
    assert amount(INGREDIENTS["lemons"], 4) == "1 lemon"
    assert amount(INGREDIENTS["lemons"], 6) == "1½ lemons"
    assert amount(INGREDIENTS["lemons"], 2) == "½ lemon"
    assert amount(INGREDIENTS["ground cinnamon"], 3) == "¾ tsp ground cinnamon"
    assert amount(INGREDIENTS["chicken thighs"], 4) == "600 g chicken thighs"
    assert amount(INGREDIENTS["capers"], 1) == "5 g capers"
