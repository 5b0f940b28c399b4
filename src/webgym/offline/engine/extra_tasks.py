"""Tasks on what only some specified websites have: groups, rows, a cart, an account, files, a chart, a map.

Every function takes the website, a random generator and a number of facts, and returns a part with that many
facts, or ``None`` if the draw gives no well-posed part.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

from webgym.core.truth import Choose, Click, Fill, Move, See, StateCheck
from webgym.offline.engine.extras import Pin
from webgym.offline.engine.navigation import Site, field_fact, go_to_item, read_bar, unfold, view_fields
from webgym.offline.engine.records import Sheet
from webgym.offline.engine.spec import RowsSpec
from webgym.offline.engine.spelling import count as counted
from webgym.offline.engine.spelling import listed, money
from webgym.offline.engine.table import Record
from webgym.offline.parts import Fact, Part, exactly, shown

_Rows = tuple[str, Record, RowsSpec, Sheet]
"""Rows of an item: their kind, the item, their specification, and the rows themselves."""


def _see_fields(sheet: Sheet, record: Record, fields: Sequence[str]) -> tuple[See, ...]:
    return tuple(See((sheet.labels[field], record.fields[field].text)) for field in fields)


# --- groups ----------------------------------------------------------------------------------------------


def group_record(site: Site, rng: random.Random, size: int) -> Part | None:
    """Look up fields of a record of a group."""
    group = rng.choice(list(site.groups))
    spec, sheet = site.spec.groups[group], site.groups[group]
    if size > min(3, len(sheet.labels)):
        return None
    record, fields = rng.choice(sheet.records), sheet.draw_fields(rng, size)
    address = site.group_href(group, record)
    return Part(
        f"look up {sheet.nouns(fields)} of the {spec.singular} {record.name}",
        f"{record.name}: {sheet.nouns(fields)}",
        tuple(sheet.fact(record, field, exactly(address)) for field in fields),
        (Click(path=site.directory(group)), Click(path=address), *_see_fields(sheet, record, fields)),
    )


def related_record(site: Site, rng: random.Random, size: int) -> Part | None:
    """Find the record of a group that an item links to, and look up fields of it."""
    group = rng.choice([name for name, spec in site.spec.groups.items() if spec.noun])
    sheet, noun = site.groups[group], site.spec.groups[group].noun
    if size not in (2, 3) or size - 1 > len(sheet.labels):
        return None
    record, fields = rng.choice(site.items.records), sheet.draw_fields(rng, size - 1)
    related = site.related(group, record)
    address = site.group_href(group, related)
    view = (site.relation_label(group), related.name)
    named = Fact(
        f"The {noun} of {record.name} is found",
        (shown(exactly(site.href(record)), *view),),
        answer=(related.name,),
        what=f"the {noun} of {record.name}",
        wrong=tuple(other.name for other in sheet.records if other != related),
    )
    return Part(
        f"find out the {noun} of {record.name}, and look up {sheet.nouns(fields)} of that {noun}",
        f"{noun} of {record.name}",
        (named, *(sheet.fact(related, field, exactly(address), about=f"that {noun}") for field in fields)),
        (*go_to_item(site, record), See(view), Click(path=address), *_see_fields(sheet, related, fields)),
    )


# --- rows ------------------------------------------------------------------------------------------------


def _draw_rows(site: Site, rng: random.Random) -> _Rows:
    kind, item = rng.choice(list(site.spec.rows)), rng.choice(site.items.records)
    return kind, item, site.spec.rows[kind], site.rows(kind, item)


def _go_to_rows(site: Site, item: Record, kind: str, texts: Sequence[str]) -> tuple[Move, ...]:
    is_first = not site.sections() and kind == next(iter(site.spec.rows))
    return (
        *go_to_item(site, item),
        *unfold(site, site.rows_label(kind), is_first=is_first),
        See(tuple(texts)),
    )


def row(site: Site, rng: random.Random, size: int) -> Part | None:
    """Look up fields of one row of an item."""
    kind, item, spec, sheet = _draw_rows(site, rng)
    if size > min(2, len(sheet.labels)):
        return None
    record, fields = rng.choice(sheet.records), sheet.draw_fields(rng, size)
    values = [record.fields[field].text for field in fields]
    return Part(
        spec.look_up.format(item=item.name, name=record.name, fields=sheet.nouns(fields)),
        f"{spec.plural} of {item.name}: {record.name}",
        tuple(sheet.fact(record, field, exactly(site.href(item)), record.name) for field in fields),
        _go_to_rows(site, item, kind, (record.name, *values)),
    )


def _over_all_rows(
    site: Site,
    rows: _Rows,
    ask: str,
    description: str,
    text: str,
    answer: Sequence[str],
    what: str,
    wrong: Sequence[str] = (),
) -> Part:
    """A part of one fact that requires seeing all rows of an item; ``answer`` lists its spellings."""
    kind, item, _, sheet = rows
    names = [record.name for record in sheet.records]
    evidence = shown(exactly(site.href(item)), *names)
    return Part(
        ask,
        description,
        (Fact(text, (evidence,), answer=tuple(answer), what=what, wrong=tuple(wrong)),),
        _go_to_rows(site, item, kind, names),
    )


def extreme_row(site: Site, rng: random.Random, size: int) -> Part | None:
    """Find the row of an item with the highest or the lowest value of a field."""
    rows = _draw_rows(site, rng)
    _, item, spec, sheet = rows
    fields = [name for name, field in sheet.fields.items() if field.least]
    if size != 1 or not fields or not spec.which:
        return None
    field, is_most = rng.choice(fields), rng.random() < 0.5
    best, second = sorted(sheet.records, key=lambda record: record.rank(field), reverse=is_most)[:2]
    if best.rank(field) == second.rank(field):
        return None
    word = sheet.fields[field].most if is_most else sheet.fields[field].least
    order = f"with the {word} {sheet.fields[field].noun}"
    return _over_all_rows(
        site,
        rows,
        spec.which.format(item=item.name, order=order),
        f"{spec.plural} of {item.name}: the one {order}",
        f"Of the {spec.plural} of {item.name}, the one {order} is found",
        answer=(best.name,),
        what=f"the one {order}",
        wrong=[record.name for record in sheet.records if record.name != best.name],
    )


def count_rows(site: Site, rng: random.Random, size: int) -> Part | None:
    """Count the rows of an item with one value of a field."""
    rows = _draw_rows(site, rng)
    _, item, spec, sheet = rows
    fields = [name for name, field in sheet.fields.items() if field.having]
    if size != 1 or not fields or not spec.tally:
        return None
    field = rng.choice(fields)
    value = rng.choice(sheet.options[field])
    total = sum(record.fields[field].text == value for record in sheet.records)
    having = sheet.fields[field].having.format(value=value)
    return _over_all_rows(
        site,
        rows,
        spec.tally.format(item=item.name, having=having),
        f"{spec.plural} of {item.name} that {having}",
        f"The number of {spec.plural} of {item.name} that {having} is found",
        answer=counted(total, *spec.plural.split()[-1:]),
        what=f"the number of {spec.plural}",
    )


# --- cart, account, files ---------------------------------------------------------------------------------


def fill_cart(site: Site, rng: random.Random, size: int) -> Part | None:
    """Add items to the cart, and say the total."""
    if size not in (2, 3):
        return None
    chosen = {record.name: (record, rng.randint(1, 4)) for record in rng.sample(site.items.records, size - 1)}
    whole_cart = StateCheck(("cart",), {name: count for name, (_, count) in chosen.items()})
    place, total = exactly(site.path("/~cart")), sum(site.price(record) * n for record, n in chosen.values())
    facts, moves = list[Fact](), list[Move]()
    for name, (record, n) in chosen.items():
        view = (name, f"{n} × {site.money(site.price(record))}")
        state = (StateCheck(("cart", name), n), *(() if facts else (whole_cart,)))
        facts.append(Fact(f"{n} of {name} are in the cart", (shown(place, *view),), state))
        moves += [*go_to_item(site, record), *((Choose(site.says["quantity"], str(n)),) if n > 1 else ())]
        moves += [Click(name=site.says["add"], role="button"), See(view)]
    view = (site.says["total"], site.money(total))
    evidence = (shown(place, *view),)
    facts.append(
        Fact(
            "What the cart comes to is given",
            evidence,
            answer=money(total, site.currency),
            what="what the cart comes to",
        )
    )
    contents = listed([f"{n} of {name}" for name, (_, n) in chosen.items()])
    return Part(
        f"put {contents} in the cart, and say what it comes to then",
        f"Cart: {contents}",
        tuple(facts),
        (*moves, See(view)),
    )


def account(site: Site, rng: random.Random, size: int) -> Part | None:
    """Sign in, and look up fields of the account page."""
    sheet = site.account_sheet
    if size not in (2, 3) or size - 1 > len(sheet.labels):
        return None
    fields, (record,) = sheet.draw_fields(rng, size - 1), sheet.records
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
            *(sheet.fact(record, field, place, about="the account") for field in fields),
        ),
        (
            Click(path=site.path("/~account")),
            Fill(site.says["user"], site.user),
            Fill(site.says["password"], site.password),
            Click(name=site.says["enter"], role="button"),
            *_see_fields(sheet, record, fields),
        ),
    )


def move_files(site: Site, rng: random.Random, size: int) -> Part | None:
    """Move files into another folder."""
    spec = site.spec.files
    if size > 3 or spec is None:
        return None
    folder = rng.choice(spec.folders)
    elsewhere = [name for name, current in site.files.items() if current != folder]
    if len(elsewhere) < size:
        return None
    chosen = rng.sample(elsewhere, size)
    place, all_moved = exactly(site.path("/~files")), StateCheck(("files",), dict.fromkeys(chosen, folder))
    file_names = listed([f'"{name}"' for name in chosen])
    return Part(
        f'move the {"file" if size == 1 else "files"} {file_names} into the folder "{folder}"',
        f"Files: {file_names}",
        tuple(
            Fact(
                f'"{name}" is in the folder "{folder}"',
                (shown(place, name, folder),),
                (StateCheck(("files", name), folder), *(() if nth else (all_moved,))),
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


# --- chart and map ----------------------------------------------------------------------------------------


def chart_bar(site: Site, rng: random.Random, size: int) -> Part | None:
    """Read the value of one bar of an item's chart, or find the month with the highest or lowest bar."""
    chart = site.spec.chart
    if size != 1 or chart is None:
        return None
    record, noun = rng.choice(site.items.records), chart.field.noun
    values, place = site.chart(record), exactly(site.href(record))
    is_most = rng.choice((True, False, None))
    if is_most is None:
        month = rng.choice(list(values))
        text = f"The {noun} of {record.name} in {month} is read from the chart"
        ask = f"read the {noun} of {record.name} in {month} from the chart"
        wrong: tuple[str, ...] = ()
        answer, what = values[month].options, f"the {noun} in {month}"
    else:
        ranked = sorted(values, key=lambda name: values[name].rank or 0, reverse=is_most)
        month, word = ranked[0], chart.field.most if is_most else chart.field.least
        text = f"The month with the {word} {noun} of {record.name} is found in the chart"
        ask = (
            f"find the month with the {word} {noun} in the chart of {record.name}, click its bar, and name it"
        )
        answer, what, wrong = (month,), "the name of the month", tuple(ranked[1:])
    view = shown(place, f"{month}: {values[month].text}")
    return Part(
        ask,
        f"Chart of {record.name}: {noun}",
        (Fact(text, (view,), (), answer, what, wrong),),
        (*go_to_item(site, record), *read_bar(site, record, month)),
    )


_SIDES = ("north", "south", "west", "east")
_LEAST_MARGIN = 6
"""Least distance of the farthest pin from the second, in percent of the map."""


def extreme_pin(site: Site, rng: random.Random, size: int) -> Part | None:
    """Find the item whose pin is farthest to one side of the map, and look up fields of it."""
    side = rng.choice(_SIDES)

    def distance(pin: Pin) -> int:
        coordinate = pin.top if side in ("north", "south") else pin.left
        return coordinate if side in ("south", "east") else -coordinate

    best, second = sorted(site.pins, key=distance, reverse=True)[:2]
    if size > 3 or distance(best) - distance(second) < _LEAST_MARGIN:
        return None
    record, place = best.record, exactly(site.path("/~map"))
    fields = site.items.draw_fields(rng, size - 1)
    request = f", and give the name and {site.items.nouns(fields)}" if fields else ", and give its name"
    singular = site.spec.singular
    named = Fact(
        f"The {singular} farthest {side} on the map is found",
        (shown(place, f"Here: {record.name}"),),
        answer=(record.name,),
        what=f"the name of that {singular}",
        wrong=tuple(pin.record.name for pin in site.pins if pin != best),
    )
    return Part(
        f"find the {singular} whose pin is farthest {side} on the map{request}",
        f"Map: farthest {side}",
        (named, *(field_fact(site, record, field, about=f"that {singular}") for field in fields)),
        (
            Click(path=site.path("/~map")),
            Click(name=f"Pin {site.pins.index(best) + 1}", role="button"),
            See((f"Here: {record.name}",)),
            *((Click(path=site.href(record)), *view_fields(site, record, fields)) if fields else ()),
        ),
    )
