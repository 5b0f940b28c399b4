"""Nothing that an agent types proves a fact: the rules, and a sample of all websites."""

from __future__ import annotations

import msgspec
import pytest

from webgym.core.task import Task
from webgym.core.truth import Evidence, Fill
from webgym.offline.families import FAMILIES
from webgym.offline.look import look
from webgym.offline.proofs import repeating_pages, typed_proofs
from webgym.offline.web import OfflineWeb
from webgym.offline.website import Response, Visit, Website, page, redirect
from webgym.tasks.sampling import draw
from webgym.testing.solutions import typed

PER_FAMILY = 1


@pytest.fixture(scope="module")
def web() -> OfflineWeb:
    return OfflineWeb()


@pytest.mark.parametrize("family", [family.family for family in FAMILIES])
def test_a_sample_of_websites_proves_nothing_by_what_is_typed(web: OfflineWeb, family: str) -> None:
    hosts = [host for host, spec in web.specs.items() if spec.family.family == family]
    tasks = [task for host in draw(hosts, PER_FAMILY, seed=5) for task in web.tasks_of(host)]
    assert list(typed(web, tasks)) == []


def with_evidence(task: Task, evidence: Evidence) -> Task:
    assert task.truth is not None
    first, *others = task.truth.facts
    facts = (msgspec.structs.replace(first, evidence=(evidence,)), *others)
    moves = (Fill("User name", "AntonMere"), Fill("Password", "rowan 573"), *task.truth.moves)
    return msgspec.structs.replace(task, truth=msgspec.structs.replace(task.truth, facts=facts, moves=moves))


@pytest.mark.parametrize(
    ("texts", "is_typed"),
    [
        (("AntonMere",), True),
        (("antonmere", "573"), True),
        (("Signed in as AntonMere",), False),
        (("AntonMere", "Inbox"), False),
    ],
)
def test_what_the_solution_types_is_no_proof(web: OfflineWeb, texts: tuple[str, ...], is_typed: bool) -> None:
    task = with_evidence(next(web.tasks()), Evidence(texts, "/"))
    assert bool([line for line in typed_proofs(task) if texts[0] in line]) == is_typed


class Echo(Website):
    """A website with four forms."""

    family = "echo"

    def build(self) -> None:
        """Nothing to build."""

    def form(self, where: str, method: str = "get", value: str = "") -> Response:
        field = f'<input name="q" value="{value}"><textarea name="more">{value}</textarea>'
        return Response(
            f'<a href="/{where}">x</a><form action="/{where}" method="{method}">{field}</form>'.encode()
        )

    @page("/")
    def home(self, visit: Visit) -> Response:
        """Links to all forms."""
        del visit
        return Response(
            "".join(f'<a href="/{name}">x</a>' for name in ("keeps", "says", "refuses", "sends")).encode()
        )

    @page("/keeps")
    def keeps(self, visit: Visit) -> Response:
        """Shows what was typed in its field alone."""
        return self.form("keeps", value=visit.query.get("q", ""))

    @page("/says")
    def says(self, visit: Visit) -> Response:
        """Repeats it."""
        said = visit.query.get("q")
        return Response(f"<p>Results for {said.upper()}".encode()) if said else self.form("says")

    @page("/refuses")
    def refuses(self, visit: Visit) -> Response:
        """A form that is refused."""
        del visit
        return self.form("refuses", "post")

    @page("/refuses", method="POST")
    def refused(self, visit: Visit) -> Response:
        """Repeats it with the error."""
        return Response(f"<p>{visit.form['more']} is wrong".encode(), 422)

    @page("/sends")
    def sends(self, visit: Visit) -> Response:
        """A form that is accepted."""
        del visit
        return self.form("sends", "post")

    @page("/sends", method="POST")
    def sent(self, visit: Visit) -> Response:
        """Goes on to a page of its own."""
        del visit
        return redirect("/")


def test_pages_that_repeat_what_was_typed_are_found() -> None:
    site = Echo(seed=1, brand="Echo", label="echo", look=look(1))
    found = [line.split(" ")[1] for line in repeating_pages(site)]
    assert found == ["/says", "/refuses"]
