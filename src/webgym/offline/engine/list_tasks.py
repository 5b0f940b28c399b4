"""Tasks on the lists of a specified website: count items, and find the first in an order.

Every function takes the website, a random generator and a number of facts, and returns a part with that many
facts, or ``None`` if the draw gives no well-posed part.
"""

from __future__ import annotations

import random

from webgym.core.truth import Click, See
from webgym.offline.engine.navigation import Site, field_fact, row_view, view_fields
from webgym.offline.engine.spelling import count as counted
from webgym.offline.parts import Fact, Part, shown


def _having(site: Site, chosen: dict[str, str]) -> str:
    facets = {facet.name: facet for facet in site.finder.facets}
    return " and ".join(
        site.items.fields[field].having.format(value=facets[field].text(value))
        for field, value in chosen.items()
    )


def _filters(site: Site, rng: random.Random, at_most: int) -> dict[str, str]:
    facets = rng.sample(site.finder.facets, min(rng.randint(1, at_most), len(site.finder.facets)))
    facets.sort(key=site.finder.facets.index)
    return {facet.name: rng.choice(facet.options)[0] for facet in facets}


def count(site: Site, rng: random.Random, size: int) -> Part | None:
    """Count the items that match filters."""
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
                answer=counted(total, plural),
                what=f"the number of {plural}",
            ),
        ),
        (Click(path=site.finder.path), *site.finder.moves(**chosen), See((text,))),
    )


def extreme(site: Site, rng: random.Random, size: int) -> Part | None:
    """Find the item with the highest or lowest value of a field among those that match filters, and its
    fields."""
    if size > 3:
        return None
    field = rng.choice([field for field in site.items.labels if any(site.items.fields[field].orders)])
    spec, is_most, chosen = site.items.fields[field], rng.random() < 0.5, _filters(site, rng, 2)
    query = {**chosen, "sort": f"{field}-{'down' if is_most else 'up'}"}
    records = site.find(**query)
    if len(records) < 3 or records[0].rank(field) == records[1].rank(field):
        return None
    best, word, having = records[0], spec.most if is_most else spec.least, _having(site, chosen)
    view = (best.name, best.fields[field].text)
    ordered = shown(site.finder.regex(**query), *view)
    rows = dict.fromkeys(text for record in records for text in row_view(site, record, field))
    unordered = shown(site.finder.regex(**chosen), *rows)
    named = Fact(
        f"Among the {site.spec.plural} that {having}, the one with the {word} {spec.noun} is found",
        (ordered, unordered) if len(records) <= site.page_size else (ordered,),
        answer=(best.name,),
        what=f"the name of the {site.spec.singular} with the {word} {spec.noun}",
        wrong=tuple(record.name for record in records[1:]),
    )
    others = [other for other in site.items.labels if other not in query and other != field]
    if size > len(others) + 1:
        return None
    more = rng.sample(others, size - 1)
    more.sort(key=list(site.items.labels).index)
    request = f", and give the name and {site.items.nouns(more)}" if more else ""
    return Part(
        f"find the {site.spec.singular} with the {word} {spec.noun} among those that {having}{request}",
        f"{word} {spec.noun} among those that {having}",
        (named, *(field_fact(site, best, other, about=f"that {site.spec.singular}") for other in more)),
        (
            Click(path=site.finder.path),
            *site.finder.moves(**query),
            See(view),
            *((Click(path=site.href(best)), *view_fields(site, best, more)) if more else ()),
        ),
    )
