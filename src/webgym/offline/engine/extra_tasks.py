"""What is asked about all that a specified website has beside its items.

Every function makes a part with so many facts, or none if the draw does not give a well-posed one.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

from webgym.core.truth import Choose, Click, Fill, Move, See, StateCheck
from webgym.offline.engine.extras import Pin
from webgym.offline.engine.navigation import Site, chart_moves, fact, go, look, unfold
from webgym.offline.engine.spelling import count as counted
from webgym.offline.engine.spelling import listed
from webgym.offline.engine.table import Record
from webgym.offline.parts import Fact, Part, exactly, shown


def member(site: Site, rng: random.Random, size: int) -> Part | None:
    """Some fields of a record of a group."""
    group = rng.choice(list(site.groups))
    spec, sheet = site.spec.groups[group], site.groups[group]
    if size > min(3, len(sheet.labels)):
        return None
    record, fields = rng.choice(sheet.records), sheet.some(rng, size)
    place = exactly(site.group_href(group, record))
    return Part(
        f"look up {sheet.nouns(fields)} of the {spec.singular} {record.name}",
        f"{record.name}: {sheet.nouns(fields)}",
        tuple(sheet.fact(record, of, place) for of in fields),
        (
            Click(path=site.directory(group)),
            Click(path=site.group_href(group, record)),
            *(See((sheet.labels[of], record.fields[of].text)) for of in fields),
        ),
        f"For {record.name}, {sheet.told(record, fields)}.",
    )


def owner(site: Site, rng: random.Random, size: int) -> Part | None:
    """What an item leads to, and some of its fields."""
    group = rng.choice([name for name, each in site.spec.groups.items() if each.noun])
    sheet, noun = site.groups[group], site.spec.groups[group].noun
    if size not in (2, 3) or size - 1 > len(sheet.labels):
        return None
    record, fields = rng.choice(site.items.records), sheet.some(rng, size - 1)
    found = site.owner(group, record)
    place = exactly(site.group_href(group, found))
    named = Fact(
        f"The {noun} of {record.name} is found",
        (shown(exactly(site.href(record)), site.owner_label(group), found.name),),
        answer=(found.name,),
        wrong=tuple(each.name for each in sheet.records if each != found)[:4],
    )
    return Part(
        f"find out the {noun} of {record.name}, and look up {sheet.nouns(fields)} of that {noun}",
        f"{noun} of {record.name}",
        (named, *(sheet.fact(found, of, place, about=f"that {noun}") for of in fields)),
        (
            *go(site, record),
            See((site.owner_label(group), found.name)),
            Click(path=site.group_href(group, found)),
            *(See((sheet.labels[of], found.fields[of].text)) for of in fields),
        ),
        f"It is {found.name}: {sheet.told(found, fields)}.",
    )


def _to_rows(site: Site, record: Record, kind: str, texts: Sequence[str]) -> tuple[Move, ...]:
    is_first = not site.sections() and kind == next(iter(site.spec.rows))
    return (*go(site, record), *unfold(site, site.rows_label(kind), is_first=is_first), See(tuple(texts)))


def line(site: Site, rng: random.Random, size: int) -> Part | None:
    """Fields of one of the lines that belong to an item."""
    kind, record = rng.choice(list(site.spec.rows)), rng.choice(site.items.records)
    spec, sheet = site.spec.rows[kind], site.rows(kind, record)
    if size > min(2, len(sheet.labels)):
        return None
    row, fields = rng.choice(sheet.records), sheet.some(rng, size)
    values = [row.fields[of].text for of in fields]
    return Part(
        spec.look_up.format(item=record.name, name=row.name, fields=sheet.nouns(fields)),
        f"{spec.plural} of {record.name}: {row.name}",
        tuple(sheet.fact(row, of, exactly(site.href(record)), row.name) for of in fields),
        _to_rows(site, record, kind, (row.name, *values)),
        f"For {row.name}, {sheet.told(row, fields)}.",
    )


def which(site: Site, rng: random.Random, size: int) -> Part | None:
    """Which line has the most or the least of something."""
    kind, record = rng.choice(list(site.spec.rows)), rng.choice(site.items.records)
    spec, sheet = site.spec.rows[kind], site.rows(kind, record)
    fields = [of for of, each in sheet.fields.items() if each.least]
    if size != 1 or not fields or not spec.which:
        return None
    of, is_most = rng.choice(fields), rng.random() < 0.5
    best, second = sorted(sheet.records, key=lambda each: each.rank(of), reverse=is_most)[:2]
    if best.rank(of) == second.rank(of):
        return None
    word = sheet.fields[of].most if is_most else sheet.fields[of].least
    order = f"with the {word} {sheet.fields[of].noun}"
    everyone = [row.name for row in sheet.records]
    return Part(
        spec.which.format(item=record.name, order=order),
        f"{spec.plural} of {record.name}: the one {order}",
        (
            Fact(
                f"Of the {spec.plural} of {record.name}, the one {order} is found",
                (shown(exactly(site.href(record)), *everyone),),
                answer=(best.name,),
                wrong=tuple(name for name in everyone if name != best.name),
            ),
        ),
        _to_rows(site, record, kind, everyone),
        f"It is {best.name}.",
    )


def tally(site: Site, rng: random.Random, size: int) -> Part | None:
    """How many of the lines say something."""
    kind, record = rng.choice(list(site.spec.rows)), rng.choice(site.items.records)
    spec, sheet = site.spec.rows[kind], site.rows(kind, record)
    fields = [of for of, each in sheet.fields.items() if each.having]
    if size != 1 or not fields or not spec.tally:
        return None
    of = rng.choice(fields)
    value = rng.choice(sheet.options[of])
    total = sum(row.fields[of].text == value for row in sheet.records)
    having, everyone = sheet.fields[of].having.format(value=value), [row.name for row in sheet.records]
    return Part(
        spec.tally.format(item=record.name, having=having),
        f"{spec.plural} of {record.name} that {having}",
        (
            Fact(
                f"The number of {spec.plural} of {record.name} that {having} is found",
                (shown(exactly(site.href(record)), *everyone),),
                answer=counted(total, *spec.plural.split()[-1:]),
            ),
        ),
        _to_rows(site, record, kind, everyone),
        f"It is {total}.",
    )


def put(site: Site, rng: random.Random, size: int) -> Part | None:
    """Some items in the cart, and what they cost together."""
    if size not in (2, 3):
        return None
    chosen = {record.name: (record, rng.randint(1, 4)) for record in rng.sample(site.items.records, size - 1)}
    held = StateCheck(("cart",), {name: count for name, (_, count) in chosen.items()})
    place, total = exactly(site.path("/~cart")), sum(site.price(record) * n for record, n in chosen.values())
    facts, moves = list[Fact](), list[Move]()
    for name, (record, n) in chosen.items():
        view = (name, f"{n} × {site.money(site.price(record))}")
        state = (StateCheck(("cart", name), n), *(() if facts else (held,)))
        facts.append(Fact(f"{n} of {name} are in the cart", (shown(place, *view),), state))
        moves += [*go(site, record), *((Choose(site.says["quantity"], str(n)),) if n > 1 else ())]
        moves += [Click(name=site.says["add"], role="button"), See(view)]
    view = (site.says["total"], site.money(total))
    answer = (site.money(total), f"{total:,}", str(total))
    facts.append(Fact("What the cart comes to is given", (shown(place, *view),), answer=answer))
    said = listed([f"{n} of {name}" for name, (_, n) in chosen.items()])
    return Part(
        f"put {said} in the cart, and say what it comes to then",
        f"Cart: {said}",
        tuple(facts),
        (*moves, See(view)),
        f"It comes to {site.money(total)}.",
    )


def account(site: Site, rng: random.Random, size: int) -> Part | None:
    """What a page behind the sign-in tells."""
    sheet = site.member
    if size not in (2, 3) or size - 1 > len(sheet.labels):
        return None
    fields, (record,) = sheet.some(rng, size - 1), sheet.records
    place = exactly(site.path("/~account"))
    return Part(
        f'sign in as "{site.user}" with the password "{site.password}", '
        f"and look up {sheet.nouns(fields)} of the account",
        f"Account: {sheet.nouns(fields)}",
        (
            Fact(
                f"The user {site.user} is signed in",
                (shown(place, site.account_label(), f"Hello, {site.user}"),),
                (StateCheck(("signed in",), site.user),),
            ),
            *(sheet.fact(record, of, place, about="the account") for of in fields),
        ),
        (
            Click(path=site.path("/~account")),
            Fill(site.says["user"], site.user),
            Fill(site.says["password"], site.password),
            Click(name=site.says["enter"], role="button"),
            *(See((sheet.labels[of], record.fields[of].text)) for of in fields),
        ),
        f"In the account, {sheet.told(record, fields)}.",
    )


def files(site: Site, rng: random.Random, size: int) -> Part | None:
    """Some files in another folder."""
    spec = site.spec.files
    if size > 3 or spec is None:
        return None
    folder = rng.choice(spec.folders)
    elsewhere = [name for name, kept in site.files.items() if kept != folder]
    if len(elsewhere) < size:
        return None
    chosen = rng.sample(elsewhere, size)
    place, held = exactly(site.path("/~files")), StateCheck(("files",), dict.fromkeys(chosen, folder))
    said = listed([f'"{name}"' for name in chosen])
    return Part(
        f'move the {"file" if size == 1 else "files"} {said} into the folder "{folder}"',
        f"Files: {said}",
        tuple(
            Fact(
                f'"{name}" is in the folder "{folder}"',
                (shown(place, name, folder),),
                (StateCheck(("files", name), folder), *(() if nth else (held,))),
            )
            for nth, name in enumerate(chosen)
        ),
        (
            Click(path=site.path("/~files")),
            *(Click(name=name, role="checkbox") for name in chosen),
            Choose(site.says["move_to"], folder),
            Click(name=site.says["move"], role="button"),
            *(See((name, folder)) for name in chosen),
        ),
    )


def bar(site: Site, rng: random.Random, size: int) -> Part | None:
    """What one bar of a chart tells, or which bar tells the most or the least."""
    chart = site.spec.chart
    if size != 1 or chart is None:
        return None
    record, noun = rng.choice(site.items.records), chart.field.noun
    values, place = site.chart(record), exactly(site.href(record))
    is_most = rng.choice((True, False, None))
    if is_most is None:
        month = rng.choice(list(values))
        what = f"The {noun} of {record.name} in {month} is read from the chart"
        ask = f"read the {noun} of {record.name} in {month} from the chart"
        wrong: tuple[str, ...] = ()
        answer, says = values[month].options, f"It is {values[month].text}."
    else:
        ranked = sorted(values, key=lambda each: values[each].rank or 0, reverse=is_most)
        month, word = ranked[0], chart.field.most if is_most else chart.field.least
        what = f"The month with the {word} {noun} of {record.name} is found in the chart"
        ask = (
            f"find the month with the {word} {noun} in the chart of {record.name}, click its bar, and name it"
        )
        answer, wrong, says = (month,), tuple(ranked[1:]), f"It is {month}."
    view = shown(place, f"{month}: {values[month].text}")
    return Part(
        ask,
        f"Chart of {record.name}: {noun}",
        (Fact(what, (view,), (), answer, wrong),),
        (*go(site, record), *chart_moves(site, record, month)),
        says,
    )


_SIDES = ("north", "south", "west", "east")
_CLEARLY = 6
"""Percent of the map by which a pin is farther than the next."""


def pin(site: Site, rng: random.Random, size: int) -> Part | None:
    """The item farthest to one side of the map, and more about it."""
    side = rng.choice(_SIDES)

    def far(each: Pin) -> int:
        place = each.top if side in ("north", "south") else each.left
        return place if side in ("south", "east") else -place

    best, second = sorted(site.pins, key=far, reverse=True)[:2]
    if size > 3 or far(best) - far(second) < _CLEARLY:
        return None
    record, place = best.record, exactly(site.path("/~map"))
    fields = site.items.some(rng, size - 1)
    also = f", and give the name and {site.items.nouns(fields)}" if fields else ", and give its name"
    told = f": {site.items.told(record, fields)}" if fields else ""
    singular = site.spec.singular
    found = Fact(
        f"The {singular} farthest {side} on the map is found",
        (shown(place, f"Here: {record.name}"),),
        answer=(record.name,),
        wrong=tuple(each.record.name for each in site.pins if each != best),
    )
    return Part(
        f"find the {singular} whose pin is farthest {side} on the map{also}",
        f"Map: farthest {side}",
        (found, *(fact(site, record, of, about=f"that {singular}") for of in fields)),
        (
            Click(path=site.path("/~map")),
            Click(name=f"Pin {site.pins.index(best) + 1}", role="button"),
            See((f"Here: {record.name}",)),
            *((Click(path=site.href(record)), *look(site, record, fields)) if fields else ()),
        ),
        f"It is {record.name}{told}.",
    )
