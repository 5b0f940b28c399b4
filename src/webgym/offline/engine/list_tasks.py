"""What is asked about the lists of a specified website: how many there are, and the first in an order.

Every function makes a part with so many facts, or none if the draw does not give a well-posed one.
"""

from __future__ import annotations

import random

from webgym.core.truth import Click, See
from webgym.offline.engine.navigation import Site, fact, look
from webgym.offline.engine.spelling import count as counted
from webgym.offline.parts import Fact, Part, shown


def _having(site: Site, chosen: dict[str, str]) -> str:
    facets = {facet.name: facet for facet in site.finder.facets}
    return " and ".join(
        site.items.fields[of].having.format(value=facets[of].text(value)) for of, value in chosen.items()
    )


def _filters(site: Site, rng: random.Random, most: int) -> dict[str, str]:
    facets = rng.sample(site.finder.facets, min(rng.randint(1, most), len(site.finder.facets)))
    facets.sort(key=site.finder.facets.index)
    return {facet.name: rng.choice(facet.options)[0] for facet in facets}


def count(site: Site, rng: random.Random, size: int) -> Part | None:
    """How many items there are of a kind."""
    chosen = _filters(site, rng, 2)
    total = len(site.find(**chosen))
    if size != 1 or total < 2:
        return None
    plural = site.spec.plural
    text, having = f"{total} {plural}", _having(site, chosen)
    return Part(
        f"find out how many {plural} {having}",
        f"Number of {plural} that {having}",
        (
            Fact(
                f"The number of {plural} that {having} is found",
                (shown(site.finder.regex(**chosen), text),),
                answer=counted(total),
            ),
        ),
        (Click(path=site.finder.path), *site.finder.moves(**chosen), See((text,))),
        f"There are {total}.",
    )


def extreme(site: Site, rng: random.Random, size: int) -> Part | None:
    """The first in an order among the items of a kind, and more about it."""
    if size > 3:
        return None
    of = rng.choice([of for of in site.items.labels if any(site.items.fields[of].orders)])
    spec, is_most, chosen = site.items.fields[of], rng.random() < 0.5, _filters(site, rng, 2)
    asked = {**chosen, "sort": f"{of}-{'down' if is_most else 'up'}"}
    found = site.find(**asked)
    if len(found) < 3 or found[0].rank(of) == found[1].rank(of):
        return None
    best, word, having = found[0], spec.most if is_most else spec.least, _having(site, chosen)
    view = (best.name, best.fields[of].text)
    named = Fact(
        f"Among the {site.spec.plural} that {having}, the one with the {word} {spec.noun} is found",
        (shown(site.finder.regex(**asked), *view),),
        answer=(best.name,),
        wrong=tuple(record.name for record in found[1:4]),
    )
    others = [each for each in site.items.labels if each not in asked and each != of]
    if size > len(others) + 1:
        return None
    more = rng.sample(others, size - 1)
    more.sort(key=list(site.items.labels).index)
    also = f", and give the name and {site.items.nouns(more)}" if more else ""
    told = f": {site.items.told(best, more)}" if more else ""
    return Part(
        f"find the {site.spec.singular} with the {word} {spec.noun} among those that {having}{also}",
        f"{word} {spec.noun} among those that {having}",
        (named, *(fact(site, best, each, about=f"that {site.spec.singular}") for each in more)),
        (
            Click(path=site.finder.path),
            *site.finder.moves(**asked),
            See(view),
            *((Click(path=site.href(best)), *look(site, best, more)) if more else ()),
        ),
        f"It is {best.name}{told}.",
    )
