"""The tasks of a specified website: their kinds, how many of each kind, and their numbers of facts.

Tasks on its list and on what only some websites have are here, too: groups, rows, a cart, an account, files,
a chart, a map. Every such function takes the website, a random generator and a number of facts, and returns
a part with that many facts, or ``None`` if the draw gives no well-posed part.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from webgym.core.truth import Choose, Click, Fill, Move, See, StateCheck
from webgym.offline.engine.extras import Pin
from webgym.offline.engine.item_tasks import (
    Site,
    compare,
    difference,
    either,
    facts,
    field_fact,
    go_to_item,
    read_bar,
    row_view,
    save,
    send,
    unfold,
    view_fields,
)
from webgym.offline.engine.records import Record, Sheet
from webgym.offline.engine.spec import RowsSpec
from webgym.offline.engine.spelling import count as counted
from webgym.offline.engine.spelling import listed, money
from webgym.offline.parts import Assignment, Fact, Part, exactly, shown
from webgym.offline.seeds import stream

PartMaker: TypeAlias = Callable[[Site, random.Random, int], Part | None]
"""Makes a part with the given number of facts; ``None`` if this draw gives no well-posed part."""

DRAWS = 60
"""Largest number of draws for one part."""
SINGLES_PER_SITE = 20
SHAPES = ((3, 1), (3, 1), (3, 2), (3, 3), (3, 3), (4, 3))
"""Number of facts in each part, of the tasks that can be decomposed."""
LAST_SHAPES = ((3, 2, 1), (5, 3, 1))


@dataclass
class Composer:
    """Composes the tasks of a website.

    Attributes:
        site: the website.
        single: tasks of one part: name, maker, and possible numbers of facts.
        large: kinds and makers of parts with three facts.
        small: kinds and makers of parts with one or two facts.
        form_task: kind and maker of parts with four or five facts.
        once: kinds of which a task has at most one part, because two would change each other's result.
    """

    site: Site
    single: Sequence[tuple[str, PartMaker, tuple[int, ...]]]
    large: Sequence[tuple[str, PartMaker]]
    small: Sequence[tuple[str, PartMaker]]
    form_task: tuple[str, PartMaker]
    once: frozenset[str] = frozenset()

    def assignments(self) -> Iterator[Assignment]:
        """Yield tasks of one part, then tasks of several parts, which can be decomposed."""
        rng, used_asks = stream(self.site.seed, "assignments"), set[str]()
        count = 0
        for name, make, sizes in rng.sample(self.single, len(self.single)):
            part = self._draw(make, name, rng.choice(sizes), used_asks)
            if part is not None and count < SINGLES_PER_SITE:
                count += 1
                yield Assignment(name, (part,))
        for nth, shape in enumerate((*SHAPES, rng.choice(LAST_SHAPES)), start=1):
            parts = self._compose(rng, f"combined {nth}", shape, used_asks)
            if parts is not None:
                yield Assignment(f"combined-{nth}", parts)

    def _draw(self, make: PartMaker, name: str, facts: int, used_asks: set[str]) -> Part | None:
        """Draw a well-posed part whose clause is not in ``used_asks``; ``None`` if no draw gives one."""
        rng = stream(self.site.seed, "part", name, facts)
        for _ in range(DRAWS):
            part = make(self.site, rng, facts)
            if part is not None and part.ask not in used_asks:
                used_asks.add(part.ask)
                return part
        return None

    def _compose(
        self, rng: random.Random, name: str, shape: Sequence[int], used_asks: set[str]
    ) -> tuple[Part, ...] | None:
        large = rng.sample(self.large, len(self.large))
        small = rng.sample(self.small, len(self.small))
        parts: list[Part] = []
        used_kinds, fact_texts = set[str](), set[str]()
        for size in shape:
            candidates = [self.form_task] if size > 3 else large if size == 3 else small
            while candidates:
                kind, make = candidates.pop()
                if kind in used_kinds & self.once:
                    continue
                part = self._draw(make, f"{name} {kind}", size, used_asks)
                if part is not None and fact_texts.isdisjoint(fact.text for fact in part.facts):
                    parts.append(part)
                    used_kinds.add(kind)
                    fact_texts |= {fact.text for fact in part.facts}
                    break
            else:
                return None
        return tuple(parts)


def assignments(site: Site) -> Iterator[Assignment]:
    """The tasks of a website."""
    extra = {name: entry for name, entry in extra_makers(site).items() if entry}
    single: list[tuple[str, PartMaker, tuple[int, ...]]] = [
        *_repeat(2 if extra else 4, "facts", facts, 1, 2, 3),
        *_repeat(3, "extreme", extreme, 1, 2, 3),
        *_repeat(2, "compare", compare, 3),
        *_repeat(2 if extra else 3, "count", count, 1),
        *_repeat(1 if extra else 2, "either", either, 1),
        *_repeat(2, "save", save, 1, 2, 3),
        *_repeat(1, "difference", difference, 3),
        *_repeat(3 if extra else 4, "send", send, 3, 4, 5),
        *(task for name, (make, *sizes) in extra.items() for task in _repeat(2, name, make, *sizes)),
    ]
    large: list[tuple[str, PartMaker]] = [
        ("facts", facts),
        ("extreme", extreme),
        ("compare", compare),
        ("difference", difference),
        ("save", save),
        *((name, make) for name, (make, *sizes) in extra.items() if 3 in sizes),
    ]
    small = [
        ("facts", facts),
        ("extreme", extreme),
        ("count", count),
        ("either", either),
        ("save", save),
        *((name, make) for name, (make, *sizes) in extra.items() if min(sizes) < 3),
    ]
    once = frozenset({"put", "account", "files"})
    yield from Composer(site, single, large, small, ("send", send), once).assignments()


def _repeat(
    count: int, name: str, make: PartMaker, *sizes: int
) -> Iterator[tuple[str, PartMaker, tuple[int, ...]]]:
    for nth in range(count):
        yield f"{name}-{nth}", make, sizes


def extra_makers(site: Site) -> dict[str, tuple[Any, ...]]:
    """Makers of the tasks on what only some websites have, each with its possible numbers of facts.

    The value of a kind that does not fit the website is empty. The keys are part of task ids.
    """
    spec = site.spec
    return {
        "member": (group_record, 1, 2, 3) if spec.groups else (),
        "owner": (related_record, 2, 3) if any(group.noun for group in spec.groups.values()) else (),
        "line": (row, 1, 2) if spec.rows else (),
        "which": (extreme_row, 1) if any(rows.which for rows in spec.rows.values()) else (),
        "tally": (count_rows, 1) if any(rows.tally for rows in spec.rows.values()) else (),
        "put": (fill_cart, 2, 3) if spec.cart else (),
        "account": (account, 2, 3) if spec.account else (),
        "files": (move_files, 1, 2, 3) if spec.files else (),
        "bar": (chart_bar, 1) if spec.chart else (),
        "pin": (extreme_pin, 1, 2, 3) if spec.map else (),
    }


# --- the list ---------------------------------------------------------------------------------------------


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
                (shown(place, site.title_of("account"), f"Hello, {site.user}"),),
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
