"""Online-Mind2Web: 300 tasks on live websites. The companion file ``human_label.json`` has human labels."""

from __future__ import annotations

from webgym.taskset.sources.base import Draft, Source
from webgym.taskset.sources.categories import named
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields

_INSTRUCTION = ("confirmed_task", "task", "task_description")


def _draft(fields: Fields, _: Companions) -> Draft:
    draft = Draft(fields.instruction(*_INSTRUCTION), fields.native_id("task_id", "annotation_id", "id"))
    draft.website = fields.website("website", "url", "web")
    draft.domain, draft.subdomain = named(fields.value("subdomain"), fields.value("domain"))
    return draft


SOURCE = Source(
    name="online-mind2web",
    paper_tasks=300,
    paper_websites=139,
    licence="CC BY 4.0",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("confirmed_task",),),
    beside=("human_label*.json",),
)
