"""Tasks played on a website's HTML alone: no dead link, well-posed tasks, evidence that stands."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

import pytest

from webgym.core.text import fold, says
from webgym.core.truth import Give
from webgym.offline.families.timetable import Timetable
from webgym.offline.look import look
from webgym.offline.parts import Place, write
from webgym.offline.website import Website

FAMILIES: tuple[type[Website], ...] = (Timetable,)
SEEDS = range(4, 12)


def made(family: type[Website], seed: int) -> Website:
    brand, label = family.christen("Fernhill", seed)
    return family(seed=seed, brand=brand, label=label, look=look(seed))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("family", FAMILIES)
def test_no_link_leads_nowhere(family: type[Website], seed: int, visitor: Any) -> None:
    site, seen, per_kind = made(family, seed), {"/"}, Counter[str]()
    queue = ["/"]
    while queue:
        url = queue.pop()
        guest = visitor(site)
        assert guest.ask(url).status in (200, 303), url
        for link in sorted(guest.links(url) - seen):
            kind = link.split("/")[1].split("?")[0]
            if per_kind[kind] < 12:
                per_kind[kind] += 1
                seen.add(link)
                queue.append(link)
    assert len(seen) > 50


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("family", FAMILIES)
def test_tasks_are_well_posed(family: type[Website], seed: int, visitor: Any) -> None:
    site = made(family, seed)
    assignments = list(site.assignments())
    assert len(assignments) >= 14
    place = Place(site.label, site.brand, site.host, site.start, site.domain, site.subdomain)
    tasks = [task for assignment in assignments for task in write(place, assignment)]
    assert len({task.id for task in tasks}) == len(tasks) >= 30
    assert len({task.instruction for task in tasks}) == len(tasks)
    assert sum(task.parent_id is not None for task in tasks) >= 12
    easy = sum(task.level == "easy" for task in tasks) / len(tasks)
    assert 0.6 <= easy <= 0.85
    assert {"easy", "medium", "hard"} == {task.level for task in tasks}
    for task in tasks:
        assert task.truth is not None
        given = task.truth.moves[-1]
        assert isinstance(given, Give)
        answer = fold(given.text)
        for options in task.truth.answer.required:
            assert any(says(answer, option) for option in options), task.id
        for wrong in task.truth.answer.forbidden:
            assert not says(answer, wrong), (task.id, wrong)
        for fact in task.truth.facts:
            assert fact.evidence


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("family", FAMILIES)
def test_evidence_stands_where_the_solution_leads(family: type[Website], seed: int, visitor: Any) -> None:
    """Plays every part of every task over HTTP and looks for the evidence on the pages it comes by."""
    site = made(family, seed)
    for assignment in site.assignments():
        for part in assignment.parts:
            guest = visitor(site)
            pages = guest.played(part.moves)
            for fact in part.facts:
                assert any(
                    re.match(evidence.path, url) and all(says(text, wanted) for wanted in evidence.texts)
                    for evidence in fact.evidence
                    for url, text in pages
                ), (assignment.name, fact.text, fact.evidence)
                for check in fact.state:
                    held: Any = site.report(guest.state)
                    for key in check.key:
                        held = held.get(key)
                    assert held == check.value, (assignment.name, fact.text)
