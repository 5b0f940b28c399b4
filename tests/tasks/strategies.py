"""Tasks and published rows of every kind, for hypothesis."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import strategies as st

from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.truth import AnswerTruth, Click, Evidence, FactTruth, StateCheck, Truth
from webgym.tasks.files import NO_FACTS
from webgym.tasks.missing_values import is_missing_value, is_no_fact
from webgym.tasks.published import task_of

text = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
spoken = text.filter(lambda said: not is_no_fact(said) and not is_missing_value(said))
addresses = st.from_regex(r"(https?://)?[a-z]{2,9}\.example(:80)?(/[ -~]{0,9})?", fullmatch=True)
json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | text,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(text, inner, max_size=3),
    max_leaves=5,
)

groups = st.builds(
    FactGroup,
    id=st.integers(-5, 2**62),
    description=text,
    facts=st.lists(spoken, min_size=1, max_size=4).map(tuple),
)
rubrics = st.lists(groups, min_size=1, max_size=4, unique_by=lambda group: group.id).map(
    lambda some: Rubric(tuple(some))
)
truths = st.builds(
    Truth,
    host=text,
    facts=st.just((FactTruth(1, 0, (Evidence(("a",), "/x"),), (StateCheck(("cart",), {"n": 1}),)),)),
    answer=st.just(AnswerTruth((("one", "1"),))),
    moves=st.just((Click("Add"),)),
)


def tasks(ids: st.SearchStrategy[str] = spoken) -> st.SearchStrategy[Task]:
    """Any task that a file can hold."""
    return st.builds(
        Task,
        id=ids,
        instruction=spoken,
        website=addresses,
        domain=text,
        subdomain=text,
        rubric=rubrics,
        source=text,
        reference_answer=st.none() | spoken,
        example_answer=st.none() | text,
        parent_id=st.none() | text,
        split=st.sampled_from([None, "train", "test"]),
        website_from=st.sampled_from(["given", "derived", "inferred"]),
        flags=st.lists(text, max_size=2).map(tuple),
        extra=st.dictionaries(
            text | st.sampled_from(["attempt_level", "published", "webgym", "task_id", "difficulty"]),
            json_values,
            max_size=3,
        ),
        truth=st.none() | truths,
    )


task_lists = st.lists(tasks(), min_size=1, max_size=5, unique_by=lambda task: task.id)

# --- rows of the published set ------------------------------------------------------------------------

_group_rows = st.fixed_dictionaries(
    {
        "id": st.integers(1, 9) | text,
        "description": text,
        "facts": st.lists(text | st.just("None"), max_size=4),
    },
    optional={"note": json_values},
)
_old_rows = st.fixed_dictionaries({"description": text, "difficulty": st.integers(0, 9) | text})
_any_references = st.one_of(
    st.lists(_group_rows, max_size=4),
    text,
    st.none(),
    st.lists(text, max_size=4),
    st.lists(_old_rows, max_size=4),
    st.lists(_group_rows | _old_rows | text, max_size=4),
    st.lists(_group_rows, max_size=2).map(json.dumps),
)


def _can_be_judged(reference: object) -> bool:
    row = {"task_id": 1, "task_name": "x", "website": "y", "evaluator_reference": reference}
    return NO_FACTS not in task_of(row).flags


references = _any_references.filter(_can_be_judged)


@st.composite
def published_rows(draw: st.DrawFn, number: int) -> dict[str, Any]:
    """A row in any of the shapes that older and newer releases have, its keys in any order."""
    row: dict[str, Any] = {
        "task_id": draw(st.sampled_from([number, f"Amazon--{number}", f"deepshop/{number}"])),
        "task_name": draw(spoken),
        "website": draw(addresses),
        "evaluator_reference": draw(references),
    }
    optional = {
        "domain": text | st.none(),
        "subdomain": text | st.none(),
        "difficulty": st.integers(0, 20) | st.none() | st.just("3") | st.just(2.0),
        "definite_answer": text | st.none() | st.integers(),
        "attempt_level": json_values,
        "distribution": text,
        "benchmark_name": st.sampled_from(["deepshop", "gaia-web", "", None]),
        "task_id_decomposed_from": st.none() | st.just("") | st.integers(0, 9) | text,
        "published": json_values,
        "webgym": json_values,
    }
    chosen = draw(st.lists(st.sampled_from(sorted(optional)), unique=True))
    row |= {name: draw(optional[name]) for name in chosen}
    order = draw(st.permutations(list(row)))
    return {name: row[name] for name in order}


@st.composite
def published_files(draw: st.DrawFn) -> bytes:
    """A whole file, as one of many writers of JSON would have it."""
    count = draw(st.integers(1, 4))
    ascii_only = draw(st.booleans())
    separators = draw(st.sampled_from([(", ", ": "), (",", ":"), (" , ", " : ")]))
    end = draw(st.sampled_from(["\n", "\r\n", "\n\n"]))
    lines = [
        json.dumps(draw(published_rows(number)), ensure_ascii=ascii_only, separators=separators)
        for number in range(count)
    ]
    mark = draw(st.sampled_from(["", "\ufeff"]))
    return (mark + end.join(lines) + draw(st.sampled_from(["", end]))).encode()
