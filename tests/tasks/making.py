"""Tasks for tests."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from webgym.core.task import FactGroup, Rubric, Task
from webgym.tasks.taxonomy import DOMAIN_OF


def rubric(*sizes: int) -> Rubric:
    """A rubric with groups of so many facts, with ids from 1."""
    return Rubric(
        tuple(
            FactGroup(number, f"group {number}", tuple(f"fact {number}.{fact}" for fact in range(size)))
            for number, size in enumerate(sizes, start=1)
        )
    )


def task(id: str, website: str = "https://a.example/", *sizes: int, **more: Any) -> Task:
    """A task with a rubric of groups of so many facts."""
    subdomain = more.pop("subdomain", "News")
    return Task(
        id=id,
        instruction=more.pop("instruction", f"Do {id}."),
        website=website,
        domain=more.pop("domain", DOMAIN_OF.get(subdomain, "")),
        subdomain=subdomain,
        rubric=more.pop("rubric", None) or rubric(*(sizes or (1,))),
        source=more.pop("source", "insta-v3"),
        **more,
    )


RUBRICS = st.lists(
    st.tuples(st.integers(-3, 99), st.integers(1, 5)),
    min_size=1,
    max_size=7,
    unique_by=lambda group: group[0],
).map(
    lambda groups: Rubric(
        tuple(FactGroup(id, f"g{id}", tuple(f"{id}.{n}" for n in range(size))) for id, size in groups)
    )
)
"""Any rubric: ids in any order, groups of all sizes."""
