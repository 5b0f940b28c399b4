"""Synthetic task sets with the statistics of the paper's, for benchmarks."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Final

import msgspec

from webgym.core.task import LEVELS, FactGroup, Level, Rubric, Task
from webgym.tasks.taxonomy import DOMAIN_OF


class Shape(msgspec.Struct, frozen=True, kw_only=True):
    """The size of a set.

    Attributes:
        tasks: number of tasks of all sources; none is derived.
        websites: number of registrable domains.
        seed: of everything that is random.
    """

    tasks: int = 300_000
    websites: int = 128_000
    seed: int = 0


_SOURCES: Final = {  # paper Table 1: tasks, and websites of their own
    "insta-v3": (146_441, 0),
    "pae-webvoyager": (128_499, 13),
    "agentsynth-web": (2_086, 328),
    "browsecomp": (1_266, 7),
    "travelplanner": (1_225, 1),
    "mind2web-live": (542, 76),
    "online-mind2web": (300, 139),
    "deepshop": (150, 1),
    "mind2web-2": (130, 44),
    "gaia-web": (87, 1),
}
_LEVELS: Final = ((0.80, (1, 3)), (0.15, (4, 6)), (0.05, (7, 10)))
"""Share of the tasks, and their range of facts: about 80 % are easy (paper §3)."""
_GROUPS: Final = (1,) * 30 + (2,) * 18 + (3, 4)
"""Numbers of facts of a group. Few are large, as about one task in twenty of the paper's set is derived."""
_STEPS: Final[dict[Level, float]] = {"easy": 7.8, "medium": 9.9, "hard": 11.9}
"""Mean number of steps of a trajectory (paper §3)."""
_SUFFIXES: Final = ("com",) * 12 + ("org", "net", "co.uk", "de", "io", "com.au", "edu", "fr", "info", "co.jp")
_FORMS: Final = ("https://www.{}/", "https://{}/", "http://{}", "{}", "https://shop.{}/en/", "www.{}")

_VERBS: Final = "Find|Search for|Look up|Locate|Show me|Compare|List|Identify|Check|Browse".split("|")
_THINGS: Final = (
    "vegetarian lasagna recipe|wireless headphones|nonstop flight|two-bedroom flat|graduate course|"
    "used bicycle|museum ticket|research article|waterproof jacket|jazz concert|hiking trail|"
    "tax form|office chair|puppy food|football fixture|science podcast|travel adapter|"
    "savings account|garden hose|mystery novel|board game|cooking class|yoga mat|camping stove|"
    "history lecture|film review|electric kettle|running shoe|job opening|language exchange|"
    "vaccination centre|vintage camera|city map|weather report|hair dryer|desk lamp"
).split("|")
_WORDS: Final = (
    "amber brisk cedar dapper early fresh gentle humble ivory jolly keen lively mellow nimble olive "
    "plain quiet rustic silver tidy urban vivid warm young zesty bright calm deep even fair grand "
    "high idle just kind light major noble open prime quick rare solid tall upper vast wide compact "
    "durable modern classic foldable"
).split()
_PLACES: Final = (
    "Lisbon Oslo Denver Kyoto Nairobi Quito Perth Zagreb Tampa Leeds Lyon Turin Hanoi Lima Accra Porto Boise "
    "Malmö Gdańsk Utrecht Sapporo Mendoza Adelaide Tucson Halifax Bergen Cusco Galway Aarhus Toledo"
).split()
_WISHES: Final = (
    "with at least {n} reviews|priced under {n} dollars|available in {place}|released after {year}|"
    "within {n} miles of {place}|rated {star} stars or higher|that comes in {word} {word}|"
    "suitable for {n} people|and give the name of its {word} maker|"
    "and say how long it takes from {place} to {place}|sorted by the lowest price|"
    "that was added in the last {n} days|and note its {word} features|"
    "offered by a {word} seller in {place}|and tell me the opening hours|with a {word} finish"
).split("|")


def make_tasks(shape: Shape) -> Iterator[Task]:
    """Generate tasks, source by source; equal shapes give equal tasks."""
    rng = random.Random(f"task set/{shape.seed}")
    paper = sum(tasks for tasks, _ in _SOURCES.values())
    counts = {source: max(1, round(shape.tasks * tasks / paper)) for source, (tasks, _) in _SOURCES.items()}
    counts["insta-v3"] += shape.tasks - sum(counts.values())
    own = {source: min(websites, counts[source]) for source, (_, websites) in _SOURCES.items()}
    own["insta-v3"] = max(1, min(shape.websites - sum(own.values()), counts["insta-v3"]))
    subdomains = list(DOMAIN_OF)
    rng.shuffle(subdomains)
    for source, count in counts.items():
        sites = [_domain(rng, f"{source[:2]}{number}") for number in range(own[source])]
        for number in range(count):
            subdomain = subdomains[min(int(rng.expovariate(2.5) * 24), 23)]
            yield Task(
                id=f"{source}/{number}",
                instruction=_instruction(rng),
                website=_FORMS[number % len(_FORMS)].format(_site(rng, sites, number)),
                domain=DOMAIN_OF[subdomain],
                subdomain=subdomain,
                rubric=_rubric(rng),
                source=source,
                website_from="derived" if source == "mind2web-live" else "given",
            )


def make_lengths(trajectories: int = 5_000, seed: int = 0) -> dict[Level, list[int]]:
    """Numbers of steps of trajectories, with about the paper's means and long tails."""
    rng = random.Random(f"lengths/{seed}")
    return {
        level: [
            1 + round(rng.gammavariate(1.7, (_STEPS[level] - 1) / 1.7))
            for _ in range(int(trajectories * share))
        ]
        for level, (share, _) in zip(LEVELS, _LEVELS, strict=True)
    }


def _domain(rng: random.Random, mark: str) -> str:
    return f"{rng.choice(_WORDS)}-{rng.choice(_WORDS)}-{mark}.{rng.choice(_SUFFIXES)}"


def _site(rng: random.Random, sites: list[str], number: int) -> str:
    """A website: each once, then the first ones more often than the last ones."""
    if number < len(sites):
        return sites[number]
    return sites[int(len(sites) * rng.random() ** 1.1)]


def _instruction(rng: random.Random) -> str:
    wishes = " ".join(rng.sample(_WISHES, rng.randint(1, 4)))
    while "{" in wishes:
        before, _, rest = wishes.partition("{")
        slot, _, after = rest.partition("}")
        wishes = before + _filled(rng, slot) + after
    adjective = f"{rng.choice(_WORDS)} {rng.choice(_WORDS)}"
    return f"{rng.choice(_VERBS)} a {adjective} {rng.choice(_THINGS)} {wishes}."


def _filled(rng: random.Random, slot: str) -> str:
    match slot:
        case "n":
            return str(rng.randint(2, 500))
        case "place":
            return rng.choice(_PLACES)
        case "year":
            return str(rng.randint(2005, 2025))
        case "star":
            return f"{rng.randint(30, 49) / 10}"
        case _:
            return rng.choice(_WORDS)


def _rubric(rng: random.Random) -> Rubric:
    drawn, facts = rng.random(), 1
    for share, (least, most) in _LEVELS:
        if drawn < share:
            facts = rng.randint(least, most)
            break
        drawn -= share
    groups: list[FactGroup] = []
    while facts:
        size = min(facts, rng.choice(_GROUPS))
        group = len(groups) + 1
        texts = tuple(_fact(rng) for _ in range(size))
        groups.append(
            FactGroup(group, f"What is {rng.choice(_WORDS)} about the {rng.choice(_THINGS)}", texts)
        )
        facts -= size
    return Rubric(tuple(groups))


def _fact(rng: random.Random) -> str:
    price = rng.randint(1, 999)
    return f"The {rng.choice(_WORDS)} {rng.choice(_THINGS)} is {rng.choice(_WORDS)} and costs {price} dollars"
