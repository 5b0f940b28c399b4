"""WebGym's published set as a source (SYSTEM.md 1.7): tasks with rubrics."""

from __future__ import annotations

from webgym.tasks.files import NO_FACTS
from webgym.tasks.missing_values import is_missing_value
from webgym.tasks.published import task_of
from webgym.taskset.sources.base import Draft, Source
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields
from webgym.taskset.sources.problems import Unusable

_NAME = "webgym"
_INSTRUCTION = ("task_name",)
_PLACEHOLDERS = {"task_id": "-", "website": "https://website.invalid/", "evaluator_reference": None}
"""Placeholders for columns that :func:`task_of` requires and records of a source may lack; not used
further."""
_EXTRA_COLUMNS = ("benchmark_name",)
"""Columns kept in ``extra``, because :class:`SourceTask` has no field for them."""


def _draft(fields: Fields, _: Companions) -> Draft:
    instruction = fields.instruction(*_INSTRUCTION)
    given = {name: value for name, value in fields.record.items() if not is_missing_value(value)}
    try:
        task = task_of(_PLACEHOLDERS | given)
    except (ValueError, TypeError) as error:
        raise Unusable(str(error)) from error
    return Draft(
        instruction,
        task.id.removeprefix(f"{_NAME}/") if "task_id" in given else None,
        fields.website("website"),
        domain=task.domain,
        subdomain=task.subdomain,
        reference_answer=task.reference_answer,
        rubric=None if NO_FACTS in task.flags else task.rubric,
        native_parent_id=task.parent_id and task.parent_id.removeprefix(f"{_NAME}/"),
        split=task.split,
        flags=list(task.flags),
        extra=task.extra | {name: given[name] for name in _EXTRA_COLUMNS if name in given},
    )


SOURCE = Source(
    name=_NAME,
    paper_tasks=292_092 + 1_167,  # training and test set
    paper_websites=127_645 + 1_167,
    licence="CDLA-Permissive-2.0",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("task_name", "evaluator_reference"),),
    is_split=True,
)
